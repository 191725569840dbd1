"""The best single decision of any smooth problem: from the best candidates to a local optimum, face by face.

A face fixes the tight rows. Where its consistent sets are points, privacy is the distance of the decision's decoy, and
regret never falls along a ray from the true belief: the best decoy of a direction is the last affordable one. A pattern search
over directions shrinks around the best. Where the sets are larger, few coordinates of the decision are free; a pattern search
over these computes the set's distance at every trial. SLSQP over the decoy, with slacks and budget as
constraints, finds the same privacies for growth problems of two and three states (to 1e-6) in up to 27 times as long: it asks
for one belief after the other, a pattern for all of them at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.scores import Scores
from inscrutable.decision_makers.search.goal import Goal
from inscrutable.decision_makers.search.rays import Rays, best_on_rays, farthest_decoys
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.validation import Array

_POINTS, _ROUNDS = 7, 10  # of the pattern search over directions
_FIRST_SPREAD, _SHRINK = 0.5, 0.4
"""Of 24 growth decisions, one loses .03 % with 4 points, and seven lose up to 1.6 % with 6 rounds. Three lose .1 % with a first
spread of 1, and six .3 % with a factor of .6, as directions are not close enough in the end. With twice the points or 16 rounds
two gain .02 %, in 1.1 and 1.2 times the time; .25 and .2 lose .03 %."""


class _Climb:
    """The state of the search from one decoy."""

    def __init__(self, goal: Goal, tight: np.ndarray, decoy: Array, basis: Array) -> None:
        self.tight, length = tight, float(np.linalg.norm(decoy - goal.belief))
        self.value, self.action = -np.inf, np.zeros(0)
        self.direction = basis.T @ (decoy - goal.belief) / max(length, tolerances.SAME_BELIEF)
        self.is_open = length > tolerances.SAME_BELIEF
        self._rng = np.random.default_rng(0)  # the pattern of trial points, the same at every call

    def turned(self, spread: float) -> Array:
        """Directions (n,X−1) around the best so far."""
        return self.direction + spread * _turns(self.direction, self._rng)

    def take(self, goal: Goal, turned: Array, trial: Rays) -> None:
        """Keep the best of some rays, if it is on the face and better than what is known."""
        values = np.where(_is_on_face(goal, self.tight, trial.actions), trial.values, -np.inf)
        index = int(values.argmax())
        if values[index] > self.value:
            self.value, self.action = float(values[index]), trial.actions[index]
            self.direction = turned[index] / np.linalg.norm(turned[index])


def climb_on_rays(goal: Goal, tight: Sequence[np.ndarray], decoys: Sequence[Array]) -> list[Array | None]:
    """Return, for each of some decoys, the decision on its face `tight` whose decoy is best, from the decoy's direction.

    None where the face is left. All searches run together: a problem solves many beliefs almost as fast as one.
    """
    basis = sum_zero_basis(goal.belief.size)
    climbs = [_Climb(goal, *start, basis) for start in zip(tight, decoys, strict=True)]
    spread, size = _FIRST_SPREAD, basis.shape[1]
    for _ in range(_ROUNDS if size > 1 else 1):
        _turn(goal, climbs, basis, spread)
        spread *= _SHRINK if size == 2 else np.sqrt(_SHRINK)
    for climb in climbs:
        climb.is_open &= climb.value > -np.inf
    _turn(goal, climbs, basis, 0.0)
    return [climb.action if climb.is_open else None for climb in climbs]


def _turn(goal: Goal, climbs: list[_Climb], basis: Array, spread: float) -> None:
    """Try directions around the best of each climb, or these again where the spread is zero."""
    under_way = [climb for climb in climbs if climb.is_open]
    if not under_way:
        return
    turned = [climb.turned(spread) if spread else climb.direction[None] for climb in under_way]
    trial = best_on_rays(goal, np.vstack(turned) @ basis.T)
    ends = np.cumsum([0, *map(len, turned)])
    for number, climb in enumerate(under_way):
        rows = slice(ends[number], ends[number + 1])
        climb.take(goal, turned[number], Rays(*(column[rows] for column in trial)))


def _is_on_face(goal: Goal, tight: np.ndarray, actions: Array) -> np.ndarray:
    region = goal.problem.constraints
    return np.asarray((region.tight_rows(actions) == tight).all(axis=1) & region.is_admissible(actions))


def _turns(direction: Array, rng: np.random.Generator) -> Array:
    """Steps across a direction (k,), the first of them none; shape (n,k)."""
    size = direction.size
    if size == 1:
        return np.zeros((1, 1))
    if size == 2:
        return np.asarray(np.linspace(-1.0, 1.0, _POINTS)[:, None] * np.array([-direction[1], direction[0]]))
    steps = rng.normal(size=(_POINTS * (size - 1), size))
    steps -= (steps @ direction)[:, None] * direction
    steps *= (rng.uniform(size=len(steps)) / np.linalg.norm(steps, axis=1))[:, None]
    return np.vstack([np.zeros(size), steps])


_FACES, _STARTS_A_FACE = 10, 6
"""Of 24 growth decisions, three lose .3 % with 3 faces, and none gains with 30. Two lose 1.4 % with 3 starts a face, in 4/5 of
the time, and six with one."""
_STARTS_APART = 0.1  # of the extent of all decoys; with 0 and .3 one of 24 growth decisions loses .1 %
_ZOOM_POINTS, _ZOOM_ROUNDS = 41, 7
"""With 15 points, four of 24 growth decisions lose .3 %; with 81, two gain .2 % in 1.2 times the time; with 4 rounds one loses
3e-5, with 12 none gains."""


class Trial(NamedTuple):
    """An admissible, affordable decision and its privacy."""

    action: Array
    privacy: float


class Start(NamedTuple):
    """A start on a face: the face's tight rows, a decoy and a decision."""

    tight: np.ndarray
    decoy: Array
    action: Array


def polish(goal: Goal, scores: Scores) -> Trial | None:
    """Return the best decision reached from the most promising faces."""
    on_rays: list[Start] = []
    others = []
    for start in _starts(goal, scores):
        free = goal.problem.constraints.directions(start.tight)
        if _goes_on_rays(goal, free):
            on_rays.append(start)
        else:
            others.append(_improve(goal, start, free))
    reached = climb_on_rays(goal, [start.tight for start in on_rays], [start.decoy for start in on_rays])
    ends = [start.action if action is None else action for start, action in zip(on_rays, reached, strict=True)]
    trials = [judge(goal, action[None]) for action in ends]
    found = [trial for trial in trials + others if trial is not None]
    return max(found, key=lambda trial: trial.privacy, default=None)


def _starts(goal: Goal, scores: Scores) -> list[Start]:
    """The best affordable candidates, and the ends of affordable rays, of every promising face, apart from each other."""
    region = goal.problem.constraints
    sets = scores.candidates.sets
    affordable = np.flatnonzero((scores.regrets <= goal.limit) & np.isfinite(scores.privacies))
    rays = farthest_decoys(goal)
    actions = np.vstack([scores.candidates.actions[affordable], rays.actions])
    decoys = np.vstack([sets.start[affordable], rays.decoys])
    value = np.concatenate([scores.privacies[affordable], rays.values])
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
                known.append(Start(tight, decoys[i], actions[i]))
        if len(faces) >= _FACES:
            break
    return [start for known in list(faces.values())[:_FACES] for start in known] + _leaving(goal)


def _leaving(goal: Goal) -> list[Start]:
    """Return starts at the optimal decision with one tight row freed, where many beliefs share that decision.

    Without them 2 of 30 decisions of growth problems lose up to .3 %.
    """
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
        free = region.directions(others)
        inward = -free @ (free.T @ region.A_ub[row])
        speed = -float(region.A_ub[row] @ inward)
        if speed <= tolerances.ON_FACE:
            continue
        step = region.played_slack * region.row_scale[row] / speed
        starts.append(Start(others, goal.belief, np.asarray(optimal + step * inward)))
    return starts


def _goes_on_rays(goal: Goal, free: Array) -> bool:
    """Whether a face's consistent sets are single beliefs: with k free coordinates their dimension is X − 1 − k."""
    return bool(free.shape[1] >= goal.problem.n_states - 1 and goal.problem.n_states > 1)


def _improve(goal: Goal, start: Start, free: Array) -> Trial | None:
    if free.shape[1] == 0 or not np.array_equal(goal.problem.constraints.tight_rows(start.action), start.tight):
        return judge(goal, start.action[None])
    return _zoomed(goal, start.action, free)


def judge(goal: Goal, actions: Array) -> Trial | None:
    """Return the best of decisions (n,U) with its exact privacy, None where none is admissible, affordable and explained."""
    allowed = actions[goal.problem.is_admissible(actions) & (goal.regrets(actions) <= goal.limit)]
    if not len(allowed):
        return None
    privacies = goal.judged(allowed).privacies
    index = int(privacies.argmax())
    return Trial(allowed[index], float(privacies[index]) + 0.0) if np.isfinite(privacies[index]) else None


def _zoomed(goal: Goal, action: Array, free: Array) -> Trial | None:
    """A pattern search over the few free coordinates of a decision, with the set's distance computed at every trial."""
    best = judge(goal, action[None])
    if goal.regrets(action) > goal.limit:
        return None
    reach = _reach(goal, action, free)
    widths = np.maximum(reach[:, 1] - reach[:, 0], 0.0)
    centre = action
    rng = np.random.default_rng(0)  # the pattern of trial points, the same at every call
    for round_number in range(_ZOOM_ROUNDS if free.shape[1] == 1 else 4 * _ZOOM_ROUNDS):
        steps = _spread(free.shape[1], rng)
        offsets = reach[:, 0] + (steps + 1.0) / 2.0 * widths if round_number == 0 else steps * widths
        trials = centre + offsets @ free.T
        found = judge(goal, trials)
        if found is not None and (best is None or found.privacy > best.privacy):
            best = found
            centre = best.action
        if best is None:
            return None
        widths = widths * (4.0 / _ZOOM_POINTS if free.shape[1] == 1 else 0.5)
    return best


def _spread(dimension: int, rng: np.random.Generator) -> Array:
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
