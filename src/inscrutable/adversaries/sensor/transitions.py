"""Estimate the transition from the beliefs of a filter: linear equations of the steps with one symbol.

With M = diag(b) P' every such step satisfies (π_{k−1}' ⊗ (π_k 1' − I)) vec(M) = 0. Rows of every M point along those of P',
so that P' = diag(a) Q with known Q, and its columns sum to one: Q'a = 1. The steps of one symbol are therefore enough for P.
"""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.validation import Array

_BATCHES, _BATCH = 30, 400
"""Most small sets of steps tried. A set is useful where one symbol made all its X+1 steps."""

_KEPT = 8
"""Number of best sets that are evaluated in full, where noise leaves the best one uncertain."""


def steps_needed(n_states: int) -> int:
    """Return how many steps of one symbol determine its matrix: X² unknowns up to a factor, X−1 equations a step."""
    return n_states + 1


def symbol_matrices(before: Array, held: Array) -> tuple[Array, Array]:
    """Return the matrix M (N,X,X) of each of N sets of steps (N,K,X), and how much the steps determine it (N,): the second
    least singular value of its equations over the largest."""
    count, n_steps, n_states = before.shape
    parts = held[:, :, :, None] * np.ones(n_states) - np.eye(n_states)
    rows = (parts[:, :, :, :, None] * before[:, :, None, None, :]).reshape(count, n_steps * n_states, n_states**2)
    _, values, vectors = np.linalg.svd(np.swapaxes(rows, 1, 2) @ rows if n_steps > _BATCH else rows, full_matrices=True)
    found = vectors[:, -1].reshape(count, n_states, n_states)
    found = found * np.where(found.sum(axis=(1, 2)) < 0, -1.0, 1.0)[:, None, None]
    gaps = values[:, n_states**2 - 2] / np.maximum(values[:, 0], tolerances.TINY)
    return found, np.sqrt(gaps) if n_steps > _BATCH else gaps


def transitions_of(matrices: Array) -> Array:
    """Return the transition (N,X,X) of each M, whose entries may be no probabilities; 0 where M does not identify it."""
    n_states = matrices.shape[-1]
    sums = matrices.sum(axis=2, keepdims=True)
    # A state in which the symbol never occurs has a row of zeros, computed with rounding.
    least = tolerances.RANK * np.abs(matrices).max(axis=(1, 2), keepdims=True)
    rows = np.divide(matrices, sums, out=np.zeros_like(matrices), where=np.abs(sums) > least)
    open_ones = np.linalg.svd(rows, compute_uv=False)[:, -1] <= tolerances.RANK
    rows[open_ones] = np.eye(n_states)
    factors = np.linalg.solve(np.swapaxes(rows, 1, 2), np.ones((len(rows), n_states, 1)))
    found = np.swapaxes(factors * rows, 1, 2)
    found[open_ones] = 0.0
    return np.asarray(found)


def of_symbols(before: Array, held: Array, symbols: np.ndarray) -> tuple[Array | None, float]:
    """Return the transition from the best-conditioned symbol, and that condition; None where no symbol has enough steps."""
    best: Array | None = None
    gap = 0.0
    for symbol in np.unique(symbols[symbols >= 0]):
        some = np.flatnonzero(symbols == symbol)
        if len(some) < steps_needed(before.shape[1]):
            continue
        matrices, gaps = symbol_matrices(before[None, some], held[None, some])
        found = transitions_of(matrices)[0]
        # Rounding changes M by rounding/gap, and P by that divided by its least singular value.
        told = float(gaps[0] * np.linalg.svd(found, compute_uv=False)[-1])
        if told > max(gap, tolerances.TRANSITION_TOLD):
            best, gap = found, told
    return best, gap


def proposed(before: Array, held: Array, n_symbols: int, rng: np.random.Generator) -> list[Array]:
    """Return candidates for the transition where symbols are not known, the most promising first.

    Sets of X+1 neighbouring steps are drawn. The score of a set's matrix is its error on the steps that it explains best, half
    as many as a common symbol makes.
    """
    n_steps, n_states = before.shape
    needed = steps_needed(n_states)
    n_judges = min(max(needed + 2, n_steps // (2 * n_symbols)), n_steps)
    pairs = np.column_stack([before, held])
    scores, found = np.full(0, np.inf), np.empty((0, n_states, n_states))
    for _ in range(_BATCHES):
        sets = _drawn(pairs, needed, rng)
        matrices, gaps = symbol_matrices(before[sets], held[sets])
        transitions = transitions_of(matrices)
        fits = (
            (transitions.min(axis=(1, 2)) >= -tolerances.NOISY_PROBABILITY)
            & transitions.any(axis=(1, 2))
            & (gaps > tolerances.REACHED_BELIEF)
        )
        if not fits.any():
            continue
        misses = np.sort(_misses(matrices[fits], before, held), axis=1)[:, :n_judges]
        scores = np.concatenate([scores, misses[:, -1]])
        found = np.concatenate([found, transitions[fits]])
        best = np.argsort(scores, kind="stable")[:_KEPT]
        scores, found = scores[best], found[best]
        if scores[0] <= tolerances.EXACT_BELIEFS:
            break
    return [np.clip(each, 0.0, None) / np.clip(each, 0.0, None).sum(axis=1, keepdims=True) for each in found]


def _drawn(pairs: Array, needed: int, rng: np.random.Generator) -> np.ndarray:
    """Draw sets of steps (N,needed): one at random, the others from its nearest neighbours, which often share its symbol."""
    n_steps = len(pairs)
    seeds = rng.integers(n_steps, size=_BATCH)
    order = np.argsort(((pairs[seeds, None] - pairs) ** 2).sum(axis=2), axis=1)
    reach = np.exp(rng.uniform(np.log(needed), np.log(n_steps), _BATCH)).astype(int).clip(needed, n_steps)
    keys = rng.random((_BATCH, n_steps))
    keys[np.arange(n_steps) >= reach[:, None]] = 2.0
    keys[:, 0] = -1.0
    picked = np.argsort(keys, axis=1)[:, :needed]
    return np.take_along_axis(order, picked, axis=1)


def _misses(matrices: Array, before: Array, held: Array) -> Array:
    """Return the distance (N,K) of each belief from each matrix's update of the belief before it."""
    shown = np.einsum("nij,kj->nki", matrices, before)
    total = shown.sum(axis=2, keepdims=True)
    shown = np.divide(shown, total, out=np.zeros_like(shown), where=np.abs(total) > tolerances.TINY)
    return np.asarray(np.linalg.norm(shown - held, axis=2))
