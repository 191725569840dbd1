"""Zeros of increasing functions of one variable: many brackets are narrowed together.

A bracket has an inner end, where f ≤ 0, and an outer end, where f > 0; either may be the larger number. Regret along a ray of
beliefs or a step of a decision is convex with its minimum at the start, so f(t) = √ρ(t) − √limit is nearly linear and the
secant through both ends is accurate. The value at a retained end is multiplied by 1 − f(new)/f(replaced), or by one half where
that is not positive, which moves the next secant towards it (Anderson and Björck). After the first few steps, a bracket wider
than bisection would leave it after three quarters of the steps is bisected. Where a value is infinite, only the sign is known,
and every step bisects.

Source: Anderson and Björck, BIT 13, 1973. SciPy's `elementwise.find_root` may end on either side of the zero, does not return
the inner end, and has an overhead of 0.2 ms per step, more than most functions here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array

_FREE_STEPS = 4
"""With two, a jump next to a nearly linear part takes four times as many steps; more change nothing."""
_HALVINGS_A_STEP = 0.75
"""With one half, jumps and flat curves take a third more steps; with one, powers do."""
_MOST_STEPS = 100


class Bracket(NamedTuple):
    """Numbers (n,) at the ends of brackets."""

    inside: Array
    outside: Array


def narrowed(
    f: Callable[[np.ndarray, Array], Array],
    ends: Bracket,
    values: Bracket,
    *,
    spare: float = 0.0,
    width: float = tolerances.POLISH,
) -> Bracket:
    """Return brackets narrowed until f ≥ −`spare` at the end inside, or the ends differ by at most `width`.

    Args:
        f: (which, x) → f of the functions `which` (k,) at x (k,); ±inf where only the side is known.
        ends: The brackets.
        values: f at their ends; ±inf where only the side is known.
        spare: How far below zero f may stay at the inner end; the target is half of it.
        width: Largest final difference of the ends.
    """
    x, known = np.stack(ends), np.stack(values)
    weights, last = np.ones_like(known), np.zeros(known.shape[1], dtype=np.int64)
    whole, left = np.abs(x[1] - x[0]), np.arange(last.size)
    for step in range(_MOST_STEPS):
        apart = np.abs(x[1, left] - x[0, left])
        still = (apart > width) & (known[0, left] < -spare)
        left, apart = left[still], apart[still]
        if not left.size:
            break
        below, above = (known[:, left] + 0.5 * spare) * weights[:, left]
        with np.errstate(divide="ignore", invalid="ignore"):
            share = np.clip(below / (below - above), tolerances.POLISH, 1.0 - tolerances.POLISH)
        behind = apart > whole[left] * 0.5 ** (_HALVINGS_A_STEP * (step - _FREE_STEPS))
        share[behind | ~np.isfinite(below - above)] = 0.5
        tried = x[0, left] + share * (x[1, left] - x[0, left])
        found = f(left, tried)
        end = (found > 0.0).astype(np.int64)
        with np.errstate(divide="ignore", invalid="ignore"):
            lean = 1.0 - found / known[end, left]
        weights[1 - end, left] *= np.where(end != last[left], 1.0, np.where(lean > 0.0, lean, 0.5))
        x[end, left], known[end, left], weights[end, left] = tried, found, 1.0
        last[left] = end
    return Bracket(*x)


def farthest(
    f: Callable[[np.ndarray, Array], Array], start: Array, *, spare: float = 0.0, width: float = tolerances.POLISH
) -> Array:
    """Return the largest x in [0, 1] found with f ≤ 0, as `narrowed` leaves them: one where f(1) ≤ 0.

    `start` (n,) is f(0), at most 0.
    """
    shares = np.ones(start.size)
    at_one = f(np.arange(start.size), shares)
    open_ends = np.flatnonzero(at_one > 0.0)
    values = Bracket(start[open_ends], at_one[open_ends])
    ends = Bracket(np.zeros(open_ends.size), np.ones(open_ends.size))
    found = narrowed(lambda which, x: f(open_ends[which], x), ends, values, spare=spare, width=width)
    shares[open_ends] = found.inside
    return shares


def side(meets: np.ndarray) -> Array:
    """Return −inf where a goal is met and +inf where not: values with a known sign only."""
    return np.where(meets, -np.inf, np.inf)


def first_met(meets: Callable[[float], bool]) -> float:
    """Return the least share found in [0, 1] at which a goal is met; it is missed at zero and met at one."""
    ends, values = Bracket(np.ones(1), np.zeros(1)), Bracket(side(np.ones(1)), side(np.zeros(1)))
    return float(narrowed(lambda _, share: side(np.array([meets(float(share[0]))])), ends, values).inside[0])
