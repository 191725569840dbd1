"""An observer's law of the private belief at each step of a sequence of decisions."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.saved import Saved, Summarised, saved_choice
from inscrutable.validation import Array


@saved_choice
class SequenceStatus(Enum):
    """How the filter used one decision of a sequence; the text says what to do.

    Example:
        >>> SequenceStatus.USED.value
        'used: some belief that was still possible plays the decision'
    """

    USED = "used: some belief that was still possible plays the decision"
    NEAREST = (
        "read as the nearest known decisions: none of the mechanism's beliefs plays exactly this one, as with a belief between "
        "those of its grid, or a rounded decision"
    )
    WIDENED = (
        "used with a tolerance: of the grid's beliefs none that was still possible plays it, so half of the law moves to the "
        "nearest that do; take a finer grid or particles"
    )
    UNSEEN = "no decision was seen"
    NEVER_PLAYED = (
        "passed over, because the mechanism never plays it: is this the agent's mechanism, was the decision rounded? "
        "`nearest=True` takes the nearest one played"
    )
    CONTRADICTED = (
        "passed over, because no belief that was still possible plays it: take a finer grid or more particles, or doubt "
        "the model"
    )


@dataclass(frozen=True, eq=False, repr=False)
class InferredBeliefs(Summarised, Saved):
    """The observer's law of the agent's private belief at each of T steps.

    Formula: weights[t,b] = Pr(π_t = π_b | what was seen), mean_t = Σ_b weights[t,b] π_b, spread_t² = E‖π_t − mean_t‖².

    Args:
        beliefs: π_b, the mechanism's beliefs, shape (B,X).
        weights: Shape (T,B); for particles, the weights of the mixtures of these beliefs that represent them.
        mean: The observer's estimate of the private belief, shape (T,X).
        spread: The observer's expected root mean square distance of the belief from the estimate, shape (T,).
        states: Pr(x_t | what was seen), shape (T,X).
        log_likelihood: Natural logarithm of the probability of each step's evidence given the earlier evidence, shape (T,). It
            is −inf where a decision had probability zero and was skipped; for a decision read with a tolerance it is that of
            the replacement beliefs.
        statuses: One `SequenceStatus` per step.
        effective_size: 1/Σ w² over the beliefs of the grid, or over the particles, shape (T,).
        interpolation_error: Expected distance of the agent's belief from the mechanism's beliefs that represent it at that
            step, shape (T,); 0 everywhere where the law is exact.
        n_particles: Number of particles; 0 on a grid.

    Source: Mattila, Rojas, Krishnamurthy, Wahlberg, Inverse Filtering for Hidden Markov Models (2017).

    Example:
        >>> one = np.ones(1)
        >>> found = InferredBeliefs(
        ...     np.eye(2), np.eye(2)[:1], np.eye(2)[:1], 0 * one, np.eye(2)[:1], 0 * one, (SequenceStatus.USED,), one, 0 * one
        ... )
        >>> found.error_of([[0.7, 0.3]]), found.is_exact
        (0.42426406871192857, True)
    """

    beliefs: Array
    weights: Array
    mean: Array
    spread: Array
    states: Array
    log_likelihood: Array
    statuses: tuple[SequenceStatus, ...]
    effective_size: Array
    interpolation_error: Array
    n_particles: int = 0

    def __len__(self) -> int:
        return len(self.statuses)

    @property
    def is_exact(self) -> bool:
        """Whether the law is exact: no particles, and the mechanism lists every belief the agent can hold at these steps."""
        return self.n_particles == 0 and bool(self.interpolation_error.max(initial=0.0) <= tolerances.SAME_BELIEF)

    def errors_of(self, beliefs: ArrayLike) -> Array:
        """Return the Euclidean distance of each estimate from the agent's belief (T,X), shape (T,).

        Raises:
            InputError: The number of beliefs differs from that of the steps.
        """
        held = validation.many_beliefs(beliefs, self.mean.shape[1])
        if held.shape != self.mean.shape:
            raise InputError(f"{len(held)} beliefs were given for {len(self)} steps; expected one each")
        return np.asarray(np.linalg.norm(held - self.mean, axis=1))

    def error_of(self, beliefs: ArrayLike) -> float:
        """Return the observer's root mean square error, that of `errors_of`."""
        return float(np.sqrt(np.mean(self.errors_of(beliefs) ** 2)))

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        by = f"{self.n_particles} particles" if self.n_particles else f"a grid of {len(self.beliefs)} beliefs"
        expected = float(np.sqrt(np.mean(self.spread**2)))
        lines = [
            f"steps          {len(self)}, by {by}{', exact' if self.is_exact else ''}",
            f"expected error {expected:.4f}, root mean square over the steps",
            f"representation {self.interpolation_error.mean():.4g} on average, {self.interpolation_error.max():.4g} at most",
            f"effective size {self.effective_size.min():.1f} at least",
        ]
        counted = Counter(self.statuses)
        lines += [f"{counted[each]:>5} steps    {each.value}" for each in SequenceStatus if counted[each]]
        return "\n".join(lines)
