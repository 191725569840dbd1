"""One step at fixed prices: the mechanism as a function of the observer's law alone."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget
from inscrutable.decision_makers.aware.columns import Columns, allowed_places
from inscrutable.decision_makers.sequential.seen import Classes, classes_of
from inscrutable.decision_makers.sequential.smooth_rival import ActedOn, SmoothRival
from inscrutable.decision_makers.sequential.stakes import Stakes, stakes_of
from inscrutable.errors import SolverError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.privacy import Loss
from inscrutable.validation import Array

_SMALL_PRICE = 0.03
"""Share of the prior loss below which a price of information is reached by continuation from above: there the rows are nearly
pure, and Newton's steps from far away fail."""
_MOST_ANSWERED = 30
"""Rounds in which a rival's answers are added: three to eight are usual."""
_MOST_WORK, _ANSWERING_WORK = 1e12, 2e10
"""Products of numbers in one step, some minutes, and of those with a rival's answers, some seconds: there the time grows with
their number in the third power. A thousandth is usual."""
_Found = tuple[np.ndarray, Array, Array, float]
"""Decisions that are played, their law, the estimates after them, and the largest reduced cost of any other."""


class Prices(NamedTuple):
    """s, loss per unit of regret, and λ, loss per nat; where λ is infinite s is in nats per unit of regret."""

    regret: float
    information: float


@dataclass(frozen=True, eq=False)
class StepTable:
    """Beliefs (B,X) of the observer's law, decisions (M), disclosed values (C), and the regret of each value under each belief.

    A belief that plays a value plays the cheapest decision with that disclosed value.
    """

    prior: Prior
    columns: Columns
    disclosure: Disclosure
    classes: Classes
    optimal_costs: Array  # (B,)
    regrets: Array  # (B,C)
    allowed: np.ndarray | None  # (B,C)
    cheapest: np.ndarray  # (B,C): the decision that a belief plays for a value
    cap: Budget | None
    stakes: Stakes
    loss: Loss
    turnover: float = np.inf  # largest Σ_j |u_j − v_j| from one decision to the next

    def within_reach(self, kept: int) -> np.ndarray:
        """Return the numbers of the values that turnover allows after the value `kept`; all after none, −1."""
        moved = np.abs(self.classes.values - self.classes.values[kept]).sum(axis=1)
        return np.flatnonzero((moved <= self.turnover + tolerances.FEASIBILITY) | (kept < 0))

    @property
    def n_values(self) -> int:
        """C, the number of disclosed values."""
        return len(self.classes.values)

    @property
    def period(self) -> int:
        """Number of steps from one disclosed decision to the next."""
        return self.disclosure.schedule.period

    def number(self, action: Any) -> int:
        """Return the number of a disclosed value, or of a decision's; −1 where there is none, or for None."""
        if action is None:
            return -1
        shown = validation.real_array(action, "action").reshape(-1)
        if self.disclosure.maps and shown.size == self.classes.values.shape[1]:
            gaps = np.abs(self.classes.values - shown).max(axis=1)
            if gaps.min() <= tolerances.SAME_ACTION:
                return int(gaps.argmin())
        place, gap = self.nearest(action, np.arange(self.n_values))
        return place if gap <= tolerances.SAME_ACTION else -1

    def nearest(self, action: Any, numbers: np.ndarray) -> tuple[int, float]:
        """Return which of some values (n,) is nearest to a decision's disclosed value, and its distance."""
        problem = self.columns.problem
        shown = problem.check_action(action)
        if self.disclosure.maps:
            shown = np.asarray(self.disclosure.shown(problem.as_actions(shown[None])), dtype=np.float64).reshape(-1)
        gaps = np.abs(self.classes.values[numbers] - shown).max(axis=1)
        return int(gaps.argmin()), float(gaps.min())

    @cached_property
    def tree(self) -> cKDTree:
        """The grid's beliefs, for the nearest one to any other."""
        return cKDTree(self.prior.beliefs)

    @cached_property
    def prior_loss(self) -> float:
        """The observer's mean loss where decisions reveal nothing."""
        return self.stakes.loss_of(self.prior.weights)

    @property
    def floor(self) -> float:
        """The loss from which losses are counted."""
        return self.stakes.floor(self.prior.weights)

    @property
    def unit(self) -> float:
        """The prior's loss above the floor: the unit of the price of information."""
        return self.prior_loss - self.floor


def step_table(
    chain: BeliefChain,
    columns: Columns,
    cap: Budget | None,
    disclosure: Disclosure | None,
    loss: Loss,
    turnover: float = np.inf,
) -> StepTable:
    """Return the data of steps at any prices."""
    prior, shown = chain.prior, Disclosure.of(disclosure)
    costs = np.asarray(columns.problem.optimal_cost(prior.beliefs))
    classes = classes_of(columns, shown)
    found = _cheapest(columns, classes, cap, (prior.beliefs, costs))
    return StepTable(
        prior, columns, shown, classes, costs, *found, cap, stakes_of(loss, chain, shown.schedule), loss, turnover
    )


def _cheapest(
    columns: Columns, classes: Classes, cap: Budget | None, beliefs: tuple[Array, Array]
) -> tuple[Array, np.ndarray | None, np.ndarray]:
    """Regrets of every value, which are allowed, and the decision played as each, shapes (T,C)."""
    regrets = columns.regrets(*beliefs)
    allowed = allowed_places(columns.clear_regrets(*beliefs), cap, beliefs[1])
    least, number = classes.cheapest(regrets)
    # A forbidden decision is dearer than every allowed one, so the cheapest is allowed if any is.
    return least, None if allowed is None else np.take_along_axis(allowed, number, axis=1), number


@dataclass(frozen=True, eq=False)
class Step:
    """The mechanism under a law p of the belief: K (B,n) over the values `numbers` (n,), and its leakage.

    The law q (n,) of the decisions and the estimates (n,d), in coordinates of the stakes, are those of the formula. The value
    is within `gap` of the optimum, in units of the loss, or in nats where information alone counts.
    """

    numbers: np.ndarray
    rows: Array
    law: Array
    estimates: Array
    gap: float
    played: Array  # Σ p K, (n,)
    regret: float  # Σ p K ρ
    loss: float  # the observer's mean loss
    bits: float  # I(π;u)
    stakes: Stakes
    is_hidden: bool = False  # whether the decision is never disclosed, so that every belief plays its optimal one


class StepRule:
    """The rule at fixed prices."""

    def __init__(
        self, table: StepTable, prices: Prices, least_price: float = tolerances.LEAST_INFORMATION_PRICE
    ) -> None:
        self.table, self.prices = table, prices
        stakes, unit = table.stakes, table.unit
        asked = prices.information
        self._informs_only = bool(np.isinf(asked))
        self.price = 1.0 if self._informs_only else max(asked, least_price * unit)
        self._first_price = 1.0 if self._informs_only else _SMALL_PRICE * unit
        found = self._values(table.regrets, table.allowed)
        self._offers = np.ascontiguousarray((found if self._informs_only else found + stakes.base[:, None]).T)
        self._first_data = self._data(stakes)

    def _barrier(self, stakes: Stakes) -> float:
        return float(tolerances.ANSWER_BARRIER * self.table.unit / (stakes.points.shape[1] + 1))

    def _data(self, stakes: Stakes) -> tuple[Any, ...]:
        """The kernel's data of a step with some answers."""
        if self._informs_only:
            points, slopes = np.empty((0, len(stakes.points))), np.empty((self.table.n_values, 0))
        else:
            points, slopes = stakes.points.T, self.prices.regret * _slopes(self.table, stakes)
        width = 0 if self._informs_only else stakes.width
        numbers = float(self.price), float(self._first_price), width, float(self._barrier(stakes))
        return np.ascontiguousarray(points), self._offers, np.ascontiguousarray(slopes), *numbers

    def _values(self, regrets: Array, allowed: np.ndarray | None) -> Array:
        """−s ρ; −∞ where a cap forbids the decision. Shape (B,M)."""
        values = -self.prices.regret * regrets
        return values if allowed is None else np.where(allowed, values, -np.inf)

    def step(self, law: Array, kept: int = -1, near: Step | None = None) -> Step:
        """Return the mechanism under a law (B,); `kept` is the decision before, which wins ties.

        `near` is the step of a similar law, a warm start: the answer may depend on it within the gap.
        """
        table = self.table
        heard = np.where(np.asarray(law) >= tolerances.UNHEARD_BELIEF, law, 0.0)
        heard /= heard.sum()
        answers = table.stakes.rival is not None  # those of the near step are the first ones
        is_near = (
            near is not None and table.allowed is None and (answers or not table.stakes.width)
        )  # a barrier starts in the interior
        for start in (near, None) if is_near else (None,):
            stakes, found, rows, gap = self._answered(heard, kept, start)
            if gap <= self._largest_gap:
                break
        else:
            raise SolverError(
                f"a step was solved to {gap:g} of its value, expected {self._largest_gap:g} at most: take a larger "
                f"{'budget, or a finite information_price' if self._informs_only else 'information_price'}"
            )
        numbers, shares, estimates, _ = found
        lost = np.flatnonzero(~(rows.sum(axis=1) > 0))
        if lost.size:
            # Beliefs of negligible weight to which no played decision is allowed play their own optimal one.
            own, first, which = np.unique(table.regrets[lost].argmin(axis=1), return_index=True, return_inverse=True)
            rows = np.hstack([rows, np.zeros((len(rows), len(own)))])
            rows[lost, len(numbers) + which] = 1.0
            numbers, shares = np.append(numbers, own), np.append(shares, np.zeros(len(own)))
            estimates = np.vstack([estimates, stakes.best(stakes.points[lost[first]])[:, : estimates.shape[1]]])
        return _measured(table, law, rows, (numbers, shares, estimates, gap), stakes)

    def _answered(self, law: Array, kept: int, near: Step | None) -> tuple[Stakes, _Found, Array, float]:
        """A step with a rival's answers: the stakes, the solution, the rows, and the gap.

        A rival with infinitely many answers starts with its best ones to the law itself; its best answers to each decision are
        added until none saves more than a share of the prior loss. The gap counts all of its answers.
        """
        stakes = self.table.stakes
        if self._informs_only or stakes.rival is None:
            found = self._solved(law, stakes, kept, near, np.array([_MOST_WORK]))
            rows = self._rows(stakes, *self._at(found[0]), found[1:3])
            solved = stakes, found, rows, self._gap(law, stakes, rows, found[1:])
            # A barrier leaves decisions some 1e-9 of the mass: they would be drawn once in a while, and leak.
            return self._kept(law, kept, solved) if stakes.width and not self._informs_only else solved
        smooth = self._smoothly(law, kept, near)
        if smooth[-1] <= tolerances.STEP_GAP * self.table.unit:
            return self._kept(law, kept, smooth)
        least = tolerances.MISSING_ANSWER * self.table.unit
        if near is not None:
            stakes = near.stakes.mixed(near.estimates, stakes)
        more: Stakes | None = stakes.begun(law, least)
        best: tuple[Stakes, _Found, Array, float] | None = None
        work = np.array([_ANSWERING_WORK])
        for _ in range(_MOST_ANSWERED):
            if more is None or work[0] < 0.0:
                break
            stakes = more
            found = self._solved(law, stakes, kept, None, work)
            rows = self._rows(stakes, *self._at(found[0]), found[1:3])
            gap = self._gap(law, stakes, rows, found[1:])
            if best is None or gap < best[-1]:
                best = stakes, found, rows, gap
            more = stakes.joined(law[:, None] * rows, least)
        assert best is not None
        return self._kept(law, kept, best)

    def _smoothly(self, law: Array, kept: int, near: Step | None) -> tuple[Stakes, _Found, Array, float]:
        """The same by Newton's steps in the beliefs that the rival acts on, for one whose best answer moves with its belief.

        It starts from the step of a similar law, or of the prior; where turnover forbids some decisions, from a constant one.
        """
        rule, some = self._smooth_rival, self.table.within_reach(kept)
        constant = self._constant(law, kept)
        if len(some) < self.table.n_values:
            rule = replace(rule, offers=rule.offers[some])
            found = rule.solved(law, np.searchsorted(some, constant), None, self._first_price)
            found = found._replace(numbers=some[found.numbers])
        else:
            start = self._at_prior if near is None else rule.similar(law, near.numbers, near.rows)
            found = rule.solved(law, constant, start, self._first_price)
        stakes, estimates = self.table.stakes.answering(found.beliefs)
        rows = self._rows(stakes, *self._at(found.numbers), (found.law, estimates))
        solved = found.numbers, found.law, estimates, found.excess
        return stakes, solved, rows, self._gap(law, stakes, rows, solved[1:])

    @cached_property
    def _smooth_rival(self) -> SmoothRival:
        answers = self.table.stakes.rival
        assert answers is not None
        offers = self._values(self.table.regrets, self.table.allowed).T / self.price
        return SmoothRival(answers.rival, answers.expected, np.ascontiguousarray(offers), self.price)

    @cached_property
    def _at_prior(self) -> ActedOn:
        """The step under the prior, from which others start."""
        law = self.table.prior.weights
        return self._smooth_rival.solved(law, self._constant(law, -1), None, self._first_price)

    def _constant(self, law: Array, kept: int) -> np.ndarray:
        """The decision of least mean regret that turnover allows, `kept` if that costs the same; more where caps forbid it to
        some beliefs."""
        regrets, found, allowed = self.table.regrets, list[int](), self.table.allowed
        if allowed is None:
            allowed = np.zeros(regrets.shape, dtype=bool)
            allowed[:, self.table.within_reach(kept)] = True
        left = np.asarray(law) > 0
        while left.any():
            reach = law[left] @ allowed[left]
            far = np.flatnonzero(reach >= reach.max() * (1.0 - tolerances.RETURNING_LAW))
            means = law[left] @ np.where(allowed[left], regrets[left], 0.0)[:, far]
            tied = kept in far and means[far == kept][0] <= means.min() + tolerances.LAW_RESIDUAL * abs(means).max()
            found.append(kept if tied else int(far[means.argmin()]))
            left &= ~allowed[:, found[-1]]
        return np.array(found)

    def _kept(
        self, law: Array, kept: int, solved: tuple[Stakes, _Found, Array, float]
    ) -> tuple[Stakes, _Found, Array, float]:
        """Return a solution, or the constant decision `kept` where its value is as large."""
        stakes, found, rows, gap = solved
        allowed = np.ones(len(law), dtype=bool) if self.table.allowed is None else self.table.allowed[:, kept]
        if kept < 0 or not allowed[law > 0].all():
            return solved
        places, certain = np.array([kept]), allowed[:, None].astype(np.float64)
        short = self._value(law, stakes, rows, found[0]) - self._value(law, stakes, certain, places)
        if short > tolerances.STEP_GAP * self.table.unit:
            return solved
        best = stakes.best((law @ stakes.points)[None])
        return stakes, (places, np.ones(1), best, 0.0), certain, max(short + gap, 0.0)

    def _value(self, law: Array, stakes: Stakes, rows: Array, numbers: np.ndarray) -> float:
        """E L − s E ρ − λ I of rows (B,n)."""
        joint = law[:, None] * rows
        spent = (joint * self.table.regrets[:, numbers]).sum()
        return float(stakes.lost(joint).sum() - self.prices.regret * spent - self.price * _nats(joint, rows))

    @property
    def _largest_gap(self) -> float:
        if self._informs_only:
            return tolerances.STEP_GAP
        barrier = tolerances.BARRIER_GAP * tolerances.ANSWER_BARRIER if self.table.stakes.width else 0.0
        return (tolerances.STEP_GAP + barrier) * self.table.unit

    def _solved(self, law: Array, stakes: Stakes, kept: int, near: Step | None, work: Array) -> _Found:
        """Decisions, their law, the estimates after them, and the largest reduced cost of any other, within some work (1,)."""
        from inscrutable.kernels.sequential_estimates import StepData
        from inscrutable.kernels.sequential_step import solved_step

        data = self._first_data if stakes is self.table.stakes else self._data(stakes)
        begun: Any = np.empty(0, np.int64), np.empty(0), np.empty((0, len(data[0])))
        some = self.table.within_reach(kept)
        if len(some) < self.table.n_values:
            points, offers, slopes, *others = data
            kept, data = int(np.searchsorted(some, kept)), (points, offers[some], slopes[some], *others)
        elif near is not None:
            begun = near.numbers, near.law, near.estimates
        numbers, shares, estimates, excess = solved_step(law, StepData(*data), int(kept), *(*begun, work))
        numbers = some[numbers]
        # The barrier does not depend on the belief, so that it can be absorbed in the law.
        shares = shares * np.exp(stakes.barriers(estimates, self._barrier(stakes)) / self.price)
        return numbers, shares, estimates, float(excess)

    def _gap(self, law: Array, stakes: Stakes, rows: Array, found: tuple[Array, Array, float]) -> float:
        """An upper bound of the distance of the value from the optimum.

        Σ_m (p_m (g(μ_m) − L_m) − λ p_m log(p_m/q_m)) + λ max log c, with the loss g(μ_m) of the estimate and the least, L_m.
        """
        shares, estimates, excess = found
        played = law @ rows
        ratios = np.log(np.divide(played, shares, out=np.ones_like(played), where=played > 0))
        gap = self.price * (max(excess, float(ratios.max())) - float(played @ ratios))
        if not self._informs_only:
            joint = law[:, None] * rows
            paid = (joint * (stakes.gains(estimates) + stakes.spare[:, None])).sum()
            gap += float(paid - stakes.lost(joint).sum())
        return max(gap, 0.0)

    def _at(self, numbers: np.ndarray) -> tuple[Array, np.ndarray | None]:
        """Regrets of some decisions, and which are allowed."""
        allowed = self.table.allowed
        return self.table.regrets[:, numbers], None if allowed is None else allowed[:, numbers]

    def _rows(
        self,
        stakes: Stakes,
        regrets: Array,
        allowed: np.ndarray | None,
        played: tuple[Array, Array],
    ) -> Array:
        law, estimates = played
        logs = self._values(regrets, allowed) / self.price
        if not self._informs_only:
            logs = logs + (stakes.own(estimates) - 2.0 * stakes.points @ estimates.T) / self.price
        top = np.where(law > 0, logs, -np.inf).max(axis=1, keepdims=True)
        with np.errstate(invalid="ignore", over="ignore"):
            rows = np.where(law > 0, np.exp(logs - top), 0.0) * law
        rows = np.where(np.isfinite(top), rows, 0.0)
        total = rows.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(rows, total, out=rows, where=total > 0))

    def answers(self, step: Step, beliefs: Array) -> tuple[Columns, Array, Array]:
        """Return decisions, K (T,n) over them and optimal costs of any beliefs (T,X), on the grid or not.

        A belief off the grid plays each disclosed value with the probability of the nearest belief on it: the chain, and so
        the observer's law, counts it as that one. Of the decisions disclosed as one value it plays its own cheapest. Where a
        cap forbids it a value, the others are scaled up; where it forbids all, its own optimal decision is added.

        The alternative, the row that the formula gives for the belief itself, changes too sharply between the beliefs of the
        grid at small prices of information. With four actions, three states and a price of .03 of the prior loss it has a
        regret of 1.05 and an observer's loss of .176, where .82 and .150 were calculated; the nearest row has .86 and .147.
        """
        table = self.table
        some = np.flatnonzero(np.isin(table.classes.place, step.numbers))
        columns = table.columns.pick(some)
        costs = np.asarray(columns.problem.optimal_cost(beliefs))
        if step.is_hidden:
            columns = columns.joined(beliefs)
            rows = np.zeros((len(beliefs), len(columns)))
            rows[np.arange(len(beliefs)), columns.regrets(beliefs, costs).argmin(axis=1)] = 1.0
            return columns, rows, costs
        order = np.argsort(step.numbers)
        classes = table.classes._replace(
            values=step.numbers, place=order[np.searchsorted(step.numbers[order], table.classes.place[some])]
        )
        _, allowed, number = _cheapest(columns, classes, table.cap, (beliefs, costs))
        shares = step.rows[table.tree.query(beliefs)[1]]
        if allowed is not None:
            shares = np.where(allowed, shares, 0.0)
            total = shares.sum(axis=1, keepdims=True)
            shares = np.divide(shares, total, out=np.zeros_like(shares), where=total > 0)
        rows = np.zeros((len(beliefs), len(columns)))
        np.put_along_axis(rows, number, shares, axis=1)
        lost = np.flatnonzero(~(rows.sum(axis=1) > 0))
        if lost.size:
            columns = columns.joined(beliefs[lost])
            rows = np.hstack([rows, np.zeros((len(beliefs), len(columns) - rows.shape[1]))])
            rows[lost, columns.regrets(beliefs[lost], costs[lost]).argmin(axis=1)] = 1.0
        return columns, rows, costs

    def mechanism(self, step: Step) -> Mechanism:
        """Return K on the grid's beliefs and all decisions: the cheapest of them where the decision is never disclosed."""
        table = self.table
        rows, atoms = np.nonzero(step.rows > 0)
        entries = step.rows[rows, atoms], (rows, table.cheapest[rows, step.numbers[atoms]])
        shape = len(table.prior.beliefs), len(table.columns)
        probabilities = sparse.csr_array(sparse.coo_array(entries, shape=shape))
        actions = table.columns.problem.as_actions(table.columns.points)
        return Mechanism(table.prior.beliefs, actions, probabilities, self._all_regrets)

    @cached_property
    def _all_regrets(self) -> Array:
        """Regrets (B,M) of all decisions."""
        table = self.table
        return table.columns.regrets(table.prior.beliefs, table.optimal_costs)


def hidden_step(table: StepTable, law: Array) -> Step:
    """Return the mechanism of a step whose decision is never disclosed: the optimal decision of each belief."""
    own = table.regrets if table.allowed is None else np.where(table.allowed, table.regrets, np.inf)
    numbers, which = np.unique(own.argmin(axis=1), return_inverse=True)
    rows = np.eye(len(numbers))[which]
    stakes = table.stakes
    played, estimates = law @ rows, np.zeros((len(numbers), stakes.points.shape[1]))
    return Step(numbers, rows, played, estimates, 0.0, played, 0.0, stakes.loss_of(law), 0.0, stakes, is_hidden=True)


def _slopes(table: StepTable, stakes: Stakes) -> Array:
    """Gradients (C,d) of the regrets of values in the points' coordinates, for first guesses of estimates; by least squares for
    a value of several decisions, and for other points."""
    if not stakes.width and not table.disclosure.maps and table.disclosure.schedule.is_immediate:
        return np.asarray(table.columns.found.costs @ stakes.directions.T)
    return np.asarray(np.linalg.lstsq(stakes.points, table.regrets - table.regrets.mean(axis=0), rcond=None)[0].T)


def _measured(
    table: StepTable, law: Array, rows: Array, found: tuple[np.ndarray, Array, Array, float], stakes: Stakes
) -> Step:
    numbers, shares, estimates, gap = found
    joint = law[:, None] * rows
    loss = max(float(stakes.lost(joint).sum()), stakes.floor(law))
    regret = float((joint * table.regrets[:, numbers]).sum())
    bits = _nats(joint, rows) / np.log(2.0)
    return Step(numbers, rows, shares, estimates, gap, joint.sum(axis=0), regret, loss, bits, stakes)


def _nats(joint: Array, rows: Array) -> float:
    """I(π;u) of a joint law with rows K."""
    played, some = joint.sum(axis=0), joint > 0
    ratios = np.log(np.divide(rows, played, out=np.ones_like(rows), where=some))
    return max(float((joint * ratios).sum()), 0.0)
