"""Least leakage about thousands of alphas whose prior has the factors of the risk, without any (n,n) matrix.

With V = F Ω F' + D and S = F Ω_S F' + τ D, in x = D^{−1/2}(m − m̄) both act on the span U of D^{−1/2}F and D^{−1/2}H' (H the
equalities), and are multiples of the identity on its complement: a problem of q dimensions and one more cost, τ/4γ, n − q
times.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import tolerances
from inscrutable.alphas.error_law import ErrorLaw, bits_of, root_of, turned
from inscrutable.alphas.one_decision import directions, filled
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.risk import FactorRisk, Risk
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class FactoredErrorLaw:
    """Covariances before and after a decision, E = D^{1/2} (U T diag(e) T'U' + e₀ τ (I − UU')) D^{1/2}.

    Args:
        scale: Diagonal of D^{1/2}, shape (n,).
        span: U, orthonormal, shape (n,q).
        inside: The law of U'x.
        share: e₀, from 0 to 1.
        variance: τ.
        regret: tr(ΘE).
        silence: tr(ΘS).
    """

    scale: Array
    span: Array
    inside: ErrorLaw
    share: float
    variance: float
    regret: float
    silence: float

    @property
    def bits(self) -> float:
        """½ log2 det S − ½ log2 det E."""
        return self.inside.bits + bits_of(np.array([self.share]), np.array([self._beside]))

    @property
    def _beside(self) -> float:
        return float(self.span.shape[0] - self.span.shape[1])

    def diagonal(self, before: bool = False) -> Array:
        """Return the variances of E, or of S, shape (n,)."""
        law, share = self.inside, 1.0 if before else self.share
        held = ((self.span @ (law.before if before else law.covariance)) * self.span).sum(axis=1)
        return np.asarray(self.scale**2 * (held + share * self.variance * (1.0 - (self.span**2).sum(axis=1))))

    @property
    def covariance(self) -> Array:
        """E as a matrix (n,n), formed on demand only."""
        inside = self.inside.covariance - self.share * self.variance * np.eye(self.span.shape[1])
        found = self.span @ inside @ self.span.T + self.share * self.variance * np.eye(len(self.scale))
        return np.asarray(self.scale[:, None] * found * self.scale)

    def message(self, difference: Array, rng: np.random.Generator) -> Array:
        """Return m̂ − m̂⁻ as drawn for m − m̂⁻, both of shape (…,n)."""
        scaled = difference / self.scale
        common = scaled @ self.span
        noise = rng.standard_normal(scaled.shape)
        within = noise @ self.span
        spread = np.sqrt(self.share * (1.0 - self.share) * self.variance)
        beside = (1.0 - self.share) * (scaled - common @ self.span.T) + spread * (noise - within @ self.span.T)
        return np.asarray(self.scale * (self.inside.told(common, within) @ self.span.T + beside))


def specific_ratio(problem: AlphaProblem, prior: Risk) -> float | None:
    """Return τ if the prior has the factors of the risk and τ times its specific variances; None otherwise."""
    risk = problem.risk
    if problem.loadings is not None or not (isinstance(risk, FactorRisk) and isinstance(prior, FactorRisk)):
        return None
    if risk.exposures.shape != prior.exposures.shape or not np.array_equal(risk.exposures, prior.exposures):
        return None
    ratios = prior.specific / risk.specific
    ratio = float(ratios[0])
    return ratio if np.abs(ratios - ratio).max() <= tolerances.COMMUTING * ratio else None


def least_information_of_factors(
    problem: AlphaProblem, prior: FactorRisk, ratio: float, budget: Array
) -> FactoredErrorLaw:
    """Return the law of fewest bits at a regret of at most budget[0] + budget[1] times the silence regret.

    Cost: O(n (k + e)²) time and O(n (k + e)) memory for k factors and e equalities.
    """
    assert isinstance(problem.risk, FactorRisk)
    scale = np.sqrt(problem.risk.specific)
    span = _span(np.hstack([problem.risk.exposures, problem.equalities[0].T]) / scale[:, None])
    theta = span.T @ (scale[:, None] * problem.theta_times(scale[:, None] * span))
    before = span.T @ (prior.times(span / scale[:, None]) / scale[:, None])
    root = root_of(before)
    costs, turn = directions(root[0], theta)
    many = np.append(np.ones(len(costs)), len(scale) - span.shape[1])
    all_costs = np.append(costs, ratio / (4.0 * problem.risk_aversion))
    silence = float(many @ all_costs)
    shares = filled(all_costs, float(budget[0] + budget[1] * silence), many)
    law = turned(root, turn, shares[:-1])
    regret = float((many * all_costs) @ shares)
    return FactoredErrorLaw(scale, span, law, float(shares[-1]), ratio, regret, silence)


def _span(columns: Array) -> Array:
    size = np.linalg.norm(columns, axis=0)  # of factors and rows, each in a unit of its own
    left, values, _ = np.linalg.svd(columns / np.where(size > 0.0, size, 1.0), full_matrices=False)
    return np.asarray(left[:, values > np.sqrt(tolerances.NO_VARIANCE) * values.max(initial=0.0)])
