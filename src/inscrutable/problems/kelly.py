"""Log-optimal growth: bets and portfolios that reveal beliefs by their shares of wealth."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise, minimum
from inscrutable.problems.base import DecisionProblem
from inscrutable.problems.constraints import Polyhedron, checked_region, simplex
from inscrutable.problems.copied_coordinates import Merged, merged_copies
from inscrutable.problems.newton import Model, minimise_smooth
from inscrutable.problems.quadratic import are_strictly_convex
from inscrutable.problems.quadratic_programme import Layout, layout_of
from inscrutable.validation import Array

_BLOCK_ENTRIES = 4_000_000


class KellyProblem(DecisionProblem):
    """Log-optimal (Kelly) investment: the shares of wealth with the largest long-run growth.

    Formula: c(i,u) = −Σ_s p_is log(r_is'u) over {u ≥ 0, 1'u = 1} unless constraints are given.

    In a horse race (r_is'u = odds × the share on the winner) whose winner is the state, u* = π for any odds, and the regret
    of betting y is the Kullback–Leibler divergence D(π‖y). Losing everything in an outcome of positive probability costs
    10,000 instead of infinity, so that under beliefs of less than about 3e-5 in its state ruin by leverage may seem to gain.
    Outcomes for which π_i p_is is positive and below 1e-10 are staked on as if it were 1e-10. From below 1e-7 on,
    `consistent_beliefs` may miss the belief behind a decision that depends on them, by rounding.

    Args:
        gross_returns: r_is, wealth after the period per unit of wealth on each asset, shape (X,S,U), at least 0.
        probabilities: p_is, of S outcomes in each state, shape (X,S), rows summing to one.
        constraints: The feasible set; None is `simplex(U)`.

    Raises:
        InputError: Shapes disagree, a return is negative, a row of probabilities does not sum to one.
        ModelError: The feasible set is empty, every decision in it loses everything in some outcome, or wealth grows without
            end in it.

    Cost: some ten quadratic programmes per belief. Source: Kelly, A New Interpretation of Information Rate (Bell System
    Technical Journal 35, 1956).

    Example:
        >>> odds = np.array([[[2.0, 0.0]], [[0.0, 2.0]]])  # two horses; the state is the winner
        >>> problem = KellyProblem(odds, [[1.0], [1.0]])
        >>> print(problem.solve([0.3, 0.7]).round(6))
        [0.3 0.7]
    """

    ruin_cost = 1e4
    """Cost of losing everything: above the logarithm of any float, so that the cost stays convex, and finite, so that it does
    not matter to beliefs that rule the loss out."""

    def __init__(
        self, gross_returns: ArrayLike, probabilities: ArrayLike, constraints: Polyhedron | None = None
    ) -> None:
        states, outcomes, assets = (Axis(what, learns=True) for what in ("state", "outcome", "asset"))
        self.gross_returns = validation.finite_array(
            gross_returns, "gross_returns", ndim=3, axes=(states, outcomes, assets)
        )
        self.probabilities = validation.stochastic_rows(probabilities, "probabilities", axes=(states, outcomes))
        n_states, n_outcomes, n_assets = self.gross_returns.shape
        if not self.gross_returns.size or self.probabilities.shape != (n_states, n_outcomes):
            raise InputError(
                f"gross_returns has shape {self.gross_returns.shape} and probabilities {self.probabilities.shape}; "
                "expected (X, S, U) and (X, S)"
            )
        if self.gross_returns.min() < 0:
            place = np.argwhere(self.gross_returns < 0)[0].tolist()
            raise InputError(
                f"gross_returns has {self.gross_returns.min():g} at {place}; expected wealth per unit staked, 1 + the return, "
                "at least 0"
            )
        region = simplex(n_assets) if constraints is None else constraints
        self.constraints = checked_region(region, n_assets, assets)
        self.state_names = states.names
        self._start = self._safest()
        if constraints is not None:  # a simplex is bounded
            self._check_bounded()

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return int(self.gross_returns.shape[0])

    def _safest(self) -> Array:
        """The decision whose wealth is largest in the worst outcome of positive probability."""
        region, size = self.constraints, self.gross_returns.shape[2]
        possible = self.probabilities > 0
        outcomes = self.gross_returns[possible]
        most = np.abs(outcomes).max(axis=1)
        if (most == 0).any():
            state, outcome = np.argwhere(possible)[int(most.argmin())]
            raise ModelError(
                f"every asset is worthless in outcome {outcome} of state {state}: no decision keeps any wealth"
            )
        # Wealth in units of the best asset's, and at most one so that the programme is bounded.
        worst = np.column_stack([-outcomes / most[:, None], np.ones(len(outcomes))])
        below = Rows(
            np.vstack([worst, np.column_stack([region.A_ub, np.zeros(len(region.b_ub))])]),
            np.concatenate([np.zeros(len(outcomes)), region.b_ub]),
        )
        equal = Rows(np.column_stack([region.A_eq, np.zeros(len(region.b_eq))]), region.b_eq)
        answer = minimum(np.append(np.zeros(size), -1.0), below, equal, [(None, None)] * size + [(None, 1.0)])
        if -answer.value <= tolerances.FEASIBILITY:
            loser = int((outcomes @ answer.x[:size] / most).argmin())
            state, outcome = np.argwhere(possible)[loser]
            raise ModelError(
                f"every decision loses everything in some outcome, the safest one in outcome {outcome} of state {state}: "
                "loosen the constraints or add an asset that pays there"
            )
        return answer.x[:size]

    def _check_bounded(self) -> None:
        """Raise `ModelError` if in some state a direction d of the feasible set loses in no outcome and gains in one."""
        region = self.constraints
        if all(np.isfinite(side).all() for side in region.coordinate_bounds):
            return
        for i, returns in enumerate(self.gross_returns):
            outcomes = returns[self.probabilities[i] > 0]
            count, size = outcomes.shape
            gains = np.column_stack([-outcomes / outcomes.max(), np.eye(count)])
            rows = np.column_stack([region.A_ub, np.zeros((len(region.b_ub), count))])
            held = np.column_stack([region.A_eq, np.zeros((len(region.b_eq), count))])
            answer = minimum(
                np.append(np.zeros(size), -np.ones(count)),
                Rows(np.vstack([gains, rows]), np.zeros(count + len(rows))),
                Rows(held, np.zeros(len(held))),
                [(None, None)] * size + [(0.0, 1.0)] * count,
            )
            if -answer.value > tolerances.FEASIBILITY:
                raise ModelError(f"wealth in state {i} grows without end over the feasible set: add bounds")

    @cached_property
    def best_returns(self) -> Array:
        """The largest return of an asset in each outcome, shape (X,S); 1 where all are worthless."""
        best = self.gross_returns.max(axis=2)
        return np.where(best > 0, best, 1.0)

    @cached_property
    def scaled_returns(self) -> Array:
        """Returns as shares of the best asset's, shape (X,S,U): the unit of an outcome's returns changes no decision."""
        return self.gross_returns / self.best_returns[:, :, None]

    @cached_property
    def largest_wealth(self) -> Array:
        """The largest wealth in each outcome, max_{u ∈ C} r_k'u, shape (X·S,); 0 where there is no limit, and in all outcomes
        where some decision loses more than everything."""
        region = self.constraints
        if not self._all_keep(0.0):
            return np.zeros(self.probabilities.size)
        below, equal = Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq)
        found = [minimise(-returns, below, equal) for returns in self.gross_returns.reshape(-1, self.n_actions)]
        return np.array([-each.value if each.status == OPTIMAL else 0.0 for each in found])

    @cached_property
    def costs_are_unique(self) -> bool:
        """Whether the wealth in each single state's outcomes determines it in all outcomes, and no decision can lose all of it.

        The logarithm is strictly concave in wealth, so that all optimal decisions have the same wealth in every outcome of
        positive probability. A belief may be certain of one state; decisions with the same wealth in that state's outcomes
        must then have the same wealth in all outcomes.
        """
        scaled = self.scaled_returns
        hessians = np.einsum("xs,xsu,xsv->xuv", self.probabilities, scaled, scaled)
        possible = scaled[self.probabilities > 0]
        if not are_strictly_convex(hessians, possible, self.constraints.A_eq):
            return False
        # Near ruin costs are so large that other costs are lost to rounding.
        return self._all_keep(tolerances.LEAST_WEALTH)

    def _all_keep(self, share: float) -> bool:
        """Whether all decisions keep this share of the best asset's wealth in every outcome of positive probability."""
        region, possible = self.constraints, self.scaled_returns[self.probabilities > 0]
        lowest = region.coordinate_bounds[0]
        # Bounds that show it, as those of any simplex, save 1.4 ms an outcome.
        if np.isfinite(lowest).all() and (possible @ lowest >= share).all():
            return True
        below, equal = Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq)
        found = (minimise(returns, below, equal) for returns in possible)
        return all(each.status == OPTIMAL and each.value >= share for each in found)

    @cached_property
    def _merged(self) -> Merged | None:
        """The feasible set with only the first of each group of copies; None where there are no copies."""
        return merged_copies(self.scaled_returns[self.probabilities > 0], self.constraints)

    @cached_property
    def without_copies(self) -> KellyProblem:
        """The problem with only the first of each group of assets with equal returns; itself where there are no copies."""
        if self._merged is None:
            return self
        return KellyProblem(self.gross_returns[:, :, self._merged.kept], self.probabilities, self._merged.constraints)

    def with_copies(self, actions: Array) -> Array:
        """Return decisions (…,F) of the problem without copies as decisions (…,U) of this one."""
        return actions if self._merged is None else self._merged.decisions(actions)

    @cached_property
    def _layout(self) -> Layout:
        return layout_of(self.constraints)

    def solve(self, beliefs: ArrayLike) -> Array:
        """Return u*(π) for one belief (X,) or many (T,X), shape (U,) or (T,U)."""
        held = self.check_beliefs(beliefs)
        if self._merged is not None:  # of tied decisions the one with a single copy, as for quadratic costs
            return self.with_copies(self.without_copies.solve(held))
        rows = np.atleast_2d(held)
        solved = np.empty((len(rows), self.n_actions))
        step = max(1, _BLOCK_ENTRIES // (self.probabilities.size * self.n_actions))
        for first in range(0, len(rows), step):
            block = rows[first : first + step]
            starts = np.tile(self._start, (len(block), 1))
            solved[first : first + step] = minimise_smooth(_Growth(self), block, starts, self._layout)
        return np.asarray(solved[0]) if held.ndim == 1 else solved

    def wealth(self, actions: ArrayLike) -> Array:
        """Return r_is'u, wealth after the period in every outcome, for decisions (…,U): shape (…,X,S)."""
        return np.asarray(np.einsum("xsu,...u->...xs", self.gross_returns, self.as_points(actions)))

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return c(i,u) for decisions (…,U): shape (…,X)."""
        wealth = self.wealth(actions)
        costs = -(self.probabilities * np.log(np.where(wealth > 0, wealth, 1.0))).sum(axis=-1)
        # However rare the outcome: with leverage, ruin times a small probability would cost less than it gains.
        is_lost = ((self.probabilities > 0) & (wealth <= 0)).any(axis=-1)
        return np.asarray(np.where(is_lost, self.ruin_cost, costs))

    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return −Σ_s p_is r_is / (r_is'u) for decisions (…,U), shape (…,X,U); wealth below a millionth of p_is times the best
        asset's counts as that."""
        least = np.maximum(tolerances.LEAST_WEALTH * self.best_returns * self.probabilities, tolerances.TINY)
        shares = self.probabilities / np.maximum(self.wealth(action), least)
        return np.asarray(-np.einsum("...xs,xsu->...xu", shares, self.gross_returns))

    def __repr__(self) -> str:
        n_states, n_outcomes, n_assets = self.gross_returns.shape
        return f"KellyProblem({n_states} states, {n_outcomes} outcomes, {n_assets} assets)"


class _Growth:
    """Expected costs under beliefs: outcomes have the weight π_i p_is."""

    def __init__(self, problem: KellyProblem) -> None:
        self._probabilities = problem.probabilities
        self._returns = problem.gross_returns.reshape(-1, problem.n_actions)  # (K, U)
        self._most = problem.largest_wealth

    def _weights(self, held: Array) -> Array:
        weights = (held[:, :, None] * self._probabilities).reshape(len(held), -1)
        return np.where(weights > 0, np.maximum(weights, tolerances.LEAST_WEIGHT), 0.0)

    def values(self, held: Array, points: Array) -> Array:
        """Return −Σ w_k log(r_k'u), infinite where an outcome of positive weight loses everything."""
        weights, wealth = self._weights(held), points @ self._returns.T
        lost = ((weights > 0) & (wealth <= 0)).any(axis=1)
        logs = np.log(np.where((weights > 0) & (wealth > 0), wealth, 1.0))
        return np.where(lost, np.inf, -(weights * logs).sum(axis=1))

    def model(self, held: Array, points: Array) -> Model:
        """Return value, gradient and Hessian."""
        weights, wealth = self._weights(held), points @ self._returns.T
        matters = weights > 0
        wealth = np.where(matters, wealth, 1.0)
        first = weights / wealth
        curved = (first / wealth)[:, :, None] * self._returns
        return Model(
            -(weights * np.log(wealth)).sum(axis=1), -(first @ self._returns), curved.transpose(0, 2, 1) @ self._returns
        )

    def longest_steps(self, held: Array, points: Array, steps: Array) -> Array:
        """Return shares that keep a hundredth of the wealth of every outcome, and half of the optimum's lower bound: there
        Σ w_k r_k'v / r_k'u ≤ 1 for every v in C, so r_k'u ≥ w_k max_v r_k'v where no v loses more than everything."""
        weights, wealth, change = self._weights(held), points @ self._returns.T, steps @ self._returns.T
        least = np.minimum(np.maximum(0.01 * wealth, 0.5 * weights * self._most), wealth)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.where((weights > 0) & (change < 0), (wealth - least) / -change, np.inf).min(axis=1)
        return np.asarray(np.minimum(reach, 1.0))
