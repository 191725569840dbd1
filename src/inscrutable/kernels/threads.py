"""Kernels that release the interpreter's lock, run on fixed chunks by every core the process may use."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from functools import cache
from threading import Event, local
from typing import Any

_here = local()
"""`_here.busy` is set on a thread that takes chunks beside others: nested chunks run on their own thread, because helpers would
only wait behind the chunks under way.
"""


def thread_count() -> int:
    """Return the environment's NUMBA_NUM_THREADS, or else the number of processors this process may use.

    Numba itself refuses a value that is not a whole number of at least 1.
    """
    asked = os.environ.get("NUMBA_NUM_THREADS", "")
    if asked.isdigit() and int(asked) > 0:
        return int(asked)
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def one_blas_thread() -> Any:
    """Return a context in which linear algebra runs on one thread: more only wait for each other where products are short."""
    return _libraries().limit(limits=1, user_api="blas")


@cache
def _libraries() -> Any:
    """The libraries of NumPy and SciPy, looked for once: it takes a millisecond or two."""
    import scipy.linalg  # noqa: F401  # brings a library of its own
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()


def in_chunks(
    work: Callable[[int, int], None], count: int, chunk: int, progress: Callable[[int, int], None] | None = None
) -> None:
    """Call work(first, last) for the fixed chunks [0, chunk), [chunk, 2 chunk), … of `count` items on all cores.

    The calling thread takes chunks as well, and all of them where there is one chunk or one core. Which thread takes
    which chunk is left open, so `work` may write only what belongs to its items; then results are the same for any
    number of threads. Helpers gain time only where `work` releases the interpreter's lock (`nogil=True`).

    An error in `work`, or Ctrl-C, ends the call as soon as the chunks under way have ended, and is raised here.
    `progress(items done, count)` is called on the calling thread, after each of its chunks and at the end.
    """
    if (
        count <= chunk and progress is None
    ):  # most single decisions: nothing to stop and nobody to wait for, 4 % of their time
        if count:
            work(0, count)
        return
    starts = iter(range(0, count, chunk))  # taking the next entry is one step under the interpreter's lock
    ended: list[int] = []
    stop, was_busy = Event(), getattr(_here, "busy", False)
    helpers = 0 if was_busy or count <= chunk else min(thread_count(), -(-count // chunk)) - 1

    def take(told: Callable[[int, int], None] | None) -> None:
        before = getattr(_here, "busy", False)
        _here.busy = before or helpers > 0
        try:
            for first in starts:
                work(first, min(first + chunk, count))
                ended.append(first)
                if told is not None:
                    told(min(len(ended) * chunk, count), count)
                if stop.is_set():
                    break
        except BaseException:
            stop.set()
            raise
        finally:
            _here.busy = before

    futures: list[Future[None]] = [_pool(os.getpid(), helpers).submit(take, None) for _ in range(helpers)]
    try:
        take(progress)
    finally:
        stop.set()
        # A helper that has not begun has nothing left to do.
        wait([future for future in futures if not future.cancel()])
    for future in futures:
        if not future.cancelled():
            future.result()
    if progress is not None and futures:
        progress(count, count)


@cache
def _pool(process: int, helpers: int) -> ThreadPoolExecutor:
    """Threads that wait for work; a forked process inherits none and so makes its own."""
    return ThreadPoolExecutor(helpers, thread_name_prefix=f"chunks-{process}")
