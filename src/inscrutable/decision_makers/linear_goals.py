"""Linear costs: the cheapest decision that no belief explains by a margin is the solution of one linear programme.

r(u) = min_π max_{v ∈ C} π·(s(u) − s(v)) = max_{v ∈ C} min_i c_i'(u − v): least regrets of at least the margin are where some
v ∈ C costs less by the margin in every state.
"""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems import LinearForm
from inscrutable.validation import Array


def cheapest_unexplained(form: LinearForm, belief: Array, margin: float) -> Array | None:
    """Return the decision (U,) of least cost under a belief whose plausibility gap is at least the margin, None where
    there is none."""
    region, costs, size = form.constraints, form.costs, form.constraints.n_actions
    scale = max(float(np.abs(costs).max()), np.finfo(float).tiny)
    # A gap is proved only up to its accuracy.
    wanted = margin / scale + 2.0 * tolerances.GAP_STEP * max(1.0, margin / scale)
    nothing, other = np.zeros_like(region.A_ub), np.zeros_like(region.A_eq)
    below = Rows(
        np.block([[-costs / scale, costs / scale], [region.A_ub, nothing], [nothing, region.A_ub]]),
        np.concatenate([np.full(len(costs), -wanted), region.b_ub, region.b_ub]),
    )
    equal = Rows(np.block([[region.A_eq, other], [other, region.A_eq]]), np.tile(region.b_eq, 2))
    answer = minimise(np.concatenate([belief @ costs / scale, np.zeros(size)]), below, equal)
    if answer.status != OPTIMAL:
        return None
    action = answer.x[:size]
    for limit in region.coordinate_bounds:
        near = np.abs(action - limit) <= tolerances.FEASIBILITY * np.maximum(1.0, np.abs(action))
        action = np.where(near, limit, action)
    return np.asarray(action) + 0.0
