"""The points of a frontier: all distinct candidates rated in one pass, and only those judged exactly that can be on it."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.distinct import LARGER, distinct_of
from inscrutable.decision_makers.envelope import RatedPoints, concave_envelope, undominated
from inscrutable.decision_makers.indicators import table_of
from inscrutable.decision_makers.results import Decision
from inscrutable.decision_makers.scores import score
from inscrutable.decision_makers.search.partition import face_programme
from inscrutable.decision_makers.search.region_search import rules_for
from inscrutable.geometry.equal_rows import distinct_patterns
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem, QuadraticProblem, quadratic_problem
from inscrutable.validation import Array


class Points(NamedTuple):
    """Regret and privacy of decisions, and which candidate each is; as many as there are stand for the optimal decision."""

    regrets: Array
    privacies: Array
    number: np.ndarray


class FrontierPoints(RatedPoints):
    """Points under one belief whose privacies are upper bounds until the set of a decision is judged itself."""

    def __init__(self, points: Points, exact: np.ndarray, judge: Callable[[int], float]) -> None:
        self.regrets, self.privacies, self.number = points
        self.exact, self._judge = exact, judge

    def refine(self, place: int) -> None:
        """Judge the set of a point."""
        self.privacies[place], self.exact[place] = self._judge(int(self.number[place])), True

    def undominated(self) -> Points:
        """Return the points that no cheaper one matches, by rising regret."""
        return self._pick(self.settled(undominated))

    def envelope(self) -> Points:
        """Return the corners of the concave envelope, by rising regret."""
        return self._pick(self.settled(concave_envelope))

    def _pick(self, which: np.ndarray) -> Points:
        return Points(self.regrets[which], self.privacies[which], self.number[which])


def goal_points(
    problem: DecisionProblem, own: Decision, belief: Array, measure: PrivacyMeasure, candidates: Candidates
) -> FrontierPoints:
    """Return the one point of a goal that is met or missed: the cheapest decision that meets it, the optimal one last."""
    table = table_of(problem, measure, candidates)
    found, regrets = table.cheapest(belief[None], np.array([own.optimal_cost]), np.array([np.inf]))
    index = np.append(table.number[found[found >= 0]], len(candidates))
    points = Points(np.append(regrets[found >= 0], own.regret), np.append(np.zeros(len(index) - 1), own.privacy), index)
    return FrontierPoints(points, np.ones(len(index), dtype=bool), lambda _: 0.0)


def distance_points(own: Decision, belief: Array, measure: PrivacyMeasure, candidates: Candidates) -> FrontierPoints:
    """Return the candidates that can be on the frontier of a measure that is ± a distance, and the optimal decision."""
    sets, table, reference = candidates.sets, distinct_of(candidates), measure.reference(belief)
    assert reference is not None
    regrets = np.maximum(table.costs @ belief - own.optimal_cost, 0.0)
    privacies = reference.sign * sets.bounds(reference.point)[table.number] + 0.0
    privacies[table.kind < 0] = -np.inf
    if reference.sign < 0:
        privacies[table.kind == LARGER] = 0.0
    chosen = _contenders(regrets, privacies, table.kind < LARGER, own.privacy)
    problem = sets.problem
    form, quadratic = problem.quadratic_form(), quadratic_problem(problem)
    if reference.sign < 0 and form is not None and quadratic is not None:
        larger = chosen[table.kind[chosen] == LARGER]
        variables = form.variables(candidates.actions[table.number[larger]])
        nearness = _distances(quadratic, variables, reference.point)
        privacies[larger] = -np.maximum(nearness - tolerances.NO_PRIVACY, 0.0)
    points = Points(
        np.append(regrets[chosen], own.regret),
        np.append(privacies[chosen], own.privacy),
        np.append(table.number[chosen], len(candidates)),
    )
    exact = np.append(table.kind[chosen] < LARGER, True)
    return FrontierPoints(points, exact, lambda index: float(measure(belief, sets[index])))


def _contenders(regrets: Array, privacies: Array, is_exact: np.ndarray, least: float) -> np.ndarray:
    """Return the points whose privacy is above `least` and above that of all cheaper ones whose privacy is exact."""
    order = np.argsort(regrets, kind="stable")
    known = np.where(is_exact, privacies, -np.inf)[order]
    before = np.maximum.accumulate(np.append(least, known[:-1]))
    return np.sort(order[(privacies[order] > before) | ((regrets[order] == 0.0) & (privacies[order] > -np.inf))])


def scored_points(own: Decision, belief: Array, measure: PrivacyMeasure, candidates: Candidates) -> FrontierPoints:
    """Return all candidates under any other measure, and the optimal decision."""
    scores = score(belief, own.optimal_cost, candidates, measure, "exclude")
    points = Points(
        np.append(scores.regrets, own.regret),
        np.append(scores.privacies, own.privacy),
        np.arange(len(candidates) + 1),
    )
    exact = np.append(scores.exact, True)
    return FrontierPoints(points, exact, lambda index: float(measure(belief, candidates.sets[index])))


def _distances(problem: QuadraticProblem, actions: Array, point: Array) -> Array:
    """Return the distances of a belief from the sets of decisions (n,U) as the search's kernel finds them; 0 where unsure."""
    from inscrutable.kernels.set_distance import NO_ROW, distance_room, nearest_belief

    found = np.zeros(len(actions))
    if not len(actions):
        return found
    patterns, pattern_of = distinct_patterns(problem.constraints.tight_rows(actions))
    rules, nearest, point = rules_for(problem.n_states), np.empty(problem.n_states), np.ascontiguousarray(point)
    for number, tight in enumerate(patterns):
        face = face_programme(problem, tight)
        which = np.flatnonzero(pattern_of.reshape(-1) == number)
        places = np.column_stack([(actions[which] - face.origin) @ face.span, np.ones(len(which))])
        room = distance_room(problem.n_states, places.shape[1] - 1, len(face.rows))
        for i, w in zip(which, np.ascontiguousarray(places), strict=True):
            found[i] = nearest_belief(face.arrays, w, point, rules, NO_ROW, nearest, room)
    return np.where(np.isfinite(found), found, 0.0)
