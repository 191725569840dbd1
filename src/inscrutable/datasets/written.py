"""Delete the obsolete files of a command's earlier run in a folder.

A list in the folder has the SHA-256 of every file as written. A file that is not in the list, or has changed since, is never
touched.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from inscrutable.datasets.files import write_json
from inscrutable.errors import InputError
from inscrutable.files import PathLike

LIST = "files.json"
_CHUNK = 1 << 20


def replace_files(folder: PathLike, command: str, written: Iterable[Path]) -> list[Path]:
    """List the files that a command has just written into a folder, and delete those that only its last run wrote.

    Args:
        folder: The folder of results.
        command: The command; files of other names that other commands wrote there stay.
        written: The files written now; files outside the folder are ignored.

    Returns:
        The files deleted.

    Raises:
        InputError: The list cannot be written, or a file not read.

    Cost: reads every file once.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> with TemporaryDirectory() as name:
        ...     folder = Path(name)
        ...     for each in ("old.csv", "table.csv", "mine.txt"):
        ...         _ = (folder / each).write_text("1")
        ...     _ = replace_files(folder, "backtest", [folder / "old.csv", folder / "table.csv"])
        ...     gone = replace_files(folder, "backtest", [folder / "table.csv"])
        ...     [path.name for path in gone], (folder / "mine.txt").exists()
        (['old.csv'], True)
    """
    place = Path(folder)
    lists = _lists(place / LIST)
    try:
        now = {path.name: _hash(path) for path in written if path.parent == place}
        removed = []
        for name, known in sorted(lists.get(command, {}).items()):
            path = place / name
            if name not in now and Path(name).name == name and path.is_file() and _hash(path) == known:
                path.unlink()
                removed.append(path)
    except OSError as error:
        raise InputError(f"files of an earlier run in {place} cannot be replaced: {error.strerror or error}") from error
    write_json({**lists, command: now}, place / LIST)
    return removed


def check_folder(folder: PathLike, command: str, name: str) -> None:
    """Raise `InputError` where the file of this name is another command's, as that command wrote it."""
    path, lists = Path(folder) / name, _lists(Path(folder) / LIST)
    if not path.is_file():
        return
    now = _hash(path)
    for other, known in lists.items():
        if other != command and known.get(name) == now != lists.get(command, {}).get(name):
            raise InputError(
                f"{folder} has the results of {other}, whose {name} {command} would replace; choose another folder"
            )


def _lists(path: Path) -> dict[str, Any]:
    """Return the files of each command; empty if the list is missing or invalid."""
    try:
        found = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    if not isinstance(found, dict) or not all(isinstance(each, dict) for each in found.values()):
        return {}
    return found


def _hash(path: Path) -> str:
    found = hashlib.sha256()
    with path.open("rb") as opened:
        while chunk := opened.read(_CHUNK):
            found.update(chunk)
    return found.hexdigest()
