"""Mixtures of tied vertices: decisions that only the beliefs on a boundary between cells explain.

On the relative interior of a face the consistent set is constant, the cell of the face's tied vertices, and the regret is
linear: of all mixtures on a face those nearest to one of its vertices are enough. Each is as near to the vertex as
`min_slack` of the feasible set allows.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries.consistent_sets import describable
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.decision_makers.candidates import Candidates, make_candidates
from inscrutable.decision_makers.proofs.face_programmes import FaceProgrammes
from inscrutable.decision_makers.proofs.subdivision import cells_of
from inscrutable.problems import DecisionProblem, LinearForm, Polyhedron
from inscrutable.validation import Array

_MOST_FACES, _MOST_CALLS = 20_000, 2_000
"""Limits of time: tied sets, and calls of the oracle for vertices that no decoy leads to. In 60 linear problems over two to
five states there are at most 216 sets and 266 calls; 13 of them have such vertices."""
_MOST_PARTS = 64
"""Most parts of a face, each of which takes a linear programme a vertex. At 64, candidates of norms over three states and six
coordinates take 1.2 s, not .1 s."""


def tied_mixtures(problem: DecisionProblem, candidates: Candidates) -> Candidates:
    """Return mixtures of vertices that are optimal for the same beliefs, and the vertices that are no candidates yet, each
    with one of these beliefs."""
    chosen = candidates.distinct[candidates.sets.dimension[candidates.distinct] >= 0]
    vertices = candidates.actions[chosen]
    missing = _missing(problem, vertices)
    missing = missing[describable(problem, missing)]
    actions: list[Array] = []
    decoys: list[Array] = []
    for vertex in missing:
        found = belief_set_of(problem, vertex)
        if not found.is_empty:
            actions.append(vertex[None])
            decoys.append(found.interior_point()[None])
    vertices = np.vstack([vertices, *actions])
    costs, corners = problem.without_common_costs.state_costs(vertices), _corners(problem, vertices)
    sets = [vertices[list(tied)] for tied in _tied_sets(costs, corners)]
    near = [near_vertices(problem, ties) for ties in sets]
    for mixed in [*near, *_on_border_faces(problem, vertices, costs, corners)]:
        if not describable(problem, mixed[:1])[0]:
            continue
        found = belief_set_of(problem, mixed[0])
        if not found.is_empty:
            actions.append(mixed)
            decoys.append(np.broadcast_to(found.interior_point(), (len(mixed), problem.n_states)))
    if not actions:
        return make_candidates(problem, vertices[:1], candidates.sets.start[chosen[:1]])
    return make_candidates(problem, np.vstack(actions), np.vstack(decoys))


def _missing(problem: DecisionProblem, known: Array) -> Array:
    """Vertices that are optimal on a cell of beliefs and not among those known (k,U)."""
    cells, _ = cells_of(problem, _MOST_CALLS)
    if cells is None:
        return known[:0]
    apart = np.abs(cells.actions[:, None] - known[None]).max(axis=2).min(axis=1)
    return np.asarray(cells.actions[apart > tolerances.SAME_ACTION])


def _corners(problem: DecisionProblem, vertices: Array) -> Array:
    """The corners of all cells, shape (n,X)."""
    corners = np.vstack([belief_set_of(problem, vertex).vertices() for vertex in vertices])
    return np.asarray(np.unique(np.round(corners, 10), axis=0))


def _on_border_faces(problem: DecisionProblem, vertices: Array, costs: Array, corners: Array) -> list[Array]:
    """Decisions near vertices that are optimal at a corner where some state has probability 0, on each part of the face of all
    decisions that are optimal there: some parts may be optimal for no other belief."""
    form = problem.linear_form()
    if form is None or problem.is_discrete:
        return []
    border = corners[(corners <= tolerances.SAME_BELIEF).any(axis=1)]
    faces, found = FaceProgrammes(form), dict[bytes, Array]()
    for corner, tied in zip(border, _tied(costs, border), strict=True):
        known = form.variables(vertices[tied])
        face = faces.optimal_at(corner, known)
        if face is None:
            continue
        mixed = (face == faces.tight_on(known)).all()
        for tight in [*([] if mixed else [face]), *_parts(form, corner, face, problem.n_actions)]:
            if tight.tobytes() not in found:
                found[tight.tobytes()] = form.decisions(faces.beside(known, tight))
    # One by one: where a level is free, decisions near several vertices may have different pieces.
    return [each[None] for near in found.values() for each in near]


def _parts(form: LinearForm, corner: Array, face: np.ndarray, n_actions: int) -> list[np.ndarray]:
    """The rows (r,) that are tight on parts of a face that is optimal at a corner: with one function of each maximum of the
    states of probability 0, whose levels the corner does not determine."""
    costs = form.costs[corner > tolerances.SAME_BELIEF, n_actions:]
    pieces = [np.flatnonzero(form.constraints.A_ub[:, n_actions + k]) for k in np.flatnonzero(~costs.any(axis=0))]
    if not pieces or np.prod(list(map(len, pieces)), dtype=np.float64) > _MOST_PARTS:
        return []
    parts = np.repeat(face[None], int(np.prod(list(map(len, pieces)))), axis=0)
    for part, chosen in zip(parts, product(*pieces), strict=True):
        part[list(chosen)] = True
    return list(parts)


def _tied(costs: Array, beliefs: Array) -> np.ndarray:
    """Which decisions of costs (n,X) are the cheapest for each belief (T,X), shape (T,n)."""
    values = beliefs @ costs.T
    # Of the costs' own size: expected costs may cancel at a corner, whose rounding moves them all the same.
    margin = tolerances.FEASIBILITY * max(float(np.abs(costs).max()), np.finfo(float).tiny)
    return np.asarray(values <= values.min(axis=1, keepdims=True) + margin)


def _tied_sets(costs: Array, corners: Array) -> list[tuple[int, ...]]:
    """Sets of two vertices or more that are optimal together: at a corner of the cells, and at all corners of a face."""
    at_corners = {frozenset(np.flatnonzero(row).tolist()) for row in _tied(costs, corners)}
    known = {each for each in at_corners if len(each) > 1}
    fresh = set(known)
    while fresh and len(known) < _MOST_FACES:
        met = {each & other for each in fresh for other in at_corners}
        fresh = {each for each in met if len(each) > 1} - known
        known |= fresh
    return sorted(tuple(sorted(each)) for each in known)


def near_vertices(problem: DecisionProblem, tied: Array, least_share: float = tolerances.SLACK_SAFETY) -> Array:
    """One mixture near each of the tied vertices (k,U), with every row that is not tight at all of them noticeably slack."""
    form = problem.linear_form()
    if form is not None and form.lift is not None:  # kinks are rows of the lifted feasible set
        lifted = _near(form.constraints, form.variables(tied), least_share)
        return form.decisions(lifted)
    return _near(problem.constraints, tied, least_share)


def _near(region: Polyhedron, tied: Array, least_share: float) -> Array:
    count, slacks = len(tied), region.slacks(tied)  # (k, n)
    loose = (slacks > tolerances.FEASIBILITY).any(axis=0)
    room = slacks[:, loose].sum(axis=0)
    least = region.min_slack * (1.0 + tolerances.SLACK_SAFETY) + tolerances.FEASIBILITY
    share = least / room.min(initial=np.inf) if room.size else 0.0
    share = min(max(share, least_share), 1.0 / count)
    weights = np.full((count, count), share) + np.eye(count) * (1.0 - count * share)
    return np.asarray(weights @ tied)
