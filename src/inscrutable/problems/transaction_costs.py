"""Costs of changing a decision: linear ones with their kink at the former decision, and quadratic ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.problems.base import DecisionProblem
from inscrutable.problems.forms import QuadraticForm, SmoothForm
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.problems.quadratic import QuadraticProblem, lifted_costs, quadratic_problem
from inscrutable.problems.segments import Segments
from inscrutable.validation import Array


def with_transaction_costs(
    problem: DecisionProblem, former: ArrayLike, *, linear: ArrayLike = 0.0, quadratic: ArrayLike = 0.0
) -> QuadraticProblem | TradingProblem:
    """Return a problem with the cost of changing the former decision added to every state's cost.

    Formula: c(i,u) + Σ_j κ_j |u_j − u⁰_j| + Σ_j η_j (u_j − u⁰_j)².

    Args:
        problem: The problem without these costs; its own costs are quadratic in the decision.
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
    smooth = _unlifted(problem)
    if smooth is None:
        raise InputError(f"transaction costs need a QuadraticProblem or another with quadratic costs, got {problem!r}")
    assets = Axis("asset", problem.asset_names)
    held = _held(former, problem.n_actions, assets)
    impact = _rates(quadratic, held.size, "quadratic", assets)
    if impact.any():
        smooth = QuadraticProblem(
            smooth.hessians + np.diag(2.0 * impact),
            smooth.linear - 2.0 * impact * held,
            smooth.constants + float(impact @ held**2),
            constraints=smooth.constraints,
        )
        smooth.state_names = problem.state_names
    rates = _rates(linear, held.size, "linear", assets)
    return TradingProblem(smooth, held, rates) if rates.any() else smooth


def _unlifted(problem: DecisionProblem) -> QuadraticProblem | None:
    """The quadratic problem in the decision itself, None where there is none."""
    if isinstance(problem, QuadraticProblem):
        return problem if problem.has_these_costs else None
    form = problem.quadratic_form() if isinstance(problem, DecisionProblem) else None
    return None if form is None or form.lift is not None else quadratic_problem(problem)


def _held(former: ArrayLike, size: int, assets: Axis) -> Array:
    held = validation.finite_array(former, "former", ndim=1, axes=(assets,))
    if held.size != size:
        raise InputError(f"former has {held.size} coordinates, expected {size}")
    return held


def _rates(value: ArrayLike, size: int, name: str, assets: Axis) -> Array:
    given = validation.finite_array(value, name, ndim=(0, 1), axes=(assets,))
    if given.ndim == 1 and given.size != size:
        raise InputError(f"{name} has {given.size} entries, expected a number or one per coordinate: {size}")
    if (given < 0).any():
        raise InputError(f"{name} has {given.min():g}; a cost of trading must be at least 0")
    return np.array(np.broadcast_to(given, (size,)))


class TradingProblem(DecisionProblem):
    """Quadratic costs plus a linear cost of trades from the former decision; `with_transaction_costs` makes it.

    Formula: c(i,u) + Σ_j κ_j |u_j − u⁰_j|. With u = u⁰ + p − m, 0 ≤ p, 0 ≤ m, it is the quadratic problem of cost
    c(i, u⁰ + p − m) + κ'(p + m) + η_i p'm. Where nothing is traded the rows p_j ≥ 0 and m_j ≥ 0 are both tight, and their
    multipliers give the subdifferential [−κ_j, κ_j]. No coordinate is both purchased and sold, so that the last term is zero;
    with η_i, the least curvature of c(i,·), it makes the cost of (p, m) strictly convex where that of u is. A trade below the
    feasible set's `min_slack` counts as none, unless it ends at a bound.

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
        if not isinstance(problem, QuadraticProblem):
            raise InputError(
                f"problem must be a QuadraticProblem, got {problem!r}; with_transaction_costs takes others with quadratic costs"
            )
        assets = Axis("asset", problem.asset_names)
        self.untraded = problem
        self.state_names = problem.state_names
        self.former = _held(former, problem.n_actions, assets)
        self.rates = _rates(rates, problem.n_actions, "rates", assets)
        self.constraints = problem.constraints
        # A coordinate without trading cost, or traded only one way, has no kink.
        limits = self.constraints.limits if isinstance(self.constraints, MagnitudeRegion) else ()
        rows = self.constraints.rows if isinstance(self.constraints, MagnitudeRegion) else self.constraints
        segments = Segments(rows, [np.where(self.rates > 0, self.former, np.nan)], limits)
        self._lifted = lifted_costs(problem, segments, self.rates, self.former)

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return self.untraded.n_states

    @property
    def costs_are_unique(self) -> bool:
        """Whether the costs without trading are: the cost of trading is convex and the same in all states."""
        return self.untraded.costs_are_unique

    def solve(self, beliefs: ArrayLike) -> Array:
        """Return u*(π) for one belief (X,) or many (T,X), shape (U,) or (T,U); untraded coordinates keep u⁰ exactly, or the
        breakpoint of a limit within 1e-9 of it."""
        return self._lifted.lift.decisions(self._lifted.problem.solve(self.check_beliefs(beliefs)))

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
        """Return the quadratic problem of purchases and sales; None where a former decision lies within a hundredth of the
        least slack of a bound, too near to tell a sale of all of it from rounding."""
        return self._lifted.quadratic_form()

    def smooth_form(self) -> SmoothForm:
        """Return the same with its gradients; an observer counts a tight row as the kink."""
        return self._lifted.smooth_form()

    def __repr__(self) -> str:
        return f"TradingProblem({self.n_states} states, {self.n_actions} coordinates)"
