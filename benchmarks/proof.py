"""Proofs: how near a bound comes to the privacy reached, at how many oracle calls, beside SCIP where it can follow."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import markets
from benchmarks.table import Quality, Row, Target, seconds_text, times_text
from inscrutable import (
    CounterAdversarialDecisionMaker,
    GlobalSearch,
    LinearProblem,
    MarkowitzProblem,
    ProbabilisticDecisionMaker,
    box,
    simplex,
)
from oracles import optimum

Array = NDArray[np.float64]

TITLE = "Proofs at a gap of 1 %, budget 0.1 of |c*|"
BUDGET, GAP = 0.1, 0.01
MEDIAN_GAPS = {3: 0.01, 4: 0.02}
ROUNDING = 1e-6  # by which SCIP's best may exceed a proven bound: its own feasibility tolerance
MOST_CALLS = 20_000


@dataclass(frozen=True)
class Sizes:
    """Numbers of states, assets and beliefs; how many of the first are given to SCIP; sizes for lotteries."""

    singles: tuple[tuple[int, int, int], ...] = ((3, 3, 20), (3, 12, 20), (4, 4, 10), (5, 5, 4))
    scip: int = 3
    lotteries: tuple[tuple[int, int, int], ...] = ((3, 3, 10), (4, 4, 4))
    linear: tuple[tuple[int, int, int], ...] = ((3, 12, 20), (4, 12, 10))
    most_calls: int = MOST_CALLS


FULL = Sizes()
QUICK = Sizes(singles=((3, 3, 1),), scip=1, lotteries=((3, 3, 1),), linear=((3, 5, 2),), most_calls=2000)


def rows(sizes: Sizes) -> Iterator[Row]:
    """Proofs for single decisions, then for lotteries, then for both where costs are linear."""
    for n_states, n_assets, count in sizes.singles:
        yield _single(n_states, n_assets, count, sizes)
    for n_states, n_assets, count in sizes.lotteries:
        yield _lottery(n_states, n_assets, count)
    for n_states, n_assets, count in sizes.linear:
        yield from _linear(n_states, n_assets, count)


def _single(n_states: int, n_assets: int, count: int, sizes: Sizes) -> Row:
    drawn = markets.market(n_states, n_assets)
    problem, beliefs = markets.problem_of(drawn), markets.beliefs(count, n_states, n_assets)
    method = GlobalSearch(certify=GAP, max_oracle_calls=sizes.most_calls)
    maker = CounterAdversarialDecisionMaker(problem, budget=BUDGET, method=method)
    seconds, found = _timed(maker, beliefs, lambda decision: decision.privacy)
    if n_states > 3 or n_assets > 3:
        return _row("CDM", n_states, n_assets, seconds, found)
    peers, over = [], -np.inf
    for index in range(min(sizes.scip, count)):
        decision = found.answers[index]
        started = time.perf_counter()
        limit = BUDGET * abs(decision.optimal_cost)
        best, _, _ = optimum.global_cdm(drawn, beliefs[index], limit, 0.0)
        peers.append(time.perf_counter() - started)
        over = max(over, best - decision.privacy_bound)
    quality = Quality(f"{found.text}; SCIP's best is at most {max(over, 0.0):.0e} above the bound", over <= ROUNDING)
    peer = statistics.median(peers)
    return _row("CDM", n_states, n_assets, seconds, found, quality, ("SCIP, 7 supports", peer))


def _lottery(n_states: int, n_assets: int, count: int) -> Row:
    problem: MarkowitzProblem = markets.problem_of(markets.market(n_states, n_assets))
    maker = ProbabilisticDecisionMaker(problem, budget=BUDGET, certify=GAP)
    beliefs = markets.beliefs(count, n_states, n_assets)
    seconds, found = _timed(maker, beliefs, lambda mixed: mixed.expected_privacy)
    return _row("PDM", n_states, n_assets, seconds, found)


def _linear(n_states: int, n_assets: int, count: int) -> Iterator[Row]:
    """A market's means alone, no asset above two fifths: mixtures of tied portfolios count, and exactly."""
    caps = box(np.zeros(n_assets), np.full(n_assets, 0.4))
    problem = LinearProblem(-markets.market(n_states, n_assets).means, simplex(n_assets) & caps)
    beliefs = markets.beliefs(count, n_states, n_assets)
    single = CounterAdversarialDecisionMaker(problem, budget=BUDGET, method=GlobalSearch(certify=GAP))
    seconds, found = _timed(single, beliefs, lambda decision: decision.privacy)
    yield _row("linear CDM", n_states, n_assets, seconds, found)
    mixed = ProbabilisticDecisionMaker(problem, budget=BUDGET, certify=GAP)
    seconds, found = _timed(mixed, beliefs, lambda lottery: lottery.expected_privacy)
    yield _row("linear PDM", n_states, n_assets, seconds, found)


@dataclass(frozen=True)
class Found:
    """What a maker answered, the relative gaps it proved, and its oracle calls."""

    answers: list[Any]
    gaps: list[float]
    calls: list[int]

    @property
    def text(self) -> str:
        """Gap and calls in words."""
        return (
            f"gap {statistics.median(self.gaps):.2%} (at most {max(self.gaps):.2%}), "
            f"{statistics.median(self.calls):,.0f} oracle calls (at most {max(self.calls):,})"
        )


def _timed(maker: Any, beliefs: Array, value: Callable[[Any], float]) -> tuple[float, Found]:
    maker.decide(np.full(beliefs.shape[1], 1 / beliefs.shape[1]))
    times, answers = [], []
    for belief in beliefs:
        started = time.perf_counter()
        answers.append(maker.decide(belief))
        times.append(time.perf_counter() - started)
    gaps = [each.privacy_bound / value(each) - 1.0 if value(each) > 0 else 0.0 for each in answers]
    return statistics.median(times), Found(answers, gaps, [each.oracle_calls for each in answers])


def _row(
    what: str,
    n_states: int,
    n_assets: int,
    seconds: float,
    found: Found,
    quality: Quality | None = None,
    peer: tuple[str, float] = ("", 0.0),
) -> Row:
    target = Target()
    if n_states in MEDIAN_GAPS:
        most = MEDIAN_GAPS[n_states] if what == "CDM" else GAP
        target = Target(f"median gap ≤ {most:.0%}", round(statistics.median(found.gaps), 4) <= most)
    quality = Quality(found.text, min(found.gaps) >= 0.0) if quality is None else quality
    name, takes = peer
    return Row(
        f"{what} decide, proved",
        f"X={n_states}, U={n_assets}",
        seconds_text(seconds, f"median of {len(found.answers)}"),
        name,
        seconds_text(takes, "median") if name else "",
        times_text(takes / seconds) if name else "",
        quality=quality,
        target=target,
        numbers={"seconds": seconds, "gap": statistics.median(found.gaps), "calls": statistics.median(found.calls)},
    )
