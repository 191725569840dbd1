"""How kernels are compiled, and how the functions that only kernels call: up to the code that their callers link.

Numba optimises each function together with all that it calls and makes machine code of it, at every level of calls anew. Here
only the kernel that Python calls does so. All kernels compile in .6 of the time, with the same bits. Of twelve kinds of
searches, timed twice in turn, eleven take .9 to 1.13 of the time, and one 1.35, which the benchmarks do not show.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from llvmlite import binding as llvm  # type: ignore[import-untyped]
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, Flags


class ComparedFlags(Flags):
    """Options of the compiler that are compared as they were set.

    Numba looks up each operation of a kernel under the options, 65,000 times for all kernels, and compares the options one by
    one. They compile in .89 of the time without that.
    """

    __slots__ = ()

    def __hash__(self) -> int:
        return hash(frozenset(self._values))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ComparedFlags) and self._values == other._values


class KernelLibrary(JITCodeLibrary):
    """The code of a kernel.

    LLVM optimises it at level 1 and unrolls no loops: loops go over a few states or assets. All kernels compile in .8 of the
    time, to three quarters of the code and with the same bits. Twenty kinds of decisions, solves, filters and fits take .90 to
    1.04 of the time.
    """

    def _passes(self) -> Any:
        tuning: Any = llvm.create_pipeline_tuning_options(speed_level=1)
        tuning.loop_unrolling = False
        return llvm.create_pass_builder(self._codegen._tm, tuning)

    def _optimize_functions(self, module: Any) -> None:
        module.data_layout = self._codegen._data_layout
        builder = self._passes()
        for function in module.functions:
            _run(builder.getFunctionPassManager(), function, builder)

    def _optimize_final_module(self) -> None:
        builder = self._passes()
        _run(builder.getModulePassManager(), self._final_module, builder)


def _run(passes: Any, code: Any, builder: Any) -> None:
    passes.add_refprune_pass()  # Numba's: it removes pairs of a reference's increment and decrement
    passes.run(code, builder)


class LinkedLibrary(KernelLibrary):
    """The code of a function that is linked into others and never called alone."""

    @property
    def codegen(self) -> Any:
        """What Numba tells of the function's environment, which only machine code has, goes nowhere."""
        return SimpleNamespace(set_env=lambda name, environment: None)

    def get_pointer_to_function(self, name: str) -> int:
        """Return 0, which Numba takes for no address."""
        return 0

    def _optimize_final_module(self) -> None:
        """The caller's library does."""

    def _finalize_final_module(self) -> None:
        self._finalized = True


class KernelCompiler(Compiler):
    """Numba's compiler with such options and such a library."""

    _library: type[KernelLibrary] = KernelLibrary

    def __init__(self, *arguments: Any) -> None:
        *others, flags, local_types = arguments
        super().__init__(*others, ComparedFlags(flags), local_types)  # type: ignore[call-arg,no-untyped-call]

    def define_pipelines(self) -> Any:
        """Return the passes of the compiler; the library is made before the first."""
        library: Any = self._library
        self.state.library = library(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()  # type: ignore[no-untyped-call]


class LinkedCompiler(KernelCompiler):
    """The compiler of functions that only kernels call."""

    _library = LinkedLibrary
