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
from inscrutable.decision_makers.sequential import calibration
from inscrutable.experiments import backtest_aware, backtest_sequential
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
def short_simulations() -> Iterator[None]:
    """Prices of sequential rules are found from a quarter of the steps."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "_FINE", 80)
        patch.setattr(calibration, "_LAST", 250)
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
        return minimize(*given, options={"maxiter": 8}, **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(local_search, "minimize", short)
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
