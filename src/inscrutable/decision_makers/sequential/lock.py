"""One process at a time on a file: a lock beside it, which the system releases when the process ends in any way."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

from inscrutable.errors import InputError
from inscrutable.files import PathLike, path_of, unwritten

_Found = TypeVar("_Found")


class FileLock:
    """A lock on a path, held until `close`, or the end of the process.

    Raises:
        InputError: Another process holds it, or the folder cannot be written.
    """

    _held = -1

    def __init__(self, path: Path) -> None:
        self.path = path
        beside = path.with_name(f".{path.name}.lock")
        try:
            held = os.open(beside, os.O_RDWR | os.O_CREAT, 0o600)
        except OSError as error:
            raise unwritten(path, error) from error
        try:
            _take(held)
        except OSError:
            os.close(held)
            raise InputError(f"{path} is in use by another process: wait until it is done, or end it") from None
        self._held = held

    def close(self) -> None:
        """Release the lock."""
        if self._held >= 0:
            os.close(self._held)
            self._held = -1

    def __del__(self) -> None:
        self.close()


class KeptInFile:
    """An object with a file that one process at a time may use, from the first `save` or `load` until `close`."""

    _lock: FileLock | None = None

    def close(self) -> None:
        """Let other processes use the file."""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def _locked(self, path: PathLike) -> None:
        target = path_of(path, "a saved sequence").absolute()
        if self._lock is None or self._lock.path != target:
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
