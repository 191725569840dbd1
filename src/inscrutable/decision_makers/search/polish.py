"""From the best candidate to a local optimum: continuous search on the faces the candidates lie on.

A face fixes the tight rows. Where a face's consistent sets are points, the decision is searched through its decoy y
(X−1 coordinates, smooth, sensitivities in closed form); where they are larger, few coordinates of the decision are
free, and these are searched directly, the set's distance being judged at every trial.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import minimize

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.scores import Scores
from inscrutable.decision_makers.search.goal import Goal
from inscrutable.decision_makers.search.ray_climb import climb_on_rays
from inscrutable.decision_makers.search.rays import farthest_decoys
from inscrutable.problems import QuadraticProblem, quadratic_problem
from inscrutable.problems.quadratic import FaceSolution
from inscrutable.validation import Array

_FACES = 10
_STARTS_A_FACE = 3
_STARTS_APART = 0.1
_MORE = 3  # times as many starts at a time as before, beginning with one: with all at once four are searched in vain
_PROMISE = 1.15
"""How much farther than its start a local search may come to rest; starts that promise less than is found are skipped."""
_ZOOM_POINTS = 41
_ZOOM_ROUNDS = 7


class Trial(NamedTuple):
    """An admissible, affordable decision and its privacy."""

    action: Array
    privacy: float


class Start(NamedTuple):
    """Where a search on a face begins: the face's tight rows, a decoy, a decision, and the most it could reach."""

    tight: np.ndarray
    decoy: Array
    action: Array
    promise: float


def polish(goal: Goal, scores: Scores) -> Trial | None:
    """Return the best decision reached from the most promising faces and their neighbours."""
    tried: set[bytes] = set()
    best: Trial | None = None
    starts, count = _starts(goal, scores), 1
    while starts:
        some, starts, count = starts[:count], starts[count:], _MORE * count
        promising = [start for start in some if best is None or start.promise > best.privacy + tolerances.POLISH]
        tried |= {start.tight.tobytes() for start in promising}
        best = _improved(goal, promising, best)
    while best is not None:
        before = best
        untried = [start for start in _neighbours(goal, best) if start.tight.tobytes() not in tried]
        tried |= {start.tight.tobytes() for start in untried}
        best = _improved(goal, untried, best)
        if best is before:
            return best
    return None


def _improved(goal: Goal, starts: list[Start], best: Trial | None) -> Trial | None:
    """The best of what searches from some starts reach and what is known."""
    known = -np.inf if best is None else best.privacy
    free = [_free_directions(goal, start) for start in starts]
    on_rays = [start for start, each in zip(starts, free, strict=True) if _goes_on_rays(goal, each)]
    reached = climb_on_rays(goal, [start.tight for start in on_rays], [start.decoy for start in on_rays], known)
    trials = [
        judge(goal, start.action if action is None else action) for start, action in zip(on_rays, reached, strict=True)
    ]
    trials += [
        _improve(goal, start, each) for start, each in zip(starts, free, strict=True) if not _goes_on_rays(goal, each)
    ]
    for trial in trials:
        if trial is not None and (best is None or trial.privacy > best.privacy):
            best = trial
    return best


def _starts(goal: Goal, scores: Scores) -> list[Start]:
    """The best affordable candidates, and the ends of affordable rays, of every promising face, apart from each other."""
    region = goal.problem.constraints
    sets = scores.candidates.sets
    affordable = np.flatnonzero((scores.regrets <= goal.limit) & np.isfinite(scores.privacies))
    decoys, actions = farthest_decoys(goal.problem, goal.belief, goal.limit)
    reach = goal.reference.sign * np.linalg.norm(decoys - goal.reference.point, axis=1)
    actions = np.vstack([scores.candidates.actions[affordable], actions])
    decoys = np.vstack([sets.start[affordable], decoys])
    value = np.concatenate([scores.privacies[affordable], reach])
    # Near a ray little is farther than its end; toward a target nothing is better than the target itself.
    length = np.linalg.norm(decoys - goal.reference.point, axis=1)
    promise = _PROMISE * length if goal.reference.sign > 0 else np.zeros(len(length))
    spread = _STARTS_APART * float(np.ptp(decoys, axis=0).max(initial=0.0))
    slack = region.slacks(actions)
    # The face an observer sees; and, where rows are slack by less than the least, the one with those rows loose.
    seen = slack < region.observed_slack
    exact = slack <= tolerances.FEASIBILITY
    between = (seen != exact).any(axis=1)
    faces: dict[bytes, list[Start]] = {}
    for i in np.argsort(-value, kind="stable"):
        for tight in (seen[i], exact[i]) if between[i] else (seen[i],):
            known = faces.setdefault(tight.tobytes(), [])
            if len(known) < _STARTS_A_FACE and all(np.linalg.norm(decoys[i] - s.decoy) > spread for s in known):
                known.append(Start(tight, decoys[i], actions[i], float(promise[i])))
        if len(faces) >= _FACES:
            break
    return [start for known in list(faces.values())[:_FACES] for start in known] + _leaving(goal)


def _leaving(goal: Goal) -> list[Start]:
    """Where many beliefs share the optimal decision, the edges on which another decision begins: each tight row freed."""
    region = goal.problem.constraints
    optimal = goal.problem.solve(goal.belief)
    tight = region.tight_rows(optimal)
    rank = np.linalg.matrix_rank(np.vstack([region.A_ub[tight], region.A_eq]))
    if region.n_actions - rank >= goal.problem.n_states - 1:
        return []
    starts = []
    for row in np.flatnonzero(tight):
        others = tight.copy()
        others[row] = False
        normals = np.vstack([region.A_ub[others], region.A_eq])
        free = null_space(normals, rcond=tolerances.ON_FACE) if len(normals) else np.eye(region.n_actions)
        inward = -free @ (free.T @ region.A_ub[row])
        speed = -float(region.A_ub[row] @ inward)
        if speed <= tolerances.ON_FACE:
            continue
        step = region.played_slack * region.row_scale[row] / speed
        starts.append(Start(others, goal.belief, np.asarray(optimal + step * inward), np.inf))
    return starts


def _neighbours(goal: Goal, trial: Trial) -> list[Start]:
    """Faces that differ in one row from the one a decision lies on: a tight row freed, a barely slack one tightened."""
    region = goal.problem.constraints
    slack = region.slacks(trial.action)
    tight = region.tight_rows(trial.action)
    barely = ~tight & (slack <= 2.0 * region.observed_slack)
    decoy = consistent_sets(goal.problem, trial.action[None])[0].nearest(goal.reference.point)
    found = []
    for row in np.flatnonzero(tight | barely):
        other = tight.copy()
        other[row] = not tight[row]
        found.append(Start(other, decoy, trial.action, 0.0))
    return found


def _free_directions(goal: Goal, start: Start) -> Array:
    """An orthonormal basis (U,k) of the directions on the face of a start."""
    region = goal.problem.constraints
    normals = np.vstack([region.A_ub[start.tight], region.A_eq])
    return null_space(normals, rcond=tolerances.ON_FACE) if len(normals) else np.eye(start.action.size)


def _explained_by_points(goal: Goal, free: Array) -> bool:
    """Whether a face's consistent sets are single beliefs: with k free coordinates their dimension is X − 1 − k."""
    return bool(free.shape[1] >= goal.problem.n_states - 1)


def _quadratic(goal: Goal) -> QuadraticProblem | None:
    """The problem, where it is quadratic in the decision itself."""
    form = goal.problem.quadratic_form()
    return quadratic_problem(goal.problem) if form is not None and form.lift is None else None


def _goes_on_rays(goal: Goal, free: Array) -> bool:
    return _explained_by_points(goal, free) and goal.problem.n_states > 1 and _quadratic(goal) is None


def _improve(goal: Goal, start: Start, free: Array) -> Trial | None:
    quadratic = _quadratic(goal)
    if _explained_by_points(goal, free) and quadratic is not None:
        return _through_decoys(goal, quadratic, start.tight, start.decoy)
    if free.shape[1] == 0 or not np.array_equal(goal.problem.constraints.tight_rows(start.action), start.tight):
        return judge(goal, start.action)
    return _on_face(goal, start.action, free)


class _FaceProgramme:
    """The smooth programme over the decoy y of one face: constraints and their slopes, for a sequential solver."""

    def __init__(self, goal: Goal, problem: QuadraticProblem, tight: np.ndarray) -> None:
        self.goal, self.problem, self.tight = goal, problem, tight
        own = problem.state_costs(problem.solve(goal.belief))
        self.scale = max(float(np.abs(own).max()), goal.limit, np.finfo(float).tiny)
        # Inside the budget by more than the solver's own violations, which are absolute.
        self.allowed = goal.limit * (1.0 - tolerances.BUDGET_SAFETY)
        self.budget_scale = max(goal.limit, tolerances.BUDGET * self.scale)
        self._last: tuple[bytes, FaceSolution] | None = None

    def _at(self, y: Array) -> FaceSolution:
        key = y.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = (key, self.problem.face_solution(y, self.tight))
        return self._last[1]

    def objective(self, y: Array) -> tuple[float, Array]:
        sign, away = self.goal.reference.sign, y - self.goal.reference.point
        return -sign * float(away @ away), -2.0 * sign * away

    def margins(self, y: Array) -> Array:
        """Budget left, slack above the least of every loose row, multipliers of the tight ones: all to be ≥ 0."""
        face = self._at(y)
        cost = self.problem.state_costs(face.action) @ self.goal.belief
        left = (self.allowed - cost + self.goal.optimal_cost) / self.budget_scale
        slack = self.problem.constraints.slacks(face.action)[~self.tight] - self.problem.constraints.played_slack
        return np.concatenate([[left], slack, face.multipliers / self.scale])

    def margin_slopes(self, y: Array) -> Array:
        face, region = self._at(y), self.problem.constraints
        gradient = self.goal.belief @ self.problem.cost_gradients(face.action)
        slack = -(region.A_ub @ face.action_slope)[~self.tight] / region.row_scale[~self.tight, None]
        return np.vstack(
            [-(gradient @ face.action_slope) / self.budget_scale, slack, face.multiplier_slope / self.scale]
        )


def _through_decoys(goal: Goal, problem: QuadraticProblem, tight: np.ndarray, start: Array) -> Trial | None:
    """Sequential quadratic programming over the decoy y of a face whose consistent sets are single beliefs."""
    programme = _FaceProgramme(goal, problem, tight)
    rules: list[Any] = [
        {"type": "eq", "fun": lambda y: np.array([y.sum() - 1.0]), "jac": lambda y: np.ones((1, y.size))},
        {"type": "ineq", "fun": programme.margins, "jac": programme.margin_slopes},
    ]
    answer = minimize(
        programme.objective,
        start,
        jac=True,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * start.size,
        constraints=rules,
        options={"ftol": tolerances.POLISH**1.5, "maxiter": 200},
    )
    decoy = np.maximum(answer.x, 0.0)
    if not np.all(np.isfinite(decoy)) or decoy.sum() <= 0:
        return None
    return _pulled_back(goal, problem, decoy / decoy.sum(), tight)


def _pulled_back(goal: Goal, problem: QuadraticProblem, decoy: Array, tight: np.ndarray) -> Trial | None:
    """Move the decoy toward the true belief, where regret falls, until its decision is affordable and admissible."""
    for step in (0.0, *(tolerances.POLISH * 10.0**k for k in range(6))):
        moved = goal.belief + (1.0 - step) * (decoy - goal.belief)
        action = problem.solve(moved)
        if not np.array_equal(problem.constraints.tight_rows(action), tight):
            # With copies of an asset the optimal decision is not unique, and this face has another one.
            action = problem.face_solution(moved, tight).action
            action = np.where(np.abs(action) <= tolerances.STATIONARITY, 0.0, action)
            if not np.array_equal(problem.constraints.tight_rows(action), tight):
                continue
        trial = judge(goal, action)
        if trial is not None:
            return trial
    return None


def judge(goal: Goal, action: Array) -> Trial | None:
    """Return a decision with its exact privacy, or None where it is not admissible, affordable and explained."""
    problem = goal.problem
    if not problem.constraints.is_admissible(action):
        return None
    if goal.regrets(action) > goal.limit:
        return None
    distance = consistent_sets(problem, action[None]).distances(goal.reference.point)[0]
    return Trial(action, goal.reference.sign * float(distance) + 0.0) if np.isfinite(distance) else None


def _on_face(goal: Goal, action: Array, free: Array) -> Trial | None:
    """A shrinking search over the few free coordinates of a decision, judging the set's distance at every trial."""
    best = judge(goal, action)
    if goal.regrets(action) > goal.limit:
        return None
    reach = _reach(goal, action, free)
    widths = np.maximum(reach[:, 1] - reach[:, 0], 0.0)
    centre = action
    rng = np.random.default_rng(0)  # the pattern of trial points, the same at every call
    for round_number in range(_ZOOM_ROUNDS if free.shape[1] == 1 else 4 * _ZOOM_ROUNDS):
        steps = _pattern(free.shape[1], rng)
        offsets = reach[:, 0] + (steps + 1.0) / 2.0 * widths if round_number == 0 else steps * widths
        trials = centre + offsets @ free.T
        found = _best_of(goal, trials[goal.regrets(trials) <= goal.limit])
        if found is not None and (best is None or found.privacy > best.privacy):
            best = found
            centre = best.action
        if best is None:
            return None
        widths = widths * (4.0 / _ZOOM_POINTS if free.shape[1] == 1 else 0.5)
    return best


def _pattern(dimension: int, rng: np.random.Generator) -> Array:
    if dimension == 1:
        return np.linspace(-1.0, 1.0, _ZOOM_POINTS)[:, None]
    return rng.uniform(-1.0, 1.0, size=(_ZOOM_POINTS, dimension))


def _reach(goal: Goal, action: Array, free: Array) -> Array:
    """How far each free coordinate may move, alone, inside the feasible set and the budget: shape (k, 2)."""
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
    steps = reach.T[:, :, None] * free.T
    return np.asarray(
        reach * goal.along_steps(action, steps.reshape(-1, action.size), tolerances.POLISH).reshape(2, -1).T
    )


def _best_of(goal: Goal, trials: Array) -> Trial | None:
    allowed = trials[goal.problem.constraints.is_admissible(trials)] if len(trials) else trials
    if not len(allowed):
        return None
    distances = consistent_sets(goal.problem, allowed).distances(goal.reference.point)
    privacies = np.where(np.isfinite(distances), goal.reference.sign * distances, -np.inf)
    index = int(privacies.argmax())
    return Trial(allowed[index], float(privacies[index])) if np.isfinite(privacies[index]) else None
