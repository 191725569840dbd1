"""Finitely many choices, as in detection, inspection and modes of operation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, depth, ordered_array
from inscrutable.errors import InputError
from inscrutable.problems.constraints import simplex
from inscrutable.problems.linear import LinearProblem
from inscrutable.validation import Array


class FiniteProblem(LinearProblem):
    """One of K choices, each with a cost per state.

    Formula: c(i,a) = costs[i,a] for a ∈ {0, …, K−1}; Π(a) = {π ∈ Δ_X : π·(s(a) − s(b)) ≤ 0 for every b}.

    A decision is a whole number. Internally it is the linear problem over the simplex of K shares, whose vertices are the
    choices: candidates hold shares (M,K), and results are whole numbers again. A mixture of tied choices
    (`decoy_grid(problem, r, faces=True)`) is an array of K shares: the frequencies of a repeated choice, or an amount divided
    among the choices. With such candidates a proof covers all shares, else the choices alone. `solve` returns the first of
    tied choices.

    Args:
        costs: Cost of each choice in each state, shape (X,K).

    Raises:
        InputError: The costs are not a table of finite numbers.

    Cost: one product per belief. Source: the paper, eq. (3), over finitely many decisions.

    Example:
        >>> problem = FiniteProblem([[0.0, 4.0], [10.0, 4.0]])  # state: sound or worn; choice: go on or repair
        >>> problem.solve([0.9, 0.1]), problem.solve([[0.9, 0.1], [0.5, 0.5]])
        (0, array([0, 1]))
        >>> print(problem.state_costs(1))
        [4. 4.]
    """

    def __init__(self, costs: ArrayLike) -> None:
        states, choices = Axis("state", learns=True), Axis("choice", learns=True)
        table = validation.finite_array(costs, "costs", ndim=2, axes=(states, choices))
        if not table.size:
            raise InputError(f"costs has shape {table.shape}, expected at least one state and one choice")
        super().__init__(table, simplex(table.shape[1]).in_order(choices))
        self.state_names = states.names

    is_discrete = True

    def _check_bounded(self) -> None:
        """A simplex is bounded."""

    def _with_costs(self, costs: Array) -> FiniteProblem:
        return FiniteProblem(costs)

    @property
    def n_choices(self) -> int:
        """Number of choices K."""
        return int(self.costs.shape[1])

    def solve(self, beliefs: ArrayLike) -> Any:
        """Return the cheapest choice, an int for one belief (X,), ints (T,) for many; the first of tied ones."""
        held = self.check_beliefs(beliefs)
        first = self.tied(held).argmax(axis=-1)
        return int(first) if held.ndim == 1 else first

    def tied(self, beliefs: ArrayLike) -> np.ndarray:
        """Return which choices are the cheapest, True at all tied ones: (K,) for one belief (X,), (T,K) for many."""
        held, costs = self.check_beliefs(beliefs), self.without_common_costs.costs
        expected = held @ costs
        # The sizes of what the sums add up, which may cancel; and the rounding of a common cost, if one was subtracted.
        scale, given = ((held @ np.abs(each)).max(axis=-1, keepdims=True) for each in (costs, self.costs))
        tolerance = np.maximum(tolerances.STATIONARITY * scale, tolerances.COST_ROUNDING * given)
        return np.asarray(expected <= expected.min(axis=-1, keepdims=True) + tolerance)

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return s(a) for choices of shape (…), or for shares (…,K): shape (…,X)."""
        given = self._given(actions)
        if given.dtype.kind in "iu":
            return np.asarray(self.costs.T[self._checked(given)])
        return super().state_costs(given)

    def as_points(self, actions: ArrayLike) -> Array:
        """Return shares (…,K): of whole numbers the corners of the simplex, of shares themselves."""
        given = self._given(actions)
        if given.dtype.kind in "iu":
            return np.asarray(np.eye(self.n_choices)[self._checked(given)])
        if given.ndim == 0:
            raise InputError(f"a choice must be a whole number from 0 to {self.n_choices - 1}, got {actions!r}")
        return super().as_points(given)

    def as_actions(self, points: Array) -> Any:
        """Return whole numbers where all shares (…,K) are corners, else the shares."""
        if points.dtype.kind in "iu":
            return int(points) if points.ndim == 0 else points
        if not ((points == 0) | (points == 1)).all():
            return points
        numbers = points.argmax(axis=-1)
        return int(numbers) if points.ndim == 1 else numbers

    def _given(self, actions: ArrayLike) -> Any:
        """Choices (…) as whole numbers, whose labels are those of rows, or shares (…,K)."""
        choices = np.asarray(actions) if depth(actions) < 2 else None
        if choices is not None and choices.dtype.kind in "iu":
            return choices
        return ordered_array(actions, "action", (Axis("choice", self.asset_names),))

    def _checked(self, choices: np.ndarray) -> np.ndarray:
        bad = choices[(choices < 0) | (choices >= self.n_choices)]
        if bad.size:
            raise InputError(f"choice {int(bad.flat[0])} does not exist: expected 0 to {self.n_choices - 1}")
        return choices

    def __repr__(self) -> str:
        return f"FiniteProblem({self.n_states} states, {self.n_choices} choices)"
