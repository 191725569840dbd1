"""What was decided for T beliefs, at most k decisions each with its probability: the one table behind all results."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.statuses import OF_LOTTERIES, DecisionStatus
from inscrutable.errors import InputError
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class ResultTable:
    """T lotteries of at most k decisions; what is padded has probability 0, and a single decision is a lottery of one."""

    problem: DecisionProblem | None
    actions: Array  # (T,k,U) decisions in the problem's coordinates, or those (M,U) among which they have `places`
    probabilities: Array  # (T,k)
    regrets: Array  # (T,k)
    privacies: Array  # (T,k)
    decoys: Array  # (T,k,X)
    optimal_cost: Array  # (T,)
    bound: Array  # (T,) no affordable privacy is larger, nor than what is expected here
    status: tuple[DecisionStatus, ...]
    price: Array = None  # type: ignore[assignment]  # (T,); None becomes NaN
    oracle_calls: np.ndarray = None  # type: ignore[assignment]  # (T,) for the proofs of the bounds; None becomes 0
    places: np.ndarray | None = None  # (T,k)

    def __post_init__(self) -> None:
        for name, nothing in (("price", np.nan), ("oracle_calls", 0)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.full(len(self.status), nothing))

    @property
    def cost(self) -> Array:
        """Optimal cost + regret, shape (T,)."""
        return self.optimal_cost + self.regret

    @property
    def regret(self) -> Array:
        """Σ_l p_l ρ_l, shape (T,)."""
        return expected(self.probabilities, self.regrets)

    @cached_property
    def privacy(self) -> Array:
        """Σ_l p_l Ψ_l, shape (T,); what is never drawn does not count, be it infinite."""
        return expected(self.probabilities, self.privacies)

    @cached_property
    def privacy_bound(self) -> Array:
        """No affordable decision or lottery has more privacy, shape (T,)."""
        return np.maximum(self.bound, self.privacy)

    @cached_property
    def points(self) -> Array:
        """All decisions, shape (T,k,U); those of finite problems as whole numbers (T,k)."""
        return self.shown(slice(None))

    def shown(self, rows: Any) -> Array:
        """Return the decisions of a row (k,U) or of many (n,k,U) as a reader meets them."""
        found = self.actions[rows if self.places is None else self.places[rows]]
        return (
            np.asarray(found)
            if self.problem is None or not self.problem.is_discrete
            else self.problem.as_actions(found)
        )

    def one_of_each(self, chosen: np.ndarray) -> ResultTable:
        """Return the table of one decision of each row, which has no proof of its own."""
        rows = np.arange(len(self.status))
        return replace(
            self,
            actions=self.actions[rows, chosen, None] if self.places is None else self.actions,
            places=None if self.places is None else self.places[rows, chosen, None],
            probabilities=np.ones((len(rows), 1)),
            regrets=self.regrets[rows, chosen, None],
            privacies=self.privacies[rows, chosen, None],
            decoys=self.decoys[rows, chosen, None],
            optimal_cost=self.optimal_cost.copy(),
            bound=self.privacy_bound,
            status=tuple(drawn_status(each) for each in self.status),
            price=np.full(len(rows), np.nan),
        )

    def check(self, written: Mapping[str, Any]) -> None:
        """Raise `InputError` where numbers, or the sums that were `written` beside them, contradict each other.

        A privacy itself cannot be judged again: neither the problem nor the true belief is kept.
        """
        shapes = (
            self.regrets.shape,
            self.privacies.shape,
            self.decoys.shape[:2],
            (len(self.status), self.regrets.shape[1]),
        )
        if any(shape != self.probabilities.shape for shape in shapes):
            raise InputError(f"probabilities have shape {self.probabilities.shape}, the other columns {shapes}")
        drawn, status = self.probabilities > 0, np.array(self.status, dtype=object)
        totals, cost, gap = self.probabilities.sum(axis=1), self.optimal_cost + self.regret, self.bound - self.privacy
        allowed = tolerances.RECOMPUTED * (np.abs(self.optimal_cost) + np.where(drawn, self.regrets, 0.0).max(axis=1))
        costs = np.atleast_1d(written.get("cost", written.get("expected_cost")))
        privacies = np.atleast_1d(written.get("expected_privacy", self.privacy))
        same = (privacies == self.privacy) | (np.abs(privacies - self.privacy) <= tolerances.RECOMPUTED)
        for wrong, said, found in (
            (~np.isfinite(cost), "a cost that is not finite", cost),
            ((self.probabilities < 0).any(axis=1), "a negative probability", self.probabilities.min(axis=1)),
            (~(np.abs(totals - 1.0) <= tolerances.PROBABILITY), "probabilities that do not sum to 1", totals),
            ((self.regrets < 0).any(axis=1), "a negative regret", self.regrets.min(axis=1)),
            (~(np.abs(costs - cost) <= allowed), "a cost that is not the optimal cost and the regret together", costs),
            (~same, "an expected privacy that its decisions do not have", privacies),
            (np.isnan(self.bound) | (gap < -tolerances.RECOMPUTED), "a bound below its privacy", self.bound),
            (
                (status == DecisionStatus.OPTIMAL) & (self.regret > allowed),
                "a regret, and is called optimal",
                self.regret,
            ),
            (
                (status == DecisionStatus.PROVED) & ~(gap <= tolerances.PROVED),
                "a bound above its privacy, and is called proved; of a lottery save the lottery, not what was drawn",
                self.bound,
            ),
        ):
            if wrong.any():
                row = int(np.argmax(wrong))
                raise InputError(f"it contradicts itself: decision {row} has {said}: {found[row]:.10g}")


def drawn_status(status: DecisionStatus) -> DecisionStatus:
    """Return the status of one decision drawn from a lottery."""
    return DecisionStatus.DRAWN if status in OF_LOTTERIES else status


def expected(probabilities: Array, values: Array) -> Array:
    """Σ_l p_l v_l of lotteries (T,k), column by column: much faster than rows of two."""
    total = np.zeros(len(values))
    for share, value in zip(probabilities.T, values.T, strict=True):
        drawn = share > 0.0
        total += np.where(drawn, share * np.where(drawn, value, 0.0), 0.0)
    return total
