"""The cheapest decisions and lotteries that meet an indicator measure, for one belief or many."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import consistent_sets
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.budgets import Budget
from inscrutable.decision_makers.hiding import Case
from inscrutable.decision_makers.indicators import Block, Indicator, cheaper, cheapest_candidates
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.results import (
    Decision,
    Decisions,
    DecisionStatus,
    MixedDecisions,
    Progress,
    ResultTable,
    counted,
)
from inscrutable.decision_makers.search.partition import face_programme
from inscrutable.errors import ModelError, SolverError
from inscrutable.geometry.hulls import LARGER
from inscrutable.kernels.calls import in_chunks
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.privacy import MaximalObfuscation
from inscrutable.problems import DecisionProblem, LinearForm, quadratic_problem
from inscrutable.problems.quadratic_programme import Layout, solve_programmes
from inscrutable.validation import Array

_CHUNK = 256
_OWN, _POLISHED, _CANDIDATE, _NOTHING = range(4)


@dataclass(frozen=True, eq=False)
class IndicatorResult:
    """The cheapest decisions of T beliefs; `source` says whether each is optimal, polished, a candidate, or missing."""

    problem: DecisionProblem
    beliefs: Array  # (T,X)
    actions: Array  # (T,U)
    optimal_costs: Array  # (T,)
    regrets: Array  # (T,)
    decoys: Array  # (T,X)
    source: np.ndarray  # (T,)

    def decisions(self) -> Decisions:
        """Return single decisions."""
        kinds = {_OWN: DecisionStatus.OPTIMAL, _NOTHING: DecisionStatus.NO_AFFORDABLE_PRIVACY}
        return Decisions(self._table(kinds))

    def lotteries(self) -> MixedDecisions:
        """Return lotteries of one atom: among equal privacies nothing is cheaper than the cheapest decision."""
        kinds = {_POLISHED: DecisionStatus.POLISHED, _NOTHING: DecisionStatus.NO_AFFORDABLE_PRIVACY}
        return MixedDecisions(replace(self._table(kinds), price=np.zeros(len(self.source))))

    def _table(self, kinds: Mapping[int, DecisionStatus]) -> ResultTable:
        status = tuple(kinds.get(int(code), DecisionStatus.BEST_CANDIDATE) for code in self.source)
        privacies = np.where(self.source == _NOTHING, -np.inf, 0.0)
        atoms = self.actions, self.regrets, privacies, self.decoys
        return ResultTable.of_single(self.problem, *atoms, self.optimal_costs, np.zeros(len(status)), status)


def cheapest_by_scan(case: Case, beliefs: Array, progress: Progress | None = None) -> IndicatorResult:
    """Return the cheapest decisions of beliefs (T,X) that meet the goal, in chunks on all cores."""
    count, n_states = beliefs.shape
    goal = Indicator(case.problem, case.measure, case.on_empty)
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
        _fill(case, goal, result, slice(first, last))

    if not goal.compares_gaps:
        in_chunks(work, count, _CHUNK, progress)
        return result
    # Comparing gaps holds the interpreter's lock: threads would only wait for one another.
    for first in range(0, count, _CHUNK):
        last = min(first + _CHUNK, count)
        work(first, last)
        if progress is not None:
            progress(last, count)
    return result


def _fill(case: Case, goal: Indicator, result: IndicatorResult, part: slice) -> None:
    problem, beliefs = case.problem, np.ascontiguousarray(result.beliefs[part])
    optimal = problem.solve_points(beliefs)
    state_costs = problem.state_costs(optimal)
    optimal_costs = (state_costs * beliefs).sum(axis=1)
    limits = case.budget.limits(optimal_costs)
    rounding = tolerances.COST_ROUNDING * (np.abs(state_costs) * beliefs).sum(axis=1)
    met = goal.met_by(beliefs, optimal, np.zeros(len(beliefs)))
    if goal.compares_gaps:
        met[:] = False
    source = np.where(met, _OWN, _NOTHING)
    actions, regrets = optimal.copy(), np.zeros(len(beliefs))
    others, sets = np.flatnonzero(~met), case.candidates.sets
    # Without a limit: what the budget does not afford may be lowered to what it does.
    no_limits = np.full(len(others), np.inf)
    numbers, paid = cheapest_candidates(goal, case.candidates, beliefs[others], optimal_costs[others], no_limits)
    found = np.flatnonzero(numbers >= 0)
    if found.size:
        chosen, paid, which = numbers[found], paid[found], others[found]
        candidates = case.candidates.actions[chosen]
        block = Block(beliefs[which], optimal[which], optimal_costs[which], sets.start[chosen],
                      sets.dimension[chosen] >= 0, candidates)  # fmt: skip
        # A finite problem has no decisions between its choices.
        members = None if goal.measure.least_distance() is None else sets.start[sets.dimension >= 0]
        polished = candidates if problem.is_discrete else cheaper(goal, block, members)
        costs = (problem.state_costs(polished) * beliefs[which]).sum(axis=1)
        reached = np.maximum(costs - optimal_costs[which], 0.0)
        better = reached < paid
        least = np.minimum(reached, paid)
        affordable = least <= limits[which] + rounding[which]
        kept = which[affordable]
        source[kept] = np.where(better, _POLISHED, _CANDIDATE)[affordable]
        actions[kept] = np.where(better[:, None], polished, candidates)[affordable]
        regrets[kept] = np.minimum(least[affordable], limits[kept])
    linear = problem.linear_form()
    if goal.compares_gaps and linear is not None and linear.lift is None and not problem.is_discrete:
        for t in others:
            exact = _by_programme(case, goal, linear, beliefs[t], float(optimal_costs[t]))
            best = limits[t] if source[t] == _NOTHING else min(limits[t], regrets[t])
            if exact is not None and exact[1] <= best:
                actions[t], regrets[t], source[t] = *exact, _POLISHED
    result.actions[part], result.regrets[part], result.source[part] = actions, regrets, source
    result.optimal_costs[part], result.decoys[part] = optimal_costs, central_members(problem, actions)


def _by_programme(
    case: Case, goal: Indicator, form: LinearForm, belief: Array, optimal_cost: float
) -> tuple[Array, float] | None:
    """The cheapest unexplained decision of linear costs and its regret, where it is admissible."""
    action = _cheapest_unexplained(form, belief, goal.margin)
    if action is None or not case.problem.is_admissible(action):
        return None
    if not goal.gap_reaches(action):
        return None
    return action, max(float(case.problem.state_costs(action) @ belief) - optimal_cost, 0.0)


def central_members(problem: DecisionProblem, actions: Array) -> Array:
    """Return a central member (n,X) of each decision's consistent set; NaN where that is empty."""
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
    # The computed gap has this error.
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


Search = Callable[[Case, Array], Decisions]
"""The best single decisions of beliefs (T,X)."""


def cheapest_by_search(case: Case, beliefs: Array, best: Search, progress: Progress | None = None) -> IndicatorResult:
    """Return the cheapest decisions of beliefs (T,X) that meet an indicator measure; where that asks for a distance, `best` is
    searched at falling budgets."""
    distance = case.measure.least_distance()
    if distance is None or quadratic_problem(case.problem) is None:
        return cheapest_by_scan(case, beliefs, progress)
    found = cheapest_by_scan(case, beliefs)
    for step, belief in counted(beliefs, progress):
        if found.source[step] == _OWN:
            continue
        limit = case.budget.limit(found.optimal_costs[step])
        most = limit if found.source[step] == _NOTHING else found.regrets[step]
        other = cheapest_keeping_distance(case, belief, best, float(most), distance)
        if other is not None and case.measure(belief, belief_set_of(case.problem, other.action)) == 0.0:
            action = case.problem.as_points(other.action)
            found.actions[step], found.regrets[step], found.source[step] = action, other.regret, _POLISHED
            found.decoys[step] = central_members(case.problem, action[None])[0]
    return found


def cheapest_keeping_distance(case: Case, belief: Array, best: Search, most: float, distance: float) -> Decision | None:
    """Return the decision of least regret, up to `most`, that keeps a distance; None where none is found that costs less.

    Decisions that no belief explains are among them only where the case's measure judges them.
    """
    problem, farthest = case.problem, replace(case, measure=MaximalObfuscation(), on_empty="exclude")

    def search(regret: float) -> Decision:
        return best(replace(farthest, budget=Budget.regret(regret)), belief[None])[0]

    def shortened(decision: Decision) -> Decision | None:
        action = shortened_on_its_face(problem, belief, decision.action)
        if action is None:
            return decision
        if not problem.is_admissible(action):
            return None
        shorter = decision_for(problem, belief, action, farthest.measure, DecisionStatus.POLISHED)
        return shorter if case.measure.judges_empty or np.isfinite(shorter.privacy) else None

    wanted = max(distance * (1.0 + tolerances.SLACK_SAFETY), distance + tolerances.NO_PRIVACY)
    found = cheapest_at_distance(search, shortened, most, wanted)
    return found if found is not None and found.regret < most else None


_MOST_SEARCHES = 20
"""Most searches at falling budgets. With 10, ten of 100 decisions over two to five states that keep a distance cost up to 3 %
more; with 40, one gains 3e-5."""
_JUMPS = 0.75
"""A privacy jumps within a bracket where its gap there is above this share of the former one's. With .6, one of these 100 costs
12 % more; with .9, two cost 5 and 10 % more; without bisections, two cost 6 and 15 % more, in 1.2 times the time."""


def cheapest_at_distance(
    search: Callable[[float], Decision],
    shortened: Callable[[Decision], Decision | None],
    most: float,
    distance: float,
) -> Decision | None:
    """Return the cheapest decision found with a privacy of at least `distance`, None where a regret of `most` affords none.

    `search` gives the most private decision for a budget B, with privacy P(B). For small B, P is about linear in √B, as regrets
    are quadratic; it jumps where a farther decision becomes affordable. That decision is `shortened` to the least regret on
    its face, if there is one, and a search with a smaller budget tests whether a cheaper one exists. Otherwise P(B) = distance
    is solved by the secant method in √B, with bisections where that gains little.
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
            best, is_end = found, False
            if least is not None and least.privacy >= distance:
                is_end = least.regret <= found.regret * (1.0 + tolerances.LEAST_ON_FACE)
                best = least if least.regret < found.regret else found
            high, above = min(high, float(np.sqrt(best.regret))), best.privacy - distance
            left, right, side = (0.5 if side > 0 else 1.0) * left, above, 1
        inside = (tolerances.LEAST_ON_FACE if is_end else tolerances.LEAST_BUDGET) * high
        jumps = above - below > _JUMPS * gap
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
    slacks, free, no_rows = face.rows[face.n_set_rows :, 0], np.full(size, np.inf), np.empty((0, size))
    layout = Layout(-free, free, -slacks[:, :size], slacks[:, size], no_rows, np.empty(0))
    try:
        place = solve_programmes(cost[None, :size, :size], cost[None, :size, size], layout)[0]
    except (ModelError, SolverError):
        return None
    return np.asarray(form.decisions(face.action(place)))
