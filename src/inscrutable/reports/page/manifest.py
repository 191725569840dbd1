"""What it takes to make a page again: versions, and a hash of the data."""

from __future__ import annotations

import hashlib
import platform
from importlib.metadata import PackageNotFoundError, version

import pandas as pd

from inscrutable import __version__

_COUNTED = ("numpy", "scipy", "numba", "daqp", "pandas")


def versions() -> dict[str, str]:
    """Return the versions of everything that had a hand in the numbers, by name."""
    found = {"inscrutable": __version__, "Python": platform.python_version()}
    for name in _COUNTED:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            found[name] = "unknown"
    return found


def hash_of(frame: pd.DataFrame) -> str:
    """Return the SHA-256 of a table, written as CSV with every float in full."""
    return hashlib.sha256(frame.to_csv(lineterminator="\n").encode("utf-8")).hexdigest()
