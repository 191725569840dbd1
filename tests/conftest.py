"""Settings for all tests: the same drawn examples at every run; `HYPOTHESIS_PROFILE=random` draws new ones.

Tests that take `fresh_rng` draw new instances at every run, in `make audit` several times; a failure prints their seed, and
`FRESH_SEED=…` repeats it.
"""

from __future__ import annotations

import gc
import os
import secrets
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

from inscrutable import cli, cli_compare
from sizes import audited
from small_runs import coarse_rivals, few_starts, nothing_painted, repeated_fits, short_simulations

# Where a test asks for all cores it gets one: two test processes share two, and worker processes take seconds to start.
# Tests of several processes ask for two.
os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.register_profile("random", deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))

# A shell's background jobs ignore Ctrl-C, and so would every command that the tests start and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)


gc.disable()  # collecting five thousand tests makes no garbage worth looking for, and half the time would go into it


def pytest_collection_finish() -> None:
    """Look for garbage again, not among what was collected, and after more new objects than usual: a saving of 2 to 5 %."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 20)
    gc.enable()


SHORTENING = {"audited", "draft_simulations", "instances", "paired", "some"}
"""A module that has one of these draws fewer instances in `make test`."""

LONGEST = ("test_documents.py", "test_studies.py", "test_study_cluster.py")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests, so that no process waits for one of them in the end.

    Where all instances are asked for, the tests of all modules that draw fewer otherwise belong to the audit, and those that
    draw fresh ones.
    """
    if audited():
        for item in items:
            is_shorter = SHORTENING & set(vars(getattr(item, "module", None) or item))
            if is_shorter or "fresh_seed" in getattr(item, "fixturenames", ()):
                item.add_marker("audit")
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))


@pytest.fixture
def undrawn() -> Iterator[None]:
    """Figures are made but not painted."""
    with nothing_painted():
        yield


@pytest.fixture
def coarse() -> Iterator[None]:
    """Rivals of a backtest on few beliefs, prices from short simulations, and fits from few starts, the same one once."""
    with coarse_rivals(), short_simulations(), few_starts(2), repeated_fits():
        yield


@pytest.fixture
def unpaged() -> Iterator[None]:
    """The verbs write an empty page, which otherwise takes a third of a backtest; tests of their own read it."""

    def blank(result: Any, folder: Path, **_: Any) -> list[Path]:
        (folder / "report.html").write_text("", "utf-8")
        return [folder / "report.html"]

    with pytest.MonkeyPatch.context() as patch:
        for module in (cli, cli_compare):
            patch.setattr(module, "write_report", blank)
        yield


FRESH_RUNS = 6
"""Runs of a fresh test in the audit. Thirty of all of them found two faults that each showed in one of hundreds, and four tests
that failed as seldom without a fault."""


@pytest.fixture(params=range(FRESH_RUNS) if audited() else None)
def fresh_seed(request: pytest.FixtureRequest) -> int:
    """A seed drawn anew at every run, shown where the test fails: also in processes whose prints are not kept."""
    seed = int(os.environ.get("FRESH_SEED") or secrets.randbits(32))
    request.node.add_report_section("setup", "seed", f"FRESH_SEED={seed}")
    return seed


@pytest.fixture
def fresh_rng(fresh_seed: int) -> np.random.Generator:
    """A generator of a fresh seed."""
    return np.random.default_rng(fresh_seed)
