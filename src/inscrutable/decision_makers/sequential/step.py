"""One step at fixed prices: the mechanism as a function of the observer's law alone."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.budgets import Budget
from inscrutable.decision_makers.aware.columns import Columns, allowed_places
from inscrutable.decision_makers.sequential.seen import Classes, classes_of
from inscrutable.decision_makers.sequential.stakes import Stakes, stakes_of
from inscrutable.errors import SolverError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.privacy import Loss
from inscrutable.validation import Array

_SMALL_PRICE = 0.03
"""Share of the prior loss below which a price of information is approached from above: there the rows hardly mix, and a
Newton step from far away says little."""


class Prices(NamedTuple):
    """s, loss per unit of regret, and λ, loss per nat; where λ is infinite s is in nats per unit of regret."""

    regret: float
    information: float


@dataclass(frozen=True, eq=False)
class StepTable:
    """Beliefs (B,X) that the observer's law is on, decisions (M), shown as values (C), and the regret of each value under each
    belief.

    A belief that plays a value plays the cheapest decision that is shown as it.
    """

    prior: Prior
    columns: Columns
    disclosure: Disclosure
    classes: Classes
    optimal_costs: Array  # (B,)
    regrets: Array  # (B,C)
    allowed: np.ndarray | None  # (B,C)
    cheapest: np.ndarray  # (B,C): the decision that a belief plays as a value
    cap: Budget | None
    stakes: Stakes

    @property
    def n_values(self) -> int:
        """C, how many values can be seen."""
        return len(self.classes.values)

    @property
    def period(self) -> int:
        """How many steps pass from one decision that is shown to the next."""
        return self.disclosure.schedule.period

    def number(self, action: Any) -> int:
        """Return the number of a value shown, or of the one a decision is shown as; −1 where there is none, or for None."""
        if action is None:
            return -1
        shown = np.asarray(action, dtype=np.float64).reshape(-1)
        if self.disclosure.maps and shown.size == self.classes.values.shape[1]:
            gaps = np.abs(self.classes.values - shown).max(axis=1)
            if gaps.min() <= tolerances.SAME_ACTION:
                return int(gaps.argmin())
        place, gap = self.nearest(action, np.arange(self.n_values))
        return place if gap <= tolerances.SAME_ACTION else -1

    def nearest(self, action: Any, numbers: np.ndarray) -> tuple[int, float]:
        """Return which of some values (n,) is nearest to what a decision is shown as, and how near."""
        problem = self.columns.problem
        shown = problem.check_action(action)
        if self.disclosure.maps:
            shown = np.asarray(self.disclosure.shown(problem.as_actions(shown[None])), dtype=np.float64).reshape(-1)
        gaps = np.abs(self.classes.values[numbers] - shown).max(axis=1)
        return int(gaps.argmin()), float(gaps.min())

    def points_of(self, beliefs: Array) -> Array:
        """Return the points of beliefs (T,X), on the grid or not; those of the nearest belief where time passes until then."""
        if self.disclosure.schedule.is_immediate:
            return np.asarray((beliefs - self.stakes.centre) @ self.stakes.directions.T)
        return np.asarray(self.stakes.points[self._tree.query(beliefs)[1]])

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self.prior.beliefs)

    @cached_property
    def prior_loss(self) -> float:
        """The observer's mean loss where decisions reveal nothing."""
        return self.stakes.loss_of(self.prior.weights)

    @property
    def floor(self) -> float:
        """What losses are counted from."""
        return self.stakes.floor(self.prior.weights)

    @property
    def unit(self) -> float:
        """The prior's loss above the floor: the unit of the price of information."""
        return self.prior_loss - self.floor


def step_table(
    chain: BeliefChain, columns: Columns, cap: Budget | None, disclosure: Disclosure | None, loss: Loss
) -> StepTable:
    """Return what steps at any prices are made from."""
    prior, shown = chain.prior, Disclosure.of(disclosure)
    costs = np.asarray(columns.problem.optimal_cost(prior.beliefs))
    classes = classes_of(columns, shown)
    found = _cheapest(columns, classes, cap, (prior.beliefs, costs))
    return StepTable(prior, columns, shown, classes, costs, *found, cap, stakes_of(loss, chain, shown.schedule))


def _cheapest(
    columns: Columns, classes: Classes, cap: Budget | None, beliefs: tuple[Array, Array]
) -> tuple[Array, np.ndarray | None, np.ndarray]:
    """Regrets of every value, which are allowed, and the decision played as each, shapes (T,C)."""
    regrets = columns.regrets(*beliefs)
    allowed = allowed_places(regrets, cap, beliefs[1])
    least, number = classes.cheapest(regrets)
    # Whatever a cap forbids is dearer than what it allows.
    return least, None if allowed is None else np.take_along_axis(allowed, number, axis=1), number


@dataclass(frozen=True, eq=False)
class Step:
    """The mechanism under a law p of the belief: K (B,n) over the values `numbers` (n,), and its leakage.

    The law q (n,) of the decisions and the estimates (n,d) say what a belief off the grid plays. The value is within `gap` of
    the optimum, in units of the loss, or in nats where information alone counts.
    """

    numbers: np.ndarray
    rows: Array
    law: Array
    estimates: Array
    gap: float
    played: Array  # Σ p K, (n,)
    regret: float  # Σ p K ρ
    loss: float  # what the observer loses on average
    bits: float  # I(π;u)
    is_hidden: bool = False  # whether the decision is never shown, so that every belief plays its own best


class StepRule:
    """The rule at fixed prices."""

    def __init__(self, table: StepTable, prices: Prices) -> None:
        self.table, self.prices = table, prices
        stakes, unit = table.stakes, table.unit
        s, asked = prices
        self._informs_only = bool(np.isinf(asked))
        self.price = 1.0 if self._informs_only else max(asked, tolerances.LEAST_INFORMATION_PRICE * unit)
        self._barrier = tolerances.ANSWER_BARRIER * unit / (stakes.points.shape[1] + 1)
        first = 1.0 if self._informs_only else _SMALL_PRICE * unit
        found = self._values(table.regrets, table.allowed)
        if not self._informs_only:
            found = found + stakes.base[:, None]
        slopes = s * _slopes(table)
        n_columns = table.n_values
        self._kernel_parts = (
            np.ascontiguousarray(stakes.points.T) if not self._informs_only else np.empty((0, len(stakes.points))),
            np.ascontiguousarray(found.T),
            np.ascontiguousarray(slopes) if not self._informs_only else np.empty((n_columns, 0)),
            float(self.price),
            float(first),
            0 if self._informs_only else stakes.width,
            float(self._barrier),
        )

    def _values(self, regrets: Array, allowed: np.ndarray | None) -> Array:
        """−s ρ; −∞ where a cap forbids the decision. Shape (B,M)."""
        values = -self.prices.regret * regrets
        return values if allowed is None else np.where(allowed, values, -np.inf)

    def step(self, law: Array, kept: int = -1, near: Step | None = None) -> Step:
        """Return what is played under a law (B,); `kept` is the decision before, which a tie goes to.

        `near` is the step of a law like this one, to begin with: the digits that the gap leaves open then depend on it.
        """
        table = self.table
        heard = np.where(np.asarray(law) >= tolerances.UNHEARD_BELIEF, law, 0.0)
        heard /= heard.sum()
        most = self._largest_gap
        is_near = (
            near is not None and table.allowed is None and not table.stakes.width
        )  # a barrier begins in the middle
        for start in (near, None) if is_near else (None,):
            found = self._solved(heard, kept, start)
            numbers, shares, estimates, _ = found
            rows = self._rows(table.stakes.points, *self._at(numbers), (shares, estimates))
            gap = self._gap(heard, rows, found[1:])
            if gap <= most:
                break
        else:
            raise SolverError(
                f"a step was solved to {gap:g} of its value, expected {most:g} at most: take a larger information_price"
            )
        lost = np.flatnonzero(~(rows.sum(axis=1) > 0))
        if (
            lost.size
        ):  # beliefs of next to no weight to which no played decision is allowed play their own best decision
            own, first, which = np.unique(table.regrets[lost].argmin(axis=1), return_index=True, return_inverse=True)
            rows = np.hstack([rows, np.zeros((len(rows), len(own)))])
            rows[lost, len(numbers) + which] = 1.0
            numbers, shares = np.append(numbers, own), np.append(shares, np.zeros(len(own)))
            estimates = np.vstack(
                [estimates, table.stakes.best(table.stakes.points[lost[first]])[:, : estimates.shape[1]]]
            )
        return _measured(table, law, rows, (numbers, shares, estimates, gap))

    @property
    def _largest_gap(self) -> float:
        if self._informs_only:
            return tolerances.STEP_GAP
        barrier = tolerances.BARRIER_GAP * tolerances.ANSWER_BARRIER if self.table.stakes.width else 0.0
        return (tolerances.STEP_GAP + barrier) * self.table.unit

    def _solved(self, law: Array, kept: int, near: Step | None) -> tuple[np.ndarray, Array, Array, float]:
        """Decisions, their law, the estimates after them, and the largest reduced cost of any other."""
        from inscrutable.kernels.sequential_estimates import StepData
        from inscrutable.kernels.sequential_step import solved_step

        if near is None:
            begun = np.empty(0, np.int64), np.empty(0), np.empty((0, len(self._kernel_parts[0])))
        else:
            begun = near.numbers, near.law, near.estimates
        numbers, shares, estimates, excess = solved_step(law, StepData(*self._kernel_parts), int(kept), *begun)
        # The barrier is the same under all beliefs, so that the law can take it over.
        shares = shares * np.exp(self.table.stakes.barriers(estimates, self._barrier) / self.price)
        return numbers, shares, estimates, float(excess)

    def _gap(self, law: Array, rows: Array, found: tuple[Array, Array, float]) -> float:
        """How far the value is from the optimum at most.

        Σ_m (p_m (worth(mean_m) − 2 mean_m·μ_m + h(μ_m)) − λ p_m log(p_m/q_m)) + λ max log c.
        """
        shares, estimates, excess = found
        stakes = self.table.stakes
        played = law @ rows
        ratios = np.log(np.divide(played, shares, out=np.ones_like(played), where=played > 0))
        gap = self.price * (max(excess, float(ratios.max())) - float(played @ ratios))
        if not self._informs_only:
            sums = rows.T @ (law[:, None] * stakes.points)
            means = sums / np.where(played > 0, played, 1.0)[:, None]
            apart = stakes.worth(means - estimates)  # a square
            if stakes.width:
                apart = stakes.worth(means) - 2.0 * (means * estimates).sum(axis=1)
            gap += float(played @ apart)
        return max(gap, 0.0)

    def _at(self, numbers: np.ndarray) -> tuple[Array, np.ndarray | None]:
        """Regrets of some decisions, and which are allowed."""
        allowed = self.table.allowed
        return self.table.regrets[:, numbers], None if allowed is None else allowed[:, numbers]

    def _rows(self, points: Array, regrets: Array, allowed: np.ndarray | None, played: tuple[Array, Array]) -> Array:
        law, estimates = played
        logs = self._values(regrets, allowed) / self.price
        if not self._informs_only:
            logs = logs + (self.table.stakes.own(estimates) - 2.0 * points @ estimates.T) / self.price
        top = np.where(law > 0, logs, -np.inf).max(axis=1, keepdims=True)
        with np.errstate(invalid="ignore", over="ignore"):
            rows = np.where(law > 0, np.exp(logs - top), 0.0) * law
        rows = np.where(np.isfinite(top), rows, 0.0)
        total = rows.sum(axis=1, keepdims=True)
        return np.asarray(np.divide(rows, total, out=rows, where=total > 0))

    def answers(self, step: Step, beliefs: Array) -> tuple[Columns, Array, Array]:
        """Return decisions, K (T,n) over them and optimal costs of any beliefs (T,X), on the grid or not.

        A belief that is allowed none of the played decisions plays its own optimal one, which joins the others.
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
        regrets, allowed, number = _cheapest(columns, classes, table.cap, (beliefs, costs))
        shares = self._rows(table.points_of(beliefs), regrets, allowed, (step.law, step.estimates))
        rows = np.zeros((len(beliefs), len(columns)))
        np.put_along_axis(rows, number, shares, axis=1)
        lost = np.flatnonzero(~(rows.sum(axis=1) > 0))
        if lost.size:
            columns = columns.joined(beliefs[lost])
            rows = np.hstack([rows, np.zeros((len(beliefs), len(columns) - rows.shape[1]))])
            rows[lost, columns.regrets(beliefs[lost], costs[lost]).argmin(axis=1)] = 1.0
        return columns, rows, costs

    def mechanism(self, step: Step) -> Mechanism:
        """Return K on the grid's beliefs and all decisions."""
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
    """Return the mechanism of a step whose decision is never shown: the best decision under each belief."""
    own = table.regrets if table.allowed is None else np.where(table.allowed, table.regrets, np.inf)
    numbers, which = np.unique(own.argmin(axis=1), return_inverse=True)
    rows = np.eye(len(numbers))[which]
    played, estimates = law @ rows, np.zeros((len(numbers), table.stakes.points.shape[1]))
    return Step(numbers, rows, played, estimates, 0.0, played, 0.0, table.stakes.loss_of(law), 0.0, is_hidden=True)


def _slopes(table: StepTable) -> Array:
    """Gradients (C,d) of the regrets of values in the points' coordinates; of a value that several decisions are shown as, and
    of other points, by least squares: they are first guesses of estimates."""
    stakes = table.stakes
    if not stakes.width and not table.disclosure.maps and table.disclosure.schedule.is_immediate:
        return np.asarray(table.columns.found.costs @ stakes.directions.T)
    return np.asarray(np.linalg.lstsq(stakes.points, table.regrets - table.regrets.mean(axis=0), rcond=None)[0].T)


def _measured(table: StepTable, law: Array, rows: Array, found: tuple[np.ndarray, Array, Array, float]) -> Step:
    numbers, shares, estimates, gap = found
    joint = law[:, None] * rows
    played = joint.sum(axis=0)
    stakes = table.stakes
    means = (joint.T @ stakes.points) / np.where(played > 0, played, 1.0)[:, None]
    some = joint > 0
    ratios = np.log2(np.divide(rows, played, out=np.ones_like(rows), where=some))
    loss = float(law @ (stakes.base + stakes.spare) - played @ stakes.worth(means))
    regret = float((joint * table.regrets[:, numbers]).sum())
    bits = max(float((joint * ratios).sum()), 0.0)
    return Step(numbers, rows, shares, estimates, gap, played, regret, max(loss, stakes.floor(law)), bits)
