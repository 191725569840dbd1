"""How Python calls kernels: interpreted until compiling them pays, and in chunks on every core.

The searches of one decision take some hundredths of a second compiled, some tenths interpreted, and 20 s to compile on
a machine that has not done so yet. So the interpreter runs such a kernel until it has spent on it about what a compiler would;
then the kernel is compiled, or at once where the machine's cache has it. Both do the same operations on doubles in the same
order, so results have the same digits. Chunks are fixed, so results are the same for any number of threads.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from threading import Event, local
from time import thread_time
from types import FunctionType
from typing import Any, TypeVar, cast

import numpy as np
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import is_jitted

Function = TypeVar("Function", bound=Callable[..., Any])

_PATIENCE = 3.0
"""Seconds that the interpreter may spend on a kernel. A first decision on a machine that has compiled nothing takes 4 s instead
of 20 over three states and 15 assets, 6 instead of 20 over five and 20."""
_patience = [_PATIENCE]


@contextmanager
def compiled_at_once() -> Iterator[None]:
    """Inside, kernels are compiled at their first call."""
    before, _patience[0] = _patience[0], 0.0
    try:
        yield
    finally:
        _patience[0] = before


@contextmanager
def put_off(*kernels: Any) -> Iterator[None]:
    """Inside, deferred kernels are interpreted, however long that takes: another process compiles them meanwhile."""
    before = [kernel._spent for kernel in kernels]
    for kernel in kernels:
        kernel._spent = -np.inf
    try:
        yield
    finally:
        for kernel, spent in zip(kernels, before, strict=True):
            kernel._spent = spent
            kernel._missing.clear()


def deferred(compile_it: Callable[[Function], Function]) -> Callable[[Function], Function]:
    """Defer what a decorator compiles. For kernels that only Python calls, in short calls: none is interrupted."""

    def decorate(function: Function) -> Function:
        compiled = compile_it(function)
        return cast(Function, _Deferred(compiled)) if is_jitted(compiled) else compiled

    return decorate


class _Deferred:
    """A kernel that is interpreted at first."""

    def __init__(self, compiled: Any) -> None:
        self._compiled = compiled
        self._interpreted: Any = None  # made at the first call, when all that the kernel calls is defined
        self._spent = 0.0
        self._is_compiled = False
        self._missing: set[tuple[Any, ...]] = set()
        self.__doc__ = compiled.__doc__

    @property
    def signatures(self) -> list[Any]:
        """What the kernel is compiled for."""
        return list(self._compiled.signatures)

    def __call__(self, *arguments: Any) -> Any:
        """Run the kernel."""
        if self._is_compiled or self._spent >= _patience[0] or self._is_cached(arguments):
            self._is_compiled = True
            return self._compiled(*arguments)
        self._interpreted = self._interpreted or interpreted(self._compiled, {})
        start = thread_time()
        with np.errstate(all="ignore"):  # compiled code divides by zero in silence
            result = self._interpreted(*arguments)
        self._spent += thread_time() - start
        return result

    def _is_cached(self, arguments: tuple[Any, ...]) -> bool:
        """Whether the disk has the kernel compiled. Numba has no public question for that."""
        signature = tuple(map(self._compiled.typeof_pyval, arguments))
        if signature in self._missing:
            return False
        with global_compiler_lock:  # two threads must not load at once
            found = self._compiled._cache.load_overload(signature, self._compiled.targetctx) is not None
        if not found:
            self._missing.add(signature)
        return found


def interpreted(kernel: Any, made: dict[Any, Any]) -> Any:
    """Return a kernel's Python function, with the kernels that it calls as Python functions too."""
    if kernel not in made:
        function = kernel.py_func
        names: dict[str, Any] = dict(function.__globals__)
        made[kernel] = FunctionType(
            function.__code__, names, function.__name__, function.__defaults__, function.__closure__
        )
        for name in function.__code__.co_names:
            if name in names and is_jitted(names[name]):
                names[name] = interpreted(names[name], made)
    return made[kernel]


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
