"""The store of a study: one SQLite file, written by one process, a transaction for every batch of rows.

The journal is a rollback journal (DELETE) with full synchronisation, not a write-ahead log. A batch is then either wholly
in the one file or, after a kill or on a full disk, rolled back from the journal at the next opening; no second file has to
be kept, copied or writable for the rows to be complete, a full disk is noticed before the file is touched, and the journal
works on network drives, where a write-ahead log does not. Batches are a second apart, so the slower commit costs nothing.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from json import JSONDecodeError
from pathlib import Path

from inscrutable.errors import DiskError, InputError
from inscrutable.experiments.studies.tasks import FAILED, Row
from inscrutable.files import whole_file

STORE = "study.sqlite"
LOCK = "study.lock"
MANIFEST = "manifest.json"
VERSION = 1
_APPLICATION = 0x494E5343  # "INSC": marks the file as one of ours
_PATIENCE = 30.0  # seconds that a reader and the writer wait for one another
_DISK = (sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR, sqlite3.SQLITE_READONLY)
_READ_ONLY = "the folder is read-only, and has to be written to for that, also to undo what a kill left half written"
_SCHEMA = """
CREATE TABLE facts (name TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID;
CREATE TABLE rows (
    number INTEGER PRIMARY KEY, task TEXT NOT NULL, parameters TEXT NOT NULL, seed TEXT NOT NULL,
    status TEXT NOT NULL, figures TEXT NOT NULL, duration REAL NOT NULL, error TEXT NOT NULL
);
"""


class Store:
    """The rows of a study on the disk, and facts about it; errors of the disk become `InputError`."""

    def __init__(self, folder: Path, connection: sqlite3.Connection) -> None:
        self.folder = folder
        self._connection = connection

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def fact(self, name: str) -> str | None:
        """Return a fact; None if it is not known."""
        with speaking(self.folder):
            found = self._connection.execute("SELECT value FROM facts WHERE name = ?", (name,)).fetchone()
        return None if found is None else str(found[0])

    def keep_fact(self, name: str, value: str) -> None:
        """Write a fact; a former one of that name is replaced."""
        with speaking(self.folder), self._transaction():
            self._connection.execute("INSERT OR REPLACE INTO facts VALUES (?, ?)", (name, value))

    def add(self, rows: Iterable[Row]) -> None:
        """Write rows in one transaction: all of them or none. A task's former row is replaced."""
        with speaking(self.folder), self._transaction():
            self._connection.executemany("INSERT OR REPLACE INTO rows VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows)

    def counts(self) -> dict[str, int]:
        """Return the number of rows by status."""
        with speaking(self.folder):
            return dict(self._connection.execute("SELECT status, COUNT(*) FROM rows GROUP BY status").fetchall())

    def seconds(self) -> float:
        """Return the time that all tasks took together."""
        with speaking(self.folder):
            return float(self._connection.execute("SELECT TOTAL(duration) FROM rows").fetchone()[0])

    def numbers(self, *, without_failed: bool) -> Iterator[int]:
        """Yield the numbers of tasks that have a row, in order; those that failed are left out where asked for."""
        where = "WHERE status != ?" if without_failed else "WHERE ? IS NOT NULL"
        with speaking(self.folder):
            for (number,) in self._connection.execute(f"SELECT number FROM rows {where} ORDER BY number", (FAILED,)):
                yield int(number)

    def rows(self) -> Iterator[Row]:
        """Yield all rows in the order of the grid."""
        with speaking(self.folder):
            for found in self._connection.execute("SELECT * FROM rows ORDER BY number"):
                yield Row(*found)

    def check(self) -> None:
        """Raise `InputError` if the file is damaged."""
        with speaking(self.folder):
            found = self._connection.execute("PRAGMA quick_check(1)").fetchone()
        if found is None or found[0] != "ok":
            raise damaged(self.folder, "" if found is None else str(found[0]))

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise


@contextmanager
def speaking(folder: Path) -> Iterator[None]:
    """Turn SQLite's errors of the disk, and incomplete texts, into one clear error."""
    try:
        yield
    except sqlite3.OperationalError as error:
        if _code(error) == sqlite3.SQLITE_CORRUPT:
            raise damaged(folder, str(error)) from None
        kind = DiskError if _code(error) in _DISK else InputError
        why = _READ_ONLY if _code(error) == sqlite3.SQLITE_READONLY else str(error)
        raise kind(f"{folder / STORE} cannot be used: {why}; the rows stored before are kept") from None
    except (sqlite3.DatabaseError, JSONDecodeError) as error:
        raise damaged(folder, str(error)) from None


def _code(error: sqlite3.Error) -> int:
    """SQLite's primary code of an error, without the extended part."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF


def damaged(folder: Path, why: str) -> InputError:
    """Return the error for a damaged file."""
    return InputError(
        f"{folder / STORE} is damaged or no store of a study ({' '.join(why.split()) or 'it is not whole'}); it was left as "
        "it is. "
        "Put a copy in its place, or run the study into another folder"
    )


def created(folder: Path, facts: dict[str, str]) -> Store:
    """Return a new store that holds facts and no rows; its file is written whole or not at all."""
    with speaking(folder), whole_file(folder / STORE) as temporary, closing(_connected(temporary, "rwc")) as connection:
        connection.executescript(_SCHEMA)
        connection.executemany("INSERT INTO facts VALUES (?, ?)", facts.items())
        connection.execute(f"PRAGMA application_id = {_APPLICATION}")
        connection.execute(f"PRAGMA user_version = {VERSION}")
    return opened(folder, writable=True)


def opened(folder: Path, *, writable: bool = False) -> Store:
    """Return the store of a folder, to read or to write.

    Raises:
        InputError: There is no store, or it is damaged or of another version.
    """
    path = folder / STORE
    if not path.is_file():
        if path.parent.is_file():
            raise InputError(f"{folder} is a file, expected a folder that a study was run into")
        within = next((each.parent for each in sorted(folder.glob(f"*/{STORE}"))), None)
        such = "" if within is None else f", such as {within}"
        raise InputError(
            f"{folder} holds no study: there is no {STORE}; expected a folder that a study was run into{such}"
        )
    if not path.stat().st_size:
        raise damaged(folder, "the file is empty")
    with speaking(folder):
        # A journal left by a kill is rolled back by the first reader, which has to write for that.
        connection = _connected(path, "rw" if writable or path.with_name(f"{STORE}-journal").exists() else "ro")
    try:
        _check_kind(folder, connection)
    except BaseException:
        connection.close()
        raise
    return Store(folder, connection)


def _check_kind(folder: Path, connection: sqlite3.Connection) -> None:
    with speaking(folder):
        application, version, pages, size = (
            int(connection.execute(f"PRAGMA {name}").fetchone()[0])
            for name in ("application_id", "user_version", "page_count", "page_size")
        )
    if application != _APPLICATION:
        raise damaged(folder, "it bears another program's mark")
    if version != VERSION:
        age = "an older" if version < VERSION else "a newer"
        raise InputError(
            f"{folder / STORE} was written by {age} release (store version {version}, this release reads {VERSION}); "
            "it was left as it is. Go on with the release named in manifest.json, or run the study anew"
        )
    if (folder / STORE).stat().st_size < pages * size:
        raise damaged(folder, f"{(folder / STORE).stat().st_size} bytes of {pages * size} are there")


def _connected(path: Path, mode: str) -> sqlite3.Connection:
    place = path.resolve().as_uri()
    connection = sqlite3.connect(
        f"{place}?mode={mode}", uri=True, timeout=_PATIENCE, isolation_level=None, check_same_thread=False
    )
    if mode != "ro":
        connection.execute("PRAGMA journal_mode = DELETE")
        connection.execute("PRAGMA synchronous = FULL")
    return connection


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep every other process from running the study of a folder meanwhile.

    The lock is SQLite's own on an empty file beside the store: the system releases it when the process ends, however it ends.

    Raises:
        InputError: Another process runs the study, or the folder cannot be written to.
    """
    path = folder / LOCK
    try:
        connection = sqlite3.connect(path, timeout=0.0, isolation_level=None)
    except sqlite3.Error as error:
        raise InputError(f"{path} cannot be written: {error}") from None
    with closing(connection):
        try:
            connection.execute("BEGIN EXCLUSIVE")
        except sqlite3.OperationalError as error:
            if "locked" in str(error):
                raise InputError(
                    f"{folder} is in use: another process runs this study; wait for it or stop it"
                ) from None
            kind = DiskError if _code(error) in _DISK else InputError
            raise kind(f"{path} cannot be written: {error}") from None
        except sqlite3.DatabaseError as error:
            raise InputError(f"{path} is no lock of a study: {error}; delete it") from None
        try:
            yield
        finally:
            connection.execute("ROLLBACK")
