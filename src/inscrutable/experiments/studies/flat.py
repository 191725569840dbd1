"""Results as flat tables of numbers by name, and back: `paper.cdm.privacy.0` is the first entry of an array."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np


def flat(value: Any, name: str = "") -> Iterator[tuple[str, float]]:
    """Yield every number of a dataclass, mapping, array or sequence named by its place; None yields nothing.

    Example:
        >>> dict(flat({"a": np.array([1.0, 2.0]), "b": {"c": 3}}))
        {'a.0': 1.0, 'a.1': 2.0, 'b.c': 3}
    """
    if value is None:
        return
    if is_dataclass(value):
        parts: Any = ((each.name, getattr(value, each.name)) for each in fields(value))
    elif isinstance(value, Mapping):
        parts = value.items()
    elif isinstance(value, (list, tuple, np.ndarray)):
        parts = enumerate(value.tolist() if isinstance(value, np.ndarray) else value)
    else:
        yield name, value.item() if isinstance(value, np.generic) else value
        return
    for key, part in parts:
        yield from flat(part, f"{name}.{key}" if name else str(key))


def unflat(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Return the data that `flat` took apart: mappings by name, arrays where the names are numbers.

    Example:
        >>> unflat({"a.0": 1.0, "a.1": None, "b.c": 3})
        {'a': array([ 1., nan]), 'b': {'c': 3}}
    """
    tree: dict[str, Any] = {}
    for name, value in figures.items():
        *path, last = name.split(".")
        here = tree
        for part in path:
            here = here.setdefault(part, {})
        here[last] = float("nan" if value is None else value) if not isinstance(value, int) else value
    return {key: _whole(part) for key, part in tree.items()}


def _whole(part: Any) -> Any:
    if not isinstance(part, dict):
        return part
    parts = {key: _whole(each) for key, each in part.items()}
    return np.array(list(parts.values())) if all(key.isdigit() for key in parts) else parts
