"""Statuses of decisions, and checks that a loaded result does not contradict itself."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from typing import Any

import numpy as np

from inscrutable import tolerances
from inscrutable.errors import InputError
from inscrutable.saved import saved_choice


@saved_choice
class DecisionStatus(Enum):
    """How a decision came about; the text says what to do about it.

    Example:
        >>> DecisionStatus.OPTIMAL.value
        'optimal: the decision of least cost'
    """

    OPTIMAL = "optimal: the decision of least cost"
    POLISHED = "best candidate, polished by a local search: no proof that nothing better exists"
    PROVED = "proved: no affordable decision is more private"
    GAP_REACHED = "proved within the gap asked for: a smaller gap, or a finer search, may find a little more"
    BOUNDED = (
        "not proved within the gap asked for: no affordable decision is more private than the bound, and the one found may be "
        "the best; allow more oracle calls, or a smaller min_slack, which rules out decisions close to a constraint"
    )
    BEST_CANDIDATE = "best of the candidates: more of them may find better"
    LOCAL_OPTIMUM = "local optimum of a local search: more starts may find better"
    NO_AFFORDABLE_PRIVACY = (
        "no affordable decision that reaches the goal was found, so the optimal one is chosen: raise the budget; "
        "cheapest_privacy says how far"
    )
    NO_PLAUSIBLE_START = "no affordable start that a belief explains was found: use the global search"
    DRAWN = "drawn from a lottery: what is proved of the lottery is not proved of one decision"
    RULE_OF_THUMB = "a rule of thumb: nothing was searched, so the privacy is whatever the rule leaves"
    UNBOUNDED = (
        "unexplained decisions count as infinitely private and are affordable: the paper's problem then has no optimum"
    )


OF_LOTTERIES = (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED, DecisionStatus.BOUNDED)
"""Statuses that hold for a lottery, not for one decision drawn from it."""


def check_loaded(table: Any, written: Mapping[str, Any]) -> None:
    """Raise `InputError` where numbers, or the sums that were `written` beside them, contradict each other.

    A privacy itself cannot be judged again: neither the problem nor the true belief is kept.
    """
    shapes = (
        table.regrets.shape,
        table.privacies.shape,
        table.decoys.shape[:2],
        (len(table.status), table.regrets.shape[1]),
    )
    if any(shape != table.probabilities.shape for shape in shapes):
        raise InputError(f"probabilities have shape {table.probabilities.shape}, the other columns {shapes}")
    drawn, status = table.probabilities > 0, np.array(table.status, dtype=object)
    totals, cost, gap = table.probabilities.sum(axis=1), table.optimal_cost + table.regret, table.bound - table.privacy
    allowed = tolerances.RECOMPUTED * (np.abs(table.optimal_cost) + np.where(drawn, table.regrets, 0.0).max(axis=1))
    costs = np.atleast_1d(written.get("cost", written.get("expected_cost")))
    privacies = np.atleast_1d(written.get("expected_privacy", table.privacy))
    same = (privacies == table.privacy) | (np.abs(privacies - table.privacy) <= tolerances.RECOMPUTED)
    for wrong, said, found in (
        (~np.isfinite(cost), "a cost that is not finite", cost),
        ((table.probabilities < 0).any(axis=1), "a negative probability", table.probabilities.min(axis=1)),
        (~(np.abs(totals - 1.0) <= tolerances.PROBABILITY), "probabilities that do not sum to 1", totals),
        ((table.regrets < 0).any(axis=1), "a negative regret", table.regrets.min(axis=1)),
        (~(np.abs(costs - cost) <= allowed), "a cost that is not the optimal cost and the regret together", costs),
        (~same, "an expected privacy that its decisions do not have", privacies),
        (np.isnan(table.bound) | (gap < -tolerances.RECOMPUTED), "a bound below its privacy", table.bound),
        (
            (status == DecisionStatus.OPTIMAL) & (table.regret > allowed),
            "a regret, and is called optimal",
            table.regret,
        ),
        (
            (status == DecisionStatus.PROVED) & ~(gap <= tolerances.PROVED),
            "a bound above its privacy, and is called proved; of a lottery save the lottery, not what was drawn",
            table.bound,
        ),
    ):
        if wrong.any():
            row = int(np.argmax(wrong))
            raise InputError(f"it contradicts itself: decision {row} has {said}: {found[row]:.10g}")
