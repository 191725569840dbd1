"""Summary of a study's rows: each figure's mean over the repeats, its interval and its spread."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.experiments.measures import MEASURES, OF_OBSERVERS, WITHOUT, reads_beside
from inscrutable.experiments.studies.grid import StudyGrid, Variant
from inscrutable.experiments.studies.tasks import DONE
from inscrutable.labels import number_text
from inscrutable.validation import Array

QUANTILES = (0.0, 0.25, 0.5, 0.75, 1.0)
_MARKET = 4  # parts of a task's place that make its setting; then come repeat, play and observer
_LEVEL = 0.975
_OF_ANY_SIZE = (("expected_regret", "worst_regret", "expected_gap"), ("worth", "secret_worth"))
"""Measures in the unit of a cost, and in that of a loss; all others of the library are of the size of 1."""
_SPOKEN = ("public",)  # keys whose values need the key beside them


@dataclass(frozen=True)
class Figure:
    """A measure, and the observer that it belongs to, if there is one.

    Args:
        measure: Its name in the study.
        observer: The observer; empty for a figure of the mechanism.
    """

    measure: str
    observer: str = ""

    @property
    def name(self) -> str:
        """Both in one text."""
        return f"{self.measure}, {self.observer}" if self.observer else self.measure


_TERMS = {"bayesian": "aware (bayesian)", "sequential": "aware over time (sequential)"}
"""The glossary's terms for observers, where a study file has another name."""


def spoken_observer(name: str) -> str:
    """Return the name of an observer for a reader; its settings after a comma stay."""
    kind, comma, settings = name.partition(",")
    return f"{_TERMS.get(kind, kind)}{comma}{settings}"


@dataclass(frozen=True, eq=False)
class StudyMeans:
    """Means of a study's figures over its repeats; S settings, P plays (decision maker and budget), F figures.

    Args:
        settings: The entries of market, beliefs and candidates that vary, one text per setting.
        makers: The decision maker of each play.
        budgets: The amount each play spends; None where it takes no budget.
        figures: The figures, one per column.
        count: Repeats with a number, shape (S,P,F).
        mean: Mean over them, shape (S,P,F); NaN without any.
        half_width: Half of the 95 % interval (Student's t over the repeats), shape (S,P,F); NaN for fewer than two repeats.
        quantiles: The least, the quartiles and the greatest, shape (S,P,F,5).
    """

    settings: tuple[str, ...]
    makers: tuple[str, ...]
    budgets: tuple[float | None, ...]
    figures: tuple[Figure, ...]
    count: np.ndarray
    mean: Array
    half_width: Array
    quantiles: Array

    @cached_property
    def place(self) -> dict[str, int]:
        """The place of a figure by its name."""
        return {figure.name: place for place, figure in enumerate(self.figures)}

    @cached_property
    def scales(self) -> list[float]:
        """The size of each figure, to which its rounding is relative: that of the largest mean of its unit, or 1."""
        return [self._scale(figure.measure) for figure in self.figures]

    def _scale(self, measure: str) -> float:
        unit = next((names for names in _OF_ANY_SIZE if measure in names), (measure,))
        if measure in MEASURES and len(unit) == 1:
            return 1.0
        found = self.mean[:, :, [place for place, figure in enumerate(self.figures) if figure.measure in unit]]
        return float(np.abs(found[np.isfinite(found)]).max(initial=0.0)) or 1.0

    @cached_property
    def amounts(self) -> list[float]:
        """The budgets that plays spend, rising."""
        return sorted({each for each in self.budgets if each is not None})

    @property
    def middle_budget(self) -> float | None:
        """The budget of the verdicts, the lower of two middle ones; None without any."""
        return self.amounts[(len(self.amounts) - 1) // 2] if self.amounts else None

    def first_setting(self, places: Sequence[int] | None = None) -> int:
        """Return the setting of the verdicts, among some or all: the first that has figures, else the first."""
        held = range(len(self.settings)) if places is None else places
        return int(self.count[list(held)].any(axis=(1, 2)).argmax())

    def frame(self) -> pd.DataFrame:
        """Return one row per setting, play and figure that has a number."""
        s, p, f = np.nonzero(self.count)
        return pd.DataFrame(
            {
                "setting": [self.settings[k] for k in s],
                "decision_maker": [self.makers[k] for k in p],
                "budget": pd.Series([self.budgets[k] for k in p], dtype="float64"),
                "measure": [self.figures[k].measure for k in f],
                "adversary": [self.figures[k].observer for k in f],
                "repeats": self.count[s, p, f],
                "mean": self.mean[s, p, f],
                "half_width": self.half_width[s, p, f],
            }
        )


def means_of(grid: StudyGrid, frame: pd.DataFrame, *, paired: bool = False) -> StudyMeans:
    """Return the means of a study's rows; tasks that failed, or have no row yet, are left out.

    Args:
        grid: The study's tasks.
        frame: Its rows, as `Study.frame` gives them.
        paired: Whether to take only the repeats in which all plays with figures have all of them, so that means can be
            compared. A setting without such a repeat has the means over those that each figure has.
    """
    observers = labels(grid.adversaries, name="name")
    makers = labels([maker for maker, _ in grid.plays], name="name")
    each_his = OF_OBSERVERS + (WITHOUT if any(reads_beside(each.data or {}) for each in grid.adversaries) else ())
    figures = tuple(
        Figure(measure, observer)
        for measure in grid.study.measures
        for observer in (observers if measure in each_his else ("",))
    )
    values = _values(grid, frame)  # settings, repeats, plays, observers, measures
    columns = []
    for figure in figures:
        found = values[..., grid.study.measures.index(figure.measure)]
        columns.append(found[..., observers.index(figure.observer)] if figure.observer else _any_of(found))
    table = np.stack(columns, axis=-1)
    if paired:
        table = _paired(table)
    return StudyMeans(
        _settings(grid),
        tuple(makers),
        tuple((budget.data or {}).get("amount") for _, budget in grid.plays),
        figures,
        *_over_repeats(table),
    )


def _values(grid: StudyGrid, frame: pd.DataFrame) -> Array:
    measures = list(grid.study.measures)
    flat = np.full((len(grid), len(measures)), np.nan)
    done = frame[frame["status"] == DONE]
    flat[done.index.to_numpy(dtype=np.intp)] = done[measures].to_numpy(dtype=np.float64)
    return flat.reshape(prod(grid.shape[:_MARKET]), *grid.shape[_MARKET:], len(measures))


def _any_of(found: Array) -> Array:
    """Return a figure that is the same for all observers, from any finished task."""
    first = found[..., 0].copy()
    for place in range(1, found.shape[-1]):
        first = np.where(np.isnan(first), found[..., place], first)
    return first


def _paired(table: Array) -> Array:
    """Return figures (S,R,P,F) of complete repeats, NaN in others, for every setting that has a complete one."""
    known = ~np.isnan(table)
    is_complete = np.asarray((known | ~known.any(axis=1, keepdims=True)).all(axis=(2, 3)))
    kept = is_complete | ~is_complete.any(axis=1, keepdims=True)
    return np.where(kept[:, :, None, None], table, np.nan)


def _over_repeats(table: Array) -> tuple[np.ndarray, Array, Array, Array]:
    """Return count, mean, half width and quantiles over axis 1; NaN does not count."""
    from scipy.stats import t

    known = ~np.isnan(table)
    count = known.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known, table, 0.0).sum(axis=1) / count
        squares = np.where(known, (table - mean[:, None]) ** 2, 0.0).sum(axis=1)
        spread = np.sqrt(squares / (count - 1) / count)
        half = np.where(count > 1, spread * t.ppf(_LEVEL, np.maximum(count - 1, 1)), np.nan)
        quantiles = _quantiles(np.sort(table, axis=1), count)
    return count, mean, half, quantiles


def _quantiles(rising: Array, count: np.ndarray) -> Array:
    """Return quantiles along axis 1 of rising numbers with NaN last, interpolated linearly."""
    at = np.array(QUANTILES) * np.maximum(count - 1, 0)[..., None]
    low = np.floor(at).astype(np.intp)
    below, above = (
        np.moveaxis(np.take_along_axis(rising, np.moveaxis(place, -1, 1), axis=1), 1, -1)
        for place in (low, np.minimum(low + 1, np.maximum(count - 1, 0)[..., None]))
    )
    return np.asarray(np.where(below == above, below, below + (at - low) * (above - below)))


def _settings(grid: StudyGrid) -> tuple[str, ...]:
    parts = {"world": grid.worlds, "problem": grid.problems, "beliefs": grid.beliefs, "candidates": grid.candidates}
    texts = [""]
    for part, choices in parts.items():
        texts = [", ".join(filter(None, (one, other))) for one in texts for other in labels(choices, prefix=f"{part}.")]
    return tuple(texts)


def labels(choices: Sequence[Variant], *, name: str | None = None, prefix: str = "") -> list[str]:
    """Return a text for each choice that distinguishes it: its name, and the entries that differ among choices of that name.

    An entry that one of them lacks counts only if the choices are the same without it.
    """
    data = [choice.data or {} for choice in choices]
    found = [_label(each, data, name, prefix) for each in data]
    again = [_label(each, data, name, prefix, lacking=True) for each in data]
    return [more if found.count(text) > 1 else text for text, more in zip(found, again, strict=True)]


def _label(
    own: Mapping[str, Any], data: Sequence[Mapping[str, Any]], name: str | None, prefix: str, *, lacking: bool = False
) -> str:
    alike = [other for other in data if name is None or other.get(name) == own.get(name)]
    told = {key: {json.dumps(other.get(key)) for other in alike if lacking or key in other} for key in own}
    parts = [str(own[name])] if name else []
    return ", ".join([*parts, *(_entry(prefix, key, own[key]) for key in own if len(told[key]) > 1)])


def _entry(prefix: str, key: str, value: Any) -> str:
    """Return an entry as text: a word alone, a number with its key; with a prefix the key is that of the file and the rows."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    told = number_text(value) if number else value
    if prefix:
        return f"{prefix}{key} = {told}"
    if isinstance(value, str) and key not in _SPOKEN:
        return value
    return f"{key.replace('_', ' ') if number else key} {told}"
