"""Costs in CVXPY read as an affine function and a weighted sum of maxima of affine functions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.problems.expressions import Node
from inscrutable.validation import Array

_MOST_PIECES = 64
"""Most affine functions in one maximum: maxima inside another multiply theirs. Beyond, the costs are taken as they are. A limit
of time, not tuned: every function is a row of the feasible set."""
_SAME_DIGITS = 12  # of maxima that count as equal: what rounding leaves of 16


class SumsOfMaxima(NamedTuple):
    """c(i,u) = g_i'u + r_i + Σ_j W_ij max_k (a_jk + b_jk'u), with W ≥ 0."""

    linear: Array  # g (X,U)
    constants: Array  # r (X,)
    weights: Array  # W (X,J)
    maxima: list[Array]  # (K_j, U+1): the slopes b_jk, then a_jk

    def levels(self, points: Array) -> Array:
        """Return the maxima (…,J) at decisions (…,U)."""
        if not self.maxima:
            return np.zeros((*points.shape[:-1], 0))
        pieces = np.vstack(self.maxima)
        starts = np.cumsum([0, *map(len, self.maxima[:-1])])
        return np.asarray(np.maximum.reduceat(points @ pieces[:, :-1].T + pieces[:, -1], starts, axis=-1))

    def values(self, points: Array) -> Array:
        """Return the costs (…,X) of decisions (…,U)."""
        return np.asarray(points @ self.linear.T + self.levels(points) @ self.weights.T + self.constants)

    def slopes(self, points: Array) -> Array:
        """Return slopes (…,X,U) of the costs at decisions (…,U), by one active function of each maximum."""
        found = np.broadcast_to(self.linear, (*points.shape[:-1], *self.linear.shape)).copy()
        for weight, each in zip(self.weights.T, self.maxima, strict=True):
            found += weight[:, None] * each[(points @ each[:, :-1].T + each[:, -1]).argmax(axis=-1), None, :-1]
        return found

    @classmethod
    def of_pieces(cls, tables: Sequence[Array]) -> SumsOfMaxima:
        """Return the form of one maximum (K_i,U+1) a state; of parallel functions the largest alone."""
        parts = [centred(table) for table in tables]
        affine = np.array([part.middle for part in parts])
        several = [i for i, part in enumerate(parts) if part.size > 0.0]
        weights = np.diag([part.size for part in parts])[:, several]
        return cls(affine[:, :-1], affine[:, -1], weights, [parts[i].pieces for i in several])


class Centred(NamedTuple):
    """A maximum as middle'(u,1) + size · max_k pieces_k'(u,1)."""

    middle: Array  # (U+1,)
    size: float
    pieces: Array  # (K,U+1), with slopes around 0 and at most 1


def centred(pieces: Array) -> Centred:
    """Return a maximum of affine functions (K,U+1) with slopes of the size of 1, so that the slack of a row z ≥ b'u + a is in
    the decision's unit, whatever the cost's unit and the slope that all functions have in common; size 0 for parallel ones."""
    middle = 0.5 * (pieces.max(axis=0) + pieces.min(axis=0))
    apart = pieces - middle
    size = float(np.abs(apart[:, :-1]).max())
    if size <= tolerances.COST_ROUNDING * float(np.abs(pieces[:, :-1]).max()):
        return Centred(pieces[pieces[:, -1].argmax()], 0.0, apart[:1])
    return Centred(middle, size, apart / size)


class _Term(NamedTuple):
    """One entry of an expression."""

    affine: Array  # (U+1,) slopes, then the constant
    weights: dict[int, float]  # of maxima, by number


class _Unread(Exception):
    """An expression has an atom that is no maximum of affine functions."""


def sums_of_maxima(costs: Sequence[Node], n_actions: int) -> SumsOfMaxima | None:
    """Return trees of single numbers in this form, None where some are of another."""
    reader = _Reader(n_actions)
    try:
        terms = [reader.terms(cost)[0] for cost in costs]
    except _Unread:
        return None
    weights = np.zeros((len(terms), len(reader.maxima)))
    for row, term in zip(weights, terms, strict=True):
        row[list(term.weights)] = list(term.weights.values())
    if not reader.maxima or weights.min() < 0.0:
        return None
    affine = np.array([term.affine for term in terms])
    return SumsOfMaxima(affine[:, :-1], affine[:, -1], weights, reader.maxima)


class _Reader:
    """Reads trees, and numbers the maxima that it meets; equal ones have one number."""

    def __init__(self, n_actions: int) -> None:
        self._size = n_actions
        self.maxima: list[Array] = []
        self._numbers: dict[bytes, int] = {}

    def terms(self, node: Node) -> list[_Term]:
        """Return the entries of an expression."""
        if node.constant is not None:
            return [_Term(np.append(np.zeros(self._size), value), {}) for value in node.constant]
        if node.slope is not None:
            offsets = np.broadcast_to(node.offset, node.size)
            return [_Term(np.append(slope, value), {}) for slope, value in zip(node.slope.T, offsets, strict=True)]
        inner = [self.terms(child) for child in node.children]
        if node.slopes is not None:
            return self._combined(node, inner)
        name, first = type(node.expression).__name__, inner[0]
        if name in ("max", "min") and node.size == 1:
            return [self._extreme(first, name == "max")]
        if name in ("maximum", "minimum"):
            return [self._extreme([each[k % len(each)] for each in inner], name == "maximum") for k in range(node.size)]
        if name == "abs":
            return [self._extreme([each, _times(each, -1.0)], True) for each in first]
        if name == "norm1":
            return [_sum([(1.0, self._extreme([each, _times(each, -1.0)], True)) for each in first], self._size)]
        if name == "norm_inf":
            return [self._extreme([*first, *(_times(each, -1.0) for each in first)], True)]
        raise _Unread

    def _combined(self, node: Node, inner: list[list[_Term]]) -> list[_Term]:
        """The entries of an affine atom of other expressions."""
        assert node.slopes is not None
        found = []
        for k, offset in enumerate(np.broadcast_to(node.offset, node.size)):
            parts = [
                (float(slope[j, k]), term)
                for slope, terms in zip(node.slopes, inner, strict=True)
                if slope is not None
                for j, term in enumerate(terms)
                if slope[j, k] != 0.0
            ]
            total = _sum(parts, self._size)
            found.append(total._replace(affine=total.affine + np.append(np.zeros(self._size), offset)))
        return found

    def _extreme(self, terms: list[_Term], is_largest: bool) -> _Term:
        """The largest of some entries; or the least, which is less the largest of those with the other sign."""
        sign = 1.0 if is_largest else -1.0
        pieces = np.unique(np.vstack([self._pieces(_times(term, sign)) for term in terms]), axis=0)
        if len(pieces) > _MOST_PIECES:
            raise _Unread
        middle, size, inner = centred(pieces)
        # Kinks at one place are multiples of the same maximum, as those of max(x,0) and max(−x,0).
        return _Term(sign * middle, {self._number(inner): sign * size} if size > 0.0 else {})

    def _number(self, pieces: Array) -> int:
        key = np.unique(np.round(pieces, _SAME_DIGITS) + 0.0, axis=0)
        number = self._numbers.setdefault(key.tobytes(), len(self.maxima))
        if number == len(self.maxima):
            self.maxima.append(pieces)
        return number

    def _pieces(self, term: _Term) -> Array:
        """The affine functions whose maximum an entry is."""
        found = term.affine[None]
        for number, weight in term.weights.items():
            if weight < 0.0 or len(found) * len(self.maxima[number]) > _MOST_PIECES:
                raise _Unread
            found = (found[:, None] + weight * self.maxima[number]).reshape(-1, self._size + 1)
        return found


def _times(term: _Term, factor: float) -> _Term:
    return _Term(factor * term.affine, {number: factor * weight for number, weight in term.weights.items()})


def _sum(parts: Sequence[tuple[float, _Term]], n_actions: int) -> _Term:
    affine, weights = np.zeros(n_actions + 1), dict[int, float]()
    for factor, term in parts:
        affine = affine + factor * term.affine
        for number, weight in term.weights.items():
            weights[number] = weights.get(number, 0.0) + factor * weight
    return _Term(affine, {number: weight for number, weight in weights.items() if weight != 0.0})
