"""The best affordable candidates for one belief, by face and direction, without reading most of them.

Candidates lie in leaves of neighbouring decoys. With s_c, J and e of a leaf, and h its radius, every decision in it costs at
least π·(s_c − e) − h‖J'π‖ and its decoy is at most ‖c − p‖ + h from the point p.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from inscrutable.kernels.options import bare
from inscrutable.kernels.search import SEGMENT


class Book(NamedTuple):
    """Candidates and leaves along the last axis, and which faces are neighbours."""

    costs: Any  # (X,D)
    decoys: Any  # (X,D)
    start: Any  # (X,D) of a segment
    along: Any  # (X,D) end − start
    square: Any  # (D,)
    kind: Any  # (D,)
    face: Any  # (D,)
    first: Any  # (L+1,)
    radius: Any  # (L,)
    reach: Any  # (L,)
    centre: Any  # (X,L)
    middle: Any  # (X,L) costs at the centre
    excess: Any  # (X,L)
    slope: Any  # (X,X,L)
    tight: Any  # (K,R) which rows each face holds
    beyond: Any  # (K,R) number of the face that differs in one row, −1: none known


@bare
def bound_leaves(book: Any, belief: Any, point: Any, work: Any) -> None:
    """Least and central cost, and distance, of every leaf."""
    n_states, n_leaves = book.centre.shape
    least, likely, far, row = work.least, work.likely, work.far, work.row
    for leaf in range(n_leaves):
        least[leaf], likely[leaf], far[leaf] = 0.0, 0.0, 0.0
    for k in range(n_states):
        for leaf in range(n_leaves):
            row[leaf] = 0.0
        for i in range(n_states):
            for leaf in range(n_leaves):
                row[leaf] += book.slope[k, i, leaf] * belief[i]
        for leaf in range(n_leaves):
            least[leaf] += row[leaf] * row[leaf]
            far[leaf] += (book.centre[k, leaf] - point[k]) ** 2
            likely[leaf] += belief[k] * book.middle[k, leaf]
    for leaf in range(n_leaves):
        far[leaf] = np.sqrt(far[leaf])
        least[leaf] = likely[leaf] - np.sqrt(least[leaf]) * book.radius[leaf]
    for k in range(n_states):
        for leaf in range(n_leaves):
            least[leaf] -= belief[k] * book.excess[k, leaf]


@bare
def _most_of(book: Any, work: Any, sign: float, leaf: int) -> float:
    """Upper bound of sign·distance in a leaf."""
    if sign > 0.0:
        return float(work.far[leaf] + book.radius[leaf])
    return float(min(book.radius[leaf] + book.reach[leaf] - work.far[leaf], 0.0))


@bare
def _read_leaf(book: Any, belief: Any, point: Any, leaf: int, work: Any) -> None:
    """Costs of a leaf's candidates and squared distances of their decoys."""
    low, high = book.first[leaf], book.first[leaf + 1]
    cost, away = work.cost, work.away
    for j in range(high - low):
        cost[j], away[j] = 0.0, 0.0
    for i in range(belief.size):
        for j in range(high - low):
            cost[j] += belief[i] * book.costs[i, low + j]
            away[j] += (point[i] - book.decoys[i, low + j]) ** 2


@bare
def _segment_square(book: Any, point: Any, d: int) -> float:
    share, total = 0.0, 0.0
    for i in range(point.size):
        share += (point[i] - book.start[i, d]) * book.along[i, d]
    share = min(max(share / book.square[d], 0.0), 1.0)
    for i in range(point.size):
        total += (point[i] - book.start[i, d] - share * book.along[i, d]) ** 2
    return total


@bare
def best_candidate(book: Any, belief: Any, point: Any, sign: float, most: float, work: Any) -> int:
    """The affordable candidate of largest quick privacy; −1: none."""
    best, floor, n_leaves = -1, -np.inf, work.far.size
    top, bound = -1, -np.inf
    for leaf in range(n_leaves):
        if work.likely[leaf] <= most and _most_of(book, work, sign, leaf) > bound:
            top, bound = leaf, _most_of(book, work, sign, leaf)
    for turn in range(-1, n_leaves):
        leaf = top if turn < 0 else turn
        if leaf < 0 or (turn == top) or work.least[leaf] > most or _most_of(book, work, sign, leaf) <= floor:
            continue
        _read_leaf(book, belief, point, leaf, work)
        first = book.first[leaf]
        for j in range(book.first[leaf + 1] - first):
            if work.cost[j] > most:
                continue
            square = work.away[j]
            if book.kind[first + j] == SEGMENT:
                square = _segment_square(book, point, first + j)
            privacy = sign * np.sqrt(square)
            if privacy > floor:
                best, floor = first + j, privacy
    return best


@bare
def collect(book: Any, basis: Any, belief: Any, point: Any, sign: float, most: float, floor: float, work: Any) -> int:
    """Fill the best affordable candidate of every face and orthant around the point, of those whose decoys are above
    `floor`; returns how many slots are in use."""
    used, axes = 0, 0
    while 2 ** (axes + 1) <= work.best.shape[1]:
        axes += 1
    slots = work.best.shape[1]
    for leaf in range(work.far.size):
        if work.least[leaf] > most or _most_of(book, work, sign, leaf) <= floor:
            continue
        _read_leaf(book, belief, point, leaf, work)
        first = book.first[leaf]
        for j in range(book.first[leaf + 1] - first):
            d = first + j
            square = work.away[j]
            if work.cost[j] > most or (sign > 0.0 and square <= floor * floor):
                continue
            if book.kind[d] == SEGMENT:
                square = _segment_square(book, point, d)
            if sign < 0.0 and square >= floor * floor:
                continue
            orthant = 0
            for c in range(axes):
                lean = 0.0
                for i in range(point.size):
                    lean += basis[i, c] * (book.decoys[i, d] - point[i])
                orthant = 2 * orthant + (1 if lean > 0.0 else 0)
            number = book.face[d]
            if work.which[number, orthant] < 0:
                work.touched[used] = number * slots + orthant
                used += 1
                work.best[number, orthant] = -np.inf
            if sign * square > work.best[number, orthant]:
                work.best[number, orthant] = sign * square
                work.which[number, orthant] = d
    return used


@bare
def take_best(work: Any, used: int) -> int:
    """The candidate of the best slot, which is emptied; −1: none is left."""
    slots, top, best = work.best.shape[1], -1, -np.inf
    for s in range(used):
        number, orthant = work.touched[s] // slots, work.touched[s] % slots
        if work.which[number, orthant] >= 0 and work.best[number, orthant] > best:
            top, best = s, work.best[number, orthant]
    if top < 0:
        return -1
    number, orthant = work.touched[top] // slots, work.touched[top] % slots
    found = work.which[number, orthant]
    work.which[number, orthant] = -1
    return int(found)
