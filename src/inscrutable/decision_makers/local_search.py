"""The paper's method: a local solver over the decision, from random affordable starts."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextvars import copy_context
from dataclasses import dataclass, field
from functools import lru_cache, partial
from threading import Condition
from typing import Any

import numpy as np
from scipy.optimize import minimize

from inscrutable import validation
from inscrutable.decision_makers.candidate_sources import random_actions
from inscrutable.decision_makers.search.goal import Goal, Judgement
from inscrutable.geometry.crossings import first_met
from inscrutable.kernels.threads import one_blas_thread
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_TRIES_A_START, _BLOCK = 200, 16
"""Random decisions among which a start is looked for, and how many are judged at once. Of 40 problems over two to five states,
two have fewer starts with 60, and two have more with 600, in 1.3 times the time. With five or 48 at once all take as long, one
by one twice as long, all at once up to 1.5 times."""
_UNEXPLAINED = 2.0
"""Loss of a trial that no belief explains, above the largest: of 50 problems with at most as many assets as states, one loses
two of three starts with 0 or 6; with .7, five gain and five lose up to 2 %."""
_STEP = 2.0**-30
"""Starts lie on multiples of this share of the way to the budget's end: the solver's answer may depend on the last digits of
its start, and these must not depend on the root finder."""
_ACCURACY = 2.0**-45
"""Accuracy of these ends: one in thirty thousand is rounded to another multiple."""
_TOGETHER = 20
"""Most starts that run together, each on a thread: over three assets five take .6 to .7 of the time of one after the other,
twenty .4 to .5, forty .4."""
_DIFFERENCE = float(np.sqrt(np.finfo(float).eps))
"""Step of forward differences. With a fifth of it, 10 of these 50 lose up to 1.2 % and two gain a start; with three times as
much six gain up to 2 %."""


@dataclass(frozen=True)
class LocalSearch:
    """The paper's solver: SLSQP over the decision, from random affordable starts, which finds local optima.

    A start is drawn uniformly from the feasible set and moved toward the optimal decision until it is affordable; starts
    that no belief explains are drawn again, because the privacy there is undefined. Trials that no belief explains
    are penalised, and the best admissible, affordable, explained trial is returned.

    Args:
        n_starts: Number of starts, at least 1.
        rng: Source of the starts.

    Raises:
        InputError: `n_starts` is not a whole number of at least 1, or `rng` is not a generator.

    Cost: some hundred evaluations of the privacy per start. Source: the paper, eq. (8) and Section V.

    Example:
        >>> LocalSearch(n_starts=3, rng=np.random.default_rng(0)).n_starts
        3
    """

    n_starts: int = 1
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(0), repr=False)

    def __post_init__(self) -> None:
        validation.count(self.n_starts, "n_starts")
        validation.generator(self.rng)


Judge = Callable[[Array], tuple[Judgement, Array]]
"""Judges the trials (n,U) of a start, and gives the gradient (U,) of the expected cost at the first."""


class _Search:
    """The searches for one belief: what they may do, and how decisions are judged."""

    def __init__(self, problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float) -> None:
        self.optimal = np.asarray(problem.solve(belief))
        self.goal = Goal(problem, belief, limit, float(problem.state_costs(self.optimal) @ belief), measure)
        self.free = problem.constraints.directions()

    def judged(self, actions: Array) -> Judgement:
        """Judge trials (n,U): explained ones alone, unless decisions that no belief explains are sought.

        Near the optimal decision most decisions are explained by no belief. They would hide nothing from an observer who
        allows for rounding.
        """
        return self.goal.judged(actions, explained=not self.goal.measure.searches_actions)

    def judged_together(self, parts: list[Array]) -> list[Judgement]:
        """Judge the trials (n,U) of several starts, each as if alone: the last digits of a product depend on the number of its
        rows, and where the solver ends may depend on them."""
        found = self.judged(np.vstack(parts))
        ends = np.cumsum([len(part) for part in parts])[:-1]
        each = [Judgement._make(columns) for columns in zip(*(np.split(column, ends) for column in found), strict=True)]
        if len(parts) == 1:
            return each
        regrets = [np.where(np.isfinite(part).all(axis=1), self.goal.regrets(part), np.inf) for part in parts]
        return [judgement._replace(regrets=own) for judgement, own in zip(each, regrets, strict=True)]

    def slopes(self, actions: Array) -> Array:
        """The gradients (n,U) of the expected cost at trials; zero where a trial is not finite."""
        is_finite = np.asarray(np.isfinite(actions).all(axis=1))[:, None]
        found = self.goal.belief @ self.goal.problem.cost_gradients(np.where(is_finite, actions, 0.0))
        return np.where(is_finite, found, 0.0)


class _Watched:
    """The objective of the local solver from one start; remembers the best trial that may be played."""

    def __init__(self, limit: float) -> None:
        self.limit = limit
        self.best: Array | None = None
        self.best_key = (-np.inf, -np.inf)
        self.worst = 0.0

    def losses(self, actions: Array, found: Judgement) -> tuple[list[float], float]:
        """Minus the privacies of trials (n,U), and the first one's excess; remembers the best admissible affordable one."""
        excess = [regret - self.limit for regret in found.regrets.tolist()]
        losses = (-found.privacies).tolist()
        for index, playable in enumerate(found.admissible.tolist()):
            if losses[index] == np.inf:
                continue
            self.worst = max(self.worst, losses[index])
            key = (-losses[index], -excess[index])
            if playable and excess[index] <= 0 and key > self.best_key:
                self.best, self.best_key = actions[index].copy(), key
        # Where no belief explains a trial its loss is above that of every belief, so that the solver turns back.
        turned = [self.worst + _UNEXPLAINED if loss == np.inf else loss for loss in losses]
        return turned, excess[0]


class _Rounds:
    """Judges the trials of several starts at once: each waits until all that still run have asked.

    A judgement takes about half a millisecond, however few its trials.
    """

    def __init__(self, search: _Search, count: int) -> None:
        self._search, self._running = search, count
        self._ready = Condition()
        self._asked: dict[int, Array] = {}
        self._answers: dict[int, tuple[Judgement, Array]] = {}
        self._error: BaseException | None = None

    def judged(self, place: int, actions: Array) -> tuple[Judgement, Array]:
        """Judge trials (n,U) of the start at a place, with the gradient (U,) of the expected cost at the first."""
        with self._ready:
            self._asked[place] = actions
            self._answer()
            self._ready.wait_for(lambda: place in self._answers or self._error is not None)
            if self._error is not None:
                raise self._error
            return self._answers.pop(place)

    def end(self) -> None:
        """Wait no longer for a start that has ended."""
        with self._ready:
            self._running -= 1
            self._answer()

    def stop(self, error: BaseException) -> None:
        """End all starts by an error."""
        with self._ready:
            self._error = error
            self._ready.notify_all()

    def _answer(self) -> None:
        """Once all that run have asked, judge their trials, in the order of their places, whichever asked first."""
        if self._error is not None or not self._asked or len(self._asked) < self._running:
            return
        places = sorted(self._asked)
        parts = [self._asked[place] for place in places]
        self._asked.clear()
        try:
            found = self._search.judged_together(parts)
            slopes = self._search.slopes(np.array([part[0] for part in parts]))
        except BaseException as error:  # raised by every start, and by the call
            self.stop(error)
            return
        self._answers.update(zip(places, zip(found, slopes, strict=True), strict=True))
        self._ready.notify_all()


def search_locally(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float, method: LocalSearch
) -> Array | None:
    """Return the best decision found, or None where no start was affordable and explained."""
    search = _Search(problem, belief, measure, limit)
    best = max(_searched(search, method), key=lambda watched: watched.best_key).best
    return best if best is None or not measure.is_indicator else _cheaper(search, best)


def privacies_by_start(
    problem: DecisionProblem, belief: Array, measure: PrivacyMeasure, limit: float, method: LocalSearch
) -> Array:
    """Return the privacy that each start alone leads to, shape (n_starts,), of a measure that is no indicator; −∞ for a
    start that was not affordable and explained."""
    found = _searched(_Search(problem, belief, measure, limit), method)
    return np.array([watched.best_key[0] for watched in found])


def _searched(search: _Search, method: LocalSearch) -> list[_Watched]:
    """The searches from all starts, each with what it found."""
    found, runs = [], list[tuple[_Watched, Array]]()
    for _ in range(method.n_starts):
        watched = _Watched(search.goal.limit)
        start = _affordable_start(search, watched, method.rng)
        found.append(watched)
        if start is not None:
            runs.append((watched, start))
    if search.goal.measure.is_indicator or not runs:
        return found
    with one_blas_thread():  # else its last digits, and where it ends, differ with the cores
        for first in range(0, len(runs), _TOGETHER):
            _run_together(search, runs[first : first + _TOGETHER])
    return found


def _run_together(search: _Search, runs: list[tuple[_Watched, Array]]) -> None:
    """Run the solver from some starts, each on a thread of its own, which takes over the caller's floating-point settings."""
    rounds = _Rounds(search, len(runs))

    def run(place: int) -> None:
        try:
            _run(search, *runs[place], partial(rounds.judged, place))
        finally:
            rounds.end()

    if len(runs) == 1:
        run(0)
        return
    with ThreadPoolExecutor(len(runs)) as pool:
        try:
            for running in [pool.submit(copy_context().run, run, place) for place in range(len(runs))]:
                running.result()
        except BaseException as error:  # Ctrl-C too
            rounds.stop(error)
            raise


def _affordable_start(search: _Search, watched: _Watched, rng: np.random.Generator) -> Array | None:
    """Return the first decision that a belief explains among random ones, each moved to a random point between the optimal
    decision and the end of the budget."""
    away = random_actions(search.goal.problem, _TRIES_A_START, rng=rng) - search.optimal
    shares = rng.uniform(size=len(away))
    # One by one where judging a start takes a search of its own.
    block = 1 if search.goal.measure.searches_actions else _BLOCK
    for first in range(0, len(away), block):
        part = slice(first, first + block)
        reach = search.goal.along_steps(search.optimal, away[part], _ACCURACY)
        affordable = np.floor(reach / _STEP) * _STEP * shares[part]
        starts = search.optimal + affordable[:, None] * away[part]
        judged = search.judged(starts)
        explained = np.flatnonzero(judged.privacies > -np.inf)
        if explained.size:
            best = explained[:1]
            watched.losses(starts[best], Judgement._make(column[best] for column in judged))
            return np.asarray(starts[best[0]])
    return None


def _cheaper(search: _Search, reached: Array) -> Array:
    """The cheapest decision on the line to the optimal one that still meets an indicator measure."""
    way = reached - search.optimal

    def meets(share: float) -> bool:
        found = search.judged((search.optimal + share * way)[None])
        return bool(found.privacies[0] == 0.0 and found.admissible[0])

    return np.asarray(search.optimal + first_met(meets) * way)


def _run(search: _Search, watched: _Watched, start: Array, judged: Judge) -> None:
    """Run the solver from one start, in coordinates along the equalities, so that finite differences stay on them."""
    region, free = search.goal.problem.constraints.in_decision, search.free
    origin = np.zeros(free.shape[1])
    around = start + np.vstack([origin, _DIFFERENCE * np.eye(origin.size)]) @ free.T
    room, normals = region.b_ub - region.A_ub @ start, region.A_ub @ free
    scale = max(watched.limit, np.finfo(float).tiny)

    @lru_cache(1)  # the solver asks for each of them at the same point
    def look(point: bytes) -> Any:
        """The loss, its gradient by forward differences; the share of the budget left, the slack of every row, slopes."""
        v = np.frombuffer(point)
        trials = around + free @ v
        found, slope = judged(trials)
        losses, excess = watched.losses(trials, found)
        gradient = np.array([(loss - losses[0]) / _DIFFERENCE for loss in losses[1:]])
        rules, slopes = np.append(-excess / scale, room - normals @ v), np.vstack([slope @ free / -scale, -normals])
        return losses[0], gradient, rules, slopes

    def loss(v: Array) -> Any:
        return look(v.tobytes())[:2]

    rules: Any = {"type": "ineq", "fun": lambda v: look(v.tobytes())[2], "jac": lambda v: look(v.tobytes())[3]}
    minimize(loss, origin, jac=True, method="SLSQP", constraints=rules)
