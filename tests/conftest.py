"""Settings for all tests: the same drawn examples at every run; `HYPOTHESIS_PROFILE=random` draws new ones.

Tests that take `fresh_rng` draw new instances at every run; a failure prints their seed, and `FRESH_SEED=…` repeats it.
"""

from __future__ import annotations

import gc
import importlib
import os
import pkgutil
import secrets
import signal
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import settings

import inscrutable.reports

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
    """Look for garbage again, but not among what was collected."""
    gc.freeze()
    gc.enable()


LONGEST = ("test_site.py", "test_documents.py", "test_studies.py", "test_study_cluster.py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests, so that no process waits for one of them in the end."""
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))


def unpainted(figure: Any, folder: Path, name: str) -> list[Path]:
    """Write pictures of nothing in place of a figure's."""
    written = [folder / f"{name}.{ending}" for ending in ("png", "svg")]
    for path in written:
        path.write_text("<svg/>", "utf-8")
    return written


@pytest.fixture
def undrawn() -> Iterator[None]:
    """Figures are made but not painted, which takes half a second each; tests of their own look at what they show."""
    found = pkgutil.walk_packages(inscrutable.reports.__path__, "inscrutable.reports.")
    modules = [importlib.import_module(each.name) for each in found]
    with pytest.MonkeyPatch.context() as patch:
        for module in modules:
            if hasattr(module, "save_figure"):
                patch.setattr(module, "save_figure", unpainted)
        yield


@pytest.fixture
def fresh_seed() -> int:
    """A seed drawn anew at every run, printed where the test fails."""
    seed = int(os.environ.get("FRESH_SEED") or secrets.randbits(32))
    print(f"FRESH_SEED={seed}")
    return seed


@pytest.fixture
def fresh_rng(fresh_seed: int) -> np.random.Generator:
    """A generator of a fresh seed."""
    return np.random.default_rng(fresh_seed)
