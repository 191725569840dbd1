"""Contract checker for decision problems: the library relies on these promises."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.adversaries.plausibility import nearest_explanation
from inscrutable.problems import (
    DecisionProblem,
    LinearForm,
    QuadraticForm,
    SmoothForm,
    checked_problem,
    quadratic_problem,
)
from inscrutable.testing.promises import INTERIOR, check_shape, promise, source_of, tried_actions, tried_beliefs
from inscrutable.validation import Array

_STEPS_ON_A_RAY = 9


class _Sample(NamedTuple):
    """The beliefs and decisions on which a problem is tried."""

    problem: DecisionProblem
    beliefs: Array  # (n, X): corners, faces and the interior
    solved: Array  # (n, U)
    actions: Array  # (m, U): feasible decisions, none of them optimal on purpose
    scale: float  # of the costs
    rng: np.random.Generator
    allowed: float  # tolerance of a promise about costs


def check_decision_problem(
    problem: DecisionProblem, *, rng: np.random.Generator | None = None, tolerance: float = tolerances.CONTRACT
) -> None:
    """Check on random beliefs and decisions that a problem keeps its promises; silent where it does.

    The promises are:

    - the shapes for one and many decisions are right;
    - costs are finite, and convex on segments;
    - gradients agree with differences of the costs;
    - `solve` returns feasible decisions of least cost, with a small KKT residual;
    - the optimal cost is concave in the belief;
    - regret does not decrease along a ray from the true belief;
    - a belief explains its optimal decision; a decision is optimal for the beliefs that explain it; a decision without an
      explanation has positive regret under every belief;
    - forms that the problem returns have its costs, slopes and optimal decisions.

    Args:
        problem: The decision problem, from this library or written by a user.
        rng: Source of the beliefs and decisions; None: a fixed seed, the same at every call.
        tolerance: Tolerance of the promises about costs, relative to their scale, above 0; pass more than the default for a
            less exact solver.

    Raises:
        AssertionError: A promise is broken; the message names it, with the belief or decision and the number.
        InputError: `problem` is not a decision problem, or `tolerance` is not above 0.

    Cost: some hundred forward solves. Source: the paper, eq. (3) and Theorem 1; regret is the Bregman divergence of the optimal
    cost, which does not decrease along a ray.

    Example:
        >>> from inscrutable import FiniteProblem
        >>> check_decision_problem(FiniteProblem([[0.0, 4.0], [10.0, 4.0]]))
    """
    source = source_of(rng)
    _check_shapes(checked_problem(problem))
    sample = _sample_of(problem, source, validation.positive(tolerance, "tolerance"))
    _check_costs(sample)
    if not problem.is_discrete:
        _check_convexity(sample)
        _check_gradients(sample)
    _check_forms(sample)
    _check_optimality(sample)
    _check_explanations(sample)
    _check_rays(sample)


def _check_shapes(problem: DecisionProblem) -> None:
    n_states, n_actions = problem.n_states, problem.n_actions
    check_shape("constraints.n_actions", (problem.constraints.n_actions,), (n_actions,))
    middle = np.full(n_states, 1.0 / n_states)
    one, many = np.asarray(problem.solve(middle)), np.asarray(problem.solve(np.tile(middle, (3, 1))))
    own = () if problem.is_discrete else (n_actions,)
    check_shape("solve(belief)", one.shape, own)
    check_shape("solve(beliefs)", many.shape, (3, *own))
    for name, action, lead in (("action", problem.as_points(one), ()), ("actions", problem.as_points(many), (3,))):
        check_shape(f"state_costs({name})", np.shape(problem.state_costs(action)), (*lead, n_states))
        check_shape(f"cost_gradients({name})", np.shape(problem.cost_gradients(action)), (*lead, n_states, n_actions))


def _sample_of(problem: DecisionProblem, rng: np.random.Generator, tolerance: float) -> _Sample:
    beliefs = tried_beliefs(problem.n_states, rng)
    solved = problem.solve_points(beliefs)
    actions = tried_actions(problem, solved, rng)
    scale = float(np.abs(problem.state_costs(np.vstack([solved[:INTERIOR], actions]))).max())
    scale = max(scale, np.finfo(float).tiny)
    return _Sample(problem, beliefs, solved, actions, scale, rng, tolerance * scale)


def _check_costs(sample: _Sample) -> None:
    problem = sample.problem
    together = problem.state_costs(sample.actions)
    promise(bool(np.isfinite(together).all()), "state costs are finite", f"found {together[~np.isfinite(together)]}")
    apart = np.array([problem.state_costs(action) for action in sample.actions])
    off = float(np.abs(together - apart).max())
    promise(
        off <= sample.allowed,
        "many decisions cost what each costs alone",
        f"they differ by {off:.3g}",
    )


def _check_convexity(sample: _Sample) -> None:
    problem, rng = sample.problem, sample.rng
    first, second = rng.permutation(sample.actions), sample.actions
    shares = rng.uniform(size=(len(first), 1))
    middle = problem.state_costs(shares * first + (1 - shares) * second)
    chord = shares * problem.state_costs(first) + (1 - shares) * problem.state_costs(second)
    excess = middle - chord
    row, state = np.unravel_index(int(excess.argmax()), excess.shape)
    promise(
        float(excess.max()) <= sample.allowed,
        "state costs are convex",
        f"the cost of state {state} lies {excess.max():.3g} above the chord between {first[row]} and {second[row]}",
    )
    if getattr(problem, "strictly_convex", False):
        apart = np.abs(first - second).max(axis=1) > tolerances.MIN_SLACK
        level = excess[apart].max(initial=-np.inf)
        promise(
            float(level) < -tolerances.EXACT_COST * sample.scale,
            "costs declared strictly convex lie below their chords",
            f"one lies {-level:.3g} below",
        )


def _check_gradients(sample: _Sample) -> None:
    """Check that a gradient, or a subgradient at a kink, never overestimates the cost a small step away."""
    problem, rng = sample.problem, sample.rng
    gradients, costs = problem.cost_gradients(sample.actions), problem.state_costs(sample.actions)
    steps = rng.permutation(sample.actions) - sample.actions
    for size in (tolerances.DIFFERENCE, -tolerances.DIFFERENCE):
        ahead = problem.state_costs(sample.actions + size * steps)
        slopes = np.einsum("mxu,mu->mx", gradients, steps)
        lacking = (costs + size * slopes - ahead) / tolerances.DIFFERENCE
        row, state = np.unravel_index(int(lacking.argmax()), lacking.shape)
        limit = tolerances.SLOPE * max(sample.scale, float(np.abs(slopes).max()))
        promise(
            float(lacking.max()) <= limit,
            "cost_gradients are the slopes of state_costs",
            f"at {sample.actions[row]} the slope of state {state} along {steps[row]} is {slopes[row, state]:.6g}, by "
            f"differences {(ahead - costs)[row, state] / size:.6g}",
        )


def _check_forms(sample: _Sample) -> None:
    """Check that a returned form has the same costs, slopes and decisions."""
    problem = sample.problem
    linear, quadratic, smooth = problem.linear_form(), problem.quadratic_form(), problem.smooth_form()
    for name, form in (("linear_form", linear), ("quadratic_form", quadratic), ("smooth_form", smooth)):
        if form is not None:
            _check_lift(sample, name, form)
    if linear is not None:
        shape = (problem.n_states, linear.constraints.n_actions)
        check_shape("linear_form().costs", np.shape(linear.costs), shape)
        _check_slopes(sample, "linear_form", linear, np.broadcast_to(linear.costs, (len(sample.actions), *shape)))
        values = linear.variables(sample.actions) @ linear.costs.T - problem.state_costs(sample.actions)
        _same(sample, "linear_form", "costs up to a constant in every state", values - values[:1])
    stated = quadratic_problem(problem)
    if quadratic is not None and stated is not None:
        check_shape("quadratic_form().linear", stated.linear.shape, (problem.n_states, stated.n_actions))
        variables = quadratic.variables(sample.actions)
        _same(sample, "quadratic_form", "costs", stated.state_costs(variables) - problem.state_costs(sample.actions))
        _check_slopes(sample, "quadratic_form", quadratic, stated.cost_gradients(variables))
        best = problem.state_costs(quadratic.decisions(stated.solve(sample.beliefs)))
        _same(
            sample,
            "quadratic_form",
            "least costs",
            (sample.beliefs * (best - problem.state_costs(sample.solved))).sum(1),
        )
    if smooth is not None:
        _check_slopes(sample, "smooth_form", smooth, smooth.gradients(smooth.variables(sample.actions)))


def _same(sample: _Sample, name: str, what: str, apart: Array) -> None:
    off = float(np.abs(apart).max())
    promise(off <= sample.allowed, f"{name} has the {what} of the problem", f"they differ by {off:.3g}")


def _check_lift(sample: _Sample, name: str, form: QuadraticForm | LinearForm | SmoothForm) -> None:
    """Check that lifted variables are feasible and map back to their decisions."""
    variables = form.variables(sample.actions)
    beyond = float(np.max(form.constraints.violation(variables)))
    promise(beyond <= tolerances.FEASIBILITY, f"{name} has feasible variables", f"a row is violated by {beyond:.3g}")
    off = float(np.abs(form.decisions(variables) - sample.actions).max())
    promise(off <= tolerances.FEASIBILITY, f"{name} leads back to decisions", f"they differ by {off:.3g}")


def _check_slopes(sample: _Sample, name: str, form: QuadraticForm | LinearForm | SmoothForm, slopes: Array) -> None:
    """Check the slopes of a form in the decision's own variables, along segments between decisions."""
    if form.lift is not None:
        return
    steps = sample.actions - sample.actions[::-1]
    apart = np.einsum("mxu,mu->mx", slopes - sample.problem.cost_gradients(sample.actions), steps)
    size = max(sample.scale, float(np.abs(np.einsum("mxu,mu->mx", slopes, steps)).max()))
    off = float(np.abs(apart).max())
    promise(off <= tolerances.SLOPE * size, f"{name} has the slopes of cost_gradients", f"they differ by {off:.3g}")


def _check_optimality(sample: _Sample) -> None:
    problem = sample.problem
    beyond = problem.constraints.violation(sample.solved)
    worst = int(beyond.argmax())
    promise(
        float(beyond[worst]) <= tolerances.FEASIBILITY,
        "solve returns feasible decisions",
        f"for belief {sample.beliefs[worst]} a row is violated by {beyond[worst]:.3g}",
    )
    alone = np.array([problem.solve_points(belief) for belief in sample.beliefs])
    off = np.abs(sample.beliefs * (problem.state_costs(alone) - problem.state_costs(sample.solved))).sum(axis=1)
    promise(
        float(off.max()) <= sample.allowed,
        "many beliefs are solved as each alone",
        f"for belief {sample.beliefs[int(off.argmax())]} the costs differ by {off.max():.3g}",
    )
    optimal = (sample.beliefs * problem.state_costs(sample.solved)).sum(axis=1)
    gain = optimal[:, None] - sample.beliefs @ problem.state_costs(np.vstack([sample.actions, sample.solved])).T
    row, other = np.unravel_index(int(gain.argmax()), gain.shape)
    promise(
        float(gain.max()) <= sample.allowed,
        "no feasible decision is cheaper than solve's",
        f"for belief {sample.beliefs[row]} decision {np.vstack([sample.actions, sample.solved])[other]} is cheaper by "
        f"{gain.max():.3g}",
    )


def _check_explanations(sample: _Sample) -> None:
    problem = sample.problem
    for belief, action in zip(sample.beliefs, sample.solved, strict=True):
        found = belief_set_of(problem, action)
        residual = float(found.violation(belief))
        promise(
            residual <= tolerances.EXPLAINED * 10,
            "a belief explains the decision it leads to",
            f"belief {belief} leaves {action} a KKT residual of {residual:.3g}, relative to the gradient's scale; "
            "costs with kinks have no gradients there, and need `explaining_rows` of their own",
        )
    for action in sample.actions:
        found = belief_set_of(problem, action)
        own = problem.state_costs(action)
        if found.is_empty:
            least = nearest_explanation(problem, action)[1]
            # The least regret has an accuracy relative to the differences of decisions.
            apart = float(np.abs(own - problem.state_costs(sample.solved[:INTERIOR])).max())
            promise(
                least > tolerances.GAP_STEP * apart,
                "what no belief explains leaves every belief a regret",
                f"{action} leaves {least:.3g}",
            )
            continue
        for corner in found.vertices():
            regret = float(corner @ (own - problem.state_costs(problem.solve_points(corner))))
            # A slack below the least counts as zero, so the set is slightly larger than that of the decision.
            slack = problem.constraints.min_slack * np.abs(problem.cost_gradients(action)).max() * action.size
            promise(
                regret <= slack + sample.allowed,
                "what a belief explains is optimal for it",
                f"{action} leaves belief {corner} a regret of {regret:.3g}",
            )


def _check_rays(sample: _Sample) -> None:
    problem, rng = sample.problem, sample.rng
    shares = np.linspace(0.0, 1.0, _STEPS_ON_A_RAY)[:, None]
    for belief, end in zip(sample.beliefs, rng.permutation(sample.beliefs), strict=True):
        decoys = belief + shares * (end - belief)
        solved = problem.solve_points(decoys)
        values = (decoys * problem.state_costs(solved)).sum(axis=1)
        excess = 0.5 * (values[:-2] + values[2:]) - values[1:-1]
        promise(
            float(excess.max()) <= sample.allowed,
            "the optimal cost is concave in the belief",
            f"between {belief} and {end} it lies {excess.max():.3g} below its chord",
        )
        costs = problem.state_costs(solved) @ belief
        falls = -np.diff(costs)
        limit = sample.allowed * max(1.0, float(np.abs(costs).max()) / sample.scale)
        promise(
            float(falls.max()) <= limit,
            "regret never falls along a ray from the true belief",
            f"from {belief} to {end} it falls by {falls.max():.3g} after decoy {decoys[int(falls.argmax())]}",
        )
