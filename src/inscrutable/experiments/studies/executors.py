"""Executors of tasks: this process, several processes on this machine, or an existing Dask cluster.

Tasks run in chunks of about one second, so the overhead is small and a kill loses at most the chunks in progress. Chunks do not
affect results.
"""

from __future__ import annotations

import logging
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from contextlib import closing, contextmanager, suppress
from itertools import islice
from typing import Any

from inscrutable.errors import InputError, SolverError
from inscrutable.experiments.studies.tasks import FAILED, Done, Row, Work, chunk_of_rows, one_by_one, runner_of

Keep = Callable[[list[Row]], None]
"""Stores rows permanently."""
Executor = Callable[[Work, Iterable[int], Keep], None]
"""Does tasks by their numbers and passes their rows to a `Keep`."""

_SECONDS = 1.0
_MOST = 5000
_GROWTH = 8
_IN_FLIGHT = 2
_LOSSES = 3  # lost workers before a task counts as the one at fault; Dask's own number
_WAIT = 30.0
_HEARTBEAT = 0.5
_LAST_PORT = 2**16 - 1


class Chunks:
    """Cuts tasks into chunks of about a second, by the time of earlier ones, and remembers which chunks are being done."""

    def __init__(self, numbers: Iterable[int]) -> None:
        self._numbers = iter(numbers)
        self._size = 1
        self.out: dict[int, list[int]] = {}

    def __iter__(self) -> Iterator[list[int]]:
        while chunk := list(islice(self._numbers, self._size)):
            self.out[chunk[0]] = chunk
            yield chunk

    def came_back(self, rows: list[Row]) -> None:
        """Take note of a chunk that is done, and of the time that it took."""
        self.out.pop(rows[0].number, None)
        each = max(sum(row.duration for row in rows) / len(rows), _SECONDS / _MOST)
        self._size = max(1, min(int(_SECONDS / each), _GROWTH * self._size))

    def taken_back(self) -> list[list[int]]:
        """Return the tasks of unfinished chunks, in order; the next chunks are small at first."""
        waiting = sorted(self.out.values())
        self.out.clear()
        self._size = 1
        return waiting


def serial(work: Work, numbers: Iterable[int], keep: Keep) -> None:
    """Do tasks in this process; the rows that are done when Ctrl-C comes are kept."""
    batch: list[Row] = []
    kept_at = time.monotonic()
    try:
        for done in one_by_one(work, numbers):
            batch.append(runner_of(work).row_of(done))
            if time.monotonic() - kept_at >= _SECONDS:
                ready, batch = batch, []
                keep(ready)
                kept_at = time.monotonic()
    finally:
        if batch:
            keep(batch)


def in_processes(jobs: int) -> Executor:
    """Return an executor with processes on this machine; −1 is one per core."""

    def execute(work: Work, numbers: Iterable[int], keep: Keep) -> None:
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        chunks = Chunks(numbers)
        while True:
            with suppress(TerminatedWorkerError):
                _through_joblib(jobs, work, chunks, keep)
            waiting = chunks.taken_back()
            if not waiting:
                return
            with closing(_Alone(work)) as alone:
                for chunk in waiting:
                    keep(alone.rows(chunk))

    return execute


def _through_joblib(jobs: int, work: Work, chunks: Chunks, keep: Keep) -> None:
    from joblib import delayed

    parallel = processes(jobs, return_as="generator_unordered", batch_size=1, pre_dispatch=f"{_IN_FLIGHT}*n_jobs")
    with renewed_quietly():
        with _deaf_to_interrupts():
            found = parallel(delayed(chunk_of_rows)(work, chunk) for chunk in chunks)
        try:
            for rows in found:
                chunks.came_back(rows)
                keep(rows)
        finally:
            found.close()


def processes(jobs: int, **how: Any) -> Any:
    """Return a call of joblib in processes that end with this one; processes of an earlier call are reused."""
    from joblib import Parallel

    return Parallel(n_jobs=jobs, initializer=_follow, initargs=(os.getpid(),), **how)


class _Alone:
    """Repeats the tasks of a lost worker one process at a time, which identifies the task at fault."""

    def __init__(self, work: Work) -> None:
        self._work = work
        self._pool: Any = None

    def close(self) -> None:
        """End the process."""
        if self._pool is not None:
            self._pool.shutdown(kill_workers=True)
            self._pool = None

    def rows(self, chunk: list[int]) -> list[Row]:
        """Do a chunk; if its process ends meanwhile, do each of its tasks alone."""
        from joblib.externals.loky.process_executor import TerminatedWorkerError

        for _ in range(_LOSSES):
            self._start()
            try:
                found: list[Row] = self._pool.submit(chunk_of_rows, self._work, chunk).result()
            except TerminatedWorkerError:
                self.close()
                if len(chunk) > 1:
                    return [row for number in chunk for row in self.rows([number])]
            else:
                return found
        return [lost_row(self._work, chunk[0])]

    def _start(self) -> None:
        """Start a process and wait until it answers, unless there is one already."""
        from joblib.externals.loky.process_executor import ProcessPoolExecutor, TerminatedWorkerError

        for _ in range(_LOSSES):
            if self._pool is not None:
                return
            self._pool = ProcessPoolExecutor(max_workers=1, initializer=_follow, initargs=(os.getpid(),))
            try:
                with _deaf_to_interrupts():
                    answer = self._pool.submit(release)
                answer.result()
            except TerminatedWorkerError:
                self.close()
        if self._pool is None:
            raise SolverError(
                f"worker processes were lost {_LOSSES} times before they did anything (killed, or out of memory); try fewer "
                "jobs, then resume"
            )


def _follow(parent: int) -> None:
    """End this worker process soon after its parent, which may be killed; otherwise it would wait minutes for tasks.

    A parent that was killed while its workers were starting is gone before they look for it. The parent alone handles
    Ctrl-C.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if os.name == "nt" and os.getppid() != parent:
        return  # on this platform the parent may be an intermediate process

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_HEARTBEAT)
        os._exit(1)

    threading.Thread(target=watch, name="follows its parent", daemon=True).start()


@contextmanager
def _deaf_to_interrupts() -> Iterator[None]:
    """Start workers that ignore Ctrl-C, which a terminal sends to every process: this one receives it and ends the others.

    Workers inherit the mask of signals from the thread that starts them, and so do those that replace them later.
    """
    from multiprocessing import resource_tracker

    from joblib.externals.loky.backend import resource_tracker as joblibs_tracker

    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # joblib starts both; the process that starts them receives interrupts again
    for tracker in (resource_tracker, joblibs_tracker):
        tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def renewed_quietly() -> Iterator[None]:
    """Suppress the warnings when a grown worker is replaced by a new one, which loses no task, or when a run is stopped."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"\d+ tasks ")
        warnings.filterwarnings("ignore", "A worker stopped while some jobs were given to the executor")
        yield


def on_cluster(address: str) -> Executor:
    """Return an executor on the workers of a Dask scheduler, such as tcp://10.0.0.1:8786."""
    try:
        from distributed import Client
    except ImportError:
        raise InputError("a cluster needs Dask's client: pip install 'inscrutable[dask]'") from None
    connect: Any = Client  # distributed publishes no types for it
    _check_address(address)

    def execute(work: Work, numbers: Iterable[int], keep: Keep) -> None:
        try:
            client = connect(address, timeout=_WAIT, set_as_default=False)
        except (OSError, ValueError) as error:
            raise InputError(f"no Dask scheduler answers at {address}: {error}") from None
        with _quiet(), client:
            _check_workers(client, address)
            try:
                _through_dask(client, work, Chunks(numbers), keep)
            except CancelledError:
                raise InputError(f"the Dask scheduler at {address} was lost; start one, then resume") from None

    return execute


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the log of Dask's client, which prints tracebacks where the scheduler is lost; the error tells it."""
    log = logging.getLogger("distributed.client")
    level = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(level)


def _check_address(address: str) -> None:
    """Raise an error for a malformed address: a client would wait a minute before it fails."""
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    get: Any = get_backend
    try:
        scheme, place = parse_address(address)
        get(scheme)
        host, port = parse_host_port(place)
        if not host or not 0 < port <= _LAST_PORT:
            raise ValueError("it has no host" if not host else f"there is no port {port}")
    except ValueError as error:
        raise InputError(
            f"cluster {address!r} is no address of a scheduler, expected one such as tcp://10.0.0.1:8786: {error}"
        ) from None


def _check_workers(client: Any, address: str) -> None:
    """Wait for a worker, and refuse workers with another release."""
    from inscrutable import __version__

    try:
        client.wait_for_workers(1, timeout=_WAIT)
    except TimeoutError:
        raise InputError(f"the scheduler at {address} has no workers; start some, then resume") from None
    try:
        versions = set(client.run(release).values())
    except (ImportError, AttributeError) as error:
        raise InputError(f"the workers of {address} cannot import inscrutable {__version__}: {error}") from None
    if versions != {__version__}:
        raise InputError(f"the workers of {address} have inscrutable {sorted(versions)}, expected {__version__}")


def release() -> str:
    """Return the release of a worker."""
    from inscrutable import __version__

    return __version__


def _through_dask(client: Any, work: Work, chunks: Chunks, keep: Keep) -> None:
    from distributed import KilledWorker, as_completed

    waiting = iter(chunks)
    out: dict[str, list[int]] = {}
    completed: Any = as_completed
    running = completed(loop=client.loop)

    def send(chunk: list[int]) -> None:
        future = client.submit(chunk_of_rows, work, chunk, pure=False)
        out[future.key] = chunk
        running.add(future)

    for chunk in islice(waiting, _IN_FLIGHT * max(1, sum(client.nthreads().values()))):
        send(chunk)
    for future in running:
        chunk = out.pop(future.key)
        try:
            rows = future.result()
        except KilledWorker:
            if len(chunk) > 1:  # one of them may be at fault
                for number in chunk:
                    send([number])
                continue
            rows = [lost_row(work, chunk[0])]
        chunks.came_back(rows)
        keep(rows)
        for chunk in islice(waiting, 1):
            send(chunk)


def lost_row(work: Work, number: int) -> Row:
    """Return the row of a task that took its workers down with it."""
    runner = runner_of(work)
    error = "SolverError: the workers doing this task were lost each time (killed, or out of memory)"
    return runner.row_of(Done(runner.grid.task(number), FAILED, {}, 0.0, error))
