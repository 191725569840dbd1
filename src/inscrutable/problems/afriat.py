"""Revealed preferences: whether choices at different prices maximise some utility, how nearly, and such a utility.

With spending ratios e_ts = p_t'x_s / p_t'x_t, choice t is revealed preferred to s at efficiency e where e_ts ≤ e, strictly
where e_ts < e. Consistency (GARP) forbids a cycle of preferences with a strict one in it, so it depends on the strongly
connected parts of one graph.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import ROUND_FLOOR, Context
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order, connected_components

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, Names
from inscrutable.errors import InputError, ModelError, SolverError
from inscrutable.linear_programmes import Rows, minimise
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.piecewise_linear import PiecewiseLinearProblem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class RevealedPreferences(Summarised, Saved):
    """Whether choices at known prices maximise a utility, and such a utility.

    Formula: U(x) = min_t (u_t + λ_t p_t'(x − e x_t)) with u_s ≤ u_t + λ_t p_t'(x_s − e x_t) and λ > 0: concave, increasing and
    piecewise linear; no x with p_t'x ≤ e p_t'x_t has a larger utility than x_t.

    Args:
        prices: p_t, shape (T,U), scaled so that each choice costs one.
        choices: x_t, shape (T,U).
        efficiency: e: a choice must be as good as every one that costs at most this share of it; 1 is full rationality.
        is_consistent: Whether the choices satisfy GARP at this efficiency.
        cycle: Observations, each revealed preferred to the next and the last to the first, at least one of them strictly;
            empty where there is none.
        efficiency_index: Afriat's index, the supremum of the efficiencies at which the choices are consistent, at most 1.
        utilities: u_t, shape (T,); NaN where the choices are inconsistent, or nearly so that the numbers overflow.
        multipliers: λ_t, shape (T,), utility per share of the budget; at least 1; NaN as the utilities.
        goods: Labels of the goods where the tables had them.

    Source: Afriat, The Construction of Utility Functions from Expenditure Data (1967); Varian, The Nonparametric Approach to
    Demand Analysis (1982).

    Example:
        >>> found = revealed_preferences([[1.0, 2.0], [2.0, 1.0]], [[2.0, 1.0], [1.0, 2.0]])
        >>> found.is_consistent, found.efficiency_index, bool(found.utility([2.0, 1.0]) > found.utility([0.0, 2.0]))
        (True, 1.0, True)
    """

    prices: Array
    choices: Array
    efficiency: float
    is_consistent: bool
    cycle: tuple[int, ...]
    efficiency_index: float
    utilities: Array
    multipliers: Array
    goods: Names | None = None

    @property
    def slopes(self) -> Array:
        """λ_t p_t, the utility's slope on each piece, shape (T,U)."""
        return np.asarray(self._explained(self.multipliers)[:, None] * self.prices)

    @property
    def levels(self) -> Array:
        """u_t − e λ_t, each piece's value at x = 0, shape (T,): a choice costs one."""
        return np.asarray(self._explained(self.utilities) - self.efficiency * self.multipliers)

    def utility(self, choices: ArrayLike) -> Array:
        """Return U(x) for choices (…,U): shape (…).

        Raises:
            InputError: Another number of goods.
            ModelError: The choices are inconsistent at this efficiency.
            SolverError: They are consistent, but so nearly inconsistent that the utility's numbers overflow.
        """
        points = validation.real_array(choices, "choices", (Axis("good", self.goods),))
        if points.ndim == 0 or points.shape[-1] != self.prices.shape[1]:
            raise InputError(
                f"choices have shape {points.shape}, expected {self.prices.shape[1]} goods in the last axis"
            )
        return np.asarray((points @ self.slopes.T + self.levels).min(axis=-1))[()]

    def _explained(self, values: Array) -> Array:
        if not self.is_consistent:
            advice = self._below_index
            raise ModelError(
                f"no utility explains the choices at efficiency {self.efficiency:g}: observations {list(self.cycle)} form a "
                f"cycle; ask with an efficiency below {_rounded_down(self.efficiency_index):g}"
                + (f", such as {advice:g}" if advice > 0 else ": none will do")
            )
        if np.isnan(values).any():
            raise SolverError(
                f"the choices are consistent at efficiency {self.efficiency:g}, but spending so nearly tied that the numbers "
                f"of their utility exceed floating point; ask with an efficiency such as {self._below_index:g}"
            )
        return values

    @property
    def _below_index(self) -> float:
        """An efficiency of six digits at which the choices are consistent."""
        return _rounded_down(self.efficiency_index, strictly=True)

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        cycle = " > ".join(str(t) for t in (*self.cycle, *self.cycle[:1]))
        return (
            f"observations     {len(self.prices)} of {self.prices.shape[1]} goods\n"
            f"consistent       {'yes' if self.is_consistent else f'no: {cycle}'}, at efficiency {self.efficiency:g}\n"
            f"efficiency index {_rounded_down(self.efficiency_index):g}"
        )


def revealed_preferences(prices: ArrayLike, choices: ArrayLike, *, efficiency: float = 1.0) -> RevealedPreferences:
    """Return whether choices at known prices maximise some utility, at which efficiency, and such a utility.

    Formula: GARP at efficiency e: x_t R x_s implies e p_s'x_s ≤ p_s'x_t; the index is the smallest, over cycles, of a cycle's
    largest spending ratio p_t'x_s / p_t'x_t, or 1; the utility is Afriat's, with the least Σλ unless ratios are so
    nearly tied that a linear programme cannot tell them apart.

    Args:
        prices: p_t, shape (T,U), at least 0.
        choices: x_t, shape (T,U), at least 0; each must cost something. Labelled rows and columns are put in the order of
            the prices'.
        efficiency: e, above 0 and at most 1.

    Raises:
        InputError: Shapes or labels differ, an entry is negative or not finite, a choice costs nothing, or
            `efficiency` is out of range.

    Cost: T² for each of log T graphs; a sparse linear programme of T² rows.

    Source: Afriat (1967); Varian (1982); the index: Afriat, On a System of Inequalities in Demand Analysis (1973).

    Example:
        >>> found = revealed_preferences([[2.0, 1.0], [1.0, 2.0]], [[2.0, 1.0], [1.0, 2.0]])
        >>> found.is_consistent, found.cycle, round(found.efficiency_index, 4)
        (False, (0, 1), 0.8)
    """
    axes = Axis("row", learns=True), Axis("good", learns=True)
    paid = validation.finite_array(prices, "prices", ndim=2, axes=axes)
    bought = validation.finite_array(choices, "choices", ndim=2, axes=axes)
    if paid.shape != bought.shape or not paid.size:
        raise InputError(f"prices have shape {paid.shape} and choices {bought.shape}; expected the same (T,U)")
    for name, values in (("prices", paid), ("choices", bought)):
        if values.min() < 0:
            t, j = np.argwhere(values < 0)[0]
            raise InputError(f"{name} has {values[t, j]:g} at index [{t}, {j}]; expected at least 0")
    share = validation.positive(efficiency, "efficiency")
    if share > 1:
        raise InputError(f"efficiency must be at most 1, got {share:g}")
    spent = (paid * bought).sum(axis=1)
    if spent.min() <= 0:
        raise InputError(f"choice {int(spent.argmin())} costs nothing at its prices")
    paid = paid / spent[:, None]
    ratios = _with_ties(paid @ bought.T, (1.0, share))
    cycle = _cycle(ratios, share)
    nothing = np.full(len(paid), np.nan)
    utilities, multipliers = (nothing, nothing) if cycle else _afriat_numbers(ratios, share)
    found = _index(ratios)
    return RevealedPreferences(paid, bought, share, not cycle, cycle, found, utilities, multipliers, axes[1].names)


def preference_problem(preferences: Sequence[RevealedPreferences], constraints: Polyhedron) -> PiecewiseLinearProblem:
    """Return the decision problem of an agent whose utility in each state is one that its choices revealed.

    Formula: c(i,x) = −U_i(x) over x ∈ C.

    Args:
        preferences: One result for each of X states, each consistent at its efficiency.
        constraints: The feasible set C in the goods' coordinates, such as a budget.

    Returns:
        A `PiecewiseLinearProblem`, for `consistent_beliefs` and every decision maker.

    Raises:
        InputError: Numbers of goods differ, or no preferences are given.
        ModelError: Some state's choices are inconsistent, or C is empty or lets utility grow without end.

    Cost: that of a linear problem with a row for each observation of each state. Source: Afriat (1967).

    Example:
        >>> import numpy as np
        >>> from inscrutable import Polyhedron
        >>> first = revealed_preferences([[1.0, 2.0], [2.0, 1.0]], [[2.0, 1.0], [1.0, 2.0]])
        >>> second = revealed_preferences([[1.0, 1.0]], [[3.0, 0.0]])
        >>> budget = Polyhedron(np.vstack([-np.eye(2), [1.0, 1.0]]), [0.0, 0.0, 3.0])
        >>> preference_problem([first, second], budget).n_states
        2
    """
    given = list(preferences) if isinstance(preferences, Iterable) else []
    if not given or not all(isinstance(each, RevealedPreferences) for each in given):
        raise InputError(f"preferences must be results of revealed_preferences, one per state, got {preferences!r}")
    goods = Axis("good", learns=True)
    slopes = [each.slopes[:, _columns(each, goods, i)] for i, each in enumerate(given)]
    region = constraints if goods.names is None else constraints.in_order(Axis("good", goods.names))
    return PiecewiseLinearProblem([-each for each in slopes], [-each.levels for each in given], region)


def _columns(preferences: RevealedPreferences, goods: Axis, i: int) -> Any:
    order = None if preferences.goods is None else goods.order(preferences.goods, f"preferences[{i}]")
    return slice(None) if order is None else order


def _with_ties(ratios: Array, values: Iterable[float]) -> Array:
    """Set ratios within rounding of one of the values to that value: such a choice is on the budget line, not below it."""
    for value in values:
        ratios = np.where(np.abs(ratios - value) <= tolerances.SAME_SPENDING * value, value, ratios)
    return ratios


def _rounded_down(value: float, *, strictly: bool = False) -> float:
    """Round a positive value down to six digits, with an allowance for rounding errors; `strictly`: to a number below it."""
    if not value > 0:
        return 0.0
    digits = Context(prec=6, rounding=ROUND_FLOOR)
    below = digits.create_decimal(repr(value * (1.0 + tolerances.SAME_SPENDING)))
    if strictly and float(below) >= value * (1.0 - 2.0 * tolerances.SAME_SPENDING):
        below = digits.next_minus(below)
    return float(below)


def _cycle(ratios: Array, efficiency: float) -> tuple[int, ...]:
    """The shortest cycle of preferences with a strict one in it, smallest number first; empty where there is none."""
    weak = _graph(ratios <= efficiency)
    part = connected_components(weak, connection="strong")[1]
    starts, ends = np.nonzero((ratios < efficiency) & (part[:, None] == part))
    best: tuple[int, ...] = ()
    for end in np.unique(ends):
        order, before = breadth_first_order(weak, int(end))
        mine = starts[ends == end]
        path = [int(order[np.isin(order, mine)][0])]  # nearest first
        while path[-1] != end:
            path.append(int(before[path[-1]]))
        if not best or len(path) < len(best):
            best = tuple(reversed(path))
    first = best.index(min(best)) if best else 0
    return best[first:] + best[:first]


def _index(ratios: Array) -> float:
    """The smallest r, at most 1, for which the preferences with ratios up to r have a cycle: bisection of the sorted ratios."""
    candidates = np.unique(ratios[ratios < 1.0])
    first, last = 0, len(candidates)
    while first < last:
        middle = (first + last) // 2
        parts = connected_components(_graph(ratios <= candidates[middle]), connection="strong")[0]
        if parts < len(ratios):
            last = middle
        else:
            first = middle + 1
    return float(candidates[first]) if first < len(candidates) else 1.0


def _graph(preferred: np.ndarray) -> Any:
    """The directed graph with an edge for each preference."""
    return sparse.csr_array(preferred.astype(np.float64))


def _afriat_numbers(ratios: Array, efficiency: float) -> tuple[Array, Array]:
    """Return u and λ ≥ 1 with u_s ≤ u_t + λ_t (e_ts − e); NaN where no floating-point numbers satisfy this.

    The numbers of the linear programme are smaller (a hundredth for 30 random choices near their index), but it cannot
    distinguish ratios within 1e-9 of e from e. Varian's numbers are exact to rounding, but grow with the number of near ties.
    """
    excess = ratios - efficiency
    for numbers in (_least_numbers, _numbers_in_order):
        with np.errstate(invalid="ignore", over="ignore"):
            utilities, multipliers = numbers(excess)
            steps = multipliers[:, None] * excess
            size = np.abs(utilities[:, None]) + np.abs(utilities) + np.abs(steps)
            holds = (utilities - utilities[:, None] - steps <= tolerances.STATIONARITY * size).all()
        if holds and np.isfinite(utilities).all() and np.isfinite(multipliers).all():
            return utilities, multipliers
    nothing = np.full(len(ratios), np.nan)
    return nothing, nothing


def _least_numbers(excess: Array) -> tuple[Array, Array]:
    """The numbers with u_0 = 0 and the least Σλ, by a linear programme; NaN where it fails."""
    count = len(excess)
    t, s = np.nonzero(~np.eye(count, dtype=bool))
    rows = np.arange(t.size)
    entries = np.concatenate([np.ones(t.size), -np.ones(t.size), -excess[t, s]])
    columns = np.concatenate([s, t, count + t])
    matrix: Any = sparse.csr_array((entries, (np.tile(rows, 3), columns)), shape=(t.size, 2 * count))
    free: list[tuple[float | None, float | None]] = [(0.0, 0.0), *[(None, None)] * (count - 1)]
    objective = np.concatenate([np.zeros(count), np.ones(count)])
    answer = minimise(objective, Rows(matrix, np.zeros(t.size)), None, [*free, *[(1.0, None)] * count])
    return answer.x[:count], answer.x[count:]


def _numbers_in_order(excess: Array) -> tuple[Array, Array]:
    """Varian's construction: the most preferred choices first, each with the largest u and the least λ that these allow."""
    number, part = connected_components(_graph(excess <= 0.0), connection="strong")
    above = np.zeros((number, number), dtype=bool)
    above[tuple(part[side] for side in np.nonzero(excess <= 0.0))] = True
    np.fill_diagonal(above, False)
    utilities, multipliers = np.zeros(len(excess)), np.ones(len(excess))
    done, left = np.zeros(0, dtype=np.int64), np.ones(number, dtype=bool)
    while left.any():
        own = int(np.flatnonzero(left & ~above[left].any(axis=0))[0])  # no choice left is preferred to it
        mine = np.flatnonzero(part == own)
        if done.size:
            limits = utilities[done, None] + multipliers[done, None] * np.minimum(excess[np.ix_(done, mine)], 0.0)
            utilities[mine] = limits.min()
            rises = (utilities[done] - limits.min()) / excess[np.ix_(mine, done)]
            multipliers[mine] = np.maximum(1.0, rises.max(axis=1))
        done, left[own] = np.append(done, mine), False
    return utilities, multipliers
