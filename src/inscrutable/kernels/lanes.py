"""Arithmetic on eight programmes at once: an array of shape (n, LANES) holds entry k of every programme in row k.

Compiled, each function is a few vector instructions per row, with the running sum kept in a register; interpreted
(NUMBA_DISABLE_JIT=1), it is the NumPy below. Every lane is summed in the same order, so the answer in one lane does not
depend on what the others hold.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from llvmlite import ir  # type: ignore[import-untyped]
from numba import config, types
from numba.core import cgutils
from numba.extending import intrinsic

LANES = 8


def plain_minus_dot(out: Any, row: int, x: Any, first: int, y: Any, second: int, n: int) -> None:
    """out[row] −= Σ_k x[first + k] · y[second + k] over k < n."""
    for k in range(n):
        out[row] -= x[first + k] * y[second + k]


def plain_plus_mix(out: Any, row: int, x: Any, first: int, weights: Any, second: int, n: int) -> None:
    """out[row] += Σ_k x[first + k] · weights[second + k] over k < n; a weight is one number for all lanes."""
    for k in range(n):
        out[row] += x[first + k] * weights[second + k]


def plain_mix(out: Any, row: int, x: Any, first: int, weights: Any, second: int, n: int) -> None:
    """out[row] = Σ_k x[first + k] · weights[second + k] over k < n; a weight is one number for all lanes."""
    out[row] = 0.0
    plain_plus_mix(out, row, x, first, weights, second, n)


def plain_times(out: Any, row: int, x: Any, first: int) -> None:
    """out[row] ·= x[first]."""
    out[row] *= x[first]


_VECTOR = ir.VectorType(ir.DoubleType(), LANES)
_FUSED = ("contract",)


class _Rows:
    """Rows of an array (n, LANES) in compiled code."""

    def __init__(self, context: Any, builder: Any, kind: Any, array: Any, first: Any) -> None:
        self.builder = builder
        data = context.make_array(kind)(context, builder, array).data
        self.start = builder.bitcast(builder.gep(data, [builder.mul(first, first.type(LANES))]), _VECTOR.as_pointer())

    def load(self, k: Any) -> Any:
        return self.builder.load(self.builder.gep(self.start, [k]), align=8)

    def store(self, value: Any) -> None:
        self.builder.store(value, self.start, align=8)


def _spread(builder: Any, number: Any) -> Any:
    """The same number in every lane."""
    one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), number, ir.IntType(32)(0))
    return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))


def _sum_of_products(context: Any, builder: Any, kinds: Any, values: Any, mixes: bool, adds: bool) -> Any:
    out, row, x, first, y, second, n = values
    place, left = _Rows(context, builder, kinds[0], out, row), _Rows(context, builder, kinds[2], x, first)
    total = cgutils.alloca_once(builder, _VECTOR)  # type: ignore[no-untyped-call]
    builder.store(place.load(row.type(0)) if adds else ir.Constant(_VECTOR, [0.0] * LANES), total)
    if mixes:
        numbers = builder.gep(context.make_array(kinds[4])(context, builder, y).data, [second])
    else:
        right = _Rows(context, builder, kinds[4], y, second)
    with cgutils.for_range(builder, n) as loop:
        k = loop.index
        factor = _spread(builder, builder.load(builder.gep(numbers, [k]))) if mixes else right.load(k)
        product = builder.fmul(left.load(k), factor, flags=_FUSED)
        add = builder.fadd if mixes else builder.fsub
        builder.store(add(builder.load(total), product, flags=_FUSED), total)
    place.store(builder.load(total))
    return context.get_dummy_value()


def _seven(mixes: bool, adds: bool) -> Callable[..., Any]:
    def typed(_: Any, out: Any, row: Any, x: Any, first: Any, y: Any, second: Any, n: Any) -> Any:
        def generated(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return _sum_of_products(context, builder, signature.args, values, mixes, adds)

        whole = types.intp
        return types.void(out, whole, x, whole, y, whole, whole), generated

    return typed


def _scaling(_: Any, out: Any, row: Any, x: Any, first: Any) -> Any:
    def generated(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        place = _Rows(context, builder, signature.args[0], values[0], values[1])
        factor = _Rows(context, builder, signature.args[2], values[2], values[3])
        zero = values[1].type(0)
        place.store(builder.fmul(place.load(zero), factor.load(zero)))
        return context.get_dummy_value()

    return types.void(out, types.intp, x, types.intp), generated


_INTERPRETED = bool(config.DISABLE_JIT)  # type: ignore[attr-defined]
minus_dot: Callable[..., None] = plain_minus_dot if _INTERPRETED else intrinsic(_seven(mixes=False, adds=True))
plus_mix: Callable[..., None] = plain_plus_mix if _INTERPRETED else intrinsic(_seven(mixes=True, adds=True))
mix: Callable[..., None] = plain_mix if _INTERPRETED else intrinsic(_seven(mixes=True, adds=False))
times: Callable[..., None] = plain_times if _INTERPRETED else intrinsic(_scaling)
