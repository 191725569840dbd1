"""The beliefs that explain a decision, in full precision or rounded.

A published decision ũ is the decision u* moved by rounding, |ũ_j − u*_j| ≤ h = ½·10^−d for d decimals. It is first projected to
the nearest feasible decision û, with the constraints that rounding can reach (a weight printed as zero) taken as active, unless
that leads farther away than U h. With δ = û − u* this gives the known bounds |δ_j| ≤ h_j = h + |û_j − ũ_j| and A_eq δ = 0.
Costs are convex, so for every belief π of the agent

    ρ(π,û) ≤ ε = max_i Σ_j |P ∇c(i,û)|_j h_j,  P the projector on A_eq δ = 0.

Where costs are quadratic and every constraint active at u* is active at û, the first-order term of the regret vanishes:

    ρ(π,û) = ½ δ'H_π δ ≤ ε = ½ max_i min( Σ_jk |P H_i P|_jk h_j h_k , λ_max(P H_i P) Σ_j h_j² ),

because H_π is an average of the H_i. The same holds under a limit Σ_j w_j |u_j − b_j| ≤ L. One that rounding cannot reach has
no multiplier at u*. One that it can reach is active at û, with û_j = b_j where rounding can reach b_j. No other term changes
sign between u* and û, so that the limit is a row there. Costs κ_j |u_j − b_j| of trades are linear between u* and û where no
b_j lies strictly between u*_j and û_j. Where one does, |û_j − b_j| ≤ h_j, and ε grows by 2 κ_j |û_j − b_j|.

The true belief therefore always lies in the near-optimal set Π_ε(û). A least regret above ε proves that no belief explains any
decision that rounds to this one.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple, overload

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import null_space

from inscrutable import tolerances, validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.adversaries.near_optimal import NearOptimalBeliefs, near_optimal_beliefs
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError, SolverError
from inscrutable.geometry import BeliefSet
from inscrutable.problems import DecisionProblem, Polyhedron, QuadraticProblem, checked_problem
from inscrutable.problems.forms import Lift
from inscrutable.problems.magnitudes import MagnitudeRegion
from inscrutable.problems.segments import MagnitudeLimit
from inscrutable.validation import Array


@overload
def consistent_beliefs(
    problem: DecisionProblem, action: ArrayLike, *, tolerance: float = ..., digits: None = None
) -> BeliefSet: ...


@overload
def consistent_beliefs(
    problem: DecisionProblem, action: ArrayLike, *, tolerance: float = ..., digits: int
) -> NearOptimalBeliefs: ...


def consistent_beliefs(
    problem: DecisionProblem,
    action: ArrayLike,
    *,
    tolerance: float = tolerances.EXPLAINED,
    digits: int | None = None,
) -> BeliefSet | NearOptimalBeliefs:
    """Return the beliefs for which `action` is optimal; with `digits`, those for which it was optimal before rounding.

    Formula: Π(u) = {π ∈ Δ_X : ∃ λ ≥ 0, ν : G(u)π + A_act'λ + A_eq'ν = 0}, where the active rows are those with less
    slack than the feasible set's `min_slack`; the multipliers are eliminated. With `digits` the result is the near-optimal set
    Π_ε(û), which contains all beliefs that explain a decision before rounding; this module's docstring derives ε.

    Args:
        problem: The decision problem that the observer knows.
        action: u, shape (U,), in the decision's unit; it must lie in the feasible set, up to rounding.
        tolerance: Largest KKT residual of a member, relative to the gradient's scale; above 0.
        digits: Digits after the point that the decision was rounded to, at least 0; None for full precision.

    Returns:
        A `BeliefSet`; empty where no belief explains the decision. With `digits` a `NearOptimalBeliefs` of the projected
        decision, whose `regret` bounds what rounding can cost.

    Raises:
        InputError: `action` has the wrong length, is not finite or lies outside the feasible set by more than rounding;
            `tolerance` ≤ 0; or `digits` for finite choices, which are whole numbers.

    Cost: one pseudo-inverse of the active rows; with `digits` some tens of forward solves at the first query. Source: the
    paper, Theorem 1 and eq. (4); this module's head.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.02, 0.03], [-0.03, 0.0]], [np.eye(2), 2 * np.eye(2)], 1.0)
        >>> consistent_beliefs(problem, problem.solve([0.3, 0.7])).contains([0.3, 0.7])
        True
        >>> consistent_beliefs(problem, problem.solve([0.3, 0.7]).round(3), digits=3).contains([0.3, 0.7])
        True
    """
    checked_problem(problem)
    kept = validation.positive(tolerance, "tolerance")
    if digits is None:
        return belief_set_of(problem, problem.check_action(action), kept)
    half = half_unit(validation.count(digits, "digits", least=0))
    if problem.is_discrete:
        raise InputError(f"choices of {problem!r} are whole numbers, which are not rounded: leave digits out")
    published = validation.finite_array(action, "action", ndim=1, axes=(Axis("asset", problem.asset_names),))
    if published.size != problem.n_actions:
        raise InputError(f"action has {published.size} coordinates, expected {problem.n_actions}")
    whole = completed(problem, published, half)
    if whole.adjustment > half * published.size:
        raise InputError(
            f"action is outside the feasible set by more than rounding to {digits} digits: the nearest decision differs by "
            f"{whole.adjustment:.3g}"
        )
    return near_optimal_beliefs(
        problem, whole.action, allowance(problem, whole, half + np.abs(whole.action - published))
    )


def half_unit(decimals: int) -> float:
    """Return h, the largest error of rounding to `decimals`."""
    return float(0.5 * 10.0**-decimals)


class Completed(NamedTuple):
    """A published row as a feasible decision; `on_face`: every constraint that rounding can reach is active, and each limit on
    magnitudes among them is a row between this decision and all that rounding can come from."""

    action: Array
    adjustment: float
    on_face: bool


def completed(problem: DecisionProblem, published: Array, half_unit: float) -> Completed:
    """Return the nearest feasible decision, on all constraints that rounding can reach where it is within U half units of them;
    then also without a trade where rounding can reach the former decision, if that is as near.

    A decision that is feasible as printed may be far from a point where all of them are active.
    """
    region = problem.constraints
    if half_unit == 0.0 and region.violation(published) <= 0.5 * tolerances.FEASIBILITY:
        return Completed(published, 0.0, True)
    kinks, rates = _kinks(problem)
    kinked = (rates > 0) & (np.abs(published - kinks) <= half_unit + tolerances.FEASIBILITY)
    for held in (kinked, np.zeros_like(kinked)) if kinked.any() else (kinked,):
        with suppress(ModelError, SolverError):  # a face that is empty, or within rounding of it
            face = _face(region, published, half_unit, np.where(held, kinks, np.nan))
            found = _changed(_nearest(face, published), published, on_face=True)
            if half_unit == 0.0 or found.adjustment <= half_unit * published.size:
                return found
    return _changed(_nearest(region, published), published, on_face=False)


def _kinks(problem: DecisionProblem) -> tuple[Array, Array]:
    """The kinks b (U,) of the costs, and their rates κ (U,): 0 where there are none."""
    lift, none = _lift(problem), np.zeros(problem.n_actions)
    return (none, none) if lift is None else (none + lift.kinks, none + lift.rates)


def _lift(problem: DecisionProblem) -> Lift | None:
    """The lift of the costs; that of the smooth form as well, where no search is possible between two kinks that are close."""
    form = problem.quadratic_form() or problem.smooth_form()
    return None if form is None else form.lift


def _face(region: Polyhedron, published: Array, half_unit: float, kinks: Array) -> Polyhedron:
    """The decisions on all constraints that rounding can reach, and at kinks (U,) of the costs, NaN for none, where no bound is
    near."""
    limits = region.limits if isinstance(region, MagnitudeRegion) else ()
    rows = region.rows if isinstance(region, MagnitudeRegion) else region
    reached = _reach(rows.A_ub, rows, published, half_unit) / rows.row_scale
    near = rows.slacks(published) <= reached + tolerances.FEASIBILITY
    bounds = near & (np.count_nonzero(rows.A_ub, axis=1) == 1)
    held = np.flatnonzero(~np.isnan(kinks) & ~rows.A_ub[bounds].any(axis=0))
    equal = [rows.A_eq, rows.A_ub[near], np.eye(published.size)[held]]
    sides = [rows.b_eq, rows.b_ub[near], kinks[held]]
    for limit in limits:
        row, side = _limit_rows(limit, rows, published, half_unit)
        equal.append(row)
        sides.append(side)
    face = Polyhedron(rows.A_ub[~near], rows.b_ub[~near], np.vstack(equal), np.concatenate(sides))
    return MagnitudeRegion(face, limits) if limits else face


def _limit_rows(limit: MagnitudeLimit, rows: Polyhedron, published: Array, half_unit: float) -> tuple[Array, Array]:
    """The limit as equalities (n,U) and their sides (n,) where rounding can reach it, else none.

    Each term that rounding can bring to zero is zero. The other terms do not change sign, and their sum is a row.
    """
    centers, edge = limit.centers, tolerances.FEASIBILITY
    lower, upper = rows.coordinate_bounds
    above, below = centers <= lower + edge, centers >= upper - edge
    zero = (limit.weights > 0) & ~above & ~below & (np.abs(published - centers) <= half_unit + edge)
    signs = np.where(above, 1.0, np.where(below, -1.0, np.sign(published - centers)))
    signed = np.where(zero, 0.0, signs * limit.weights)
    row = (signed.sum(axis=0) + limit.linear)[None]
    reach = _reach(row, rows, published, half_unit)[0] + half_unit * limit.weights[zero].sum()
    if limit.most - limit.used(published) > reach + edge * limit.weights.max():
        return np.zeros((0, published.size)), np.zeros(0)
    held = np.eye(published.size)[np.nonzero(zero)[1]]
    return np.vstack([row, held]), np.append(limit.most + (signed * centers).sum(), centers[zero])


def _reach(normals: Array, rows: Polyhedron, published: Array, half_unit: float) -> Array:
    """The most (n,) that rounding changes a'u for each of the normals a (n,U), which the equalities limit too.

    With r = b_eq − A_eq ũ and any multipliers y, a'(u* − ũ) = (a − A_eq'y)'(u* − ũ) + y'r; here y is that of least squares.
    """
    multipliers = np.linalg.lstsq(rows.A_eq.T, normals.T, rcond=None)[0]
    free = normals - multipliers.T @ rows.A_eq
    missed = np.abs(multipliers.T @ (rows.b_eq - rows.A_eq @ published))
    return np.asarray(
        np.minimum(half_unit * np.abs(normals).sum(axis=1), half_unit * np.abs(free).sum(axis=1) + missed)
    )


def _changed(action: Array, published: Array, *, on_face: bool) -> Completed:
    return Completed(action, float(np.abs(action - published).max()), on_face)


def _nearest(region: Polyhedron, point: Array) -> Array:
    projection = QuadraticProblem(np.eye(point.size)[None], -point[None], constraints=region)
    action = projection.solve(np.ones(1))
    # An asset that is not held must be printed as exactly 0, not as −0 or the rounding of a linear solve.
    return np.where(np.abs(action) <= tolerances.STATIONARITY, 0.0, action)


def allowance(problem: DecisionProblem, whole: Completed, reach: Array, *, is_optimal: bool = True) -> float:
    """Return ε of this module's docstring, for coordinates off by at most `reach` (U,), of an optimal decision or another."""
    equalities = problem.constraints.A_eq
    free = null_space(equalities) if len(equalities) else np.eye(reach.size)
    project = free @ free.T
    form, lift = problem.quadratic_form(), _lift(problem)
    hessians = lift.hessians if lift is not None else None if form is None else form.hessians
    if not (whole.on_face and is_optimal) or hessians is None:
        slopes = np.abs(problem.cost_gradients(whole.action) @ project)
        return float((slopes @ reach).max())
    worst = 0.0
    for hessian in hessians:
        curved = project @ hessian @ project
        largest = float(np.linalg.eigvalsh(curved)[-1]) * float(reach @ reach)
        worst = max(worst, min(float(reach @ np.abs(curved) @ reach), largest))
    kinks, rates = _kinks(problem)
    apart = np.abs(whole.action - kinks)
    return 0.5 * worst + 2.0 * float(rates @ np.where(apart <= reach + tolerances.FEASIBILITY, apart, 0.0))
