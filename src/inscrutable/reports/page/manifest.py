"""The manifest of a page: versions and a hash of the data."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

import pandas as pd

from inscrutable.experiments.studies import Study
from inscrutable.experiments.studies.runner import versions


def versions_told(known: Mapping[str, Any] | None = None) -> dict[str, str]:
    """Return the versions of all packages behind the numbers, one line each; None: the current ones."""
    return {f"version of {name}": str(number) for name, number in (versions() if known is None else known).items()}


def hash_of(frame: pd.DataFrame) -> str:
    """Return the SHA-256 of a table, written as CSV with every float in full."""
    return hashlib.sha256(frame.to_csv(lineterminator="\n").encode("utf-8")).hexdigest()


def manifest_of(study: Study) -> dict[str, str]:
    """Return a study's manifest from its store: versions, seed, data, and every key of its file."""
    known = study.manifest()
    used = {name: [str(number)] for name, number in known.get("versions", {}).items()}
    for later in known.get("continued_with", []):
        for name, number in later.items():
            used[name].append(str(number))
    found = versions_told({name: ", later ".join(numbers) for name, numbers in used.items()})
    found["seed"] = str(study.plan.seed)
    if known.get("data_sha256"):
        found["data, SHA-256"] = str(known["data_sha256"])
    return found | keys_of(known.get("study", {}))


def keys_of(file: Mapping[str, Any]) -> dict[str, str]:
    """Return the keys of a study's file as text, except those with their own lines."""
    return {
        key.replace("_", " "): value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        for key, value in file.items()
        if key not in ("seed", "note")
    }
