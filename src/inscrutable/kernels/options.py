"""How kernels are compiled: kept on disk, without the interpreter's lock, with NumPy's division."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = numba.njit
_options = {"cache": True, "nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True}
_ANY_ORDER = ("reassoc", "contract", "nnan", "nsz")
_counting = {**_options, "_nrt": True}  # explicit, or else it is inherited from the first caller


def kernel(function: Function) -> Function:
    """Compile a function that Python calls."""
    return cast(Function, _njit(**_counting)(function))


def internal(function: Function) -> Function:
    """Compile a function that only kernels call: without the code that takes Python objects apart, which is slow to
    compile."""
    return cast(Function, _njit(**_counting, no_cpython_wrapper=True)(function))


def fused(function: Function) -> Function:
    """Compile as `internal` does, with a product and a sum rounded at once: last digits differ between machines."""
    return cast(Function, _njit(**_counting, no_cpython_wrapper=True, fastmath={"contract"})(function))


def summed(function: Function) -> Function:
    """Compile as `fused` does, with sums in any order, so that loops that add up are taken by the lane; no number is NaN."""
    return cast(Function, _njit(**_counting, no_cpython_wrapper=True, fastmath={*_ANY_ORDER})(function))


def uncounted(function: Function) -> Function:
    """Compile a function that only kernels call and that allocates nothing, without counting references to its arrays."""
    return cast(Function, _njit(**_options, no_cpython_wrapper=True, _nrt=False)(function))


def uncounted_kernel(function: Function) -> Function:
    """Compile a function that Python calls as well and that allocates nothing, without counting references."""
    return cast(Function, _njit(**_options, _nrt=False)(function))


def inlined(function: Function) -> Function:
    """Copy a function into its callers before they are compiled, as if it were written there: a loop is then taken by the
    lane, and what is called once is compiled once. Copies of large functions that hold copies are slow to make."""
    return cast(Function, _njit(**_options, inline="always", _nrt=False)(function))


def integer(number: int) -> int:
    """An integer constant of type int64: for a plain literal a kernel is compiled once per value."""
    return cast(int, np.int64(number))
