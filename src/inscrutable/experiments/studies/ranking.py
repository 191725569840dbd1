"""The ranking of decision makers at equal expected regret, and the verdict on hiding there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.experiments.holding import Reached, Requirement
from inscrutable.experiments.measures import MEASURES, WITHOUT
from inscrutable.experiments.studies.layout import JUDGED, PAID
from inscrutable.experiments.studies.means import StudyMeans, spoken_observer
from inscrutable.validation import Array

SAME_COST = 0.05
"""Expected regrets within this share of one another count as equal: budgets held at each belief differ by as much by chance."""

UNPROTECTED = "ODM"
"""The decision maker that hides nothing."""


@dataclass(frozen=True)
class Ranking:
    """Decision makers at a budget by one figure, the most private first; each is a place in the study's means.

    Args:
        plays: Those that are ranked.
        values: The figure of each, at the expected regret at which they are compared.
        spenders: All decision makers, including those that cannot spend as little.
        spent: The expected regret of each of these; NaN where it was not measured.
        regret: The expected regret at which they are compared; None where all spend the same, or where it is not known.
    """

    plays: tuple[int, ...]
    values: tuple[float, ...]
    spenders: tuple[int, ...]
    spent: tuple[float, ...]
    regret: float | None = None

    @property
    def by_play(self) -> dict[int, float]:
        """The figure of each that is ranked."""
        return dict(zip(self.plays, self.values, strict=True))

    @property
    def is_known(self) -> bool:
        """Whether the expected regrets of all spenders are known."""
        return not np.isnan(self.spent).any()

    @property
    def dearest(self) -> int:
        """The spender of largest expected regret."""
        return int(np.argmax(self.spent))

    @property
    def cheapest(self) -> int:
        """The spender of least expected regret above 0."""
        return int(np.argmin(np.where(_spends(np.array(self.spent)), self.spent, np.inf)))

    @property
    def times(self) -> float:
        """Ratio of the largest to the least cost of hiding."""
        return self.spent[self.dearest] / self.spent[self.cheapest]


def ranking(means: StudyMeans, setting: int, budget: float | None, figure: int) -> Ranking:
    """Return the ranking by a figure of the decision makers with and without a budget.

    Where costs differ by more than `SAME_COST`, all are compared at the least regret that a decision maker with the budget
    spends. A decision maker that spends more is interpolated to that regret by a public randomisation between two of its own
    plays, or between one and the optimal decision: means mix linearly, errors by their squares. One that cannot spend so little
    is left out.
    """
    measured = means.mean[setting, :, figure]
    plays = [p for p, each in enumerate(means.budgets) if each in (None, budget) and not np.isnan(measured[p])]
    paid = _paid(means, setting)
    values, regret = {p: float(measured[p]) for p in plays}, None
    costs = {p: float(paid[p]) for p, spends in zip(plays, _spends(paid[plays]), strict=True) if spends}
    known = not np.isnan(paid[plays]).any()
    if known and costs and max(costs.values()) > (1.0 + SAME_COST) * min(costs.values()):
        regret = min([cost for p, cost in costs.items() if means.budgets[p] is not None] or costs.values())
        found = {p: _at(means, setting, p, figure, regret) for p in plays}
        values = {p: each for p, each in found.items() if not np.isnan(each)}
    kind = MEASURES.get(means.figures[figure].measure)  # None: of a user's own
    sign = (kind.sign if kind is not None else 0) or 1
    order = sorted(values, key=lambda p: -sign * values[p])
    spenders = (*order, *(p for p in plays if p not in values))
    return Ranking(
        tuple(order), tuple(values[p] for p in order), spenders, tuple(float(paid[p]) for p in spenders), regret
    )


def protection(
    means: StudyMeans, setting: int, budget: float | None, *, spoken: Callable[[str], str] = str
) -> list[str]:
    """Return lines that state which decision makers hide the belief at a budget from each observer, with the numbers reached
    and asked for.

    Costs are made equal as in `ranking`; one that spends nothing is not judged, and the optimal decision never
    is. Empty where errors and namings were not measured, no decision maker spends anything, or there is nothing to hide.
    `spoken` writes out a decision maker's name.
    """
    paid, parts, first = _paid(means, setting), [], None
    hides = (_spends(paid) | np.isnan(paid)) & (np.array(means.makers) != UNPROTECTED)
    for observer in dict.fromkeys(figure.observer for figure in means.figures):
        error_without, chance = (_known(means, setting, name, observer) for name in WITHOUT)
        if not error_without > 0 or np.isnan(chance):
            continue
        asked = Requirement(error_without, min(chance, 1.0))
        judged = [means.place.get(f"{name}, {observer}") for name in JUDGED]
        error, named = ({} if place is None else ranking(means, setting, budget, place).by_play for place in judged)
        found = {p: Reached(spoken(means.makers[p]), error[p], named[p]) for p in sorted(error) if p in named}
        reached = [each for p, each in found.items() if hides[p]]
        if not reached:
            continue
        unprotected = next((each for p, each in found.items() if not hides[p]), None)
        first = asked if first is None else first
        own = (
            f" (for it errors of {asked.least_error:.2f} and namings of {asked.most_named:.0%})"
            if asked != first
            else ""
        )
        parts.append(f"Hidden from the {spoken_observer(observer)} observer{own}: {asked.judge(reached, unprotected)}.")
    return [] if first is None else [*parts, first.meaning(without="decisions", state="state", cases="the cases")]


def _known(means: StudyMeans, setting: int, measure: str, observer: str) -> float:
    """Return a figure that is the same for every play, the observer's own if it has one; NaN if it was not measured."""
    place = means.place.get(f"{measure}, {observer}", means.place.get(measure))
    found = np.array([]) if place is None else means.mean[setting, :, place]
    return float(next(iter(found[~np.isnan(found)]), np.nan))


def times_the_least(means: StudyMeans, setting: int, budget: float | None) -> Array:
    """Return the expected regret of every play divided by the least regret above 0 at its budget, shape (P,).

    Plays without a budget are compared with `budget`. 0 where nothing is spent, NaN where it was not measured.
    """
    paid = _paid(means, setting)
    found = np.full(len(paid), np.nan)
    for place, own in enumerate(means.budgets):
        at = budget if own is None else own
        beside = paid[[p for p, each in enumerate(means.budgets) if each in (None, at)]]
        least = beside[_spends(beside)].min(initial=np.inf)
        found[place] = paid[place] / least if np.isfinite(least) else 0.0 * paid[place]
    return np.where(found < tolerances.NO_COST, 0.0, found)


def _paid(means: StudyMeans, setting: int) -> Array:
    """Return the expected regret of every play; NaN where it was not measured."""
    if PAID not in means.place:
        return np.full(len(means.makers), np.nan)
    return np.asarray(means.mean[setting, :, means.place[PAID]])


def _spends(paid: Array) -> np.ndarray:
    """Whether each regret exceeds the rounding of the largest."""
    return np.asarray(paid > tolerances.NO_COST * np.nanmax(paid, initial=0.0))


def _at(means: StudyMeans, setting: int, play: int, figure: int, regret: float) -> float:
    """Return a play's figure at an expected regret; NaN where its decision maker cannot spend so little."""
    paid, measured = _paid(means, setting), means.mean[setting, :, figure]
    if paid[play] <= (1.0 + SAME_COST) * regret:
        return float(measured[play])
    own = [
        p
        for p, name in enumerate(means.makers)
        if name in (means.makers[play], UNPROTECTED) and not np.isnan(measured[p])
    ]
    below = [p for p in own if paid[p] <= regret]
    if not below:
        return float("nan")
    low = max(below, key=lambda p: paid[p])
    high = min((p for p in own if paid[p] > regret), key=lambda p: paid[p])
    share = (regret - paid[low]) / (paid[high] - paid[low])
    power = 2 if means.figures[figure].measure == "error" else 1
    return float(((1.0 - share) * measured[low] ** power + share * measured[high] ** power) ** (1.0 / power))
