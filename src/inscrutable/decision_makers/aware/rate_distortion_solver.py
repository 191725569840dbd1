"""Least mutual information at an expected regret, with the bound that certifies it.

This module uses arrays alone, and the letters of `rate_distortion_steps`. Any law and price bound the rate from below:
R(r) ≥ −Σ_b p_b log z_b − log max_m c_m − s r. After squared Blahut–Arimoto steps on all columns comes an interior-point method
on those that are played most, or have c_m > 1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.aware.rate_distortion_newton import newton_law
from inscrutable.decision_makers.aware.rate_distortion_steps import Source, mean_regret, meeting_slope, squared_cycle
from inscrutable.validation import Array

BITS = 1.0 / float(np.log(2.0))
_TINY = np.finfo(float).tiny
_KEPT_UNIFORM = 0.2
"""Share of the uniform law in a warm start: columns of probability 0 may return. 61 curves of 5 to 496 beliefs and 5 to 5,000
decisions take up to 1.1 times as long with .02, and as long with .5."""
_MOST_COLUMNS = 200
"""Columns of Newton's steps at most. Nine of these curves, with 400 decisions and more, take 1.2 times as long with 300, nearly
three times with 900, and .9 of the time with 100."""
_MOST_STEPS = 100_000
"""Blahut–Arimoto steps at most: a hundred to a thousand are usual."""


@dataclass(frozen=True, eq=False)
class Hidden:
    """A law of the columns q (M,), the price of regret [nats per unit], the rate and its bound [bits], and the regret."""

    law: Array
    slope: float
    rate: float
    bound: float
    regret: float
    steps: int = 0
    free: float = 0.0  # excess regret that counts as none where the price is infinite
    own_gap: float = 0.0  # rate minus the bound by this law and price, which may lie below the bound and below 0

    @property
    def gap(self) -> float:
        """Rate minus bound, in bits."""
        return self.rate - self.bound


@dataclass(frozen=True)
class RateEffort:
    """How near rate and bound must come [bits], and who is told of the steps."""

    gap: float
    progress: Callable[[int, int], None] | None = None


def least_rate(source: Source, regret: float, effort: RateEffort, start: Hidden | None = None) -> Hidden:
    """Return the least mutual information at an expected excess regret of at most `regret`, with its bound."""
    constant = _constant(source, regret)
    if constant is not None:
        return constant
    n_columns = source.excess.shape[1]
    uniform = np.full(n_columns, 1.0 / n_columns)
    law = uniform if start is None else (1.0 - _KEPT_UNIFORM) * start.law + _KEPT_UNIFORM * uniform
    scale = float(source.weights @ source.excess.mean(axis=1))
    none = tolerances.NO_REGRET * scale
    if regret <= none:
        free = source.excess <= none
        masked = Source(source.weights, source.excess, free if source.allowed is None else free & source.allowed)
        cold = _Search(masked, np.inf, effort, law, 0.0)
        return replace(_alternated(cold), slope=float("inf"), free=none)
    if start is None or not 0 < start.slope < np.inf:
        return _alternated(_Search(source, regret, effort, law, 1.0 / regret))
    return _alternated(_Search(source, regret, effort, law, start.slope))


def rows(source: Source, hidden: Hidden) -> Array:
    """Return K (B,M) of a law and a price."""
    if np.isinf(hidden.slope):
        free = source.excess <= hidden.free
        kernel = (free if source.allowed is None else free & source.allowed) * hidden.law
    else:
        kernel = source.kernel(hidden.slope) * hidden.law
    return np.asarray(kernel / np.maximum(kernel.sum(axis=1), _TINY)[:, None])


def _constant(source: Source, regret: float) -> Hidden | None:
    """A constant decision, where one is allowed everywhere and affordable: its rate is 0."""
    means = source.weights @ source.excess
    if source.allowed is not None:
        held = source.weights > 0
        means = np.where(source.allowed[held].all(axis=0), means, np.inf)
    best = int(means.argmin())
    if not means[best] <= regret * (1.0 + tolerances.NO_REGRET):
        return None
    law = np.zeros(len(means))
    law[best] = 1.0
    return Hidden(law, 0.0, 0.0, 0.0, float(means[best]))


def _alternated(search: _Search) -> Hidden:
    """Steps on all columns and Newton's on those that are played, in turn, until the bound is near.

    Where a turn gains nothing, twice as many steps on all columns follow.
    """
    cycles, gap = 1, np.inf
    while not search.done:
        search.steps_on_all(cycles)
        if not search.done:
            search.newton(search.few)
        cycles, gap = 2 * cycles if search.best.own_gap >= gap else cycles, search.best.own_gap
    return replace(search.best, steps=search.steps)


class _Search:
    """The law and price as they stand, and the best certified so far."""

    def __init__(self, source: Source, regret: float, effort: RateEffort, law: Array, slope: float) -> None:
        self.source, self.regret, self.effort = source, regret, effort
        self.law, self.slope = law, slope
        self.best = Hidden(law, slope, np.inf, 0.0, np.inf, own_gap=np.inf)
        self.gains = np.ones(len(law))
        self.steps = 0
        self._target = 0.5 * effort.gap / BITS

    @property
    def done(self) -> bool:
        """Whether rate and bound, both of one law and price, are near enough, or the steps used up.

        With the bound of another price the rate may be near its least, and law and price far from those that play it.
        """
        return self.best.own_gap <= self.effort.gap or self.steps >= _MOST_STEPS

    @property
    def few(self) -> np.ndarray:
        """Columns for Newton's steps: the most played ones that the optimal law may use, and those with the largest c > 1."""
        kept = self.law > tolerances.SELDOM * self._target / len(self.law)
        if np.count_nonzero(kept) > _MOST_COLUMNS // 2:
            kept = self.law >= np.partition(self.law, -_MOST_COLUMNS // 2)[-_MOST_COLUMNS // 2]
        asked = np.flatnonzero(self.gains > 1.0 + 0.5 * self._target)
        asked = asked[np.argsort(-self.gains[asked])][: _MOST_COLUMNS // 2]
        kept[asked] = True
        return np.flatnonzero(kept)

    def steps_on_all(self, cycles: int) -> None:
        """Some squared cycles on all columns, each at the price that meets the budget before it."""
        for _ in range(cycles):
            self.slope = meeting_slope(self.source, self.law, self.regret, self.slope, tolerances.REGRET_NEAR)
            kernel = self.source.kernel(self.slope)
            self.law, done = squared_cycle(kernel, self.source.weights, self.law, self._target)
            self.steps += done
            if done == 1 or self.steps >= _MOST_STEPS:
                break
        self._certify()

    def newton(self, columns: np.ndarray) -> None:
        """Interior-point steps on some columns."""
        start = np.maximum(self.law[columns], tolerances.SELDOM / len(columns))
        # They converge quadratically: a tenth of the target costs a step or two.
        goal = 0.1 * self._target
        law, slope, done = newton_law(self.source.some(columns), self.regret, start / start.sum(), self.slope, goal)
        self.law = np.zeros_like(self.law)
        self.law[columns], self.slope = law, slope
        self.steps += done
        self._certify()

    def _certify(self) -> None:
        found, self.gains = certified(self.source, self.law, self.regret, self.slope)
        self.slope = found.slope
        bound = max(found.bound, self.best.bound)
        self.best = replace(found if found.own_gap <= self.best.own_gap else self.best, bound=bound)
        if self.effort.progress is not None:
            self.effort.progress(min(self.steps, _MOST_STEPS), _MOST_STEPS)


def certified(source: Source, law: Array, regret: float, slope: float) -> tuple[Hidden, Array]:
    """Return rate and bound, and c, of a law after the price has been moved to meet the budget."""
    law = np.where(law > tolerances.RARELY_PLAYED, law, 0.0)
    law = law / law.sum()
    slope = meeting_slope(source, law, regret, slope)
    kernel = source.kernel(slope)
    weights = source.weights
    held = np.maximum(kernel @ law, _TINY)
    gains = (weights / held) @ kernel
    value = float(-(weights @ np.log(held)))
    played = law * gains
    mean = mean_regret(kernel, kernel * source.excess, weights, law)
    # I(π;u) = Σ p K log(K/q) − Σ_m played log(played/q): with the law that is really played the rate is the true one.
    some = played > 0
    rate = value - slope * mean - float(played[some] @ np.log(gains[some]))
    bound = value - float(np.log(gains.max())) - (slope * regret if slope > 0 else 0.0)
    if mean > regret * (1.0 + tolerances.REGRET_NEAR):  # no price makes these columns affordable
        rate = np.inf
    own = (rate - bound) * BITS
    return Hidden(law, slope, max(rate, 0.0) * BITS, max(bound, 0.0) * BITS, mean, own_gap=own), gains
