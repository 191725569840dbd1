"""The aware observer's law of the belief given all weights so far; it knows the rule and the belief's dynamics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.adversaries import SequentialAdversary
from inscrutable.adversaries.rounded import half_unit
from inscrutable.adversaries.sequence_results import InferredBeliefs, SequenceStatus
from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    SequentialDecisionMaker,
)
from inscrutable.errors import InputError
from inscrutable.experiments.attack import Attack, Reading, missing_rows
from inscrutable.experiments.backtest_aware import beliefs_resolution, doubted
from inscrutable.experiments.cell_mechanism import N_NEAREST, cell_beliefs, cell_mechanism
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.experiments.performance import frequency_of
from inscrutable.experiments.protect_sequence import sequence_budget
from inscrutable.experiments.silence import chain_of
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.memory import MechanismRule
from inscrutable.mechanisms.played import PlaysMany
from inscrutable.validation import Array

_SEED = 1
"""Seed of the path whose beliefs fill the cells: the same at every call."""


@dataclass(frozen=True, eq=False)
class AttackOverTime:
    """The aware observer's belief after each row.

    Args:
        attack: The same weights, each read alone by the naive observer.
        rule: The rule that the observer assumes.
        inferred: The observer's law of the belief after each row, and how each row was read.
        prior_error: √E‖π − E π‖², its error without weights, in the long run of the model.
        n_off: Number of rows that the rule does not play, rounding allowed for: those farther from its nearest decision than
            that one's neighbours are; for the sequential rule all that it does not play.
        budget: The rule's budget that the observer assumes, in words; empty where the rule has none.
    """

    attack: Attack
    rule: str
    inferred: InferredBeliefs
    prior_error: float
    n_off: int
    budget: str = ""

    @property
    def expected_error(self) -> float:
        """Root mean square of the observer's expected errors: its error if the rule and the model are the true ones."""
        return float(np.sqrt(np.mean(self.inferred.spread**2)))

    def table(self) -> pd.DataFrame:
        """Return one row per published row: the estimate of each regime, its expected error, and the row's status."""
        table = pd.DataFrame(self.inferred.mean, index=self.attack.index, columns=list(self.attack.model.regimes))
        table["expected error"] = self.inferred.spread
        table["reading"] = [status.value.partition(":")[0] for status in self.inferred.statuses]
        return table

    def summary(self) -> str:
        """Return the observer's mean figures, and how many rows the rule does not play."""
        found = self.inferred
        played = f"{self.rule}, {self.budget}" if self.budget else self.rule
        figures = (
            f"If the rule ({played}) and the model are the true ones, the aware observer errs by {self.expected_error:.3f}, "
            f"root mean square; without weights by {self.prior_error:.3f}, in the long run. It gives the likeliest regime a "
            f"probability of {found.mean.max(axis=1).mean():.2f} on average."
        )
        return "\n".join([figures, *self.cautions()])

    def cautions(self) -> list[str]:
        """Return what may be wrong about rule, model or rows."""
        found, lines = self.inferred, list[str]()
        lost = self.attack.count(Reading.IMPLAUSIBLE)
        if self.n_off:
            lines.append(
                f"Caution: the rule plays nothing near {self.n_off} of the {len(found)} rows under any belief that the model's "
                "own filter reaches; the nearest weights that it plays stand for them. Does the investor follow the rule, with "
                "this budget, by beliefs of this model?"
            )
        model, index = self.attack.model, self.attack.index
        lines += (
            missing_rows(index) if model.turnover is None else []
        )  # with a limit on turnover, the attack says so itself
        lines += _other_steps(index, model.step) if model.step else []
        if lost:
            lines.append(
                f"Caution: {lost} of the {len(found)} rows are explained by no belief of this model, so that this observer's "
                "figures say little: the investor follows another rule or another model."
            )
        return lines

    def lines(self) -> pd.DataFrame:
        """Return the same as text."""
        table = self.table()
        numbers = table.columns[:-1]
        table[numbers] = table[numbers].map("{:.3f}".format)
        return table


def _other_steps(index: pd.Index, step: str) -> list[str]:
    """Return a caution where dated rows are not as far apart as the steps of the model."""
    if not isinstance(index, pd.DatetimeIndex) or len(index) < 2:
        return []
    found = frequency_of(index)
    if found.step == step:
        return []
    told = f"every {365.25 / found.per_year:.3g} days" if found.word == "period" else f"once a {found.step}"
    return [f"Caution: rows come {told}, the steps of the model once a {step}; each row counts as one step."]


def attack_over_time(
    attack: Attack, rule: str, budget: Budget | float | None = None, *, state: str | Path | None = None
) -> AttackOverTime:
    """Return the aware observer's law of the belief after each row; it knows the rule, its budget and the model.

    Rows are one step apart in time. A decision that the rule does not play, under beliefs in the cells of a grid, is read as
    one of the nearest that it plays; for the sequential rule as the nearest.

    Args:
        attack: From `attack_weights`.
        rule: The rule: "optimal", "cdm", "pdm" or "sequential".
        budget: The rule's budget; None: the model's, for "sequential" that of the file.
        state: For "sequential": the file of the sequence, from which the rule's prices are taken, but no decision.

    Raises:
        InputError: The rule is unknown, dates of rows go back, or the file is not given, missing, damaged, in use, or of
            another model or budget.

    Cost: four decisions for each of about 500 cells, and one filter step per row.

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
    if not isinstance(known, Mechanism):  # the sequential rule's chain is its own
        watched = _Watched(known)
        inferred = SequentialAdversary(chain, watched).filter(attack.actions, nearest=1)
        return AttackOverTime(attack, rule, inferred, chain.prior.error, watched.n_off(attack, inferred.statuses))
    inferred = SequentialAdversary(doubted(chain), known).filter(attack.actions, nearest=N_NEAREST)
    return AttackOverTime(
        attack, rule, inferred, chain.prior.error, _n_off(known.actions, attack), _assumed(rule, model, budget)
    )


def _assumed(rule: str, model: InvestorModel, given: Budget | float | None) -> str:
    """Return the budget that the observer assumes in words; empty for optimal decisions."""
    if rule == "optimal":
        return ""
    return f"the model's budget, {model.budget}" if given is None else f"a budget of {as_budget(given)}"


class _Watched:
    """A rule, with the decisions that it may play at each step."""

    def __init__(self, rule: MechanismRule) -> None:
        self._rule, self.beliefs = rule, rule.beliefs
        self._played: list[Array] = []

    def mechanism_for(self, prior: Prior, before: Any = None) -> Mechanism:
        """Return the mechanism of the next step."""
        made = self._rule.mechanism_for(prior, before)
        self._played.append(np.asarray(made.actions)[np.unique(made.probabilities.nonzero()[1])])
        return made

    def n_off(self, attack: Attack, statuses: Sequence[SequenceStatus]) -> int:
        """Return how many rows of weights the rule does not play, rounding allowed for."""
        gaps = [np.abs(each - row).max(axis=1).min() for each, row in zip(self._played, attack.actions, strict=True)]
        return sum(
            not (status is SequenceStatus.USED or (status is SequenceStatus.NEAREST and gap <= _rounding(attack)))
            for status, gap in zip(statuses, gaps, strict=True)
        )


_ROUNDED = 2.0
"""Half units of the last digit by which a row may be off: its rounding, and that of the weights that make up for the sum."""


def _rounding(attack: Attack) -> float:
    """The most that rounding changes a weight of a row."""
    return _ROUNDED * (tolerances.SAME_ACTION if attack.decimals is None else half_unit(attack.decimals))


def _n_off(played: Array, attack: Attack) -> int:
    """Return how many rows lie farther from the nearest played decision than `N_NEAREST` of its neighbours, and than rounding
    moves them."""
    seen, tree = attack.actions, cKDTree(played)
    gaps, place = tree.query(seen)
    around = np.atleast_2d(tree.query(played[place], k=min(N_NEAREST + 1, len(played)))[0])[:, -1]
    return int((gaps > np.maximum(around, np.sqrt(seen.shape[1]) * _rounding(attack))).sum())


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
        world, rng = model.world, np.random.default_rng(_SEED)
        return cell_mechanism(
            makers[rule](), chain.prior, cell_beliefs(chain.prior, world, beliefs_resolution(world.n_states), rng=rng)
        )
    if rule != "sequential":
        raise InputError(f"rule must be one of {', '.join([*makers, 'sequential'])}, got {rule!r}")
    if state is None or not Path(state).exists():
        raise InputError("the sequential rule's prices are in the file of its sequence: give one that protect has made")
    limit = sequence_budget(model, chain.prior, Path(state)) if given is None else given
    source = np.random.default_rng(_SEED)
    sequence = SequentialDecisionMaker(problem, limit, chain=chain, turnover=model.turnover, rng=source).begin()
    try:
        return sequence.load(state)
    finally:
        sequence.close()
