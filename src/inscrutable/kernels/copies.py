"""Values from one array to another, by loops.

Assigning one slice to another, or sorting, adds some 2,000 lines of machine-independent code each, for shapes that do not match
and memory that overlaps; with that a first decision waits for the compiler several times as long.
"""

from __future__ import annotations

from typing import Any

from inscrutable.kernels.options import uncounted


@uncounted
def put(values: Any, out: Any) -> None:
    """Copy `values` (n,) to the first n entries of `out`."""
    for i in range(values.size):
        out[i] = values[i]


@uncounted
def put_rows(values: Any, out: Any) -> None:
    """Copy `values` (n,d) to the first n rows of `out`."""
    for i in range(values.shape[0]):
        put(values[i], out[i])


@uncounted
def put_at_least(low: float, values: Any, out: Any) -> None:
    """Fill the first n entries of `out` with the larger of `low` and `values` (n,)."""
    for i in range(values.size):
        out[i] = max(values[i], low)


@uncounted
def put_shifted(values: Any, share: float, step: Any, out: Any) -> None:
    """Fill the first entries of `out` with values + share·step; as many as `step` has."""
    for i in range(step.size):
        out[i] = values[i] + share * step[i]


@uncounted
def put_descending(values: Any, order: Any) -> None:
    """Fill `order` (n,) with the places of `values` (n,), the largest first."""
    for i in range(values.size):
        j = i
        while j > 0 and values[order[j - 1]] < values[i]:
            order[j] = order[j - 1]
            j -= 1
        order[j] = i
