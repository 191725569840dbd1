"""What changing a decision costs: linear costs with their kink at the former decision, and quadratic ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.labels import Axis
from inscrutable.problems.base import DecisionProblem, SmoothForm
from inscrutable.problems.constraints import Polyhedron
from inscrutable.problems.quadratic import QuadraticProblem
from inscrutable.validation import Array


def with_transaction_costs(
    problem: QuadraticProblem, former: ArrayLike, *, linear: ArrayLike = 0.0, quadratic: ArrayLike = 0.0
) -> QuadraticProblem | TradingProblem:
    """Return a problem with the cost of changing the former decision added to every state's cost.

    Formula: c(i,u) + Σ_j κ_j |u_j − u⁰_j| + Σ_j η_j (u_j − u⁰_j)².

    Args:
        problem: The problem without these costs.
        former: u⁰, the former decision as the observer knows it, shape (U,).
        linear: κ ≥ 0, cost per unit traded, a number or one per coordinate (U,); labels are aligned with the problem's.
        quadratic: η ≥ 0, cost per squared unit traded, a number or (U,).

    Returns:
        A `QuadraticProblem` where κ is zero, else a `TradingProblem`.

    Raises:
        InputError: `problem` is not quadratic, a shape is wrong or a cost is negative.

    Cost: none. Source: linear costs keep their subdifferential: a multiplier in [−κ_j, κ_j] where u_j = u⁰_j.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> plain = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> trading = with_transaction_costs(plain, [0.5, 0.5], linear=0.02)
        >>> print(trading.solve([[0.5, 0.5], [0.55, 0.45], [1.0, 0.0]]).round(3))
        [[0.5  0.5 ]
         [0.5  0.5 ]
         [0.54 0.46]]
    """
    if not isinstance(problem, QuadraticProblem):
        raise InputError(f"transaction costs need a QuadraticProblem or MarkowitzProblem, got {problem!r}")
    assets = Axis("asset", problem.asset_names)
    held = validation.finite_array(former, "former", ndim=1, axes=(assets,))
    if held.size != problem.n_actions:
        raise InputError(f"former has {held.size} coordinates, expected {problem.n_actions}")
    bend = _rates(quadratic, held.size, "quadratic", assets)
    smooth = problem
    if bend.any():
        smooth = QuadraticProblem(
            problem.hessians + np.diag(2.0 * bend),
            problem.linear - 2.0 * bend * held,
            problem.constants + float(bend @ held**2),
            constraints=problem.constraints,
        )
        smooth.state_names = problem.state_names
    rates = _rates(linear, held.size, "linear", assets)
    return TradingProblem(smooth, held, rates) if rates.any() else smooth


def _rates(value: ArrayLike, size: int, name: str, assets: Axis) -> Array:
    given = validation.finite_array(value, name, ndim=(0, 1), axes=(assets,))
    if given.ndim == 1 and given.size != size:
        raise InputError(f"{name} has {given.size} entries, expected a number or one per coordinate: {size}")
    if (given < 0).any():
        raise InputError(f"{name} has {given.min():g}; a cost of trading must be at least 0")
    return np.array(np.broadcast_to(given, (size,)))


class TradingProblem(DecisionProblem):
    """Quadratic costs with a linear cost of trading away from the former decision; made by `with_transaction_costs`.

    Formula: c(i,u) + Σ_j κ_j |u_j − u⁰_j|. With u = u⁰ + p − m, p ≥ 0, m ≥ 0, it is the quadratic problem of cost
    c(i, u⁰ + p − m) + κ'(p + m), whose rows p_j ≥ 0 and m_j ≥ 0 are both tight where nothing is traded: what their two
    multipliers leave of κ_j is the subdifferential [−κ_j, κ_j]. A trade below the feasible set's `min_slack` counts as none.

    Args:
        problem: The costs without trading.
        former: u⁰, shape (U,).
        rates: κ ≥ 0, shape (U,), cost per unit traded.

    Raises:
        InputError: As `with_transaction_costs`.

    Cost: one active-set quadratic programme of up to 2U variables per belief. Source: Lobo, Fazel, Boyd, Portfolio
    Optimization with Linear and Fixed Transaction Costs (Annals of Operations Research 152, 2007).

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> plain = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> problem = TradingProblem(plain, [0.5, 0.5], [0.02, 0.02])
        >>> print(problem.state_costs([0.6, 0.4]).round(3))
        [0.404 0.444]
    """

    def __init__(self, problem: QuadraticProblem, former: ArrayLike, rates: ArrayLike) -> None:
        assets = Axis("asset", problem.asset_names)
        self.untraded = problem
        self.state_names = problem.state_names
        self.former = validation.finite_array(former, "former", ndim=1, axes=(assets,))
        self.rates = _rates(rates, problem.n_actions, "rates", assets)
        self.constraints = problem.constraints
        size = problem.n_actions
        # A coordinate that is traded for nothing has no kink, and one column.
        self._priced = np.flatnonzero(self.rates > 0)
        free = np.flatnonzero(self.rates == 0)
        unit = np.eye(size)
        self._columns = np.hstack([unit[:, self._priced], -unit[:, self._priced], unit[:, free]])
        price = np.concatenate([self.rates[self._priced], self.rates[self._priced], np.zeros(free.size)])
        self._lifted = QuadraticProblem(
            self._columns.T @ problem.hessians @ self._columns,
            problem.cost_gradients(self.former) @ self._columns + price,
            problem.state_costs(self.former),
            constraints=self._region(problem.constraints),
        )

    def _region(self, region: Polyhedron) -> Polyhedron:
        traded, count = 2 * self._priced.size, self._columns.shape[1]
        names = [f"{side} of u[{j}] >= 0" for side in ("purchase", "sale") for j in self._priced]
        n = len(region.b_ub)
        return Polyhedron(
            np.vstack([region.A_ub @ self._columns, -np.eye(count)[:traded]]),
            np.concatenate([region.b_ub - region.A_ub @ self.former, np.zeros(traded)]),
            region.A_eq @ self._columns,
            region.b_eq - region.A_eq @ self.former,
            names=[*region.names[:n], *names, *region.names[n:]],
            min_slack=region.min_slack,
        )

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return self.untraded.n_states

    @property
    def costs_are_unique(self) -> bool:
        """Whether the costs without trading are: what trading adds is the same in all states, and convex."""
        return self.untraded.costs_are_unique

    def solve(self, beliefs: ArrayLike) -> Array:
        """Return u*(π) for one belief (X,) or many (T,X), shape (U,) or (T,U); what is not traded is kept to the last digit."""
        actions = self.former + self._lifted.solve(self.check_beliefs(beliefs)) @ self._columns.T
        for limit in self.constraints.coordinate_bounds:
            actions = np.where(np.abs(actions - limit) <= tolerances.SAME_ACTION, limit, actions)
        return np.asarray(actions)

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return c(i,u) for decisions (…,U), trading included: shape (…,X)."""
        points = self.as_points(actions)
        return np.asarray(self.untraded.state_costs(points) + (np.abs(points - self.former) @ self.rates)[..., None])

    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return ∇_u c(i,u) for decisions (…,U), shape (…,X,U); at the kink the middle of the slopes."""
        points = self.as_points(action)
        slopes = self.rates * np.sign(points - self.former)
        return np.asarray(self.untraded.cost_gradients(points) + slopes[..., None, :])

    def smooth_form(self, actions: Array) -> SmoothForm:
        """Return the quadratic problem of purchases and sales, in which an observer counts as the kink what is tight."""
        trades = self.as_points(actions) - self.former
        priced = trades[..., self._priced]
        free = np.delete(trades, self._priced, axis=-1)
        points = np.concatenate([np.maximum(priced, 0.0), np.maximum(-priced, 0.0), free], axis=-1)
        return SmoothForm(self._lifted.constraints, points, self._lifted.cost_gradients)

    def __repr__(self) -> str:
        return f"TradingProblem({self.n_states} states, {self.n_actions} coordinates)"
