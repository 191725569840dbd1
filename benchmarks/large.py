"""Large problems: single decisions against the best that minutes of multistart over active sets found, which are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchmarks import markets
from benchmarks.table import Quality, Row, Target, seconds_text, times_text
from benchmarks.timing import median_of
from inscrutable import Budget, CounterAdversarialDecisionMaker
from oracles import large_markets, multistart
from oracles.large_markets import Instance

TITLE = "Large problems: one CDM decision, candidates in hand"
NEARBY = 0.05  # how far the timed beliefs are from the instance's, as a share of the way to another
SHARE = 0.99  # of the best privacy found by multistart
ADMISSIBLE = 1e-9  # by which rounding may carry a regret above the limit, relative


@dataclass(frozen=True)
class Sizes:
    """How many instances of each kind, and how many beliefs are timed for each."""

    instances: int = 100
    beliefs: int = 5


FULL = Sizes()
QUICK = Sizes(instances=1, beliefs=1)


class Reached(NamedTuple):
    """One instance: seconds of a decision, its privacy over the best found, and whether it keeps the rules."""

    name: str
    seconds: float
    share: float
    keeps_rules: bool
    peer_found: float
    peer_run: float


def rows(sizes: Sizes) -> Iterator[Row]:
    """One row for each kind of instance; the oracle judges our action from nothing but itself."""
    kinds: dict[str, Callable[[Instance], bool]] = {
        "X=5, U=50": lambda each: each.name.startswith("X5") and "gamma" not in each.name,
        "X=8, U=100": lambda each: each.name.startswith("X8") and "gamma" not in each.name,
        "concentrated, X=5-6, U=20-50": lambda each: each.name[:2] in ("X5", "X6") and "gamma" in each.name,
        "concentrated, X=8, U=20-90": lambda each: each.name.startswith("X8") and "gamma" in each.name,
    }
    known = list(large_markets.instances())
    for kind, belongs in kinds.items():
        chosen = [instance for instance in known if belongs(instance)][: sizes.instances]
        yield _row(kind, [_reached(instance, sizes) for instance in chosen])


def _row(kind: str, reached: list[Reached]) -> Row:
    seconds = max(each.seconds for each in reached)
    worst = min(reached, key=lambda each: each.share)
    found = [each.peer_found for each in reached]
    quality = f"of the best privacy found {worst.share:.2%} at worst ({worst.name}), "
    quality += f"{np.mean([each.share for each in reached]):.2%} on average"
    right = worst.share >= SHARE and all(each.keeps_rules for each in reached)
    return Row(
        "CDM decide",
        f"{kind}, {len(reached)} instance{'s' if len(reached) > 1 else ''}",
        seconds_text(seconds, "the slowest"),
        "multistart over active sets",
        f"{seconds_text(max(found))} until found, in runs of {max(each.peer_run for each in reached):g} s at most",
        times_text(float(np.median([each.peer_found / each.seconds for each in reached]))),
        Quality(quality, right),
        Target("within 1 % of the best found", worst.share >= SHARE),
        {"seconds": seconds, "share": worst.share},
    )


def _reached(instance: Instance, sizes: Sizes) -> Reached:
    problem, known = markets.problem_of(instance.market), large_markets.best_known(instance)
    agent = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(instance.limit))
    decision = agent.decide(instance.belief)
    others = markets.beliefs(sizes.beliefs, problem.n_states)
    ours = median_of(agent.decide, (1.0 - NEARBY) * instance.belief + NEARBY * others)
    verdict = multistart.judged(instance.market, instance.belief, decision.optimal_cost, decision.action)
    keeps_rules = verdict.admissible and verdict.regret <= instance.limit * (1 + ADMISSIBLE)
    share = verdict.privacy / known.privacy
    return Reached(instance.name, ours.seconds, share, bool(keeps_rules), known.found_seconds, known.run_seconds)
