"""Smooth convex costs over a polyhedron: Newton's method, each step a quadratic programme solved by an active set.

At u the model g'd + ½d'(H + δI)d is minimised over u + d ∈ C. Near the solution the step is full and the active set stays,
so the last step is as exact as `quadratic_programme`: the KKT equations to a few roundings, bounds exactly.
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import SolverError
from inscrutable.problems.quadratic_programme import Layout, solve_programmes
from inscrutable.validation import Array

_MOST_STEPS = 200
_MOST_HALVINGS = 60
_DESCENT = 0.01
_UNSEEN = 1e3
_ENOUGH = 4


class Model(NamedTuple):
    """A cost and its derivatives at n points."""

    values: Array  # (n,)
    gradients: Array  # (n, U)
    hessians: Array  # (n, U, U)


class SmoothCosts(Protocol):
    """Expected costs π·s(u) of beliefs (n,X), each at a point (n,U) of its own."""

    def model(self, held: Array, points: Array) -> Model:
        """Return value, gradient and (approximate, symmetric) Hessian."""

    def values(self, held: Array, points: Array) -> Array:
        """Return values (n,), infinite outside the cost's domain."""

    def longest_steps(self, held: Array, points: Array, steps: Array) -> Array:
        """Return shares (n,) of the steps, at most one, that stay well inside the cost's domain."""


def minimise_smooth(costs: SmoothCosts, held: Array, starts: Array, layout: Layout) -> Array:
    """Return the minimisers (n,U) for beliefs (n,X), from feasible points (n,U) inside the domain."""
    points = np.array(starts)
    left = np.arange(len(held))
    settled = np.zeros(len(held), dtype=np.int64)
    for _ in range(_MOST_STEPS):
        beliefs, here = held[left], points[left]
        model = costs.model(beliefs, here)
        ends = _newton_points(model, here, layout)
        steps = ends - here
        fall = -(model.gradients * steps).sum(axis=1)
        reach = costs.longest_steps(beliefs, here, steps)
        rounding = 8 * np.finfo(float).eps * np.maximum(np.abs(model.values), 1.0)
        # Near the end the fall of the cost is below its rounding: the full step is taken, which solves the stationarity
        # equations.
        trusted = fall <= _UNSEEN * rounding
        line = _Ways(here, steps, model.values + rounding, fall, reach)
        shares, moved = _searched(costs, beliefs, line, ~trusted)
        astray = _astray(
            costs, beliefs, line._replace(values=model.values + _UNSEEN * rounding), np.flatnonzero(trusted)
        )
        shares[astray], moved[astray] = 0.0, False
        points[left] = np.where((shares == 1.0)[:, None], ends, here + shares[:, None] * steps)
        size = np.maximum(np.abs(here).max(axis=1), 1.0)
        done = np.abs(steps).max(axis=1, initial=0.0) <= tolerances.STATIONARITY * size
        settled[left] += trusted
        # A few quadratically convergent steps below the cost's rounding reach full accuracy.
        left = left[~done & moved & (settled[left] < _ENOUGH)]
        if not left.size:
            return points
    raise SolverError(
        f"Newton's method did not converge for belief {held[left[0]]}: its last step promised {fall.max():.1e} of the cost"
    )


def _newton_points(model: Model, here: Array, layout: Layout) -> Array:
    n_actions = here.shape[1]
    # Per coordinate: a tiny share of wealth has a huge curvature, which must not damp the others.
    curvatures = np.abs(np.einsum("nuu->nu", model.hessians))
    typical, steep = np.median(curvatures, axis=1), np.abs(model.gradients).max(axis=1)
    typical = np.select(
        [typical > 0, curvatures.max(axis=1) > 0, steep > 0], [typical, curvatures.max(axis=1), steep], 1.0
    )
    damping = tolerances.DAMPING * (curvatures + tolerances.DAMPING * typical[:, None])
    damped = model.hessians + damping[:, :, None] * np.eye(n_actions)
    return solve_programmes(damped, model.gradients - np.einsum("nuv,nv->nu", damped, here), layout)


class _Ways(NamedTuple):
    """Line searches: points (n,U), steps, values that a trial must not exceed, predicted decreases and largest step lengths."""

    here: Array
    steps: Array
    values: Array
    fall: Array
    reach: Array


def _astray(costs: SmoothCosts, held: Array, line: _Ways, trusted: np.ndarray) -> np.ndarray:
    """Return which of the trusted points a full step moves uphill: where costs are flat it is the rounding of a slope, divided
    by the damping, and may go anywhere."""
    if not trusted.size:
        return trusted
    reached = costs.values(held[trusted], line.here[trusted] + line.reach[trusted, None] * line.steps[trusted])
    return np.asarray(trusted[~(reached <= line.values[trusted])])


def _searched(costs: SmoothCosts, held: Array, line: _Ways, doubtful: np.ndarray) -> tuple[Array, np.ndarray]:
    """Step lengths at which the cost falls enough, and which points move; the search is limited to the `doubtful` points."""
    shares = line.reach.copy()
    unsure = np.flatnonzero(doubtful)
    for _ in range(_MOST_HALVINGS):
        if not unsure.size:
            break
        trial = costs.values(held[unsure], line.here[unsure] + shares[unsure, None] * line.steps[unsure])
        unsure = unsure[~(trial <= line.values[unsure] - _DESCENT * shares[unsure] * line.fall[unsure])]
        shares[unsure] *= 0.5
    moved = np.ones(len(shares), dtype=bool)
    moved[unsure] = False
    shares[unsure] = 0.0
    return shares, moved
