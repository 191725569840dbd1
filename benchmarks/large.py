"""Large problems: one decision against the best that ten minutes of multistart find; run by `make audit`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks import markets
from benchmarks.table import Quality, Row, Target, seconds_text, times_text
from benchmarks.timing import best_of
from inscrutable import Budget, CounterAdversarialDecisionMaker
from oracles import multistart

TITLE = "Large problems: one CDM decision, candidates in hand"
HAIR = 1e-7
SHARE = 0.99  # of the best privacy found by multistart
ADMISSIBLE = 1e-9  # by which rounding may carry a regret above the limit, relative


@dataclass(frozen=True)
class Sizes:
    """Which of the oracle's instances, seconds of multistart for each, and tries of ours."""

    instances: tuple[str, ...] = ("X5-U50-open-0.1", "X8-U100-open-0.1")
    seconds: float = 600.0
    tries: int = 3


FULL = Sizes()
QUICK = Sizes(instances=("X5-U50-open-0.1",), seconds=1.0, tries=1)


def rows(sizes: Sizes) -> Iterator[Row]:
    """One row for each instance; the oracle judges our action from nothing but itself."""
    for instance in multistart.large_instances():
        if instance.name in sizes.instances:
            yield _compared(instance, sizes)


def _compared(instance: multistart.Instance, sizes: Sizes) -> Row:
    problem = markets.problem_of(instance.market)
    agent = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(instance.limit))
    n_candidates = len(agent.candidates)
    numbers = np.arange(problem.n_states)

    def decide(number: int) -> object:
        # What was found for a belief is remembered with the candidates: a hair's breadth makes it another belief.
        moved = instance.belief * (1 + HAIR * (number + 2) * numbers)
        return agent.decide(moved / moved.sum())

    ours = best_of(sizes.tries, decide)
    decision = agent.decide(instance.belief)
    rng = np.random.default_rng([markets.SEED, 13])
    best = multistart.best_by_multistart(
        *instance.market, instance.belief, instance.limit, seconds=sizes.seconds, rng=rng
    )
    verdict = multistart.judged(instance.market, instance.belief, decision.optimal_cost, decision.action)
    share = verdict.privacy / best.privacy if best.privacy > 0 else 1.0
    keeps_rules = verdict.admissible and verdict.regret <= instance.limit * (1 + ADMISSIBLE)
    reached = f"privacy {verdict.privacy:.4f}, the best found {best.privacy:.4f}: {share:.2%}"
    return Row(
        "CDM decide",
        f"{instance.name}, M={n_candidates:,}",
        ours.text,
        "multistart over faces",
        seconds_text(sizes.seconds),
        times_text(sizes.seconds / ours.seconds),
        Quality(reached, bool(keeps_rules and share >= SHARE)),
        Target("within 1 % of the best found", share >= SHARE),
        {"seconds": ours.seconds, "share": share},
    )
