"""Many decisions: 2,000 random beliefs in one call, beside the same maker that only compares the candidates.

Every try decides other beliefs, so nothing can be remembered. The answers are judged by what is recomputed
from the actions alone, beside the frontier of a grid ten times finer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import markets
from benchmarks.table import Quality, Row, at_most, times_text
from benchmarks.timing import Timing, best_of
from inscrutable import (
    Budget,
    Candidates,
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    PrivacyMeasure,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    decoy_grid,
    privacy_frontier,
)
from inscrutable.experiments.candidates_only import CandidateDecisionMaker

Array = NDArray[np.float64]

TITLE = "Many decisions: X = 3 states, U = 12 assets, budget 0.1 of |c*|"
N_STATES, N_ASSETS = 3, 12
BUDGET = 0.1
MILLISECONDS = 0.5  # a belief
SPENT = 1e-9  # by which rounding may carry a regret above the budget, relative
RECOMPUTED = 1e-6  # between what a result says and what is recomputed from its actions
PROBE = 200  # beliefs that tell how long all of them will take
TARGET = np.array([0.6, 0.3, 0.1])


@dataclass(frozen=True)
class Sizes:
    """Beliefs, resolution of the decoys, and what judges: the reference's resolution, on how many beliefs, how well.

    `behind` is what a decision may lack to the finer grid, in units of privacy; `seconds` is what all tries may take.
    """

    n_beliefs: int = 2_000
    resolution: int = 100
    finer: int = 1000
    compared: int = 100
    behind: float = 1e-4
    tries: int = 7
    seconds: float = 60.0


FULL = Sizes()
QUICK = Sizes(n_beliefs=2, resolution=8, finer=12, compared=1, behind=0.02, tries=1)


@dataclass(frozen=True)
class Case:
    """One market with the candidates of the finer grid."""

    name: str
    problem: MarkowitzProblem
    finer: Candidates

    def references(self, beliefs: Array, measure: PrivacyMeasure) -> list[Any]:
        """The frontier of every belief over the finer candidates."""
        return [privacy_frontier(self.problem, belief, measure, candidates=self.finer) for belief in beliefs]


def rows(sizes: Sizes) -> Iterator[Row]:
    """Both makers and both measures on two kinds of market."""
    for name, problem in _problems():
        case = Case(name, problem, decoy_grid(problem, sizes.finer))
        judged = markets.beliefs(sizes.n_beliefs, N_STATES, 1)[: sizes.compared]
        for measure in (MaximalObfuscation(), DesiredObfuscation(TARGET)):
            frontiers = case.references(judged, measure)
            candidates = decoy_grid(problem, sizes.resolution)
            for maker in (ProbabilisticDecisionMaker, CounterAdversarialDecisionMaker):
                yield _decided(case, maker, measure, sizes, candidates, frontiers)


def _problems() -> Iterator[tuple[str, MarkowitzProblem]]:
    yield "spread portfolios", markets.problem_of(markets.market(N_STATES, N_ASSETS))
    concentrated = np.random.default_rng([markets.SEED, 3])
    drawn = markets.broad_market(concentrated, N_STATES, N_ASSETS, positive_value=True)
    yield "concentrated portfolios", markets.problem_of(drawn)


def _decided(
    case: Case,
    maker: Any,
    measure: PrivacyMeasure,
    sizes: Sizes,
    candidates: Candidates,
    frontiers: Sequence[Any],
) -> Row:
    agent = maker(case.problem, measure, BUDGET, candidates=candidates)
    ours = _timed(agent, sizes)
    is_lottery = maker is ProbabilisticDecisionMaker
    judged = markets.beliefs(sizes.n_beliefs, N_STATES, 1)[: sizes.compared]
    comparison = _compared(case, measure, judged, agent.decide_many(judged), frontiers)
    each = 1e3 * ours.seconds / sizes.n_beliefs
    not_points = float(((candidates.actions > 0).sum(axis=1) < N_STATES).mean())
    return Row(
        f"{'PDM' if is_lottery else 'CDM'} decide_many, {_named(measure)} obfuscation",
        f"T={sizes.n_beliefs:,}, M={len(candidates):,}, {case.name} ({not_points:.0%} of the sets no point)",
        f"{ours.text}, {each:.2g} ms a belief",
        *(
            _peer(case, sizes, candidates, is_lottery, ours)
            if isinstance(measure, MaximalObfuscation)
            else ("", "", "")
        ),
        comparison.quality(sizes.behind),
        at_most(each, MILLISECONDS, " ms a belief"),
        {"seconds": ours.seconds, "candidates": len(candidates)},
    )


def _peer(case: Case, sizes: Sizes, candidates: Candidates, is_lottery: bool, ours: Timing) -> tuple[str, str, str]:
    """The choice among the candidates alone: its name, its time, and ours as a share of it."""
    alone = CandidateDecisionMaker(case.problem, Budget(BUDGET), candidates, mixes=is_lottery)
    found = _timed(alone, sizes)
    return "the candidates alone", found.text, times_text(ours.seconds / found.seconds)


def _timed(agent: Any, sizes: Sizes) -> Timing:
    """The best of all tries, each on beliefs of its own; on fewer beliefs, and said so, if that would take too long."""
    few = min(PROBE, sizes.n_beliefs)
    probe = best_of(1, lambda number: agent.decide_many(markets.beliefs(few, N_STATES, 20 + number)))
    affordable = int(sizes.seconds / (sizes.tries + 1) / probe.seconds * few)
    n = min(sizes.n_beliefs, max(few, affordable))
    batches = {number: markets.beliefs(n, N_STATES, 2 + number) for number in range(-1, sizes.tries)}
    found = best_of(sizes.tries, lambda number: agent.decide_many(batches[number]))
    if n == sizes.n_beliefs:
        return found
    how = f"{found.how}, extrapolated from T={n:,}"
    return found._replace(seconds=found.seconds * sizes.n_beliefs / n, how=how)


def _named(measure: PrivacyMeasure) -> str:
    return "maximal" if isinstance(measure, MaximalObfuscation) else "desired"


@dataclass(frozen=True)
class Comparison:
    """What some decisions are worth: against the finer grid, their own statements, and the budget."""

    gains: tuple[float, ...]
    off: float
    overspent: float
    n_finer: int

    def quality(self, behind: float) -> Quality:
        """Right when no decision lacks more than `behind`, says something else than it does, or overspends."""
        text = (
            f"{np.mean(self.gains):+.0e} on average, {min(self.gains):+.0e} at worst, beside a grid of "
            f"{self.n_finer:,} ({len(self.gains)} compared); recomputed to {self.off:.0e}, "
            f"budget exceeded by {self.overspent:.0e}"
        )
        right = min(self.gains) >= -behind and self.off <= RECOMPUTED and self.overspent <= SPENT
        return Quality(text, right)


def _compared(
    case: Case, measure: PrivacyMeasure, beliefs: Array, results: Any, frontiers: Sequence[Any]
) -> Comparison:
    """Privacy and regret recomputed from the actions, against the finer grid's frontier at the same budget."""
    gains, off, overspent = [], 0.0, 0.0
    for i, (belief, frontier) in enumerate(zip(beliefs, frontiers, strict=True)):
        probabilities, actions, said = _atoms(results, i)
        sets = [consistent_beliefs(case.problem, action) for action in actions]
        privacy = float(probabilities @ [measure(belief, each) for each in sets])
        regret = float(probabilities @ case.problem.regret(belief[None], actions))
        limit = BUDGET * abs(float(case.problem.optimal_cost(belief)))
        gains.append(privacy - (frontier.randomized(limit) if _is_mixed(results) else frontier.deterministic(limit)))
        off = max(off, abs(privacy - said))
        overspent = max(overspent, regret / limit - 1)
    return Comparison(tuple(gains), off, overspent, len(case.finer))


def _is_mixed(results: Any) -> bool:
    return hasattr(results, "probabilities")


def _atoms(results: Any, step: int) -> tuple[Array, Array, float]:
    """Probabilities, actions and the expected privacy that a result states for one belief."""
    if not _is_mixed(results):
        return np.ones(1), results.action[step][None], float(results.privacy[step])
    held = results.probabilities[step] > 0
    return results.probabilities[step][held], results.actions[step][held], float(results.expected_privacy[step])
