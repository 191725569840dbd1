"""One decision: `decide` on one belief with the candidates in hand, against the paper's way, SCIP and SLSQP."""

from __future__ import annotations

import statistics
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks import markets
from benchmarks.decision_peers import Answer, GridMethod, slsqp_multistart
from benchmarks.table import Quality, Row, Target, at_least, at_most, seconds_text, times_text
from benchmarks.timing import Timing, median_of
from inscrutable import (
    CounterAdversarialDecisionMaker,
    MarkowitzProblem,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    simplex_grid,
)
from oracles import optimum

Array = NDArray[np.float64]

TITLE = "One decision: X = 3 states, budget 0.1 of |c*|, candidates in hand"
N_STATES = 3
BUDGET = 0.1
MILLISECONDS = 5.0
OVER_SCIP = 1000.0
SHARE_OF_SCIP = 1 - 1e-4  # of SCIP's optimum that a decision must reach
SPENT = 1e-9  # by which rounding may carry a regret above the budget, relative
RECOMPUTED = 1e-9  # between a decision's privacy and the distance recomputed from its action
SCIP_ASSETS = 6  # up to here SCIP is asked: it takes 2^U − 1 programmes
PULLS = 40  # halvings of the way back to π along which a decoy becomes affordable


@dataclass(frozen=True)
class Sizes:
    """Beliefs for `decide` and for each peer; the paper's grids; starts of SLSQP."""

    resolutions: tuple[tuple[int, int], ...] = ((3, 40), (6, 8), (12, 4))
    beliefs: int = 200
    peers_beliefs: int = 5
    n_starts: int = 20


FULL = Sizes()
QUICK = Sizes(resolutions=((3, 4),), beliefs=4, peers_beliefs=1, n_starts=1)


@dataclass(frozen=True)
class Case:
    """One market, the beliefs, and our decisions on them."""

    market: markets.Market
    problem: MarkowitzProblem
    beliefs: Array
    timing: Timing

    @property
    def decisions(self) -> list[Any]:
        """Ours, one for each belief."""
        return list(self.timing.result)

    def allowed(self, index: int) -> float:
        """The largest affordable cost."""
        optimal = self.decisions[index].optimal_cost
        return float(optimal + BUDGET * abs(optimal))


def rows(sizes: Sizes) -> Iterator[Row]:
    """Per number of assets: our single call, then each peer on some of the same beliefs."""
    for n_assets, resolution in sizes.resolutions:
        drawn = markets.market(N_STATES, n_assets)
        problem = markets.problem_of(drawn)
        size = f"U={n_assets}"
        beliefs = markets.beliefs(sizes.beliefs, N_STATES, n_assets)
        makers = CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker
        cdm, pdm = (_timed(maker(problem, budget=BUDGET), beliefs) for maker in makers)
        case = Case(drawn, problem, beliefs, cdm)
        yield _single_call("CDM decide", size, cdm, _judged(case))
        yield _single_call("PDM decide", size, pdm, _mixtures_judged(case, pdm))
        few = range(min(sizes.peers_beliefs, len(beliefs)))
        if n_assets <= SCIP_ASSETS:
            yield _against_scip(case, size, few)
        yield from _against_grid(case, pdm, resolution, range(min(2, len(few))))
        yield _against_slsqp(case, size, few, sizes.n_starts)


def _timed(maker: Any, beliefs: Array) -> Timing:
    for belief in markets.beliefs(3, N_STATES, 99):
        maker.decide(belief)
    return median_of(maker.decide, beliefs)


def _single_call(what: str, size: str, timing: Timing, quality: Quality) -> Row:
    target = at_most(timing.seconds * 1e3, MILLISECONDS, " ms")
    return Row(what, size, timing.text, quality=quality, target=target, numbers={"seconds": timing.seconds})


def _judged(case: Case) -> Quality:
    """Regret within the budget, privacy as recomputed from the action alone, on every belief."""
    overspent, off = 0.0, 0.0
    for belief, decision in zip(case.beliefs, case.decisions, strict=True):
        regret = float(case.problem.regret(belief, decision.action))
        limit = BUDGET * abs(decision.optimal_cost)
        overspent = max(overspent, regret / limit - 1)
        off = max(off, abs(consistent_beliefs(case.problem, decision.action).distance(belief) - decision.privacy))
    mean = statistics.mean(decision.privacy for decision in case.decisions)
    text = f"privacy {mean:.4f} on average, recomputed to {off:.0e}, budget exceeded by {max(overspent, 0.0):.0e}"
    return Quality(text, overspent <= SPENT and off <= RECOMPUTED)


def _mixtures_judged(case: Case, timing: Timing) -> Quality:
    """Expected regret within the budget, and no lottery below the CDM on the same belief."""
    overspent = max(
        mixed.expected_regret / (BUDGET * abs(mixed.optimal_cost)) - 1 if mixed.optimal_cost else 0.0
        for mixed in timing.result
    )
    pairs = zip(timing.result, case.decisions, strict=True)
    behind = max(decision.privacy - mixed.expected_privacy for mixed, decision in pairs)
    mean = statistics.mean(mixed.expected_privacy for mixed in timing.result)
    text = f"privacy {mean:.4f} on average, never below the CDM's, budget exceeded by {max(overspent, 0.0):.0e}"
    return Quality(text, overspent <= SPENT and behind <= RECOMPUTED)


def _against_scip(case: Case, size: str, indices: range) -> Row:
    """SCIP's own seconds: its starts, the scans of two-asset supports and the enumeration are not counted."""
    shares, seconds = [], []
    for i in indices:
        budget = case.allowed(i) - case.decisions[i].optimal_cost
        least = case.problem.constraints.min_slack
        faces = optimum.solve_faces(case.market, case.beliefs[i], budget, least)
        seconds.append(sum(face.scip_seconds for face in faces))
        best = max(face.privacy for face in faces)
        shares.append(case.decisions[i].privacy / best if best > 0 else 1.0)
    text = f"{min(shares):.6f} of SCIP's optimum at least"
    quality = Quality(text, min(shares) >= SHARE_OF_SCIP)
    peer = f"SCIP, {2**case.problem.n_actions - 1} supports"
    return _compared("CDM decide", size, case.timing, peer, seconds, quality, OVER_SCIP)


def _against_grid(case: Case, pdm: Timing, resolution: int, indices: range) -> Iterator[Row]:
    grid = GridMethod(case.market, simplex_grid(case.problem.n_actions, resolution))
    grid.distance(case.beliefs[0], 0)  # canonicalised here
    size = f"U={case.problem.n_actions}, {len(grid.actions):,} actions"
    name = "the paper's way: CVXPY/Clarabel for each"
    best = [grid.best(case.beliefs[i], case.allowed(i)) for i in indices]
    ours = [case.decisions[i].privacy for i in indices]
    yield _beside("CDM decide", size, case.timing, f"{name} affordable action", ours, best)
    mixed = [grid.mixture(case.beliefs[i], case.allowed(i)) for i in indices]
    ours = [pdm.result[i].expected_privacy for i in indices]
    yield _beside("PDM decide", size, pdm, f"{name} action, then an LP", ours, mixed)


def _against_slsqp(case: Case, size: str, indices: range, n_starts: int) -> Row:
    rng = np.random.default_rng([markets.SEED, 11])
    answers = []
    for i in indices:
        belief, allowed = case.beliefs[i], case.allowed(i)
        decoys, seconds = slsqp_multistart(case.market, belief, allowed, n_starts=n_starts, rng=rng)
        reached = [privacy_of_decoy(case.problem, belief, decoy, allowed) for decoy in decoys]
        answers.append(Answer(max(reached, default=0.0), seconds))
    ours = [case.decisions[i].privacy for i in indices]
    return _beside("CDM decide", size, case.timing, f"SciPy SLSQP, {n_starts} starts", ours, answers)


def privacy_of_decoy(problem: MarkowitzProblem, belief: Array, decoy: Array, allowed: float) -> float:
    """The privacy of u*(y), after y is pulled towards π as little as makes it affordable: regret grows along the ray."""

    def action_at(share: float) -> Array:
        point = np.maximum(belief + share * (decoy - belief), 0.0)
        return problem.solve(point / point.sum())

    low, high = 0.0, 1.0
    middle = high
    for _ in range(PULLS):
        if float(belief @ problem.state_costs(action_at(middle))) <= allowed:
            low = middle
        else:
            high = middle
        if low == high:
            break
        middle = (low + high) / 2
    return float(consistent_beliefs(problem, action_at(low)).distance(belief))


def _beside(what: str, size: str, timing: Timing, peer: str, ours: list[float], answers: list[Answer]) -> Row:
    """Our mean privacy beside the peer's where it finds any; a peer that finds none is not said to be fast or slow."""
    found = [(own, answer.privacy) for own, answer in zip(ours, answers, strict=True) if answer.privacy >= 0]
    seconds = [answer.seconds for answer in answers]
    if not found:
        quality = Quality(f"privacy {statistics.mean(ours):.4f}, the peer finds none")
        return replace(_compared(what, size, timing, peer, seconds, quality), ratio="")
    own, other = (statistics.mean(values) for values in zip(*found, strict=True))
    behind = max(answer - mine for mine, answer in found)
    text = f"privacy {own:.4f}, the peer's {other:.4f} on {len(found)} of {len(ours)} beliefs"
    quality = Quality(text, behind <= (1 - SHARE_OF_SCIP) * max(other, 1.0))
    return _compared(what, size, timing, peer, seconds, quality)


def _compared(
    what: str,
    size: str,
    ours: Timing,
    peer: str,
    seconds: list[float],
    quality: Quality,
    least: float | None = None,
) -> Row:
    taken = statistics.median(seconds)
    ratio = taken / ours.seconds
    target = at_least(ratio, least) if least else Target()
    numbers = {"seconds": ours.seconds, "peer_seconds": taken}
    takes = seconds_text(taken, f"median of {len(seconds)}")
    return Row(what, size, ours.text, peer, takes, times_text(ratio), quality, target, numbers)
