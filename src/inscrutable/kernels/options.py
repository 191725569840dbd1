"""How kernels are compiled: kept on disk, without the interpreter's lock, with NumPy's division."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = numba.njit
_options = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}


def kernel(function: Function) -> Function:
    """Compile a function that Python calls."""
    return cast(Function, _njit(**_options)(function))


def part(function: Function) -> Function:
    """Compile a function that only kernels call: without the code that takes Python objects apart, which is slow to
    compile."""
    return cast(Function, _njit(**_options, no_cpython_wrapper=True)(function))
