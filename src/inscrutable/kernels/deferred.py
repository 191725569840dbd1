"""Kernels that the interpreter runs until compiling them pays.

The searches of one decision take some hundredths of a second compiled, some tenths interpreted, and 20 s to compile on
a machine that has not done so yet. So the interpreter runs such a kernel until it has spent on it about what a compiler would;
then the kernel is compiled, or at once where the machine's cache has it. Both do the same operations on doubles in the same
order, so results have the same digits.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
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
