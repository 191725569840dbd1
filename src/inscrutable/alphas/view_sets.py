"""Expected returns implied by weights without loadings (B = I): closed forms.

All views with regret ρ(m,u) ≤ r are m = 2γV(u + δ) + H'ν + G'λ with γ δ'Vδ + s'λ ≤ r and λ ≥ 0, s the slacks of the
inequalities G u ≤ h at the weights u: duality of the least cost over C. At r = 0 only multipliers of active rows remain. The
set is unbounded along d if H d ≠ 0, or if (G d)_i > 0 with s_i = 0; otherwise the bound is d'(2γVu) plus the best combination
of δ and one λ_i.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq, lsq_linear

from inscrutable import tolerances
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.errors import SolverError
from inscrutable.validation import Array

_MOST_TURNS = 100
_STRIDE = 2.0
"""Step in the logarithm of the multiplier, until it brackets the regret."""


class ViewSet(ABC):
    """The views m that explain weights, as a set."""

    problem: AlphaProblem
    weights: Array
    has_sides: bool = False
    """Whether some multiplier of the set has a fixed sign."""

    @property
    @abstractmethod
    def dimension(self) -> int:
        """Dimension of the set; −1 where it is empty."""

    @property
    @abstractmethod
    def gap(self) -> float:
        """Least regret of the weights under any view: zero where one explains them."""

    @abstractmethod
    def signal_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return least and greatest m_j, shape (q,2), of the signals with the given numbers."""

    @abstractmethod
    def asset_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return least and greatest (Bm)_i − ρ'(Bm), shape (q,2), of the assets with the given numbers; ρ None is zero."""

    @abstractmethod
    def nearest(self, mean: Array) -> Array:
        """Return the member nearest to a mean (k,); the best fit if the set is empty."""

    @abstractmethod
    def contains(self, mean: Array) -> bool:
        """Return whether a mean (k,) is a member."""


class Slacks(NamedTuple):
    """Slacks of the weights in bounds and general rows; infinite for bounds that do not exist."""

    lower: Array  # (n,)
    upper: Array  # (n,)
    general: Array  # (rows,)


def slacks_of(problem: AlphaProblem, weights: Array, within: float = tolerances.FEASIBILITY) -> Slacks:
    """Return the slacks at weights; slacks of at most `within`, relative to the row, are set to zero."""
    layout = problem.layout
    if layout is None:
        nothing = np.full(problem.n_assets, np.inf)
        return Slacks(nothing, nothing, np.zeros(0))
    scale = np.abs(layout.general).max(axis=1, initial=0.0)
    found = weights - layout.lower, layout.upper - weights, (layout.sides - layout.general @ weights) / scale
    lower, upper, general = (np.where(slack <= within, 0.0, slack) for slack in found)
    return Slacks(lower, upper, general * scale)


class FreeViews(ViewSet):
    """Views m of all assets under which weights cost at most a regret more than the best.

    Args:
        problem: The decision problem, without loadings.
        weights: u, shape (n,), a member of C.
        regret: r ≥ 0; 0 is none.
    """

    def __init__(self, problem: AlphaProblem, weights: Array, regret: float) -> None:
        self.problem, self.weights, self.regret = problem, weights, regret
        self._center = 2.0 * problem.risk_aversion * problem.risk.times(weights)
        self._slacks = slacks_of(problem, weights)
        tight = (self._slacks.lower == 0) != (self._slacks.upper == 0)
        self.has_sides = bool(tight.any() or (self._slacks.general == 0).any())

    @property
    def gap(self) -> float:
        """Zero: 2γVu always explains u."""
        return 0.0

    @cached_property
    def dimension(self) -> int:
        """The rank of the active rows; n within a positive regret."""
        if self.regret > 0:
            return self.problem.n_assets
        bound = (self._slacks.lower == 0) | (self._slacks.upper == 0)
        rows, _ = self._rows
        return int(bound.sum()) + (int(np.linalg.matrix_rank(rows[:, ~bound])) if len(rows) else 0)

    @cached_property
    def _rows(self) -> tuple[Array, int]:
        """Return the normals whose multiples may be added to a view, (e + t, n), equalities first, and the number e."""
        rows, layout = self.problem.equalities[0], self.problem.layout
        if layout is None:
            return rows, len(rows)
        return np.vstack([rows, layout.general[self._slacks.general == 0]]), len(rows)

    def signal_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """The assets' bounds."""
        return self.asset_bounds(reference, wanted)

    def asset_bounds(self, reference: Array | None, wanted: np.ndarray) -> Array:
        """Return least and greatest m_i − ρ'm by the closed form, in O(n k) for factors."""
        problem, gamma = self.problem, self.problem.risk_aversion
        share = np.zeros(problem.n_assets) if reference is None else reference
        middle = self._center - share @ self._center
        risk = problem.risk
        spread = risk.diagonal - 2.0 * risk.times(share) + risk.quadratic(share)
        found = np.empty((problem.n_assets, 2))
        for side, sign in enumerate((-1.0, 1.0)):
            rate = self._rates(share, sign)
            with np.errstate(divide="ignore", invalid="ignore"):
                mixed = gamma * spread / rate + rate * self.regret
                inside = 2.0 * np.sqrt(gamma * self.regret * np.maximum(spread, 0.0))
                extra = np.where(rate**2 * self.regret > gamma * spread, mixed, inside)
            found[:, side] = middle + sign * np.where(np.isinf(rate), np.inf, extra)
        return np.asarray(found[wanted])

    def _rates(self, share: Array, sign: float) -> Array:
        """Return, for each d = ±(e_i − ρ), the largest change by one multiplier per unit of regret; infinite where free."""
        slacks = self._slacks
        each = np.maximum(_over(sign * share, slacks.lower), _over(-sign * share, slacks.upper))
        rates = _greatest_of_others(each)
        own = np.maximum(_over(sign * (share - 1.0), slacks.lower), _over(sign * (1.0 - share), slacks.upper))
        rates = np.maximum(rates, own)
        layout = self.problem.layout
        if layout is None:
            return rates
        for row, slack in zip(layout.general, slacks.general, strict=True):
            rates = np.maximum(rates, _over(sign * (row - row @ share), np.full(len(row), slack)))
        for row in layout.equalities:
            rates[np.abs(row - row @ share) > tolerances.ON_FACE * np.abs(row).max()] = np.inf
        return rates

    def contains(self, mean: Array) -> bool:
        """Return whether a mean meets the regret or, at regret 0, the conditions of optimality up to rounding."""
        if self.regret > 0:
            return bool(self.problem.regret(mean, self.weights) <= self.regret * (1.0 + tolerances.ON_FACE))
        scale = max(float(np.abs(self._center).max()), float(np.abs(mean).max(initial=0.0)))
        return float(np.abs(mean - self.nearest(mean)).max()) <= tolerances.EXPLAINED * scale

    def nearest(self, mean: Array) -> Array:
        """Return the member nearest to a mean."""
        if self.regret > 0:
            return nearest_within(self.problem, self.weights, self.regret, mean)
        rows, n_free = self._rows
        slacks = self._slacks
        low, high = slacks.lower == 0, slacks.upper == 0
        levels, apart = np.zeros(len(rows)), mean - self._center
        if len(rows):
            levels = _levels(apart, rows, n_free, low, high)
        explained = self._center + rows.T @ levels
        return np.where(_cut(mean - explained, low, high) == 0.0, mean, explained)


def _cut(left: Array, low: np.ndarray, high: np.ndarray) -> Array:
    """Return the part of a difference that the multipliers of active bounds do not remove."""
    kept = np.where(low, np.maximum(left, 0.0), left)
    return np.asarray(np.where(high, np.minimum(kept, 0.0), kept))


def _levels(apart: Array, rows: Array, n_free: int, low: np.ndarray, high: np.ndarray) -> Array:
    """Return the multipliers (e + t,), the last t at least 0, of least squared residual.

    Newton's method minimises a convex, piecewise quadratic function.
    """
    least = np.concatenate([np.full(n_free, -np.inf), np.zeros(len(rows) - n_free)])
    levels = np.zeros(len(rows))
    left = _cut(apart, low, high)
    for _ in range(_MOST_TURNS):
        if np.abs(left).max() <= tolerances.STATIONARITY * np.abs(apart).max():
            return levels
        matters = ~(low | high) | (left != 0.0)
        if len(rows) == n_free:
            goal = np.linalg.lstsq(rows[:, matters].T, apart[matters], rcond=tolerances.RANK)[0]
        else:
            goal = lsq_linear(
                rows[:, matters].T, apart[matters], (least, np.inf), method="bvls", tol=tolerances.STATIONARITY
            ).x
        step, size, now = goal - levels, 1.0, float(left @ left)
        slope = 2.0 * float(left @ (rows.T @ step))
        while size > tolerances.FEASIBILITY:
            after = _cut(apart - rows.T @ (levels + size * step), low, high)
            if float(after @ after) <= now - tolerances.LEAST_FALL * size * slope:
                break
            size *= 0.5
        else:  # what is left is rounding
            return levels
        levels = levels + size * step
        same = np.array_equal(matters, ~(low | high) | (after != 0.0))
        left = after
        if (same and size == 1.0) or float(after @ after) >= now * (1.0 - tolerances.STATIONARITY):
            return np.asarray(levels)
    raise SolverError(f"the nearest view was not found within {_MOST_TURNS} steps")


def nearest_within(problem: AlphaProblem, weights: Array, regret: float, mean: Array) -> Array:
    """Return the view nearest to a mean (k,) under which weights have at most a regret, for any loadings.

    At a multiplier μ of regret the best view is m − μB'(v−u), where v is the best decision with V + μBB'/(2γ) for the mean Bm +
    μBB'u; v is also the optimal decision for that view, so its regret needs no further solve. One search over μ.
    """
    if problem.regret(mean, weights) <= regret:
        return mean
    loads, gamma = problem.loadings, problem.risk_aversion
    alphas, back = problem.alphas(mean), weights if loads is None else loads @ (loads.T @ weights)

    def at(price: float) -> tuple[Array, float]:
        share = price / (2.0 * gamma)
        columns = np.zeros((len(weights), 0)) if loads is None else np.sqrt(share) * loads
        risk = problem.risk.with_more(columns, share if loads is None else 0.0)
        best = AlphaProblem(risk, gamma, problem.constraints).optimum_for((alphas + price * back)[None])[0]
        apart = weights - best
        view = mean + price * (apart if loads is None else loads.T @ apart)
        slope = 2.0 * gamma * problem.risk.times(best) - problem.alphas(view)
        return view, gamma * float(problem.risk.quadratic(apart)) + float(slope @ apart)

    def beyond(log_price: float) -> float:
        return float(np.log(max(at(np.exp(log_price))[1], tolerances.TINY) / regret))

    low = high = float(np.log(2.0 * gamma * problem.risk.diagonal.mean()))
    while beyond(low) < 0:
        low -= _STRIDE
    while beyond(high) > 0:
        high += _STRIDE
    found = low if low == high else brentq(beyond, low, high, xtol=tolerances.STATIONARITY)
    return at(np.exp(found))[0]


def _over(values: Array, slacks: Array) -> Array:
    """values/slacks where values are above zero, else 0; infinite over no slack."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(values > tolerances.ON_FACE, values / slacks, 0.0)


def _greatest_of_others(values: Array) -> Array:
    """Return, for each index, the greatest value at any other index."""
    first = int(values.argmax())
    found = np.full(values.size, values[first])
    found[first] = np.delete(values, first).max(initial=0.0)
    return found
