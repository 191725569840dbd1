"""A backtest with a limit on turnover: every decision is near the previously published one.

The decision before is public. So an observer knows the feasible set of each decision, and reads it with that month's problem:
Π_t(u) = {π : u is optimal for π near u_{t−1}}. Each decision maker has its own path. The law of a decision depends on the
previous one, so no single mechanism K(u|π) describes a rule, and aware observers are not modelled.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
)
from inscrutable.decision_makers.results import Decision, MixedDecision, Progress, counted, stack, stack_mixed
from inscrutable.experiments.episodes import Episode, Record, part_of
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.problems import MarkowitzProblem
from inscrutable.validation import Array

Maker = OriginalDecisionMaker | CounterAdversarialDecisionMaker | ProbabilisticDecisionMaker


def limited_episode(
    investor: InvestorModel,
    beliefs: Array,
    makers: Mapping[str, Callable[[MarkowitzProblem], Maker]],
    *,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Episode:
    """Let every decision maker decide on beliefs (T,X), near its own last published weights; the first is not limited."""
    records = {}
    for done, (name, making) in enumerate(makers.items()):
        watch = part_of(progress, done, len(makers))
        records[name] = _followed(investor, beliefs, making, rng, watch)
    return Episode(investor.problem, beliefs, records)


def _followed(
    investor: InvestorModel,
    beliefs: Array,
    making: Callable[[MarkowitzProblem], Maker],
    rng: np.random.Generator,
    watch: Progress,
) -> Record:
    published: list[Decision] = []
    lotteries: list[MixedDecision] = []
    for _, belief in counted(beliefs, watch):
        made = making(investor.problem_after(published[-1].action if published else None)).decide(belief)
        if isinstance(made, MixedDecision):
            lotteries.append(made)
            made = made.sample(rng=rng)
        published.append(made)
    decisions = stack(published, None)
    vars(decisions)["belief_set"] = tuple(each.belief_set for each in published)  # each of its own problem
    return Record(decisions, stack_mixed(lotteries, None) if lotteries else None)
