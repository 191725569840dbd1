"""Writing files, all or nothing."""

from __future__ import annotations

import errno
import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from inscrutable.errors import DiskError, InputError

DISK = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EIO, errno.EFBIG)
"""Errors of the operating system that are the disk's: full, over quota, read-only, failing, file too large."""
PathLike = str | os.PathLike[str]


@contextmanager
def whole_file(path: PathLike) -> Iterator[Path]:
    """Give a temporary path in the target's folder to write to, and move it to `path` when all went well.

    Args:
        path: The file to create or replace, or a symbolic link to it. Its folder must exist. The temporary file keeps the
            suffix, so writers that go by it (images, npz) work.

    Yields:
        The temporary path. The new file gets the permissions of the one it replaces. After an exception the temporary file
        is deleted, and the former file, if any, is unchanged.

    Raises:
        InputError: The file cannot be written, with the operating system's reason; a `DiskError` where the disk is full,
            failing or read-only. Other exceptions of the body pass through.

    Cost: one rename. The data are flushed to the disk before it.

    Example:
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from inscrutable.files import whole_file
        >>> with TemporaryDirectory() as folder:
        ...     with whole_file(folder + "/note.txt") as temporary:
        ...         _ = temporary.write_text("all of it")
        ...     (Path(folder) / "note.txt").read_text()
        'all of it'
    """
    target = path_of(path, "a file to write")
    target = Path(os.path.realpath(target)) if target.is_symlink() else target
    temporary = target.with_name(f".{target.stem}.{secrets.token_hex(6)}{target.suffix}") if target.name else target
    try:
        if target.is_dir():
            raise InputError(f"{target} cannot be written: it is a folder, expected a file name")
        if target.exists():
            # Private from the start: others can at no time read the content.
            temporary.touch(mode=0o600, exist_ok=False)
        yield temporary
        with temporary.open("r+b") as written:
            os.fsync(written.fileno())
        if target.exists():
            temporary.chmod(target.stat().st_mode & 0o7777)
        temporary.replace(target)
    except OSError as error:
        raise unwritten(target, error) from error
    finally:
        remove(temporary, unless=target)


def path_of(value: PathLike, what: str) -> Path:
    """Return a path, or raise `InputError`."""
    if not isinstance(value, (str, os.PathLike)):
        raise InputError(f"{what} must be given by its path, got {type(value).__name__}: {value!r:.60}")
    return Path(value)


def read_json(path: Path, what: str) -> Any:
    """Return the data of a JSON file, or raise one `InputError`; `what` names the kind of file."""
    try:
        return json.loads(path.read_text("utf-8"))
    except OSError as error:
        raise InputError(f"{path} cannot be read: {reason(error)}; expected {what}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path} is not UTF-8 text; expected {what}") from None
    except json.JSONDecodeError as error:
        raise InputError(f"{path}, line {error.lineno}, column {error.colno}: not JSON ({error.msg})") from None
    except ValueError as error:  # a number of thousands of digits
        raise InputError(f"{path} is not JSON that can be read: {error}") from None
    except RecursionError:
        raise InputError(f"{path} is nested too deeply to be {what}") from None


def remove(temporary: Path, *, unless: Path) -> None:
    """Delete a temporary file that may be there, unless it is the target itself."""
    if temporary != unless:
        try:
            temporary.unlink(missing_ok=True)
        except OSError:
            return  # the folder itself is out of reach; the first error is the one to report


def unwritten(what: object, error: OSError) -> InputError:
    """Return the error for a failed write: a `DiskError` where the disk is the cause."""
    kind = DiskError if error.errno in DISK else InputError
    return kind(f"{what} cannot be written: {reason(error)}")


def reason(error: OSError) -> str:
    """Return what the operating system says of an error, without its number and path."""
    return error.strerror or str(error)
