"""What is said while kernels compile: one line on stderr, only where no cache exists and only if it takes long."""

from __future__ import annotations

import logging
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

pytest.importorskip("numba")

from numba.core import config, event

from inscrutable.cli_console import library_log
from inscrutable.kernels.compiling import MESSAGE, CompilationNotice

FIRST_DECISION = """
import numpy as np
from numba.core import event
from inscrutable import CounterAdversarialDecisionMaker, MarkowitzProblem
with event.install_recorder("numba:compile") as compiled:
    problem = MarkowitzProblem([[0.02, 0.01], [-0.03, 0.0], [0.0, 0.01]], [np.eye(2), 2 * np.eye(2), np.eye(2)], 1.0)
    CounterAdversarialDecisionMaker(problem, budget=0.1).decide([0.5, 0.3, 0.2])
print(*{each.data["dispatcher"].__name__ for _, each in compiled.buffer})
"""


def said(code: str, cache: Path) -> tuple[str, str]:
    """What `code` writes to stdout and stderr in a new interpreter with this folder of compiled kernels."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "NUMBA_DISABLE_JIT": "0"}
    run = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stderr
    return run.stdout, run.stderr


@pytest.fixture
def spoken(monkeypatch):
    """Lines written by notices made in this test."""
    lines: list[str] = []
    monkeypatch.setattr("inscrutable.kernels.compiling._LOGGER", SimpleNamespace(warning=lines.append))
    return lines


def compilation(module: str) -> tuple[event.Event, event.Event]:
    """Start and end of the compilation of a function of a module."""
    data = {"dispatcher": SimpleNamespace(py_func=SimpleNamespace(__module__=module))}
    return tuple(event.Event("numba:compile", each, data) for each in event.EventStatus)  # type: ignore[return-value]


def wait_for(notice: CompilationNotice, seconds: float) -> None:
    """Let a notice's clock run, as a compilation would."""
    timer = notice._timer
    if timer is not None:
        timer.join(seconds)


@pytest.mark.audit  # a new process compiles for 10 s
def test_a_first_decision_compiles_no_search_and_says_so_once(tmp_path: Path) -> None:
    """One line on a fresh machine, and nothing in a second run, which compiles nothing."""
    if config.DISABLE_JIT:
        pytest.skip("nothing is compiled")
    (names, heard), second = said(FIRST_DECISION, tmp_path), said(FIRST_DECISION, tmp_path)
    compiled = set(names.split())
    assert "solve_path" in compiled  # many beliefs at once: only compiled code is fast enough
    assert not compiled & {"search_regions", "best_starts", "climb", "project_in"}
    assert heard == f"{MESSAGE}\n"
    assert second == ("\n", "")


def test_the_log_is_silenced_as_any_other(caplog: pytest.LogCaptureFixture) -> None:
    for level, heard in ((logging.WARNING, [MESSAGE]), (logging.ERROR, [])):
        notice = CompilationNotice(patience=0.0)
        start, end = compilation("inscrutable.kernels.hidden_markov")
        caplog.clear()
        with caplog.at_level(level, logger="inscrutable"):
            notice.on_start(start)
            wait_for(notice, 5.0)
            notice.on_end(end)
        assert caplog.messages == heard


def test_a_quiet_command_does_not_hear_it(caplog: pytest.LogCaptureFixture) -> None:
    logger = logging.getLogger("inscrutable.kernels")
    for quiet in (False, True):
        with library_log(quiet=quiet):
            logger.warning("quiet: %s", quiet)
            logger.error("error")
    logger.warning("afterwards")
    assert caplog.messages == ["quiet: False", "error", "error", "afterwards"]


def test_a_long_compilation_is_announced_once(spoken: list[str]) -> None:
    notice = CompilationNotice(patience=0.05)
    start, end = compilation("inscrutable.kernels.hidden_markov")
    for _ in range(3):
        notice.on_start(start)
        notice.on_start(start)  # a kernel that it calls
        wait_for(notice, 5.0)
        notice.on_end(end)
        notice.on_end(end)
    assert spoken == [MESSAGE]


def test_short_compilations_add_up(spoken: list[str]) -> None:
    notice = CompilationNotice(patience=0.3)
    start, end = compilation("inscrutable.kernels.hidden_markov")
    rounds = 0
    while not spoken and rounds < 50:
        rounds += 1
        notice.on_start(start)
        wait_for(notice, 0.05)
        notice.on_end(end)
    assert 2 <= rounds <= 8
    assert spoken == [MESSAGE]


def test_a_short_compilation_is_not_announced(spoken: list[str]) -> None:
    notice = CompilationNotice(patience=0.05)
    start, end = compilation("inscrutable.kernels.hidden_markov")
    notice.on_start(start)
    timer = notice._timer
    notice.on_end(end)
    assert timer is not None
    timer.join(5.0)
    assert spoken == []


def test_what_a_user_compiles_is_their_own_affair(spoken: list[str]) -> None:
    notice = CompilationNotice(patience=0.0)
    start, end = compilation("inscrutable_strategies.mine")
    notice.on_start(start)
    assert notice._timer is None
    notice.on_end(end)
    assert spoken == []
