"""From the best candidate to a local optimum: continuous search on the faces the candidates lie on.

A face fixes the tight rows. Where a face's consistent sets are points, the decision is searched through its decoy y
(X−1 coordinates, smooth, sensitivities in closed form); where they are larger, few coordinates of the decision are
free, and these are searched directly, the set's distance being judged at every trial.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import minimize

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.scores import Scores
from inscrutable.privacy.measures import Reference
from inscrutable.problems import DecisionProblem, QuadraticProblem
from inscrutable.problems.quadratic import FaceSolution
from inscrutable.validation import Array

_FACES = 6
_STARTS_A_FACE = 3
_ZOOM_POINTS = 41
_ZOOM_ROUNDS = 7


class Trial(NamedTuple):
    """An admissible, affordable decision and its privacy."""

    action: Array
    privacy: float


class Goal(NamedTuple):
    """What the polish works on: a problem, a belief, an allowed regret and a distance to grow or shrink."""

    problem: DecisionProblem
    belief: Array
    limit: float
    reference: Reference
    optimal_cost: float


def polish(goal: Goal, scores: Scores) -> Trial | None:
    """Return the best decision reached from the best candidates of the most promising faces."""
    best: Trial | None = None
    for index in _starts(goal, scores):
        for trial in _improve(goal, scores, index):
            if best is None or trial.privacy > best.privacy:
                best = trial
    return best


def _starts(goal: Goal, scores: Scores) -> list[int]:
    affordable = np.flatnonzero((scores.regrets <= goal.limit) & np.isfinite(scores.privacies))
    if not affordable.size:
        return []
    tight = goal.problem.constraints.tight_rows(scores.candidates.actions[affordable])
    _, face_of = np.unique(tight, axis=0, return_inverse=True)
    face_of = face_of.reshape(-1)
    order = np.lexsort((scores.regrets[affordable], -scores.privacies[affordable]))
    chosen: list[int] = []
    faces: dict[int, list[Array]] = {}
    members = scores.candidates.sets.start
    for place in order:
        face = int(face_of[place])
        if face not in faces and len(faces) >= _FACES:
            continue
        near = faces.setdefault(face, [])
        member = members[affordable[place]]
        # Starts on one face must lie apart to find different optima.
        if len(near) < _STARTS_A_FACE and all(np.linalg.norm(member - other) > 0.1 for other in near):
            near.append(member)
            chosen.append(int(affordable[place]))
    return chosen


def _improve(goal: Goal, scores: Scores, index: int) -> list[Trial]:
    problem = goal.problem
    region = problem.constraints
    action = scores.candidates.actions[index]
    tight = region.tight_rows(action)
    normals = np.vstack([region.A_ub[tight], region.A_eq])
    free = null_space(normals, rcond=tolerances.ON_FACE) if len(normals) else np.eye(action.size)
    if scores.candidates.sets.dimension[index] == 0 and isinstance(problem, QuadraticProblem):
        found = _through_decoys(goal, problem, tight, scores.candidates.sets.start[index])
    elif free.shape[1] == 0:
        return []
    else:
        found = _on_face(goal, action, free)
    return [] if found is None else [found]


def _through_decoys(goal: Goal, problem: QuadraticProblem, tight: np.ndarray, start: Array) -> Trial | None:
    """Sequential quadratic programming over the decoy y of a face whose consistent sets are single beliefs."""
    region = problem.constraints
    loose = ~tight
    # Above the threshold itself, so that the observer does not count the row as tight.
    least = region.min_slack * (1.0 + tolerances.SLACK_SAFETY)
    own = problem.state_costs(np.asarray(goal.problem.solve(goal.belief)))
    scale = max(float(np.abs(own).max()), goal.limit, np.finfo(float).tiny)
    known: dict[bytes, FaceSolution] = {}

    def at(y: Array) -> FaceSolution:
        key = y.tobytes()
        if key not in known:
            if len(known) > 4:
                known.clear()
            known[key] = problem.face_solution(y, tight)
        return known[key]

    def constraint(y: Array) -> Array:
        face = at(y)
        cost = problem.state_costs(face.action) @ goal.belief
        return np.concatenate(
            [
                [(goal.limit - cost + goal.optimal_cost) / scale],
                region.slacks(face.action)[loose] - least,
                face.multipliers / scale,
            ]
        )

    def constraint_slope(y: Array) -> Array:
        face = at(y)
        gradient = goal.belief @ problem.cost_gradients(face.action)
        slack_slope = -(region.A_ub @ face.action_slope) / region.row_scale[:, None]
        return np.vstack(
            [-(gradient @ face.action_slope)[None] / scale, slack_slope[loose], face.multiplier_slope / scale]
        )

    sign, point = goal.reference.sign, goal.reference.point
    answer = minimize(
        lambda y: (-sign * float((y - point) @ (y - point)), -2.0 * sign * (y - point)),
        start,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * start.size,
        constraints=[
            {"type": "eq", "fun": lambda y: np.array([y.sum() - 1.0]), "jac": lambda y: np.ones((1, y.size))},
            {"type": "ineq", "fun": constraint, "jac": constraint_slope},
        ],
        options={"ftol": tolerances.POLISH**1.5, "maxiter": 200},
    )
    decoy = np.maximum(answer.x, 0.0)
    if not np.all(np.isfinite(decoy)) or decoy.sum() <= 0:
        return None
    return _pulled_back(goal, decoy / decoy.sum(), tight)


def _pulled_back(goal: Goal, decoy: Array, tight: np.ndarray) -> Trial | None:
    """Move the decoy toward the true belief (regret falls, fact F1) until its decision is affordable and admissible."""
    share = 1.0
    for step in (0.0, *(tolerances.POLISH * 10.0**k for k in range(6))):
        share = 1.0 - step
        action = goal.problem.solve(goal.belief + share * (decoy - goal.belief))
        if np.array_equal(goal.problem.constraints.tight_rows(action), tight):
            trial = judge(goal, action)
            if trial is not None:
                return trial
    return None


def judge(goal: Goal, action: Array) -> Trial | None:
    """Return a decision with its exact privacy, or None where it is not admissible, affordable and explained."""
    problem = goal.problem
    if not problem.constraints.is_admissible(action):
        return None
    if problem.state_costs(action) @ goal.belief - goal.optimal_cost > goal.limit:
        return None
    distance = consistent_sets(problem, action[None]).distances(goal.reference.point)[0]
    return Trial(action, goal.reference.sign * float(distance)) if np.isfinite(distance) else None


def _on_face(goal: Goal, action: Array, free: Array) -> Trial | None:
    """A shrinking search over the few free coordinates of a decision, judging the set's distance at every trial."""
    best = judge(goal, action)
    if best is None:
        return None
    reach = _reach(goal, action, free)
    widths = np.maximum(reach[:, 1] - reach[:, 0], 0.0)
    centre = action
    rng = np.random.default_rng(0)  # the pattern of trial points, the same at every call
    for round_number in range(_ZOOM_ROUNDS if free.shape[1] == 1 else 4 * _ZOOM_ROUNDS):
        steps = _pattern(free.shape[1], rng)
        offsets = reach[:, 0] + (steps + 1.0) / 2.0 * widths if round_number == 0 else steps * widths
        trials = _snap(goal, centre + offsets @ free.T)
        found = _best_of(goal, trials)
        if found is not None and found.privacy > best.privacy:
            best = found
            centre = best.action
        widths = widths * (4.0 / _ZOOM_POINTS if free.shape[1] == 1 else 0.5)
    return best


def _pattern(dimension: int, rng: np.random.Generator) -> Array:
    if dimension == 1:
        return np.linspace(-1.0, 1.0, _ZOOM_POINTS)[:, None]
    return rng.uniform(-1.0, 1.0, size=(_ZOOM_POINTS, dimension))


def _reach(goal: Goal, action: Array, free: Array) -> Array:
    """How far each free coordinate may move, alone, inside the feasible set: shape (k, 2)."""
    region = goal.problem.constraints
    slack = np.maximum(region.b_ub - region.A_ub @ action, 0.0)
    reach = np.empty((free.shape[1], 2))
    for k, direction in enumerate(free.T):
        speed = region.A_ub @ direction
        moving = np.abs(speed) > tolerances.ON_FACE
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = slack / speed
        reach[k, 1] = steps[moving & (speed > 0)].min(initial=1.0)
        reach[k, 0] = steps[moving & (speed < 0)].max(initial=-1.0)
    return reach


def _snap(goal: Goal, trials: Array) -> Array:
    """Pull trials that cost too much back along the line to the optimal decision, where the cost is convex."""
    own = goal.problem.state_costs(trials) @ goal.belief - goal.optimal_cost
    return np.asarray(trials[own <= goal.limit])


def _best_of(goal: Goal, trials: Array) -> Trial | None:
    allowed = trials[goal.problem.constraints.is_admissible(trials)] if len(trials) else trials
    if not len(allowed):
        return None
    distances = consistent_sets(goal.problem, allowed).distances(goal.reference.point)
    privacies = np.where(np.isfinite(distances), goal.reference.sign * distances, -np.inf)
    index = int(privacies.argmax())
    return Trial(allowed[index], float(privacies[index])) if np.isfinite(privacies[index]) else None
