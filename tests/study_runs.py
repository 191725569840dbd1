"""A small study for tests, and a process of its own to run it in, which can be killed at a chosen moment."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

from inscrutable import Study
from inscrutable.experiments.studies.tasks import Row, Work, chunk_of_rows

SMALL: dict[str, Any] = {
    "name": "small",
    "seed": 7,
    "repeats": 4,
    "world": {"kind": "random"},
    "beliefs": {"kind": "path", "steps": 6},
    "candidates": {"resolution": 5},
    "decision_makers": [
        "ODM",
        "uniform",
        {"name": "coin", "probability": [0.1, 0.4]},
        {"name": "Dirichlet noise", "draws": 20},
    ],
    "budgets": {"values": [0.1, 0.3]},
    "adversaries": ["naive", "bayesian"],
    "measures": ["error", "naive_privacy", "expected_regret", "mutual_information"],
}

DRIVER = """
import json, os, random, signal, sys, threading, time
from inscrutable.experiments.studies import Study, executors, resume_study, run_study, store
mode, moment, folder, plan = sys.argv[1], float(sys.argv[2]), sys.argv[3], json.loads(sys.argv[4])
executors._SECONDS = 0.01
die = lambda: os.kill(os.getpid(), signal.SIGKILL)
batches = 0
def dying(add):
    def wrapped(self, rows):
        global batches
        batches += 1
        def last():
            for row in rows:
                yield row
            die()
        return add(self, last() if batches > moment else rows)
    return wrapped
if mode == "transaction":
    store.Store.add = dying(store.Store.add)
def watch(progress):
    if mode == "moment" and progress.fresh == 0:
        threading.Timer(moment, die).start()
    time.sleep(0.005)
if os.path.exists(os.path.join(folder, "study.sqlite")):
    resume_study(folder, progress=watch)
else:
    run_study(Study.of(plan), folder, progress=watch)
"""
"""Kills itself by SIGKILL: within the transaction after so many batches, or so many seconds after the start."""


def environment() -> dict[str, str]:
    """The variables of a process that finds the package under test."""
    return os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "NO_COLOR": "1"}


def killed(mode: str, moment: float, folder: Path, plan: str) -> int:
    """Run or resume the study in a process that kills itself; its exit code."""
    command = [sys.executable, "-c", DRIVER, mode, str(moment), str(folder), plan]
    return subprocess.run(command, env=environment(), capture_output=True, timeout=120).returncode


def table(study: Study) -> str:
    """The exported rows."""
    return study.frame().to_csv(lineterminator="\n")


def worker_processes() -> list[int]:
    """The processes that joblib has do tasks now."""
    from joblib.externals.loky import reusable_executor

    return list(reusable_executor._executor._processes)


def dead() -> None:
    """Be killed, as the system does where memory ends."""
    os.kill(os.getpid(), signal.SIGKILL)


def deadly(marks: Path, work: Work, numbers: list[int]) -> list[Row]:
    """Do tasks, of which one loses its first worker and another every worker.

    It stands here because a worker imports the module that it stands in.
    """
    once = marks / "once"
    if 1 in numbers and not once.exists():
        once.touch()
        dead()
    if 3 in numbers:
        dead()
    return chunk_of_rows(work, numbers)
