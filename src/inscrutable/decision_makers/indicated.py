"""From goals that are met or missed to results: single decisions and lotteries, for one belief or many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.adversaries.consistent_sets import LARGER
from inscrutable.adversaries.level_test import LevelTest
from inscrutable.decision_makers.hiding import Case
from inscrutable.decision_makers.indicators import Indicator, IndicatorTable, table_of
from inscrutable.decision_makers.result_table import ResultTable
from inscrutable.decision_makers.results import (
    Decision,
    Decisions,
    DecisionStatus,
    MixedDecisions,
    Progress,
)
from inscrutable.decision_makers.search.indicator_polish import Block, cheaper
from inscrutable.kernels.threads import in_chunks
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems import DecisionProblem, LinearForm
from inscrutable.validation import Array

_CHUNK = 64
_OWN, _POLISHED, _CANDIDATE, _NOTHING = range(4)


@dataclass(frozen=True, eq=False)
class IndicatorResult:
    """How T beliefs are best hidden: `source` says whether by the optimal decision, a polished one, a candidate, or not."""

    problem: DecisionProblem
    beliefs: Array  # (T,X)
    actions: Array  # (T,U)
    optimal_costs: Array  # (T,)
    regrets: Array  # (T,)
    decoys: Array  # (T,X)
    source: np.ndarray  # (T,)

    @property
    def is_optimal(self) -> np.ndarray:
        """Whether the optimal decision itself meets the goal (T,)."""
        return np.asarray(self.source == _OWN)

    @property
    def is_met(self) -> np.ndarray:
        """Whether the goal is met (T,)."""
        return np.asarray(self.source != _NOTHING)

    def improve(self, step: int, decision: Decision) -> None:
        """Let a cheaper decision meet the goal for one belief."""
        self.actions[step], self.regrets[step] = self.problem.as_points(decision.action), decision.regret
        self.decoys[step], self.source[step] = _centres(self.problem, self.actions[step : step + 1])[0], _POLISHED

    def decisions(self) -> Decisions:
        """Return single decisions."""
        kinds = {_OWN: DecisionStatus.OPTIMAL, _NOTHING: DecisionStatus.NO_AFFORDABLE_PRIVACY}
        return Decisions(self._table(kinds))

    def lotteries(self) -> MixedDecisions:
        """Return lotteries of one atom: among equal privacies nothing is cheaper than the cheapest decision."""
        kinds = {_POLISHED: DecisionStatus.POLISHED, _NOTHING: DecisionStatus.NO_AFFORDABLE_PRIVACY}
        return MixedDecisions(replace(self._table(kinds), price=np.zeros(len(self.source))))

    def _table(self, kinds: Mapping[int, DecisionStatus]) -> ResultTable:
        return ResultTable(
            self.problem,
            self.actions[:, None],
            np.ones((len(self.source), 1)),
            self.regrets[:, None],
            np.where(self.source == _NOTHING, -np.inf, 0.0)[:, None],
            self.decoys[:, None],
            self.optimal_costs,
            np.zeros(len(self.source)),
            tuple(kinds.get(int(code), DecisionStatus.BEST_CANDIDATE) for code in self.source),
        )


def met(case: Case, beliefs: Array, progress: Progress | None = None) -> IndicatorResult:
    """Return how beliefs (T,X) are best hidden; chunks of them in turn, on all cores."""
    count, n_states = beliefs.shape
    table = table_of(case.problem, case.measure, case.candidates, case.on_empty)
    result = IndicatorResult(
        case.problem,
        beliefs,
        np.empty((count, case.problem.n_actions)),
        np.empty(count),
        np.empty(count),
        np.empty((count, n_states)),
        np.empty(count, dtype=np.int64),
    )

    def work(first: int, last: int) -> None:
        _fill(case, table, result, slice(first, last))

    if not table.goal.compares_gaps:
        in_chunks(work, count, _CHUNK, progress)
        return result
    # Comparing gaps holds the interpreter's lock: threads would only wait for one another.
    for first in range(0, count, _CHUNK):
        last = min(first + _CHUNK, count)
        work(first, last)
        if progress is not None:
            progress(last, count)
    return result


def _fill(case: Case, table: IndicatorTable, result: IndicatorResult, part: slice) -> None:
    problem, goal, beliefs = case.problem, table.goal, np.ascontiguousarray(result.beliefs[part])
    optimal = problem.solve_points(beliefs)
    optimal_costs = (problem.state_costs(optimal) * beliefs).sum(axis=1)
    limits = case.budget.limits(optimal_costs)
    met = goal.met_by(beliefs, optimal, np.zeros(len(beliefs)))
    if goal.compares_gaps:
        met[:] = False
    source = np.where(met, _OWN, _NOTHING)
    actions, regrets = optimal.copy(), np.zeros(len(beliefs))
    others = np.flatnonzero(~met)
    cheapest = table.cheapest(beliefs[others], optimal_costs[others], limits[others])
    found = np.flatnonzero(cheapest.found >= 0)
    if found.size:
        chosen, which = table.number[cheapest.found[found]], others[found]
        sets, candidates = case.candidates.sets, case.candidates.actions[chosen]
        block = Block(beliefs[which], optimal[which], optimal_costs[which], sets.start[chosen],
                      sets.dimension[chosen] >= 0, candidates)  # fmt: skip
        # Between choices there is nothing.
        polished = candidates if problem.is_discrete else cheaper(goal, block, table.starts)
        costs = (problem.state_costs(polished) * beliefs[which]).sum(axis=1)
        reached = np.maximum(costs - optimal_costs[which], 0.0)
        better = reached < cheapest.regrets[found]
        source[which] = np.where(better, _POLISHED, _CANDIDATE)
        actions[which] = np.where(better[:, None], polished, candidates)
        regrets[which] = np.where(better, reached, cheapest.regrets[found])
    linear = problem.linear_form()
    if goal.compares_gaps and linear is not None and linear.lift is None and not problem.is_discrete:
        for t in others:
            exact = _by_programme(case, goal, linear, beliefs[t], float(optimal_costs[t]))
            best = limits[t] if source[t] == _NOTHING else min(limits[t], regrets[t])
            if exact is not None and exact[1] <= best:
                actions[t], regrets[t], source[t] = *exact, _POLISHED
    result.actions[part], result.regrets[part], result.source[part] = actions, regrets, source
    result.optimal_costs[part], result.decoys[part] = optimal_costs, _centres(problem, actions)


def _by_programme(
    case: Case, goal: Indicator, form: LinearForm, belief: Array, optimal_cost: float
) -> tuple[Array, float] | None:
    """The cheapest unexplained decision of linear costs and its regret, where it is admissible."""
    action = _cheapest_unexplained(form, belief, goal.margin)
    if action is None or not case.problem.constraints.is_admissible(action):
        return None
    if not LevelTest(case.problem, goal.margin).reaches(action):
        return None
    return action, max(float(case.problem.state_costs(action) @ belief) - optimal_cost, 0.0)


def _centres(problem: DecisionProblem, actions: Array) -> Array:
    """A belief in the middle of what explains each decision; NaN where nothing does."""
    sets = consistent_sets(problem, actions)
    middle = 0.5 * (sets.start + sets.end)
    for i in np.flatnonzero(sets.dimension >= LARGER):
        middle[i] = sets[int(i)].interior_point()
    return np.where((sets.dimension < 0)[:, None], np.nan, middle)


def _cheapest_unexplained(form: LinearForm, belief: Array, margin: float) -> Array | None:
    """Return the decision (U,) of least cost under a belief whose plausibility gap is at least the margin, None where
    there is none.

    r(u) = min_π max_{v ∈ C} π·(s(u) − s(v)) = max_{v ∈ C} min_i c_i'(u − v): least regrets of at least the margin are where
    some v ∈ C costs less by the margin in every state. One linear programme finds the cheapest.
    """
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
