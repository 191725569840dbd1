"""One step at fixed prices: what is played as a function of the law that the observer holds, and nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.budgets import Budget
from inscrutable.decision_makers.aware.columns import Columns, allowed_places
from inscrutable.errors import SolverError
from inscrutable.mechanisms import Mechanism, Prior
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
    """Beliefs (B,X) that the observer's law is on, decisions (M), and what each costs whom."""

    prior: Prior
    columns: Columns
    optimal_costs: Array  # (B,)
    regrets: Array  # (B,M)
    allowed: np.ndarray | None  # (B,M)
    cap: Budget | None
    basis: Array  # (X−1,X): orthonormal directions in which beliefs differ
    points: Array  # (B,X−1): beliefs less the prior's mean in these directions

    def number(self, action: Any) -> int:
        """Return the number of a decision; −1 for None, or for one that is not among these."""
        if action is None:
            return -1
        gaps = np.abs(self.columns.points - self.columns.problem.check_action(action)).max(axis=1)
        return int(gaps.argmin()) if gaps.min() <= tolerances.SAME_ACTION else -1

    @property
    def prior_loss(self) -> float:
        """The prior's mean square error: the unit of the price of information."""
        return float(self.prior.weights @ (self.points**2).sum(axis=1))

    def loss_of(self, law: Array) -> float:
        """Return L(p) = Σ p |π − mean|²."""
        mean = law @ self.points
        return max(float(law @ (self.points**2).sum(axis=1) - mean @ mean), 0.0)


def step_table(prior: Prior, columns: Columns, cap: Budget | None) -> StepTable:
    """Return what steps at any prices are made from."""
    costs = np.asarray(columns.problem.optimal_cost(prior.beliefs))
    regrets = columns.regrets(prior.beliefs, costs)
    basis = np.linalg.svd(np.ones((1, prior.beliefs.shape[1])))[2][1:]
    points = (prior.beliefs - prior.mean) @ basis.T
    return StepTable(prior, columns, costs, regrets, allowed_places(regrets, cap, costs), cap, basis, points)


@dataclass(frozen=True, eq=False)
class Step:
    """What is played under a law p of the belief: K (B,n) over the decisions `numbers` (n,), and what it gives away.

    The law q (n,) of the decisions and the estimates (n,d) say what a belief off the grid plays. The value is within `gap` of
    the optimum, in units of the loss, or in nats where information alone counts.
    """

    numbers: np.ndarray
    rows: Array
    law: Array
    estimates: Array
    gap: float
    played: Array  # Σ p K, (n,)
    means: Array  # (n,d) posterior means after the decisions, in the table's directions
    regret: float  # Σ p K ρ
    loss: float  # Σ p K |π − mean|²
    bits: float  # I(π;u)


class StepRule:
    """The rule at fixed prices."""

    def __init__(self, table: StepTable, prices: Prices) -> None:
        self.table, self.prices = table, prices
        unit = table.prior_loss
        s, asked = prices
        self._informs_only = bool(np.isinf(asked))
        self.price = 1.0 if self._informs_only else max(asked, tolerances.LEAST_INFORMATION_PRICE * unit)
        first = 1.0 if self._informs_only else _SMALL_PRICE * unit
        found = self._values(table.points, table.regrets, table.allowed)
        slopes = s * (table.columns.found.costs @ table.basis.T)
        n_columns = len(table.columns)
        self._kernel_parts = (
            np.ascontiguousarray(table.points.T) if not self._informs_only else np.empty((0, len(table.points))),
            np.ascontiguousarray(found.T),
            np.ascontiguousarray(slopes) if not self._informs_only else np.empty((n_columns, 0)),
            float(self.price),
            float(first),
        )

    def _values(self, points: Array, regrets: Array, allowed: np.ndarray | None) -> Array:
        """|x|² − s ρ, or −s ρ; −∞ where a cap forbids the decision. Shape (B,M)."""
        values = -self.prices.regret * regrets
        if not self._informs_only:
            values = values + (points**2).sum(axis=1)[:, None]
        return values if allowed is None else np.where(allowed, values, -np.inf)

    def step(self, law: Array, kept: int = -1, near: Step | None = None) -> Step:
        """Return what is played under a law (B,); `kept` is the decision before, which a tie goes to.

        `near` is the step of a law like this one, to begin with: the digits that the gap leaves open then depend on it.
        """
        table = self.table
        heard = np.where(np.asarray(law) >= tolerances.UNHEARD_BELIEF, law, 0.0)
        heard /= heard.sum()
        unit = 1.0 if self._informs_only else table.prior_loss
        for start in (near, None) if near is not None and table.allowed is None else (None,):
            found = self._solved(heard, kept, start)
            numbers, shares, estimates, _ = found
            rows = self._rows(table.points, *self._at(numbers), (shares, estimates))
            gap = self._gap(heard, rows, found[1:])
            if gap <= tolerances.STEP_GAP * unit:
                break
        else:
            raise SolverError(
                f"a step was solved to {gap:g} of its value, expected {tolerances.STEP_GAP * unit:g} at most: take a larger "
                "information_price"
            )
        lost = np.flatnonzero(~(rows.sum(axis=1) > 0))
        if lost.size:  # next to no weight, and allowed nothing that is played: each plays its own best decision
            own, first, which = np.unique(table.regrets[lost].argmin(axis=1), return_index=True, return_inverse=True)
            rows = np.hstack([rows, np.zeros((len(rows), len(own)))])
            rows[lost, len(numbers) + which] = 1.0
            numbers, shares = np.append(numbers, own), np.append(shares, np.zeros(len(own)))
            estimates = np.vstack([estimates, table.points[lost[first], : estimates.shape[1]]])
        return _measured(table, law, rows, (numbers, shares, estimates, gap))

    def _solved(self, law: Array, kept: int, near: Step | None) -> tuple[np.ndarray, Array, Array, float]:
        """Decisions, their law, the estimates after them, and by how much any other tempts at most."""
        from inscrutable.kernels.sequential_saddle import StepData
        from inscrutable.kernels.sequential_step import solved_step

        if near is None:
            begun = np.empty(0, np.int64), np.empty(0), np.empty((0, len(self._kernel_parts[0])))
        else:
            begun = near.numbers, near.law, near.estimates
        numbers, shares, estimates, excess = solved_step(law, StepData(*self._kernel_parts), int(kept), *begun)
        return numbers, shares, estimates, float(excess)

    def _gap(self, law: Array, rows: Array, found: tuple[Array, Array, float]) -> float:
        """How far the value is from the optimum at most: Σ_m (p_m |mean_m − μ_m|² − λ p_m log(p_m/q_m)) + λ max log c."""
        shares, estimates, excess = found
        played = law @ rows
        ratios = np.log(np.divide(played, shares, out=np.ones_like(played), where=played > 0))
        gap = self.price * (max(excess, float(ratios.max())) - float(played @ ratios))
        if not self._informs_only:
            moved = rows.T @ (law[:, None] * self.table.points) - played[:, None] * estimates
            gap += float((moved**2).sum(axis=1) @ np.divide(1.0, played, out=np.zeros_like(played), where=played > 0))
        return max(gap, 0.0)

    def _at(self, numbers: np.ndarray) -> tuple[Array, np.ndarray | None]:
        """Regrets of some decisions, and which are allowed."""
        allowed = self.table.allowed
        return self.table.regrets[:, numbers], None if allowed is None else allowed[:, numbers]

    def _rows(self, points: Array, regrets: Array, allowed: np.ndarray | None, played: tuple[Array, Array]) -> Array:
        law, estimates = played
        logs = self._values(points, regrets, allowed) / self.price
        if not self._informs_only:
            logs = logs + ((estimates**2).sum(axis=1) - 2.0 * points @ estimates.T) / self.price
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
        columns = table.columns.pick(step.numbers)
        costs = np.asarray(columns.problem.optimal_cost(beliefs))
        regrets = columns.regrets(beliefs, costs)
        allowed = allowed_places(regrets, table.cap, costs)
        points = (beliefs - table.prior.mean) @ table.basis.T
        rows = self._rows(points, regrets, allowed, (step.law, step.estimates))
        lost = np.flatnonzero(~(rows.sum(axis=1) > 0))
        if lost.size:
            columns = columns.joined(beliefs[lost])
            rows = np.hstack([rows, np.zeros((len(beliefs), len(columns) - rows.shape[1]))])
            rows[lost, columns.regrets(beliefs[lost], costs[lost]).argmin(axis=1)] = 1.0
        return columns, rows, costs

    def mechanism(self, step: Step) -> Mechanism:
        """Return K on the grid's beliefs and all decisions."""
        from scipy import sparse

        table = self.table
        rows, atoms = np.nonzero(step.rows > 0)
        entries = step.rows[rows, atoms], (rows, step.numbers[atoms])
        probabilities = sparse.csr_array(sparse.coo_array(entries, shape=table.regrets.shape))
        actions = table.columns.problem.as_actions(table.columns.points)
        return Mechanism(table.prior.beliefs, actions, probabilities, table.regrets)


def _measured(table: StepTable, law: Array, rows: Array, found: tuple[np.ndarray, Array, Array, float]) -> Step:
    numbers, shares, estimates, gap = found
    joint = law[:, None] * rows
    played = joint.sum(axis=0)
    means = (joint.T @ table.points) / np.where(played > 0, played, 1.0)[:, None]
    some = joint > 0
    ratios = np.log2(np.divide(rows, played, out=np.ones_like(rows), where=some))
    loss = float(law @ (table.points**2).sum(axis=1) - played @ (means**2).sum(axis=1))
    regret = float((joint * table.regrets[:, numbers]).sum())
    bits = max(float((joint * ratios).sum()), 0.0)
    return Step(numbers, rows, shares, estimates, gap, played, means, regret, max(loss, 0.0), bits)
