"""How kernels are compiled: kept on disk, without the interpreter's lock, with NumPy's division."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from inscrutable.kernels.linking import KernelCompiler, LinkedCompiler

Function = TypeVar("Function", bound=Callable[..., Any])

_njit: Any = numba.njit
_ANY_ORDER = ("reassoc", "contract", "nnan", "nsz")
_numbers = {"nogil": True, "error_model": "numpy", "no_cfunc_wrapper": True, "pipeline_class": KernelCompiler}
_called = {**_numbers, "cache": True}
_linked = {**_numbers, "no_cpython_wrapper": True, "pipeline_class": LinkedCompiler}


def kernel(function: Function) -> Function:
    """Compile a function that Python calls."""
    return cast(
        Function, _njit(**_called, _nrt=True)(function)
    )  # explicit, or else it is inherited from the first caller


def uncounted_kernel(function: Function) -> Function:
    """Compile a function that Python calls and that allocates nothing, without counting references to its arrays."""
    return cast(Function, _njit(**_called, _nrt=False)(function))


def internal(function: Function) -> Function:
    """Compile a function that only kernels call."""
    return cast(Function, _njit(**_linked, _nrt=True)(function))


def fused(function: Function) -> Function:
    """Compile as `internal` does, with a product and a sum rounded at once: last digits differ between machines."""
    return cast(Function, _njit(**_linked, _nrt=True, fastmath={"contract"})(function))


def summed(function: Function) -> Function:
    """Compile as `fused` does, with sums in any order, so that loops that add up are taken by the lane; no number is NaN."""
    return cast(Function, _njit(**_linked, _nrt=True, fastmath={*_ANY_ORDER})(function))


def uncounted(function: Function) -> Function:
    """Compile a function that only kernels call, that allocates nothing and that returns no array, without counting references
    to its arrays."""
    return cast(Function, _njit(**_linked, _nrt=False)(function))


def inlined(function: Function) -> Function:
    """Copy a function that returns arrays it does not own into its callers, before they are compiled: so both kinds may call
    it."""
    return cast(Function, _njit(**_numbers, inline="always", _nrt=False)(function))


def integer(number: int) -> int:
    """An integer constant of type int64: for a plain literal a kernel is compiled once per value."""
    return cast(int, np.int64(number))
