"""One process at a time on a file: a lock beside it, which the system releases when the process ends in any way."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar
from weakref import WeakValueDictionary

from inscrutable.errors import InputError
from inscrutable.files import PathLike, path_of, unwritten

_Found = TypeVar("_Found")


class FileLock:
    """A lock on a path, held until `close`, or the end of the process; objects of one process share it.

    Raises:
        InputError: Another process holds it, or the folder cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.process = path, os.getpid()
        self._held: _Held | None = _held(path)

    def close(self) -> None:
        """Release the lock, unless another object of this process holds it too."""
        self._held = None


class _Held:
    """The descriptor of a locked file, closed with the last object that uses it.

    The system's lock belongs to the process, and ends when the process closes any descriptor of the file: it has only one.
    """

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._process = descriptor, os.getpid()

    def __del__(self) -> None:
        if self._process == os.getpid():  # a fork that closed its parent's would lose the lock that it took itself
            os.close(self._descriptor)


_ALL_HELD: WeakValueDictionary[tuple[int, Path], _Held] = WeakValueDictionary()
_ONE_AT_A_TIME = threading.Lock()


def _held(path: Path) -> _Held:
    """The lock of a path, as this process holds it or anew; a forked process does not hold its parent's."""
    key = os.getpid(), path
    with _ONE_AT_A_TIME:
        found = _ALL_HELD.get(key)
        if found is None:
            found = _ALL_HELD[key] = _Held(_taken(path))
        return found


def _taken(path: Path) -> int:
    """The descriptor of the file beside a path, locked."""
    try:
        descriptor = os.open(path.with_name(f".{path.name}.lock"), os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise unwritten(path, error) from error
    try:
        _take(descriptor)
    except OSError:
        os.close(descriptor)
        raise InputError(f"{path} is in use by another process: wait until it is done, or end it") from None
    return descriptor


class KeptInFile:
    """An object with a file that one process at a time may use, from the first `save` or `load` until `close`.

    A copy has no lock until it saves or loads itself.
    """

    _lock: FileLock | None = None

    def __getstate__(self) -> dict[str, object]:
        return {name: value for name, value in vars(self).items() if name != "_lock"}

    def close(self) -> None:
        """Let other processes use the file."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _locked(self, path: PathLike) -> None:
        target = Path(os.path.realpath(path_of(path, "a saved sequence")))
        if self._lock is None or (self._lock.path, self._lock.process) != (target, os.getpid()):
            taken = FileLock(target)
            self.close()
            self._lock = taken

    def _read(self, path: PathLike, read: Callable[[], _Found]) -> _Found:
        """Return `read()` under the lock; if it raises `InputError`, the lock is as before."""
        if not path_of(path, "a saved sequence").exists():
            raise InputError(f"{path} is not a saved sequence: there is no such file")
        before = self._lock
        self._locked(path)
        try:
            return read()
        except InputError:
            if self._lock is not before:
                self.close()
            raise


if sys.platform == "win32":

    def _take(held: int) -> None:
        import msvcrt

        msvcrt.locking(held, msvcrt.LK_NBLCK, 1)

else:

    def _take(held: int) -> None:
        import fcntl

        fcntl.lockf(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
