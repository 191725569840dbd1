"""What it takes to make a page again: versions, and a hash of the data."""

from __future__ import annotations

import hashlib
import json
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import pandas as pd

from inscrutable import __version__
from inscrutable.experiments.studies import Study

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


def manifest_of(study: Study) -> dict[str, str]:
    """Return what a study's store knows of how it was begun: versions, seed, data, and every key of its file."""
    known = study.manifest()
    found = {f"version of {name}": str(number) for name, number in known.get("versions", {}).items()}
    found["seed"] = str(study.plan.seed)
    if known.get("data_sha256"):
        found["data, SHA-256"] = str(known["data_sha256"])
    return found | keys_of(known.get("study", {}))


def keys_of(file: Mapping[str, Any]) -> dict[str, str]:
    """Return every key of a study's file as text, but those that have lines of their own."""
    return {
        key.replace("_", " "): value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        for key, value in file.items()
        if key not in ("seed", "note")
    }
