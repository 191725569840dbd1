"""Runs that take little: pictures that are not painted, rivals on coarse grids, prices found by short simulations."""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import inscrutable.reports
from inscrutable.decision_makers import local_search
from inscrutable.decision_makers.sequential import calibration, rule
from inscrutable.experiments import backtest, backtest_aware, backtest_sequential, comparison_watchers, silence
from inscrutable.experiments.studies import reproduction_tasks
from inscrutable.worlds import gaussian_fit
from inscrutable.worlds.baum_welch import Climb, Standardised
from inscrutable.worlds.covariances import CovarianceRule
from sizes import audited

PICTURE = '<svg xmlns="http://www.w3.org/2000/svg" width="2000" height="1000"><title>{}</title></svg>'


def unpainted(figure: Any, folder: Path, name: str) -> list[Path]:
    """Write empty pictures with a figure's name in its place."""
    written = [folder / f"{name}.{ending}" for ending in ("png", "svg")]
    for path in written:
        path.write_text(PICTURE.format(name), "utf-8")
    return written


@contextmanager
def nothing_painted() -> Iterator[None]:
    """Figures are made but not painted, which takes half a second each; tests of their own look at what they show."""
    found = pkgutil.walk_packages(inscrutable.reports.__path__, "inscrutable.reports.")
    modules = [importlib.import_module(each.name) for each in found]
    with pytest.MonkeyPatch.context() as patch:
        for module in modules:
            if hasattr(module, "save_figure"):
                patch.setattr(module, "save_figure", unpainted)
        yield


@contextmanager
def coarse_rivals(beliefs: int = 60, draws: int = 1) -> Iterator[None]:
    """Rivals of a backtest read on few beliefs, and the sequential rule is drawn anew seldom.

    For tests that judge what is shown of the figures, not how good they are.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(backtest_aware, "_MOST_BELIEFS", beliefs)
        patch.setattr(backtest_sequential, "_OTHER_DRAWS", draws)
        yield


@contextmanager
def short_simulations(steps: int = 80, last: int = 250) -> Iterator[None]:
    """Prices of sequential rules are found from a quarter of the steps, or fewer."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "_COARSE", min(calibration._COARSE, steps))
        patch.setattr(calibration, "_FINE", steps)
        patch.setattr(calibration, "_LAST", last)
        yield


@contextmanager
def draft_simulations() -> Iterator[None]:
    """Short simulations, and in `make audit` those of the library."""
    with nullcontext() if audited() else short_simulations():
        yield


@contextmanager
def short_searches() -> Iterator[None]:
    """The paper's local search takes few steps; for tests that judge how its results are kept, not how good they are."""
    minimize = local_search.minimize

    def short(*given: Any, **more: Any) -> Any:
        return minimize(*given, options={"maxiter": 2}, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local_search, "minimize", short)
        yield


@contextmanager
def learned_from_few(most: int = 1) -> Iterator[None]:
    """In a comparison the risk aversion is learned from few decisions; for tests that judge other figures."""
    learn = comparison_watchers.learned_cost

    def from_few(problem: Any, actions: Any) -> Any:
        return learn(problem, np.unique(actions, axis=0)[:most])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(comparison_watchers, "learned_cost", from_few)
        yield


@contextmanager
def repeated_markets() -> Iterator[None]:
    """A random market is gone through once; for tests that judge how its record is kept, and not what is in it."""
    run, kept = reproduction_tasks.run_market, dict[tuple[Any, ...], Any]()

    def once(plan: Any, seed: np.random.SeedSequence, has_samples: bool) -> Any:
        key = (
            plan.model_dump_json(exclude={"markets", "simulations", "steps"}),
            seed.entropy,
            seed.spawn_key,
            has_samples,
        )
        if key not in kept:
            kept[key] = run(plan, seed, has_samples)
        return deepcopy(kept[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reproduction_tasks, "run_market", once)
        yield


@contextmanager
def repeated_laws() -> Iterator[None]:
    """The law of a world's belief is simulated once, and a ceiling found once; for tests of what a sequence remembers."""
    simulate, bound = silence.predicted_chain, rule.ceiling_of
    laws, ceilings = dict[tuple[Any, ...], Any](), dict[tuple[Any, ...], float]()

    def law(world: Any, resolution: int, *, rng: np.random.Generator) -> Any:
        sensor = world.emission
        parts = (world.transition, world.initial, sensor.means, sensor.covariances)
        key = (*(each.tobytes() for each in parts), world.names, resolution, repr(rng.bit_generator.state))
        if key not in laws:
            laws[key] = simulate(world, resolution, rng=rng)
        return laws[key]

    def ceiling(table: Any, limit: float) -> float:
        parts = (table.regrets, table.prior.beliefs, table.prior.weights, table.cheapest)
        allowed = None if table.allowed is None else table.allowed.tobytes()
        key = *(each.tobytes() for each in parts), allowed, type(table.stakes), table.period, table.turnover, limit
        if key not in ceilings:
            ceilings[key] = bound(table, limit)
        return ceilings[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(silence, "predicted_chain", law)
        patch.setattr(rule, "ceiling_of", ceiling)
        yield


@contextmanager
def repeated_fits() -> Iterator[None]:
    """A fit of the same rows from the same starting points is made once; for tests that fit no regimes of their own."""
    run, kept = gaussian_fit._restart, dict[tuple[bytes, int, str, str], Climb]()

    def once(data: Standardised, n_states: int, rule: CovarianceRule, rng: np.random.Generator) -> Climb:
        key = data.rows.tobytes(), n_states, repr(rule), repr(rng.bit_generator.state)
        if key not in kept:
            kept[key] = run(data, n_states, rule, rng)
        return deepcopy(kept[key])

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(gaussian_fit, "_restart", once)
        yield


@contextmanager
def few_starts(most: int = 7) -> Iterator[None]:
    """A backtest's fit has few starts: those of the first seven give the pages' figures; other tests judge no fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(backtest, "RESTARTS", most)
        patch.setattr(backtest, "_LEAST_RESTARTS", most)
        yield
