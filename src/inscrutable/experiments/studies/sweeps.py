"""The keys that a study sweeps over its settings, and which of them are drawn on an axis, as curves and as facets."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from inscrutable.experiments.studies.grid import StudyGrid
from inscrutable.labels import number_text

MOST_CURVES, MOST_FACETS = 6, 6
_LACKING = "–"


@dataclass(frozen=True)
class Curve:
    """One line of a figure.

    Args:
        name: Its label.
        maker: The decision maker.
        settings: The setting at each value of the axis; None where the study has none.
    """

    name: str
    maker: str
    settings: tuple[int | None, ...]


@dataclass(frozen=True)
class Sweep:
    """Figures over swept keys: one key on the axis, another as curves, all others and the decision makers as facets.

    Args:
        axis: The key on the axis.
        values: Its values, in order: numbers, or words side by side.
        curves_of: The key whose values are the curves; empty where these are the decision makers.
        facets: Titles with their curves.
        left_out: The swept keys that are not drawn, in words; empty if all are.
    """

    axis: str
    values: tuple[Any, ...]
    curves_of: str
    facets: tuple[tuple[str, tuple[Curve, ...]], ...]
    left_out: str = ""

    @property
    def is_numeric(self) -> bool:
        """Whether the values on the axis are numbers."""
        return all(map(_is_number, self.values))


def sweep_of(grid: StudyGrid, makers: Sequence[str]) -> Sweep | None:
    """Return the figures of a study whose settings sweep at least one key; None for others.

    The axis is the key of numbers with most values, or a key of words if there is none; the next key makes the curves. With one
    key the curves are the decision makers. A figure has at most `MOST_CURVES` curves; there are at most `MOST_FACETS` figures.
    """
    settings = _settings(grid)
    names = dict.fromkeys(key for each in settings for key in each)
    keys = {key: _ordered([each.get(key, _LACKING) for each in settings]) for key in names}
    swept = {key: values for key, values in keys.items() if len(values) > 1}
    if not swept:
        return None
    order = sorted(swept, key=lambda key: (not all(map(_is_number, swept[key])), -len(swept[key])))
    axis, inner, others = order[0], order[1:2], order[2:]
    of = {tuple(each.get(key, _LACKING) for key in order): place for place, each in enumerate(settings)}

    def curve(name: str, maker: str, rest: tuple[Any, ...]) -> Curve:
        return Curve(name, maker, tuple(of.get((value, *rest)) for value in swept[axis]))

    if not inner:
        drawn = tuple(curve(name, name, ()) for name in makers[:MOST_CURVES])
        return Sweep(axis, swept[axis], "", (("", drawn),), _rest([("decision makers", len(makers), MOST_CURVES)]))
    facets = list(product(makers, *(swept[key] for key in others)))
    shown = swept[inner[0]][:MOST_CURVES]
    return Sweep(
        axis,
        swept[axis],
        inner[0],
        tuple(
            (
                ", ".join([maker, *(_said(key, value) for key, value in zip(others, rest, strict=True))]),
                tuple(curve(_said(inner[0], value), maker, (value, *rest)) for value in shown),
            )
            for maker, *rest in facets[:MOST_FACETS]
        ),
        _rest([(f"values of {inner[0]}", len(swept[inner[0]]), MOST_CURVES), ("figures", len(facets), MOST_FACETS)]),
    )


def _settings(grid: StudyGrid) -> list[dict[str, Any]]:
    """Return the keys of every setting, in the order of the study's means."""
    parts = {"world": grid.worlds, "problem": grid.problems, "beliefs": grid.beliefs, "candidates": grid.candidates}
    found: list[dict[str, Any]] = [{}]
    for part, choices in parts.items():
        keys = [{f"{part}.{key}": _plain(value) for key, value in (each.data or {}).items()} for each in choices]
        found = [one | other for one in found for other in keys]
    return found


def _plain(value: Any) -> Any:
    return json.dumps(value) if isinstance(value, (list, Mapping)) else value


def _ordered(values: list[Any]) -> tuple[Any, ...]:
    """Return the different values: numbers in rising order, words in the order of the file."""
    found = list(dict.fromkeys(values))
    return tuple(sorted(found)) if all(map(_is_number, found)) else tuple(found)


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _said(key: str, value: Any) -> str:
    return f"{key} = {number_text(value) if _is_number(value) else value}"


def _rest(counted: list[tuple[str, int, int]]) -> str:
    """Return, in words, the values that do not fit into the figures."""
    return "; ".join(f"{most} of {count} {what} are drawn" for what, count, most in counted if count > most)
