"""Studies on a real Dask scheduler with worker processes on this machine: the same rows, also when a worker is lost."""

from __future__ import annotations

import importlib.util
import json
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from inscrutable import Study, resume_study, run_study
from inscrutable.errors import InputError
from inscrutable.experiments.studies import StudyProgress, executors
from inscrutable.experiments.studies.executors import lost_row, on_cluster
from inscrutable.experiments.studies.grid_tasks import GridRunner
from inscrutable.experiments.studies.tasks import FAILED, Work
from study_runs import SMALL, environment, table

with_dask = pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="distributed is not installed")
PLAN = SMALL | {"name": "on a cluster", "repeats": 30, "decision_makers": ["ODM", "uniform", "coin"]}


@contextmanager
def started(*arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A process of Dask's own command line, ended afterwards."""
    process = subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments],
        env=environment(),
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@contextmanager
def cluster(folder: Path) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """The address of a scheduler and its two workers, each of two threads."""
    file = folder / "scheduler.json"
    options = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    worker = ("worker", "--scheduler-file", str(file), "--nthreads", "2", "--no-nanny", "--no-dashboard")
    local = ("--local-directory", str(folder))
    with started("scheduler", *options), started(*worker, *local) as one, started(*worker, *local) as other:
        while not file.exists() or not file.stat().st_size:
            time.sleep(0.05)
        yield json.loads(file.read_text())["address"], [one, other]


@with_dask
@pytest.mark.filterwarnings("ignore")  # of a client that closes after its scheduler
def test_a_cluster_of_threads_gives_the_same_rows(tmp_path: Path) -> None:
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, processes=False, dashboard_address=None, protocol="tcp://") as threads:
        study = run_study(Study.of(SMALL), tmp_path / "out", cluster=threads.scheduler_address)
    assert table(study) == table(run_study(Study.of(SMALL), tmp_path / "serial"))


@with_dask
@pytest.mark.audit  # four processes import the package
@pytest.mark.filterwarnings("ignore")  # of connections to the worker that is gone
def test_a_cluster_that_loses_a_worker_gives_the_same_rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    serial = run_study(Study.of(PLAN), tmp_path / "serial")
    monkeypatch.setattr(executors, "_SECONDS", 0.05)
    lost: list[int] = []

    def watch(progress: StudyProgress) -> None:
        if progress.done >= 20 and not lost:
            lost.append(progress.done)
            workers[0].kill()

    with cluster(tmp_path) as (address, workers):
        study = run_study(Study.of(PLAN), tmp_path / "out", cluster=address, progress=watch)
    assert 20 <= lost[0] < serial.n_tasks, "the worker was to be lost in between"
    assert table(study) == table(serial)


@with_dask
@pytest.mark.filterwarnings("ignore")  # of connections to the scheduler that is gone
def test_a_lost_scheduler_is_told_and_the_study_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    from distributed import LocalCluster

    def watch(progress: StudyProgress) -> None:
        if progress.fresh:
            threads.close()

    monkeypatch.setattr(executors, "_SECONDS", 0.01)
    with LocalCluster(n_workers=1, processes=False, dashboard_address=None, protocol="tcp://") as threads:
        address = threads.scheduler_address
        with pytest.raises(InputError, match=f"the Dask scheduler at {address} was lost; start one, then resume"):
            run_study(Study.of(SMALL), tmp_path / "out", cluster=address, progress=watch)
    assert not [each for each in caplog.records if each.name == "distributed.client"]
    assert 0 < Study.load(tmp_path / "out").status().done < Study.of(SMALL).n_tasks
    assert resume_study(tmp_path / "out").status().left == 0


@with_dask
@pytest.mark.filterwarnings("ignore")  # what the client of an absent scheduler leaves behind
def test_no_scheduler_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    from inscrutable.experiments.studies import executors

    monkeypatch.setattr(executors, "_WAIT", 0.3)
    with pytest.raises(InputError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        on_cluster("tcp://127.0.0.1:9")(Work(GridRunner, "", None, ""), [], lambda rows: None)


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'inscrutable\[dask\]'"):
        run_study(Study.of(SMALL), tmp_path / "out", cluster="tcp://127.0.0.1:1")
    assert not (tmp_path / "out").exists()


def test_a_task_that_takes_its_workers_down_is_a_failed_row() -> None:
    row = lost_row(Work(GridRunner, Study.of(SMALL).plan.model_dump_json(), None, "[]"), 3)
    assert (row.number, row.status, row.figures) == (3, FAILED, "{}")
    assert "workers doing this task were lost" in row.error
    assert row.task == Study.of(SMALL).grid.task(3).key


@with_dask
@pytest.mark.parametrize(
    ("address", "told"),
    [("foo", "port"), ("http://x:1", "http"), ("tcp://:88", "no host"), ("tcp://a:99999", "99999"), ("", "port")],
)
def test_what_is_no_address_is_refused_before_anything_is_written(address: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"is no address of a scheduler, expected one such as tcp://.*{told}"):
        run_study(Study.of(PLAN), tmp_path / "out", cluster=address)
    assert not (tmp_path / "out").exists()
