"""Forward solves: the optimal decisions of thousands of decoys, against one quadratic programme after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks import markets
from benchmarks.quadratic_peers import PEERS, kkt_residual, polished
from benchmarks.table import Quality, Row, Target, at_least, seconds_text, times_text
from benchmarks.timing import PATIENCE, Timing, best_of, loop
from inscrutable import Candidates, MarkowitzProblem, decoy_grid, simplex_grid

Array = NDArray[np.float64]

TITLE = "Forward solves: candidates for X = 4 states"
N_STATES = 4
ERROR = 1e-8  # largest error of a weight against DAQP polished; the fraction of a portfolio nobody trades
RESIDUAL = 1e-9  # of the first-order conditions, relative; a weight's error of 1e-8 times a condition number of ten
COARSE = 3  # resolution of the decoys that tell how long all of them will take
PEER_ERROR = 1e-2  # a percentage point of the portfolio: a peer that errs by more has not solved the programme
SPEED_UPS = {20: (10, 30), 100: (40, 100), 500: (150, 400)}


@dataclass(frozen=True)
class Sizes:
    """Decoys on a grid of this resolution, for each number of assets; seconds a peer may take; answers compared."""

    resolution: int = 29
    assets: tuple[int, ...] = (20, 100, 500)
    tries: int = 5
    seconds: float = 3.0
    compared: int = 200


FULL = Sizes()
QUICK = Sizes(resolution=3, assets=(4, 20), tries=2, seconds=0.05, compared=5)


def rows(sizes: Sizes) -> Iterator[Row]:
    """Per number of assets: `problem.solve` against every peer, and the whole of `decoy_grid` against the fastest."""
    decoys = simplex_grid(N_STATES, sizes.resolution)
    for n_assets in sizes.assets:
        problem = markets.problem_of(markets.market(N_STATES, n_assets))
        yield from _compared(problem, decoys, sizes, "forward solves")
    n_assets = max(sizes.assets)
    hard = markets.broad_market(np.random.default_rng([markets.SEED, n_assets]), N_STATES, n_assets)
    yield from _compared(markets.problem_of(hard), decoys, sizes, "forward solves, broad portfolios")


def _compared(problem: MarkowitzProblem, decoys: Array, sizes: Sizes, what: str) -> Iterator[Row]:
    n_assets, is_standard = problem.n_actions, what == "forward solves"
    ours = best_of(sizes.tries, lambda _: problem.solve(decoys))
    peers = {name: loop(prepare(problem, decoys), len(decoys), sizes.seconds) for name, prepare in PEERS.items()}
    reference = _reference(problem, decoys, peers["DAQP"], sizes.compared)
    errors = {name: _error(peer, reference) for name, peer in peers.items()}
    fastest = min((name for name in peers if errors[name] <= PEER_ERROR), key=lambda name: peers[name].seconds)
    quality = _quality(problem, decoys, ours.result, reference)
    held = float((ours.result > 0).sum(axis=1).mean())
    size = f"U={n_assets}, {len(decoys):,} decoys, {held:.0f} held"
    for name, peer in peers.items():
        ratio = peer.seconds / ours.seconds
        asked = SPEED_UPS.get(n_assets) if is_standard and name == fastest else None
        yield Row(
            what,
            size,
            ours.text,
            name + (", the fastest" if name == fastest else ""),
            peer.text,
            times_text(ratio),
            Quality(f"{quality.text}; {name}'s error {errors[name]:.0e}", quality.right),
            at_least(ratio, *asked) if asked else Target(),
            {"assets": n_assets, "seconds": ours.seconds, "peer_seconds": peer.seconds, "held": held},
        )
    if is_standard:
        yield from _whole(problem, sizes, size, fastest, peers[fastest])


def _whole(problem: MarkowitzProblem, sizes: Sizes, size: str, name: str, peer: Timing) -> Iterator[Row]:
    """`decoy_grid` also computes the state costs, and for a search what an observer infers; the peer only solves."""
    asked = SPEED_UPS.get(problem.n_actions)
    yield _grid_row(
        "candidates (decoy_grid)", problem, _grid_timed(problem, sizes, decoy_grid), size, name, peer, asked
    )
    ours = _grid_timed(problem, sizes, _with_sets)
    yield _grid_row("candidates with consistent sets", problem, ours, size, name, peer, None)


def _with_sets(problem: MarkowitzProblem, resolution: int) -> Candidates:
    made = decoy_grid(problem, resolution)
    assert len(made.sets) == len(made)
    return made


def _grid_row(
    what: str,
    problem: MarkowitzProblem,
    ours: Timing,
    size: str,
    name: str,
    peer: Timing,
    asked: tuple[float, float] | None,
) -> Row:
    ratio = peer.seconds / ours.seconds
    return Row(
        what,
        size,
        ours.text,
        f"{name}, solves alone",
        seconds_text(peer.seconds),
        times_text(ratio),
        _costs_right(problem, ours),
        at_least(ratio, *asked) if asked else Target(),
        {"assets": problem.n_actions, "seconds": ours.seconds, "peer_seconds": peer.seconds},
    )


def _grid_timed(problem: MarkowitzProblem, sizes: Sizes, make: Callable[[MarkowitzProblem, int], Candidates]) -> Timing:
    """The best of all tries, or extrapolated from a coarse grid where even one would take too long."""
    coarse = min(COARSE, sizes.resolution)
    few, n = len(simplex_grid(N_STATES, coarse)), len(simplex_grid(N_STATES, sizes.resolution))
    probe = best_of(1, lambda _: make(problem, coarse))
    expected = probe.seconds * n / few
    if expected > PATIENCE:
        return Timing(expected, f"extrapolated from {few}", probe.result)
    return best_of(sizes.tries, lambda _: make(problem, sizes.resolution))


def _costs_right(problem: MarkowitzProblem, ours: Timing) -> Quality:
    """State costs written out for the last candidates, state by state."""
    actions = ours.result.actions[-20:]
    written = [
        [problem.risk_aversion * u @ s @ u - m @ u for m, s in zip(problem.means, problem.covariances, strict=True)]
        for u in actions
    ]
    error = float(np.abs(ours.result.state_costs[-20:] - np.array(written)).max())
    return Quality(f"error of the state costs {error:.0e}", error <= ERROR)


def _reference(problem: MarkowitzProblem, decoys: Array, daqp: Timing, most: int) -> dict[int, Array]:
    indices, actions = daqp.result
    chosen = np.unique(np.linspace(0, len(indices) - 1, min(most, len(indices))).astype(int))
    return {int(indices[k]): polished(problem, decoys[indices[k]], actions[k]) for k in chosen}


def _quality(problem: MarkowitzProblem, decoys: Array, actions: Array, reference: dict[int, Array]) -> Quality:
    error = max(float(np.abs(actions[i] - action).max()) for i, action in reference.items())
    residual = kkt_residual(problem, decoys, actions)
    text = f"error ≤ {error:.0e} ({len(reference)} compared), KKT residual ≤ {residual:.0e} (all)"
    return Quality(text, error <= ERROR and residual <= RESIDUAL)


def _error(peer: Timing, reference: dict[int, Array]) -> float:
    indices, actions = peer.result
    gaps = [
        float(np.abs(action - reference[int(i)]).max())
        for i, action in zip(indices, actions, strict=True)
        if int(i) in reference
    ]
    return max(gaps, default=float("nan"))
