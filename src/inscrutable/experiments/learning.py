"""The learning curve of an observer who has only data: its error by number of pairs of belief and decision."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from inscrutable import validation
from inscrutable.adversaries.data_adversary import DataAdversary
from inscrutable.errors import InputError
from inscrutable.experiments.guesses import guess_error, guesses_of, top_state_share
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.joint import Joint, joint_law
from inscrutable.privacy import leakage
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array

REPEATS = 5


@dataclass(frozen=True, eq=False, repr=False)
class LearningCurve(Summarised, Saved):
    """The error of an observer who has only data, by the number of pairs of belief and decision.

    Args:
        pairs: Numbers of pairs, shape (S,).
        errors: Root mean square error of its estimates, Euclidean, in units of belief, shape (S,): the mean over the exact law
            of belief and decision, and over repeats.
        error_se: Standard errors over repeats, shape (S,).
        top_state: Probability that it names a most likely state, shape (S,).
        bayes_error: Error of the aware observer, a lower bound for every number of pairs.
        prior_error: Error of an observer who knows the mean belief and sees no decision.

    Source: `learning_curve`.

    Example:
        >>> found = LearningCurve(np.array([100]), np.array([0.2]), np.array([0.01]), np.array([0.7]), 0.15, 0.4)
        >>> print(found.summary())
              100 pairs   error 0.2000 ± 0.0100, top state named 70.0%
        mechanism known   error 0.1500
           no decisions   error 0.4000
    """

    pairs: np.ndarray
    errors: Array
    error_se: Array
    top_state: Array
    bayes_error: float
    prior_error: float

    def summary(self) -> str:
        """Return a line per number of pairs."""
        lines = [
            f"{n:>9,} pairs   error {error:.4f} ± {spread:.4f}, top state named {named:.1%}"
            for n, error, spread, named in zip(self.pairs, self.errors, self.error_se, self.top_state, strict=True)
        ]
        known = f"mechanism known   error {self.bayes_error:.4f}"
        return "\n".join([*lines, known, f"   no decisions   error {self.prior_error:.4f}"])


def learning_curve(
    mechanism: Mechanism, prior: Prior, pairs: Sequence[int], *, rng: np.random.Generator, repeats: int = REPEATS
) -> LearningCurve:
    """Return the error of an observer who has only data, by the number of pairs of belief and decision.

    Formula: √Σ w_b K(u|π_b) ‖π_b − ŷ_n(u)‖², ŷ_n learned from n independent pairs; the squared error is averaged over repeats.

    Args:
        mechanism: K(u|π), unknown to the observer.
        prior: Weights of the mechanism's beliefs, unknown to the observer.
        pairs: Numbers of pairs, each at least 10.
        rng: Source of the pairs.
        repeats: Number of samples of pairs per point, at least 1.

    Raises:
        InputError: An argument is malformed, or scikit-learn is missing.

    Cost: about 10 ms per number of pairs and repeat.

    Source: `DataAdversary`; errors over the exact law, as `leakage`.

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker, mechanism, uniform_prior
        >>> prior = uniform_prior(2, 20)
        >>> played = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), prior.beliefs)
        >>> found = learning_curve(played, prior, (20, 2000), rng=np.random.default_rng(0))
        >>> bool(found.bayes_error < found.errors[1] < found.errors[0])
        True
    """
    source, times = validation.generator(rng), validation.count(repeats, "repeats")
    counts = np.array(
        [validation.count(n, "pairs") for n in (pairs if isinstance(pairs, Iterable) else ())], dtype=np.intp
    )
    if not len(counts):
        raise InputError(f"pairs must be a list of at least one number of pairs, such as (100, 1000), got {pairs!r}")
    joint, known = joint_law(mechanism, prior), leakage(mechanism, prior)
    squares, named = np.empty((len(counts), times)), np.empty((len(counts), times))
    for s, n in enumerate(counts):
        for r, stream in enumerate(source.spawn(times)):
            error, named[s, r] = _read(mechanism, prior, joint, int(n), stream)
            squares[s, r] = error**2
    errors = np.sqrt(squares.mean(axis=1))
    spread = np.sqrt(squares).std(axis=1, ddof=1) / np.sqrt(times) if times > 1 else np.full(len(counts), np.nan)
    return LearningCurve(counts, errors, spread, named.mean(axis=1), known.bayes_error, known.prior_error)


def _read(
    mechanism: Mechanism, prior: Prior, joint: Joint, n_pairs: int, rng: np.random.Generator
) -> tuple[float, float]:
    observer = DataAdversary.of(mechanism, prior, n_pairs, rng=rng)
    guesses = guesses_of(observer, np.asarray(mechanism.actions), joint)
    return guess_error(joint, guesses), top_state_share(joint, guesses)
