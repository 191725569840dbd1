"""Studies at the size they are made for: a hundred thousand tasks, and fifty kills."""

from __future__ import annotations

import json
import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest

from inscrutable import Study, run_study
from inscrutable.experiments.studies import StudyProgress, executors
from study_runs import SMALL, killed, table, worker_processes

pytestmark = pytest.mark.audit

TINY = {
    "name": "many small tasks",
    "repeats": 1000,
    "world": {"kind": "random"},
    "beliefs": {"kind": "grid", "resolution": 2},
    "candidates": {"resolution": 2},
    "decision_makers": [{"name": "coin", "probability": [step / 50 for step in range(50)]}],
    "adversaries": ["naive", "bayesian"],
    "measures": ["error", "expected_regret"],
}
_PAGE = 4096


def memory(process: int) -> int:
    """Bytes of memory that a process holds."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * _PAGE


def test_a_hundred_thousand_small_tasks_with_flat_memory(tmp_path: Path) -> None:
    """On two processes; memory at a tenth of the way and at the end, and the share of time not spent in tasks."""
    seen: list[tuple[float, float, int, int]] = []  # seconds of work, moment, memory here and in workers
    ends = iter((0.1, 1.0))
    following = [next(ends)]

    def watch(progress: StudyProgress) -> None:
        if progress.fresh and progress.done >= following[0] * progress.total:
            workers = sum(memory(each) for each in worker_processes())
            worked = Study.load(tmp_path).status().seconds
            seen.append((worked, time.monotonic(), memory(os.getpid()), workers))
            following[0] = next(ends, 2.0)

    study = Study.of(TINY)
    assert study.n_tasks == 100_000
    started = time.monotonic()
    status = run_study(study, tmp_path, jobs=2, progress=watch).status()
    taken = time.monotonic() - started
    assert (status.done, status.failed) == (100_000, 0)
    early, late = seen
    worked, spent, own, workers = (after - before for before, after in zip(early, late, strict=True))
    print(f"\n100,000 tasks in {taken:.0f} s, the start of the processes included")
    overhead = 1 - worked / (2 * spent)
    print(f"from a tenth of the way on {overhead:.1%} of their time was not in tasks")
    print(f"memory gained meanwhile: {own / 1e6:.1f} MB here, {workers / 1e6:.1f} MB in workers")
    assert overhead < 0.05
    assert own < 30e6
    assert workers < 60e6


def test_fifty_runs_killed_and_resumed_have_the_same_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """At random moments, every other one within a transaction; a study that ends is compared, and the next one begun."""
    plan = SMALL | {"repeats": 60}
    text, rng = json.dumps(plan), np.random.default_rng(0)
    whole = run_study(Study.of(plan), tmp_path / "whole")
    kills = studies = 0
    folder = tmp_path / "0"
    while kills < 50:
        within = kills % 2 == 1
        mode, moment = ("transaction", rng.integers(0, 12)) if within else ("moment", rng.uniform(0.0, 0.8))
        code = killed(mode, float(moment), folder, text)
        assert code in (0, -signal.SIGKILL)
        kills += code != 0
        if code == 0:
            assert table(Study.load(folder)) == table(whole)
            studies += 1
            folder = tmp_path / str(studies)
    monkeypatch.setattr(executors, "_SECONDS", 0.01)
    while killed("none", 0.0, folder, text) != 0:
        pass
    frame = Study.load(folder).frame()
    print(f"\n50 kills, {studies + 1} studies of {len(frame)} rows: none lost, none doubled")
    assert frame["task"].is_unique
    assert (frame["status"] == "done").all(), frame["failure"].unique()
    assert table(Study.load(folder)) == table(whole)
