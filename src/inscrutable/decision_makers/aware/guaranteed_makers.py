"""Decision makers under guarantees: their own objective on the programme of `least_regret`, within their budgets."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.budgets import Budget
from inscrutable.decision_makers.aware.base import AwareDecisionMaker
from inscrutable.decision_makers.aware.cheapest_rule import RegretSearch, checked_guarantees, undecided
from inscrutable.decision_makers.aware.columns import Columns, places_of
from inscrutable.decision_makers.aware.entropy_cones import least_informing
from inscrutable.decision_makers.aware.guaranteed_aims import LeastExcess, LeastInformation, Spending, ToldAim
from inscrutable.decision_makers.aware.guaranteed_programme import (
    MOST_ROUNDS,
    PlayedGame,
    RowBlock,
    Solved,
    TableSearch,
    repaired,
    solved_programme,
    stacked,
)
from inscrutable.decision_makers.aware.guarantees import Guarantee
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array

_PROPOSALS = 10
"""Laws of the interior-point method before the first programme, each with cuts at the one before: most rules take one. With 3,
four of 36 rules for 6 to 20 beliefs leak up to .5 % more, one after 6 times the time; with 30 none leaks less."""
_LINE_STEPS = 30
"""With ten, two of 29 rules for 6 to 20 beliefs end with a value up to .3 % worse, in the same time."""
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)
_IDLE = 4
"""Rounds that a cut of the objective stays without a price. With one these 29 take 1.7 times as long, six values are up to .5 %
worse, and one gap is not reached."""


class Promised(NamedTuple):
    """A table that gives the guarantees within the budgets, with its value, bound and decisions."""

    columns: Columns
    game: PlayedGame
    regrets: Array  # (B,M)
    solved: Solved
    levels: tuple[float, ...]
    price: float  # of one unit more of the budgets' regret, in the aim's unit


class AimedSearch(TableSearch):
    """The least objective among tables that keep guarantees and budgets; `start` is one."""

    def __init__(
        self,
        game: PlayedGame,
        aim: ToldAim | LeastExcess,
        spending: Spending | None,
        rules: tuple[Guarantee, ...],
        start: Array,
        goal: float,
    ) -> None:
        self.game, self.aim, self.spending, self.goal = game, aim, spending, goal
        beside = () if spending is None else (spending,)
        self.rules = (aim, *beside, *rules)
        self.unit, self.objective = aim.unit, np.zeros(game.shape)
        self.blocks = [[rule.rows(game)] for rule in self.rules]
        self.start = self.best = start
        self.value, self.bound = aim.value(game, start), 0.0
        self.prices = (0.0,) * len(self.rules)

    def run(self) -> Solved:
        """Solve, and add cuts, until value and bound meet or rounds are used up."""
        if isinstance(self.aim, LeastInformation):
            self._begin()
        every, idle = np.arange(self.game.shape[1]), np.zeros(0)
        for _ in range(MOST_ROUNDS):
            found = solved_programme(self.game, self.objective, self.blocks, every)
            self._keep(found.table)
            self._bounded(found, 0.0)
            if self.value - self.bound <= self.goal:
                break
            idle = self._without_idle(found.duals[0], idle)
            if not self._cut(found.table):
                break
            if isinstance(self.aim, ToldAim):
                middle = self.aim.cuts(self.game, self.best)
                assert middle is not None
                self.blocks[0].append(middle)
        return Solved(self.best, self.value, min(self.bound, self.value), self.prices)

    def _begin(self) -> None:
        """Begin with cuts at the table of an interior-point method, which may violate guarantees that need cuts."""
        assert isinstance(self.aim, LeastInformation)
        proposed = None
        for _ in range(_PROPOSALS):
            table = least_informing(self.game, [stacked(group) for group in self.blocks[1:]])
            if table is None:
                break
            proposed = table
            broken = [rule.cuts(self.game, table) for rule in self.rules[1:]]
            for block, cut in zip(self.blocks[1:], broken, strict=True):
                if cut is not None:
                    block.append(cut)
            if all(cut is None for cut in broken):
                break
        if proposed is not None:
            self._keep(proposed)
            self.blocks[0].append(self.aim.at(self.game, proposed))

    def _without_idle(self, duals: Array, idle: Array) -> Array:
        """Drop cuts that have had no price for some rounds; return for how many rounds the others had none."""
        first, *cuts = self.blocks[0]
        idle = np.append(idle, np.zeros(len(duals) - len(first.sides) - len(idle)))
        idle = np.where(duals[len(first.sides) :] > 0.0, 0.0, idle + 1.0)
        if not cuts:
            return idle
        kept = idle < _IDLE
        whole = stacked(cuts)
        table, extra, sides, slopes, columns = (part[kept] for part in whole[:5])
        self.blocks[0] = [first, RowBlock(table, extra, sides, slopes, columns, first.costs)]
        return np.asarray(idle[kept])

    def _keep(self, table: Array) -> None:
        """Line search from the best table toward another one."""
        other = self._within(repaired(self.game, table, self.rules))
        low, high = 0.0, 1.0

        def at(share: float) -> tuple[float, Array]:
            mixed = (1.0 - share) * self.best + share * other
            return self.aim.value(self.game, mixed), mixed

        tried = [at(1.0)]
        for _ in range(_LINE_STEPS):
            near, far = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            one, two = at(near), at(far)
            tried += [one, two]
            low, high = (low, far) if one[0] <= two[0] else (near, high)
            if high - low < tolerances.LINE_SEARCH:
                break
        value, best = min(tried, key=lambda each: each[0])
        if value < self.value:
            self.best, self.value = best, value

    def _within(self, table: Array) -> Array:
        """The table mixed with the first one, as little as the budgets need."""
        if self.spending is None:
            return table
        limits = self.spending.limits
        over = self.spending.spent(table) - limits
        rounding = tolerances.REGRET_MET * limits + tolerances.NO_REGRET * float(self.spending.regrets.max())
        if not (over > rounding).any():
            return table
        room = np.maximum(limits - self.spending.spent(self.start), 0.0)
        share = float(np.where(over > rounding, over / np.maximum(over + room, tolerances.TINY), 0.0).max())
        return (1.0 - share) * table + share * self.start


def promised(
    maker: AwareDecisionMaker,  # type: ignore[type-arg]
    shares: Callable[[Array], Array],
    aim: Callable[[PlayedGame, Columns, Array], ToldAim],
    goal: Callable[[ToldAim], float],
) -> Promised:
    """Return the best table for a maker's aim that gives its guarantees.

    Args:
        maker: Problem, budget, prior, candidates and guarantees.
        shares: The weight of each belief in each budget, (k,B), from the prior's weights (B,).
        aim: The objective, from a game, its columns and regrets.
        goal: The gap that counts as none.

    Raises:
        ModelError: No rule on these candidates gives them all; which of them are in conflict.
        SolverError: A budget lies between the least regret that was found and its bound.
    """
    plausible_only = maker.options.plausible_only
    search = RegretSearch(maker.problem, maker.prior, maker._given, 1.0, plausible_only=plausible_only)
    game, regrets = search.game, search.regrets
    parts = shares(game.weights)
    limits = maker.budget.limits(search.optimal_costs)
    spending = Spending(parts, parts @ limits, regrets)
    asked = maker.guarantees
    for each in asked:
        if each.limit - each.most(game) > tolerances.GUARANTEE_ROUNDING:
            raise _conflict((each,), None)
    start, excess = _least_excess(search, spending, asked)
    if excess > _rounding(spending):
        kept = list(range(len(asked)))
        for place in tuple(kept):
            fewer = [other for other in kept if other != place]
            if _least_excess(search, spending, tuple(asked[other] for other in fewer))[1] > _rounding(spending):
                kept = fewer
        raise _conflict(tuple(asked[place] for place in kept), maker.budget)
    if spending.excess(start) > _rounding(spending):
        spent = spending.spent(start)
        worst = int((spent - spending.limits).argmax())
        limit = float(spending.limits[worst])
        raise undecided(limit, float(spent[worst]), limit + excess, "ask for a larger budget, or for fewer candidates")
    wanted = aim(game, search.columns, regrets)
    solved = AimedSearch(game, wanted, spending, asked, start, goal(wanted)).run()
    levels = tuple(each.level(game, solved.table) for each in asked)
    return Promised(search.columns, game, regrets, solved, levels, solved.prices[1])


def _least_excess(search: RegretSearch, spending: Spending, rules: tuple[Guarantee, ...]) -> tuple[Array, float]:
    """A table that gives the guarantees with the least excess over budgets, and a lower bound of that excess."""
    silent = np.zeros(search.game.shape)
    silent[:, int((search.game.weights @ search.regrets).argmin())] = 1.0
    aim = LeastExcess(spending.shares, spending.limits, spending.regrets)
    start = repaired(search.game, silent, rules)
    solved = AimedSearch(search.game, aim, None, rules, start, tolerances.LEAST_REGRET_GAP * search.silence).run()
    return solved.table, solved.bound - float(spending.limits.max())


def _rounding(spending: Spending) -> float:
    largest = float(spending.limits.max())
    return tolerances.REGRET_MET * largest + tolerances.NO_REGRET * float(spending.regrets.max())


def _conflict(guarantees: tuple[Guarantee, ...], budget: Budget | None) -> ModelError:
    said = [f"  in conflict: {each}" for each in guarantees]
    if budget is not None:
        said.append(f"  in conflict: {budget!r}")
    return ModelError("\n".join(["no rule on these candidates gives them all; one of these must give way", *said]))


def promised_rows(known: Array, probabilities: Array, beliefs: Array) -> Array:
    """Return the rows of beliefs (T,X) that are among those known; raise `InputError` where one is not."""
    place = places_of(known, beliefs)
    missing = np.flatnonzero(place < 0)
    if missing.size:
        raise InputError(
            f"belief {beliefs[missing[0]]} is none of the {len(known)} beliefs that the prior gives weight, so nothing is "
            "guaranteed there"
        )
    return np.asarray(np.asarray(probabilities)[place])


def guarantees_of(given: object, worst_regret: object) -> tuple[Guarantee, ...]:
    """Return a decision maker's guarantees, or raise `InputError`."""
    held = () if given is None else checked_guarantees(given)  # type: ignore[arg-type]
    if any(isinstance(each, Budget) for each in held):
        raise InputError("guarantees must be others than budgets: the decision maker has one of its own")
    if held and worst_regret is not None:
        raise InputError(
            "worst_regret cannot be asked for together with guarantees, which are met by playing decisions of other beliefs "
            "now and then, whatever their regret: give guarantees with a budget alone (of RateDistortionDecisionMaker in the "
            "mean, of StackelbergDecisionMaker for every belief), or worst_regret alone"
        )
    return tuple(each for each in held if isinstance(each, Guarantee))
