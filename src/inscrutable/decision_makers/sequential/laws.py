"""What the observer holds of the present belief, and how it moves from step to step."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.validation import Array


class ChainLaw:
    """Laws p (B,) of a belief that moves by a chain."""

    def __init__(self, chain: BeliefChain) -> None:
        self.chain = chain
        self._forward: Any = sparse.csr_array(chain.transition.T)

    @property
    def prior(self) -> Prior:
        """The beliefs, and their long-run law."""
        return self.chain.prior

    @property
    def is_still(self) -> bool:
        """Whether no belief ever moves."""
        return bool((self.chain.transition.diagonal() >= 1.0).all())

    def start(self) -> Array:
        """Return the law before the first decision."""
        return np.array(self.chain.prior.weights)

    def seen(self, state: Array, shares: Array) -> Array:
        """Return the law after a decision that beliefs play with the probabilities `shares` (B,): Bayes' rule."""
        found = state * shares
        return np.asarray(found / found.sum())

    def moved(self, state: Array, steps: int = 1) -> Array:
        """Return the law so many steps later: p T."""
        for _ in range(steps):
            found = self._forward @ state
            state = np.asarray(found / found.sum())
        return state

    def weights(self, state: Array) -> Array:
        """Return the law of the belief, shape (B,)."""
        return state
