"""The belief of least regret for a decision, with a proof that no belief has less.

The least regret over beliefs equals the saving that one other decision achieves in every state: costs are convex, so
min over beliefs of the largest saving equals max over decisions of the least saving (von Neumann).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances
from inscrutable.adversaries.inverse import belief_set_of, smooth_form_of
from inscrutable.adversaries.plausibility import closed_planes, weights_of_planes
from inscrutable.errors import InputError
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems import DecisionProblem, SmoothForm, checked_problem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array

_MOST_LISTED = 6
_MUCH = 0.01
"""Changes of coordinates below this share of the largest change are not listed."""


@dataclass(frozen=True, eq=False, repr=False)
class ActionExplanation(Summarised, Saved):
    """The belief of least regret for a decision, that regret, and a proof.

    Formula: r(u) = min_{π ∈ Δ} ρ(π,u) = max_{v ∈ C} min_i (c(i,u) − c(i,v)).

    Args:
        action: u, shape (U,).
        is_explained: Whether some belief makes the decision optimal.
        belief: The belief of least regret, shape (X,).
        gap: r(u), its regret, in the cost's unit; zero where a belief explains the decision.
        better: A decision v that costs less than u in every state, by at least the gap up to rounding; u itself where a belief
            explains u.
        savings: c(i,u) − c(i,v) in every state, shape (X,).
        direction: A feasible direction d with Σ|d_j| = 1 that lowers the cost in every state: the Farkas certificate that the
            conditions of Theorem 1 have no solution; zero where a belief explains the decision.
        rate: The least decrease of the cost per unit of that direction, over states.
        tight: Names of the active constraints.
        coordinates: Names of the decision's coordinates.

    Source: the paper, Theorem 1 and measure (a); Farkas' lemma.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem(np.zeros((2, 2)), [np.eye(2), 2 * np.eye(2)], 1.0)
        >>> found = explain_action(problem, [1.0, 0.0])
        >>> round(found.gap, 6), found.better.round(3)
        (0.5, array([0.5, 0.5]))
    """

    action: Array
    is_explained: bool
    belief: Array
    gap: float
    better: Array
    savings: Array
    direction: Array
    rate: float
    tight: tuple[str, ...]
    coordinates: tuple[str, ...]

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        belief = np.array2string(self.belief, precision=4, floatmode="fixed", separator=" ")
        tight = ", ".join(self.tight[:_MOST_LISTED]) + (" …" if len(self.tight) > _MOST_LISTED else "")
        if self.is_explained:
            return f"explained      by the belief {belief}, the centre of the set\ntight rows     {tight or 'none'}"
        lines = [
            f"no explanation every belief leaves a regret of at least {self.gap:.6g}",
            f"nearest belief {belief}",
        ]
        if self.savings.min() > 0:
            change = self.better - self.action
            lines.append(
                f"better         in every state, by {self.savings.min():.3g} to {self.savings.max():.3g}: "
                f"{self._changes(change)}"
            )
        if self.rate > 0:
            lines.append(
                f"contradiction  {self._changes(self.direction)} is allowed and lowers the cost in every state, by "
                f"{self.rate:.3g} per unit or more"
            )
        lines.append(f"tight rows     {tight or 'none'}")
        lines.append(f"what to do     near_optimal_beliefs at a regret above {self.gap:.3g} has members")
        return "\n".join(lines)

    def _changes(self, change: Array) -> str:
        order = np.argsort(-np.abs(change), kind="stable")
        told = [j for j in order if abs(change[j]) > _MUCH * np.abs(change).max()]
        parts = [f"{self.coordinates[j]} {change[j]:+.3g}" for j in told[:_MOST_LISTED]]
        return ", ".join(parts) + (" …" if len(told) > _MOST_LISTED else "")


def explain_action(
    problem: DecisionProblem, action: ArrayLike, *, names: Sequence[str] | None = None
) -> ActionExplanation:
    """Return the belief of least regret for a decision, that regret, and a proof.

    Formula: r(u) = min_π ρ(π,u), the decision that saves r(u) in every state, and a direction d with A_act d ≤ 0,
    A_eq d = 0 and ∇c(i,u)·d < 0 for every state i.

    Args:
        problem: The decision problem that the observer knows.
        action: u, shape (U,), feasible.
        names: Names of the decision's coordinates, such as tickers; None is the problem's, or u[0], u[1], …

    Returns:
        An `ActionExplanation`; `print` shows it as a few lines.

    Raises:
        InputError: `action` is not feasible, or the number of names differs from the number of coordinates.
        ModelError: The problem has neither a smooth form nor `explaining_rows`.
        SolverError: The cutting planes did not converge.

    Cost: some tens of forward solves. Source: the paper, Theorem 1; Farkas' lemma.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem(np.zeros((2, 2)), [np.eye(2), 2 * np.eye(2)], 1.0)
        >>> print(explain_action(problem, [1.0, 0.0], names=["Oil", "Gas"]).summary())
        no explanation every belief leaves a regret of at least 0.5
        nearest belief [1.0000 0.0000]
        better         in every state, by 0.5 to 1: Oil -0.5, Gas +0.5
        contradiction  Oil -0.5, Gas +0.5 is allowed and lowers the cost in every state, by 1 per unit or more
        tight rows     u[1] >= 0
        what to do     near_optimal_beliefs at a regret above 0.5 has members
    """
    u = checked_problem(problem).check_action(action)
    known = problem.asset_names if names is None else names
    labels = tuple(f"u[{j}]" for j in range(u.size)) if known is None else tuple(str(name) for name in known)
    if len(labels) != u.size:
        raise InputError(f"names has {len(labels)} entries, expected one per coordinate of the action: {u.size}")
    form = _told_form(problem)
    tight = tuple(form.constraints.names[i] for i in np.flatnonzero(form.constraints.tight_rows(form.variables(u))))
    beliefs = belief_set_of(problem, u)
    nothing = np.zeros(u.size)
    if not beliefs.is_empty:
        zeros = np.zeros(problem.n_states)
        return ActionExplanation(u, True, beliefs.interior_point(), 0.0, u, zeros, nothing, 0.0, tight, labels)
    found = closed_planes(problem, u)
    better = weights_of_planes(found.planes) @ problem.solve_points(found.beliefs)
    savings = problem.state_costs(u) - problem.state_costs(better)
    direction, rate = _contradiction(problem, form, u)
    return ActionExplanation(u, False, found.belief, found.gap, better, savings, direction, rate, tight, labels)


def _told_form(problem: DecisionProblem) -> SmoothForm:
    """Return the form in the decision's own coordinates; a lifted one only where it adds no rows."""
    if problem.constraints.needs_lift:
        return smooth_form_of(problem)
    return SmoothForm(problem.constraints, problem.cost_gradients)


def _contradiction(problem: DecisionProblem, form: SmoothForm, u: Array) -> tuple[Array, float]:
    """Return the direction of unit 1-norm that maximises the least decrease of the cost over states."""
    point, region = form.variables(u), form.constraints
    gradients = form.gradients(point[None])[0]
    scale = max(float(np.abs(gradients).max()), np.finfo(float).tiny)
    active = region.A_ub[region.tight_rows(point)]
    size = point.size
    falls = np.hstack([gradients / scale, -gradients / scale, np.ones((len(gradients), 1))])
    stays = np.hstack([active, -active, np.zeros((len(active), 1))])
    unit = np.append(np.ones(2 * size), 0.0)
    answer = minimise(
        np.append(np.zeros(2 * size), -1.0),
        Rows(np.vstack([falls, stays, unit]), np.append(np.zeros(len(falls) + len(stays)), 1.0)),
        Rows(np.hstack([region.A_eq, -region.A_eq, np.zeros((len(region.A_eq), 1))]), np.zeros(len(region.A_eq))),
        (0, None),
    )
    if answer.status != OPTIMAL or answer.x[-1] <= tolerances.LINEAR_PROGRAMME:
        return np.zeros(u.size), 0.0
    moved = answer.x[:size] - answer.x[size : 2 * size]
    direction = moved if form.lift is None else form.decisions(point + moved) - u
    length = float(np.abs(direction).sum())
    if not length > 0:
        return np.zeros(u.size), 0.0
    direction = direction / length
    # At kinks a gradient need not predict the cost of a change: compare the costs themselves.
    probed = problem.state_costs(u + tolerances.SLOPE_PROBE * direction)
    if (probed >= problem.state_costs(u)).any():
        return np.zeros(u.size), 0.0
    return direction, float(answer.x[-1] * scale / (length if form.lift is not None else 1.0))
