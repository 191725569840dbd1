"""Whether an observer can detect altered decisions: by one decision that no belief explains, or by frequencies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from inscrutable.adversaries.consistent_sets import consistent_sets
from inscrutable.adversaries.observers import NaiveAdversary
from inscrutable.adversaries.plausibility import nearest_explanations
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.joint import joint_law
from inscrutable.mechanisms.matching import points_in
from inscrutable.mechanisms.priors import checked_prior
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class Detectability(Summarised, Saved):
    """Detectability: how well a test of one decision separates a mechanism from the optimal rule, under a prior.

    Formula: p(u) = Σ_b w_b K(u|π_b) for the mechanism, q(u) = Σ_b w_b [u = u*(π_b)] for the optimal decisions, and
    r(u) = min_π ρ(π,u).

    Args:
        expected_gap: Σ_u p(u) r(u), in the cost's unit.
        largest_gap: The largest r(u) of a played decision, in the cost's unit.
        implausible_share: Σ_u p(u) [no belief explains u]: the probability that one decision alone proves the alteration.
        auc: P(λ(u) > λ(v)) + ½ P(λ(u) = λ(v)) for u drawn from p and v from q, with λ = p/q: ½ where a test is no better
            than chance.
        total_variation: ½ Σ_u |p(u) − q(u)|: with equal odds the best test is right with probability (1 + this)/2.
        divergence: Σ_u p(u) log2(p(u)/q(u)), in bits a decision: the growth of evidence over independent decisions; infinite
            where some decision is optimal under no belief of the prior.
        read_auc: The AUC of an observer who uses only the naive estimate, rounded to the nearest belief of the prior; the
            estimate is the mean of the corners of Π(u), and all decisions that no belief explains are one outcome.
        read_total_variation: The total variation of these estimates.
        gaps: r(u) of each of the mechanism's decisions, shape (M,); NaN for one never played.
        likelihood_ratios: λ of each of them, shape (M,): infinite where q is zero, NaN where both are.
        excuses: For a played decision that no belief explains, the belief of least regret, shape (M,X); NaN for others.

    Where a prior's points approximate a continuum, a comparison decision by decision is pessimistic: a decision that is
    optimal between two points differs from all that are optimal at the points. The gaps and `read_` figures avoid this.

    Source: Neyman and Pearson (1933) for the ratio; the area under the curve as a probability: Hanley and McNeil (1982).

    Example:
        >>> from inscrutable import FiniteProblem, Mechanism, uniform_prior
        >>> problem, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), uniform_prior(2, 1)
        >>> coin = Mechanism(prior.beliefs, [0, 1], [[1.0, 0.0], [0.5, 0.5]], [[0.0, 1.0], [1.0, 0.0]])
        >>> found = detectability(coin, prior, problem)
        >>> found.auc, found.total_variation, found.implausible_share
        (0.625, 0.25, 0.0)
    """

    expected_gap: float
    largest_gap: float
    implausible_share: float
    auc: float
    total_variation: float
    divergence: float
    read_auc: float
    read_total_variation: float
    gaps: Array
    likelihood_ratios: Array
    excuses: Array

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        return "\n".join(
            [
                f"implausible  {self.implausible_share:.1%} of the play; "
                f"plausibility gap {self.expected_gap:.3g} expected, {self.largest_gap:.3g} at most",
                f"one decision against one optimal decision: AUC {self.auc:.4f}, "
                f"total variation {self.total_variation:.4f}, {self.divergence:.4g} bits a decision",
                f"the same by the belief it reads: AUC {self.read_auc:.4f}, "
                f"total variation {self.read_total_variation:.4f}",
            ]
        )


def detectability(mechanism: Mechanism, prior: Prior, problem: DecisionProblem) -> Detectability:
    """Return the detectability of a mechanism: how well a test of one decision separates it from the optimal rule.

    Formula: those of `Detectability`.

    Args:
        mechanism: K(u|π).
        prior: Weights of the mechanism's beliefs, in any order; it may hold only some of them.
        problem: The decision problem that the observer knows.

    Raises:
        InputError: A belief of the prior is none of the mechanism's, or the problem has another number of states or
            other decisions.
        SolverError: The cutting planes of a plausibility gap did not converge.

    Cost: one forward solve a belief, and some tens of them for each played decision that no belief explains.

    Source: see `Detectability`.

    Example:
        >>> from inscrutable import MarkowitzProblem, OriginalDecisionMaker, mechanism, uniform_prior
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> prior = uniform_prior(2, 4)
        >>> detectability(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem).auc
        0.5
    """
    joint = joint_law(mechanism, prior)
    points = points_in(problem, mechanism)
    checked_prior(prior, problem)
    gaps, excuses, explained = _gaps(problem, points, joint.played > 0)
    some = joint.weights > 0
    honest = problem.solve_points(joint.beliefs[some])
    first = first_same(np.vstack([points, honest]))
    total = len(first)
    hiding = _by_decision(first[: len(points)], joint.played, total)
    open_ = _by_decision(first[len(points) :], joint.weights[some], total)
    shown = joint.played > 0
    place = _readings(problem, np.vstack([points, honest]), joint.beliefs[some])
    outcomes = int(some.sum()) + 1
    read = _by_decision(place, hiding, outcomes), _by_decision(place, open_, outcomes)
    return Detectability(
        expected_gap=float(joint.played[shown] @ gaps[shown]),
        largest_gap=float(gaps[shown].max()),
        implausible_share=min(float(joint.played[~explained].sum()), 1.0),
        auc=area_under_curve(hiding, open_),
        total_variation=_variation(hiding, open_),
        read_auc=area_under_curve(*read),
        read_total_variation=_variation(*read),
        divergence=_divergence(hiding, open_),
        gaps=gaps[first[: len(points)]],
        likelihood_ratios=_ratios(hiding[first], open_[first])[: len(points)],
        excuses=excuses,
    )


def area_under_curve(hiding: Array, honest: Array) -> float:
    """Return P(λ(u) > λ(v)) + ½ P(λ(u) = λ(v)), u ~ p, v ~ q, λ = p/q, for two laws on the same decisions (N,)."""
    some = (hiding > 0) | (honest > 0)
    p, q = hiding[some], honest[some]
    # The share p/(p+q) orders as p/q does, and is finite.
    _, group = np.unique(p / (p + q), return_inverse=True)
    by_p, by_q = np.bincount(group.reshape(-1), weights=p), np.bincount(group.reshape(-1), weights=q)
    below = np.cumsum(by_q) - by_q
    return min(float(by_p @ (below + 0.5 * by_q)), 1.0)


def _readings(problem: DecisionProblem, decisions: Array, beliefs: Array) -> np.ndarray:
    """The belief (of B) nearest to the naive reading of every decision, B for those that none explains, shape (N,)."""
    estimates = NaiveAdversary(problem).estimates(decisions)
    empty = np.isnan(estimates[:, 0])
    place = np.full(len(decisions), len(beliefs))
    place[~empty] = cKDTree(beliefs).query(estimates[~empty])[1]
    return place


def _variation(hiding: Array, honest: Array) -> float:
    return min(0.5 * float(np.abs(hiding - honest).sum()), 1.0)


def _by_decision(first: np.ndarray, shares: Array, total: int) -> Array:
    """Shares added up where decisions are equal, shape (N,)."""
    return np.asarray(np.bincount(first, weights=shares, minlength=total), dtype=np.float64)


def _gaps(problem: DecisionProblem, points: Array, played: np.ndarray) -> tuple[Array, Array, np.ndarray]:
    """Plausibility gaps of the played decisions (M,), NaN elsewhere, the nearest beliefs of those that none explains (M,X),
    NaN elsewhere, and which decisions some belief explains."""
    gaps, explained = np.full(len(points), np.nan), np.ones(len(points), dtype=bool)
    excuses = np.full((len(points), problem.n_states), np.nan)
    index = np.flatnonzero(played)
    explained[index] = consistent_sets(problem, points[index]).dimension >= 0
    gaps[index] = 0.0
    if not explained.all():
        excuses[~explained], gaps[~explained] = nearest_explanations(problem, points[~explained])
    return gaps, excuses, explained


def _ratios(hiding: Array, honest: Array) -> Array:
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(hiding / honest)


def _divergence(hiding: Array, honest: Array) -> float:
    some = hiding > 0
    if (honest[some] == 0).any():
        return float("inf")
    return max(float(hiding[some] @ np.log2(hiding[some] / honest[some])), 0.0)  # rounding only
