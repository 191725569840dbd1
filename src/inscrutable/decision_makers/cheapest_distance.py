"""The least regret at which a distance is reached, from searches for the greatest distance that a budget affords."""

from __future__ import annotations

from collections.abc import Callable

import daqp
import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.results import Decision
from inscrutable.decision_makers.search.partition import face_programme
from inscrutable.problems import DecisionProblem, quadratic_problem
from inscrutable.validation import Array

_MOST_SEARCHES = 20
_JUMPS = 0.75  # share of the gap in privacy that a smaller bracket leaves where the privacy jumps in it


def cheapest_at_distance(
    search: Callable[[float], Decision], shortened: Callable[[Decision], Decision], most: float, distance: float
) -> Decision | None:
    """Return the cheapest decision found with a privacy of at least `distance`, None where a regret of `most` affords none.

    `search` gives the decision of greatest privacy P(B) for a budget B. Near the belief P is about linear in √B, as regrets
    are quadratic; elsewhere it jumps, where a farther decision comes into reach. That one is `shortened` to the least regret
    on its face, and a search with less tells whether that is the least of all. Otherwise P(B) = distance is bracketed by
    secants in √B, and by halvings where those gain little.
    """
    found = search(most)
    if not found.privacy >= distance:
        return None
    low, high, best = 0.0, float(np.sqrt(most)), found
    below, above, left, right = -distance, np.inf, -distance, np.inf  # excess at both ends, and as the secant takes it
    width = gap = np.inf
    is_end, side = False, 0
    for _ in range(_MOST_SEARCHES):
        if found.privacy >= distance:
            least = shortened(found)
            is_end = least.privacy >= distance and least.regret <= found.regret * (1.0 + tolerances.LEAST_ON_FACE)
            best = least if is_end and least.regret < found.regret else found
            high, above = min(high, float(np.sqrt(best.regret))), best.privacy - distance
            left, right, side = (0.5 if side > 0 else 1.0) * left, above, 1
        inside, jumps = (
            (tolerances.LEAST_ON_FACE if is_end else tolerances.LEAST_BUDGET) * high,
            above - below > _JUMPS * gap,
        )
        width, gap = high - low, above - below
        if width <= 1.5 * inside or above <= tolerances.LEAST_BUDGET * distance:
            break
        share = 0.5 if jumps else max(-left / (right - left), 0.1)
        trial = high - inside if is_end else min(low + share * width, high - inside)
        found = search(trial**2)
        if found.privacy < distance:
            low, below = trial, found.privacy - distance
            left, right, side = below, (0.5 if side < 0 else 1.0) * right, -1
    return best


def shortened_on_its_face(problem: DecisionProblem, belief: Array, action: Array) -> Array | None:
    """Return the decision (U,) of least cost under a belief (X,) with the same tight rows, the others slack by the least.

    None where nothing is free, or no such decision is found. Quadratic costs; cost: a small quadratic programme.
    """
    form, quadratic = problem.quadratic_form(), quadratic_problem(problem)
    if form is None or quadratic is None:
        return None
    face = face_programme(quadratic, quadratic.constraints.tight_rows(form.variables(action)))
    size = face.span.shape[1]
    if not size:
        return None
    cost = np.tensordot(belief, face.curves, axes=1)
    slacks = np.ascontiguousarray(face.rows[face.n_set_rows :, 0])
    place, _, flag, _ = daqp.solve(
        np.ascontiguousarray(cost[:size, :size]),
        np.ascontiguousarray(cost[:size, size]),
        np.ascontiguousarray(-slacks[:, :size]),
        slacks[:, size].copy(),
        np.full(len(slacks), -np.inf),
        np.zeros(len(slacks), dtype=np.int32),
        primal_tol=tolerances.LINEAR_PROGRAMME,
    )
    return np.asarray(form.decisions(face.action(place))) if flag >= 1 else None
