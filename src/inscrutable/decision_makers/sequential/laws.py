"""The observer's law of the present belief, and its dynamics."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from inscrutable.errors import InputError
from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.validation import Array
from inscrutable.worlds.observations import symbols


class ChainLaw:
    """Laws p (B,) of a belief that moves by a chain."""

    def __init__(self, chain: BeliefChain) -> None:
        self.chain = chain
        tables = [chain.transition] if chain.public is None else chain.public
        self._forwards: list[Any] = [sparse.csr_array(each.T) for each in tables]

    @property
    def prior(self) -> Prior:
        """The beliefs, and their long-run law."""
        return self.chain.prior

    @property
    def n_public(self) -> int | None:
        """Number of public symbols at a step; None where nothing is public."""
        return None if self.chain.public is None else len(self._forwards)

    def symbols(self, public: Any, n_steps: int) -> np.ndarray:
        """Return the public information of `n_steps` steps as symbols; real numbers, one row a step, become their cells.

        Raises `InputError` where it is neither symbols nor such rows, or of another length.
        """
        if self.n_public is None:
            raise InputError("public was given, but the rule's chain has no public information")
        cells = self.chain.cells
        is_real = cells is not None and np.ndim(public) == 2
        read = cells.symbols(public) if cells is not None and is_real else symbols(public, self.n_public, "public")
        if len(read) != n_steps:
            raise InputError(f"public has {len(read)} entries, expected one per belief: {n_steps}")
        return read

    @property
    def is_still(self) -> bool:
        """Whether no belief ever changes, and nothing is public."""
        return self.chain.public is None and bool((self.chain.transition.diagonal() >= 1.0).all())

    def start(self) -> Array:
        """Return the law before the first decision and the first public symbol."""
        return np.array(self.chain.prior.weights)

    def seen(self, state: Array, shares: Array) -> Array:
        """Return the law after a decision that beliefs play with the probabilities `shares` (B,): Bayes' rule."""
        found = state * shares
        return np.asarray(found / found.sum())

    def moved(self, state: Array, read: int | None = None) -> Array:
        """Return the law one step later, given the public symbol then: p T_z.

        Raises `InputError` where the symbol has probability 0.
        """
        found = self._forwards[0 if read is None else read] @ state
        total = found.sum()
        if not total > 0:
            raise InputError(f"the public symbol {read} has probability 0, given the earlier decisions and symbols")
        return np.asarray(found / total)

    def later(self, state: Array, n_steps: int) -> Array:
        """Return the law `n_steps` steps later, where nothing is public."""
        for _ in range(n_steps):
            state = self.moved(state)
        return state

    def drawn(self, state: Array, uniform: float) -> int | None:
        """Return the public symbol one step later, drawn by inversion of its law; None where nothing is public."""
        if self.n_public is None:
            return None
        sums = np.cumsum([(each @ state).sum() for each in self._forwards])
        return int(np.searchsorted(sums, uniform * sums[-1], side="right").clip(max=len(sums) - 1))
