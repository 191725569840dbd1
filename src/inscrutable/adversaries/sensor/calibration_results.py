"""Results of the calibration of a sensor from decisions under known states."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from inscrutable.saved import Saved, Summarised, saved_choice
from inscrutable.validation import Array


@saved_choice
class LikelihoodStatus(Enum):
    """Whether decisions identify the parameters of a sensor; the text says what to do.

    Example:
        >>> LikelihoodStatus.IDENTIFIED.value
        'identified: one maximum of the likelihood, inside the bounds'
    """

    IDENTIFIED = "identified: one maximum of the likelihood, inside the bounds"
    WEAK = (
        "weak: a value at a bound is nearly as plausible, so that an interval is open there: see the profile; take more "
        "decisions, or a better probe"
    )
    FLAT = "not identified: the decisions have the same probability under all sensors of the family"
    SEVERAL = "several: values apart from one another explain the decisions nearly as well; see the profile"
    IMPOSSIBLE = (
        "no sensor of the family explains the decisions: check the mechanism, and take a finer grid; the parameters are the "
        "middle of the bounds"
    )


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedSensor(Summarised, Saved):
    """The parameters of a sensor by maximum likelihood, with the profile of the likelihood.

    Formula: θ̂ = argmax_θ log Pr_θ(u_0..u_{T−1} | x_0..x_{T−1}); intervals θ̂_k ± 1.96 √(H⁻¹)_kk with H the negative second
    derivative, widened to all v with profile_k(v) ≥ log Pr_θ̂ − 1.92; profile_k(v) = max over the other parameters with θ_k = v.

    Args:
        parameters: θ̂, shape (K,).
        intervals: 95 % intervals within the bounds, shape (K,2); the bounds where the likelihood is not concave.
        log_likelihoods: The profile of each parameter at `grid`, shape (K,G), natural logarithms; −inf where decisions are
            impossible.
        status: Whether the decisions determine the parameters.
        grid: Values of each parameter in ascending order, shape (K,G), with θ̂.
        names: Names of the parameters.
        information: H, shape (K,K); NaN for a parameter whose profile contradicts the curvature, as where the likelihood
            jumps.

    Source: Krishnamurthy, Rangaswamy, How to Calibrate Your Adversary's Capabilities? Inverse Filtering for Counter-Autonomous
    Systems, arXiv 1905.07230.

    Example:
        >>> import numpy as np
        >>> one = np.ones((1, 1))
        >>> status = LikelihoodStatus.IDENTIFIED
        >>> found = CalibratedSensor(one[0], np.array([[0.7, 1.0]]), -3.0 * one, status, one, ("p",), one)
        >>> found.log_likelihood
        -3.0
    """

    parameters: Array
    intervals: Array
    log_likelihoods: Array
    status: LikelihoodStatus
    grid: Array
    names: tuple[str, ...]
    information: Array

    @property
    def log_likelihood(self) -> float:
        """The largest log-likelihood."""
        return float(self.log_likelihoods.max())

    @property
    def is_identified(self) -> bool:
        """Whether the decisions determine the parameters."""
        return self.status == LikelihoodStatus.IDENTIFIED

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        lines = [
            f"{name:<14} {value:.5g}, 95 % from {low:.5g} to {high:.5g}"
            for name, value, (low, high) in zip(self.names, self.parameters, self.intervals, strict=True)
        ]
        return "\n".join([*lines, f"log-likelihood {self.log_likelihood:.6g}", f"status         {self.status.value}"])


@dataclass(frozen=True, eq=False, repr=False)
class ProbeRanking(Summarised, Saved):
    """Fisher information about a sensor's parameters under each of several probes (sequences of states).

    Args:
        information: Fisher information of each probe, shape (N,K,K).
        bounds: Cramér–Rao bounds: least standard deviations of unbiased estimates, shape (N,K); infinite where decisions
            carry no information.
        best: Index of the probe with the least sum of variances, each in units of its parameter's range.
        is_exact: Whether the sum is over all sequences of decisions; else over a sample.
        names: Of the parameters.

    Source: Krishnamurthy, Rangaswamy, arXiv 1905.07230, Section IV; the bound is Cramér's and Rao's.

    Example:
        >>> import numpy as np
        >>> one = np.ones((1, 1, 1))
        >>> ProbeRanking(one, one[0], 0, True, ("p",)).best
        0
    """

    information: Array
    bounds: Array
    best: int
    is_exact: bool
    names: tuple[str, ...]

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        told = [
            f"probe {i}{' (best)' if i == self.best else ''}: "
            + ", ".join(f"{name} to {bound:.4g}" for name, bound in zip(self.names, row, strict=True))
            for i, row in enumerate(self.bounds)
        ]
        return "\n".join([*told, f"standard deviations at best; {'exact' if self.is_exact else 'sampled'}"])
