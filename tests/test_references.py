"""Named tuples by reference: the same numbers as by value, compiled and interpreted."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
from numba.core.errors import TypingError

from inscrutable.kernels.options import internal, kernel, uncounted
from inscrutable.kernels.references import by_reference, release


class Part(NamedTuple):
    """Fields of one type."""

    low: Any
    high: Any


class Whole(NamedTuple):
    """Fields of several types, one of them a named tuple."""

    values: Any
    part: Any
    count: int
    pair: Any


@uncounted
def _add(part: Any, amount: float) -> None:
    part.low[0] += amount
    part.high[0] -= amount


@internal
def _visit(whole: Any, rounds: int) -> float:
    part, total = whole.part, 0.0
    for r in range(rounds):
        scratch = whole.values.copy()  # a counted array beside the ones that are not
        _add(part, scratch[r % scratch.size])
        total += part.low[0] * whole.count + whole.pair[1]
    return total


@kernel
def given(whole: Any, rounds: int) -> float:
    """Visit a record of the caller's."""
    return _visit(by_reference(whole), rounds)


@kernel
def made(values: Any, rounds: int) -> Any:
    """Visit a record that is made here, while many other arrays come and go."""
    whole = Whole(values.copy(), Part(np.zeros(3), np.ones(3)), 2, (1, 0.5))
    reference = by_reference(whole)
    total = 0.0
    for r in range(rounds):
        other = np.full(3, -1.0 - r)  # would take the place of an array that was freed
        total += _visit(reference, 1) + other[0]
    low = reference.part.low[0]
    release(whole)
    return total, low


def whole() -> Whole:
    return Whole(np.array([1.0, 2.0, 4.0]), Part(np.zeros(3), np.ones(3)), 2, (1, 0.5))


def test_a_record_by_reference_is_the_record() -> None:
    one = whole()
    added = np.resize(one.values, 50)
    assert given(one, 50) == pytest.approx((2.0 * added.cumsum() + 0.5).sum())
    assert one.part.low[0] == 1.0 - one.part.high[0] == added.sum()
    assert by_reference(one) is one  # to the interpreter


def test_a_record_that_a_kernel_makes_lives_until_it_is_released() -> None:
    values = np.array([1.0, 2.0, 4.0])
    total, low = made(values, 1000)
    assert low == 1000.0  # the first of the values, a thousand times
    assert total == pytest.approx((2.0 * np.arange(1, 1001) + 0.5 - 1.0 - np.arange(1000)).sum())


def test_a_field_that_is_none_is_refused() -> None:
    @kernel
    def wrong(part: Any) -> Any:
        return by_reference(part).middle

    with pytest.raises(TypingError, match="middle"):
        wrong(whole().part)
