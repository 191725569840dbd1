"""The aware observer's law of the belief given all weights so far; it knows the rule and the belief's dynamics."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable import validation
from inscrutable.adversaries import SequentialAdversary
from inscrutable.adversaries.sequence_results import InferredBeliefs, SequenceStatus
from inscrutable.budgets import Budget, as_budget
from inscrutable.datasets.suspicious import missing_steps
from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    SequentialDecisionMaker,
)
from inscrutable.errors import InputError
from inscrutable.experiments.attack import Attack, Reading
from inscrutable.experiments.backtest_aware import doubted
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.protect_sequence import sequence_budget
from inscrutable.experiments.silence import chain_of
from inscrutable.mechanisms import mechanism
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.played import PlaysMany


@dataclass(frozen=True, eq=False)
class AttackOverTime:
    """The aware observer's belief after each row.

    Args:
        attack: The same weights, each read alone by the naive observer.
        rule: The rule that the observer assumes.
        inferred: The observer's law of the belief after each row, and how each row was read.
        prior_error: √E‖π − E π‖², its error without weights, in the long run of the model.
    """

    attack: Attack
    rule: str
    inferred: InferredBeliefs
    prior_error: float

    def table(self) -> pd.DataFrame:
        """Return one row per published row: the estimate of each regime, its expected error, and the row's status."""
        table = pd.DataFrame(self.inferred.mean, index=self.attack.index, columns=list(self.attack.model.regimes))
        table["expected error"] = self.inferred.spread
        table["reading"] = [status.value.partition(":")[0] for status in self.inferred.statuses]
        return table

    def summary(self) -> str:
        """Return the observer's mean figures, and how many rows the rule does not play."""
        found = self.inferred
        error = float(np.sqrt(np.mean(found.spread**2)))
        lines = [
            f"By its own law the aware observer, who knows the rule ({self.rule}), errs by {error:.3f}, root mean square; "
            f"without weights by {self.prior_error:.3f}, in the long run. It gives the likeliest regime a probability of "
            f"{found.mean.max(axis=1).mean():.2f} on average."
        ]
        off = sum(status is not SequenceStatus.USED for status in found.statuses)
        lost = self.attack.count(Reading.IMPLAUSIBLE)
        if off:
            lines.append(
                f"The rule plays {off} of the {len(found)} rows under no belief of the grid; the nearest weights that it plays "
                "stand for them."
            )
        index = self.attack.index
        missing = missing_steps(list(index)) if isinstance(index, pd.DatetimeIndex) else ""
        if missing:
            lines.append(f"Caution: rows follow one another as single steps, but their dates have gaps: {missing}.")
        if lost:
            lines.append(
                f"Caution: {lost} of the {len(found)} rows are explained by no belief of this model, so that this observer's "
                "figures say little: the investor follows another rule or another model."
            )
        return "\n".join(lines)

    def lines(self) -> pd.DataFrame:
        """Return the same as text."""
        table = self.table()
        numbers = table.columns[:-1]
        table[numbers] = table[numbers].map("{:.3f}".format)
        return table


def attack_over_time(
    attack: Attack, rule: str, budget: Budget | float | None = None, *, state: str | Path | None = None
) -> AttackOverTime:
    """Return the aware observer's law of the belief after each row; it knows the rule, its budget and the model.

    Rows are one step apart in time. A decision that the rule plays under no belief of the grid is replaced by the nearest
    played one.

    Args:
        attack: From `attack_weights`.
        rule: The rule: "optimal", "cdm", "pdm" or "sequential".
        budget: The rule's budget; None: the model's, for "sequential" that of the file.
        state: For "sequential": the file of the sequence, from which the rule's prices are taken, but no decision.

    Raises:
        InputError: The rule is unknown, dates of rows go back, or the file is not given, missing, damaged, in use, or of
            another model or budget.

    Cost: one decision for each of about 500 beliefs, and one filter step per row.

    Source: see `SequentialAdversary`.

    Example:
        >>> from inscrutable.experiments.attack import attack_weights
        >>> from inscrutable import GaussianEmission, HiddenMarkovModel, MarkowitzProblem
        >>> sensor = GaussianEmission([[0.02, 0.0], [-0.03, 0.01]], [0.002 * np.eye(2), 0.006 * np.eye(2)])
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], sensor)
        >>> problem = MarkowitzProblem(sensor.means, sensor.covariances, 4.0)
        >>> model = InvestorModel(world, problem, ("A", "B"), ("calm", "turbulent"))
        >>> published = pd.DataFrame(problem.solve([[0.8, 0.2], [0.3, 0.7]]), columns=["A", "B"])
        >>> print(attack_over_time(attack_weights(model, published), "optimal").table()["calm"].round(2).tolist())
        [0.8, 0.3]
    """
    model = attack.model
    validation.time_order(attack.index, "decisions")
    chain = chain_of(model.world)
    known = _mechanism(model, chain, rule, None if budget is None else as_budget(budget), state)
    # For the sequential rule the chain is its own; for others the chain rules out no move.
    followed = SequentialAdversary(chain if rule == "sequential" else doubted(chain), known)
    return AttackOverTime(attack, rule, followed.filter(attack.actions, nearest=True), chain.prior.error)


def _mechanism(
    model: InvestorModel, chain: BeliefChain, rule: str, given: Budget | None, state: str | Path | None
) -> Any:
    problem, budget = model.problem, model.budget if given is None else given
    makers: dict[str, Callable[[], PlaysMany]] = {
        "optimal": lambda: OriginalDecisionMaker(problem),
        "cdm": lambda: CounterAdversarialDecisionMaker(problem, budget=budget),
        "pdm": lambda: ProbabilisticDecisionMaker(problem, budget=budget),
    }
    if rule in makers:
        return mechanism(makers[rule](), chain.prior.beliefs)
    if rule != "sequential":
        raise InputError(f"rule must be one of {', '.join([*makers, 'sequential'])}, got {rule!r}")
    if state is None or not Path(state).exists():
        raise InputError("the sequential rule's prices are in the file of its sequence: give one that protect has made")
    limit = sequence_budget(model, chain.prior, Path(state)) if given is None else given
    sequence = SequentialDecisionMaker(problem, limit, chain=chain, rng=np.random.default_rng(0)).begin()
    try:
        return sequence.load(state)
    finally:
        sequence.close()
