"""What changing a decision costs: linear costs with their kink at the former decision, and quadratic ones."""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.problems.base import DecisionProblem
from inscrutable.problems.constraints import Polyhedron, box
from inscrutable.problems.forms import Lift, QuadraticForm, SmoothForm
from inscrutable.problems.quadratic import QuadraticProblem, quadratic_problem
from inscrutable.validation import Array

_MOST_STRETCHED = 100.0
"""Times that a purchase or sale is stretched: its curvature shrinks by the square, and must not be taken for none."""


def with_transaction_costs(
    problem: DecisionProblem, former: ArrayLike, *, linear: ArrayLike = 0.0, quadratic: ArrayLike = 0.0
) -> QuadraticProblem | TradingProblem:
    """Return a problem with the cost of changing the former decision added to every state's cost.

    Formula: c(i,u) + Σ_j κ_j |u_j − u⁰_j| + Σ_j η_j (u_j − u⁰_j)².

    Args:
        problem: The problem without these costs, of quadratic ones in the decision itself.
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
    form = problem.quadratic_form() if isinstance(problem, DecisionProblem) else None
    if form is None or form.lift is not None:
        raise InputError(f"transaction costs need a QuadraticProblem or another with quadratic costs, got {problem!r}")
    smooth = cast(QuadraticProblem, quadratic_problem(problem))
    assets = Axis("asset", problem.asset_names)
    held = validation.finite_array(former, "former", ndim=1, axes=(assets,))
    if held.size != problem.n_actions:
        raise InputError(f"former has {held.size} coordinates, expected {problem.n_actions}")
    bend = _rates(quadratic, held.size, "quadratic", assets)
    if bend.any():
        smooth = QuadraticProblem(
            smooth.hessians + np.diag(2.0 * bend),
            smooth.linear - 2.0 * bend * held,
            smooth.constants + float(bend @ held**2),
            constraints=smooth.constraints,
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


def _gaps(distances: Array) -> Array:
    """Distances to bounds, those of rounding size as none."""
    return np.where(distances <= tolerances.FEASIBILITY, 0.0, distances)


class TradingProblem(DecisionProblem):
    """Quadratic costs with a linear cost of trading away from the former decision; made by `with_transaction_costs`.

    Formula: c(i,u) + Σ_j κ_j |u_j − u⁰_j|. With u = u⁰ + p − m, 0 ≤ p, 0 ≤ m, it is the quadratic problem of cost
    c(i, u⁰ + p − m) + κ'(p + m) + η_i p'm, whose rows p_j ≥ 0 and m_j ≥ 0 are both tight where nothing is traded: what their
    two multipliers leave of κ_j is the subdifferential [−κ_j, κ_j]. Nobody purchases and sells the same: p'm = 0, so that
    the last term costs nothing; with η_i, the least curvature of c(i,·), it makes the cost of (p, m) bend in all directions
    where that of u does, and what u_j may be bounds p_j and m_j alone. A trade below the feasible set's `min_slack` counts as
    none, but for one that ends at a bound.

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
        lower, upper = self.constraints.coordinate_bounds
        short, long = _gaps(self.former - lower), _gaps(upper - self.former)
        # A coordinate that is traded for nothing, or only one way, has no kink, and one column.
        self._kinked = np.flatnonzero((self.rates > 0) & (short > 0) & (long > 0))
        self._plain = np.setdiff1d(np.arange(size), self._kinked)
        kinked, plain, unit = self._kinked, self._plain, np.eye(size)
        least = self.constraints.min_slack * (1.0 + tolerances.SLACK_SAFETY)
        gaps = np.concatenate([long[kinked], short[kinked]])
        # A gap below the least slack is stretched to it: a sale of all that is held is admissible however little that was.
        self._stretch = np.clip(least / gaps, 1.0, _MOST_STRETCHED)
        self._is_searched = bool((self._stretch * gaps >= least).all())
        self._columns = np.hstack([unit[:, kinked] / self._stretch[: kinked.size],
                                   -unit[:, kinked] / self._stretch[kinked.size :], unit[:, plain]])  # fmt: skip
        rates = np.concatenate([self.rates[kinked], self.rates[kinked]]) / self._stretch
        one_way = np.where(short[plain] <= 0, self.rates[plain], -self.rates[plain])
        hessians = self._columns.T @ problem.hessians @ self._columns
        bends = np.maximum(np.linalg.eigvalsh(problem.hessians)[:, 0], 0.0)
        for j in range(kinked.size):
            both = [j, kinked.size + j]
            hessians[:, both, both[::-1]] += (bends / self._stretch[both].prod())[:, None]
        self._lifted = QuadraticProblem(
            hessians,
            problem.cost_gradients(self.former) @ self._columns + np.concatenate([rates, one_way]),
            problem.state_costs(self.former),
            constraints=self._region(problem.constraints, self._stretch * gaps),
        )

    def _region(self, region: Polyhedron, most: Array) -> Polyhedron:
        """The feasible purchases and sales: bounds on each, and the rows that combine coordinates."""
        lower, upper = (limit[self._plain] - self.former[self._plain] for limit in region.coordinate_bounds)
        wide = np.count_nonzero(region.A_ub, axis=1) > 1
        rows = Polyhedron(
            region.A_ub[wide] @ self._columns,
            region.b_ub[wide] - region.A_ub[wide] @ self.former,
            region.A_eq @ self._columns,
            region.b_eq - region.A_eq @ self.former,
            min_slack=region.min_slack,
        )
        bounds = np.concatenate([np.zeros(most.size), lower]), np.concatenate([most, upper])
        return rows & box(*bounds, min_slack=region.min_slack) if np.isfinite(bounds).any() else rows

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
        return self._traded(self._lifted.solve(self.check_beliefs(beliefs)))

    def state_costs(self, actions: ArrayLike) -> Array:
        """Return c(i,u) for decisions (…,U), trading included: shape (…,X)."""
        points = self.as_points(actions)
        return np.asarray(self.untraded.state_costs(points) + (np.abs(points - self.former) @ self.rates)[..., None])

    def cost_gradients(self, action: ArrayLike) -> Array:
        """Return ∇_u c(i,u) for decisions (…,U), shape (…,X,U); at the kink the middle of the slopes."""
        points = self.as_points(action)
        slopes = self.rates * np.sign(points - self.former)
        return np.asarray(self.untraded.cost_gradients(points) + slopes[..., None, :])

    def quadratic_form(self) -> QuadraticForm | None:
        """Return the quadratic problem of purchases and sales; None where a former decision lies so near to a bound, within
        a hundredth of the least slack, that selling all of it could not be told from rounding."""
        lifted = self._lifted
        lift = Lift(self._trades, self._traded)
        form = QuadraticForm(lifted.hessians, lifted.linear, lifted.constants, lifted.constraints, lift)
        return form if self._is_searched else None

    def smooth_form(self) -> SmoothForm:
        """Return the same with its gradients; an observer counts as the kink what is tight."""
        form = self._lifted.smooth_form()
        return SmoothForm(form.constraints, form.gradients, Lift(self._trades, self._traded), form.size)

    def _trades(self, actions: Array) -> Array:
        """Purchases, sales, and what has no kink, of decisions (…,U)."""
        trades = self.as_points(actions) - self.former
        kinked = trades[..., self._kinked]
        two_ways = np.concatenate([np.maximum(kinked, 0.0), np.maximum(-kinked, 0.0)], axis=-1) * self._stretch
        return np.concatenate([two_ways, trades[..., self._plain]], axis=-1)

    def _traded(self, variables: Array) -> Array:
        """The decisions (…,U) that trades lead to; what ends beside a bound by rounding is put on it."""
        actions = self.former + variables @ self._columns.T
        for limit in self.constraints.coordinate_bounds:
            actions = np.where(np.abs(actions - limit) <= tolerances.SAME_ACTION, limit, actions)
        return np.asarray(actions)

    def __repr__(self) -> str:
        return f"TradingProblem({self.n_states} states, {self.n_actions} coordinates)"
