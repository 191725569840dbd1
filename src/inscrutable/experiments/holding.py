"""The definition of a hidden belief, for every verb, report and page.

Let e₀ be the error without decisions, and n₀ the share of cases in which the commonest state is right. A belief is hidden from
an observer of error e who names the likeliest state in a share n of the cases if

    e ≥ ⅔ e₀  and  n ≤ n₀ + ⅓ (1 − n₀).

Both conditions are needed: an estimate can have a large error and still name the right state nearly always, or a small error
and often name a wrong state.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from inscrutable import tolerances, validation
from inscrutable.errors import InputError, ModelError
from inscrutable.labels import listed
from inscrutable.mechanisms.joint import top_states
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel

ERROR_KEPT = 2.0 / 3.0
"""Least error of the observer, as a share of the error without decisions."""

NAMING_GAINED = 1.0 / 3.0
"""Most naming of the likeliest state, as a share of the range from chance to always."""

RANKED = 5.0 / 6.0
"""Share of rightly ranked pairs beyond which an observer distinguishes a state even if it seldom names it: two thirds of the
way from chance, a half, to always. It is .72 under the sequential rule on the packaged returns and 1 for optimal
decisions; .92 was met where one regime held in 89 % of the weeks, so that the naming could hardly fail."""

TURNED = 0.5
"""Share of the namings right by chance below which a caution says that of two states the opposite is mostly right."""

_MOST_LISTED = 3
_MOST_DIGITS = 8  # additional digits tried where a figure misses its bound by rounding


class Reached(NamedTuple):
    """The error of an observer's estimate under one decision maker, and the share of right namings.

    Both are NaN where no belief explains any of its decisions to that observer.
    """

    name: str
    error: float
    named: float


@dataclass(frozen=True)
class Requirement:
    """The requirement for a belief to count as hidden from an observer.

    Args:
        error_without: e₀, root mean square error without decisions, at least 0.
        chance: n₀, share of the cases in which always naming the commonest state is right.

    Raises:
        InputError: A number is out of its range.

    Example:
        >>> asked = Requirement(error_without=0.6, chance=0.61)
        >>> asked.is_met(Reached("CDM", error=0.5, named=0.7)), asked.is_met(Reached("PDM", error=0.7, named=0.95))
        (True, False)
        >>> asked.judge([Reached("CDM", 0.5, 0.7), Reached("PDM", 0.7, 0.95)])
        'by CDM (error 0.50, named 70%), not by PDM (error 0.70, named 95% > 74%)'
    """

    error_without: float
    chance: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "error_without", validation.non_negative(self.error_without, "error_without"))
        object.__setattr__(self, "chance", validation.non_negative(self.chance, "chance"))
        if self.chance > 1.0:
            raise InputError(f"chance must be a share between 0 and 1, got {self.chance:g}")

    @property
    def least_error(self) -> float:
        """The least error of a hidden belief; rounding decides no tie."""
        return ERROR_KEPT * self.error_without * (1.0 - tolerances.SUM_ROUNDING)

    @property
    def most_named(self) -> float:
        """The largest share of right namings of a hidden belief; rounding decides no tie."""
        return (self.chance + NAMING_GAINED * (1.0 - self.chance)) * (1.0 + tolerances.SUM_ROUNDING)

    def is_met(self, reached: Reached) -> bool:
        """Return whether the belief is hidden; False without an estimate."""
        return reached.error >= self.least_error and reached.named <= self.most_named

    def meaning(self, *, without: str, state: str, cases: str) -> str:
        """Return what "hidden" means, with its numbers; where one state is the likeliest in all cases, naming it tests nothing.

        Args:
            without: What the observer does not see, such as "weights".
            state: What the observer names, such as "regime".
            cases: The cases of the shares, such as "months".
        """
        errs = (
            f"Hidden means: the observer's estimate errs by at least {self.least_error:.2f} (two thirds of "
            f"{self.error_without:.2f}, its error without {without})"
        )
        if self.most_named >= 1.0:
            return f"{errs}. One {state} is the likeliest in all {cases}, so naming it tests nothing: the error alone decides."
        return (
            f"{errs}, and it names the likeliest {state} in at most {self.most_named:.0%} of {cases} (a third of the way from "
            f"chance, {self.chance:.0%}, to always)."
        )

    def opposite(self, named: float, regimes: Sequence[str]) -> str:
        """Return as text how often the opposite of what the observer names is right; empty unless that is often, of two."""
        if len(regimes) != 2 or not named < TURNED * self.chance:
            return ""
        return f"with two regimes, an observer who reads the opposite is right in {1 - named:.0%}."

    def caution(self, named: float, ranking: StateRanking | None, regimes: Sequence[str]) -> str:
        """Return what estimates that hide the belief in some rows nevertheless tell, as text; empty for nothing."""
        ranked = "" if ranking is None else ranking.told(regimes, "row")
        return self.opposite(named, regimes) or ranked

    def judge(self, reached: Sequence[Reached], unprotected: Reached | None = None) -> str:
        """Return which decision makers hide the belief and which do not, with the error and the share of right namings reached.

        The text shows a figure that misses its bound beside the bound. The best come first, at most three of each. Decision
        makers without explained decisions are named and not judged. Where `unprotected` decisions meet the requirement as well,
        none is judged.
        """
        if unprotected is not None and self.is_met(unprotected):
            return f"cannot be judged, as without protection it is hidden as well, by {self._listed([unprotected])}"
        blind = [each.name for each in reached if math.isnan(each.error)]
        known = sorted((each for each in reached if not math.isnan(each.error)), key=self._margin, reverse=True)
        unread = f"no belief explains any decision of {' or '.join(blind)}"
        if not known:
            return f"not known, as {unread}"
        held = [each for each in known if self.is_met(each)]
        missed = [each for each in known if not self.is_met(each)]
        told = f"by {self._listed(held)}" if held else f"by none of {self._listed(missed)}"
        if held and missed:
            told += f", not by {self._listed(missed)}"
        return f"{told} ({unread})" if blind else told

    def compare(self, reached: Reached) -> str:
        """Return the error and the share of right namings as text; one that misses its bound stands beside the bound."""
        return f"{self._error(reached.error)}, {self._named(reached.named)}"

    def _listed(self, reached: Sequence[Reached]) -> str:
        told = [f"{each.name} ({self.compare(each)})" for each in reached]
        if len(told) > _MOST_LISTED + 1:
            told = [*told[:_MOST_LISTED], f"{len(told) - _MOST_LISTED} more"]
        return listed(told)

    def _error(self, error: float) -> str:
        if error >= self.least_error:
            return f"error {error:.2f}"
        return "error " + " < ".join(_told_apart(error, self.least_error, lambda digits: f".{2 + digits}f"))

    def _named(self, named: float) -> str:
        if math.isnan(named):
            return "naming unknown"
        if named <= self.most_named:
            return f"named {named:.0%}"
        return "named " + " > ".join(_told_apart(named, self.most_named, lambda digits: f".{digits}%"))

    def _margin(self, reached: Reached) -> float:
        """Return the slack of the tighter of the two bounds, as a share of its range."""
        error = reached.error / self.error_without - ERROR_KEPT if self.error_without > 0 else 0.0
        named = NAMING_GAINED - (reached.named - self.chance) / (1.0 - self.chance) if self.chance < 1 else 1.0
        return min(error, named)


def _told_apart(reached: float, bound: float, form: Callable[[int], str]) -> tuple[str, str]:
    """Return both numbers as text with enough digits to differ."""
    pairs = [(format(reached, form(more)), format(bound, form(more))) for more in range(_MOST_DIGITS)]
    return next((pair for pair in pairs if pair[0] != pair[1]), pairs[-1])


class EstimateQuality(NamedTuple):
    """The error and the share of right namings of estimates; NaN without estimates."""

    error: float
    named: float


def estimate_quality(estimates: Array, beliefs: Array) -> EstimateQuality:
    """Return the root mean square error of estimates (T,X) of beliefs (T,X), and how often they name a likeliest state.

    Rows of NaN, for decisions that no belief explains, are left out. Of several states as likely by an estimate one is named at
    random, and its chance counts.
    """
    read = ~np.isnan(estimates).any(axis=1)
    if not read.any():
        return EstimateQuality(float("nan"), float("nan"))
    found, held = estimates[read], beliefs[read]
    tied = top_states(found)
    named = (top_states(held) * tied).sum(axis=1) / tied.sum(axis=1)
    return EstimateQuality(float(np.sqrt(((found - held) ** 2).sum(axis=1).mean())), float(named.mean()))


class StateRanking(NamedTuple):
    """Accuracy of estimates in ranking the cases in which a state is the likeliest: the area under the ROC curve.

    `share` is the share of pairs, one case in which the state is likeliest and one in which it is not, where its estimated
    probability is larger in the first; equal ones count half.
    """

    state: int
    share: float

    def told(self, states: Sequence[str], case: str) -> str:
        """Return the ranking as a sentence; `case`: the cases, such as "month". Empty where few pairs are ranked rightly."""
        if self.share <= RANKED:
            return ""
        name = states[self.state]
        return (
            f"its estimate still tells when {name} is likeliest: in {self.share:.0%} of the pairs of a {case} in which it is "
            f"and a {case} in which it is not, the first has the larger estimated probability of {name}."
        )


def best_ranking(estimates: Array, beliefs: Array) -> StateRanking | None:
    """Return the state that estimates (T,X) of beliefs (T,X) rank best; None where no state is likeliest in some cases alone.

    Rows of NaN are left out.
    """
    read = ~np.isnan(estimates).any(axis=1)
    found, likeliest = estimates[read], top_states(beliefs[read]) > 0.0
    shares = {
        state: _ranked(found[:, state], is_it)
        for state, is_it in enumerate(likeliest.T)
        if 0 < is_it.sum() < len(is_it)
    }
    best = max(shares, key=lambda state: shares[state], default=None)
    return None if best is None else StateRanking(best, shares[best])


def _ranked(values: Array, is_it: NDArray[np.bool_]) -> float:
    """Return the share of pairs with a larger value where `is_it` holds, from the sum of its ranks (Mann and Whitney 1947)."""
    n, others = is_it.sum(), (~is_it).sum()
    _, place, equal = np.unique(values, return_inverse=True, return_counts=True)
    ranks = (np.cumsum(equal) - (equal - 1) / 2)[place]
    return float((ranks[is_it].sum() - n * (n + 1) / 2) / (n * others))


def requirement_of(world: HiddenMarkovModel, beliefs: Array) -> Requirement | None:
    """Return the requirement for beliefs (T,X) to be hidden; None where the stationary law is not unique.

    That law is the estimate of an observer without decisions.
    """
    try:
        long_run = HiddenMarkovModel(world.transition, world.emission).initial
    except ModelError:
        return None
    without = estimate_quality(np.tile(long_run, (len(beliefs), 1)), beliefs)
    return Requirement(without.error, base_rate(beliefs))


def base_rate(beliefs: Array) -> float:
    """Return the share of beliefs (T,X) in which the state that is likeliest most often is so."""
    return float(top_states(beliefs).mean(axis=0).max())
