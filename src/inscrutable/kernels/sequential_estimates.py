"""Data of one step of a sequential rule, and the term h(μ) of the observer's estimates with its derivatives.

h(μ) = |μ|² where a square error counts; −τ Σ log of the shares where estimates mix a rival's answers, see `sequential_saddle`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import internal

_INSIDE = 0.95  # share of the way to a mixture without one of its answers that a step may go


class StepData(NamedTuple):
    """What stays the same from step to step."""

    points: Any  # (d,B)
    values: Any  # (M,B)
    slopes: Any  # (M,d): gradient of s ρ_m in the points' coordinates
    price: float  # λ
    first_price: float  # first price of a continuation to a small λ; none where at most λ
    width: int  # coordinates that a mixture of answers has; 0 where estimates are means of the points
    barrier: float  # τ


@internal
def _last_share(data: StepData, estimate: Any, start: int) -> float:
    """The share of the last answer of the mixture that begins at a coordinate."""
    rest = 1.0
    for i in range(start, start + data.width):
        rest -= estimate[i]
    return rest


@internal
def own_cost(data: StepData, estimate: Any) -> float:
    """h(μ): |μ|², or −τ Σ log of the shares of every mixture; inf where one of them is not positive."""
    total = 0.0
    if data.width == 0:
        for i in range(estimate.size):
            total += estimate[i] * estimate[i]
        return total
    for start in range(0, estimate.size, data.width):
        rest = _last_share(data, estimate, start)
        for i in range(start, start + data.width):
            if not estimate[i] > 0.0:
                return np.inf
            total -= np.log(estimate[i])
        if not rest > 0.0:
            return np.inf
        total -= np.log(rest)
    return data.barrier * total


@internal
def own_slope(data: StepData, estimate: Any, slope: Any) -> None:
    """∇h, shape (d,)."""
    if data.width == 0:
        for i in range(slope.size):
            slope[i] = 2.0 * estimate[i]
        return
    for start in range(0, estimate.size, data.width):
        rest = _last_share(data, estimate, start)
        for i in range(start, start + data.width):
            slope[i] = data.barrier * (1.0 / rest - 1.0 / estimate[i])


@internal
def own_curve(data: StepData, estimate: Any, curve: Any) -> None:
    """∇²h, shape (d,d)."""
    curve[:] = 0.0
    if data.width == 0:
        for i in range(estimate.size):
            curve[i, i] = 2.0
        return
    for start in range(0, estimate.size, data.width):
        rest = _last_share(data, estimate, start)
        for i in range(start, start + data.width):
            for j in range(start, start + data.width):
                curve[i, j] = data.barrier / rest**2
            curve[i, i] += data.barrier / estimate[i] ** 2


@internal
def longest(data: StepData, estimate: Any, step: Any) -> float:
    """The longest share of a step, at most 1, that keeps every share of a mixture positive."""
    length = 1.0
    if data.width > 0:
        for start in range(0, estimate.size, data.width):
            rest, lost = _last_share(data, estimate, start), 0.0
            for i in range(start, start + data.width):
                lost += step[i]
                if step[i] < 0.0:
                    length = min(length, -_INSIDE * estimate[i] / step[i])
            if lost > 0.0:
                length = min(length, _INSIDE * rest / lost)
    return length
