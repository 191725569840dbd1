"""Child seeds of many tasks at once: what `numpy.random.SeedSequence` says of each, in a hundredth of the time.

A row names its task's seed by one number. To make a `SeedSequence` for that takes longer than all else that is done beside a
small task. Its algorithm is fixed by NumPy's promise that streams stay the same; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

Words = np.ndarray[Any, np.dtype[np.uint32]]

_POOL = 4  # words of 32 bits in a pool of entropy
_HASH_FIRST, _HASH_STEP = 0x43B0D7E5, 0x931E8875
_STATE_FIRST, _STATE_STEP = 0x8B51F9DD, 0x58F38DED
_LEFT, _RIGHT = np.uint32(0xCA01F9DD), np.uint32(0x4973F715)
_HALF = np.uint32(16)
_WORD_BITS = 32
_MODULUS = 1 << _WORD_BITS


class _Hash:
    """Hashes words with a constant that moves on at every call."""

    def __init__(self, constant: int, step: int) -> None:
        self._constant, self._step = constant, step

    def __call__(self, words: Words) -> Words:
        words = words ^ np.uint32(self._constant)
        self._constant = self._constant * self._step % _MODULUS
        hashed: Words = words * np.uint32(self._constant)
        return hashed ^ (hashed >> _HALF)


def _mixed(pool: Words, words: Words) -> Words:
    found: Words = pool * _LEFT - words * _RIGHT
    return found ^ (found >> _HALF)


def seed_numbers(seed: int, keys: Sequence[str]) -> list[int]:
    """Return the first 64 bits of every key's child of a seed.

    Args:
        seed: The parent's entropy, at least 0.
        keys: Hexadecimal texts, all of one length, a multiple of 8 characters.

    Example:
        >>> child = np.random.SeedSequence(7, spawn_key=(0xABCD0123, 5))
        >>> seed_numbers(7, ["abcd012300000005"]) == child.generate_state(1, np.uint64).tolist()
        True
    """
    if not keys:
        return []
    words = np.frombuffer(bytes.fromhex("".join(keys)), dtype=">u4").astype(np.uint32).reshape(len(keys), -1)
    n_words = max(1, -(-seed.bit_length() // _WORD_BITS))
    constant = (
        _HASH_FIRST  # the parent's pool took a hash for each of its words, for each pair, and for what did not fit
    )
    hashes = _POOL + _POOL * (_POOL - 1) + _POOL * max(0, n_words - _POOL)
    mixing = _Hash(constant * pow(_HASH_STEP, hashes, _MODULUS) % _MODULUS, _HASH_STEP)
    pool = [np.full(len(keys), word, dtype=np.uint32) for word in np.random.SeedSequence(seed).pool]
    for column in words.T:
        pool = [_mixed(part, mixing(column)) for part in pool]
    state = _Hash(_STATE_FIRST, _STATE_STEP)
    low, high = (state(part).astype(np.uint64) for part in pool[:2])
    found: list[int] = (low | high << np.uint64(_WORD_BITS)).tolist()
    return found
