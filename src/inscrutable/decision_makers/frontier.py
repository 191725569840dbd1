"""Every budget at once: privacy against regret for one belief."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers.arguments import checked_measure
from inscrutable.decision_makers.candidate_sources import candidates_for
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.envelope import concave_envelope, undominated
from inscrutable.decision_makers.original import decision_for
from inscrutable.decision_makers.results import DecisionStatus
from inscrutable.decision_makers.scores import score, with_extra
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False, repr=False)
class Frontier(Summarised, Saved):
    """The privacy-utility trade-off of one belief: the best privacy as a function of regret, without and with lotteries.

    Args:
        belief: The true belief, shape (X,).
        optimal_cost: V(π), in the cost's unit; a share c_b of it is the regret c_b·|V(π)|.
        points: Regret and privacy of the undominated decisions, shape (K,2), by increasing regret.
        corners: The points on the concave envelope, shape (H,2).
        indices: Index of each point's candidate; the number of candidates stands for the optimal decision.

    Source: the paper, eq. (12) and Figure 7, for all budgets.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> frontier = privacy_frontier(problem, [0.5, 0.5])
        >>> bool(frontier.randomized(0.001) >= frontier.deterministic(0.001))
        True
    """

    belief: Array
    optimal_cost: float
    points: Array
    corners: Array
    indices: np.ndarray

    def summary(self) -> str:
        """Return a line for a person to read."""
        if not len(self.points):
            return "frontier: no decision has a privacy"
        (least, first), (most, last) = self.points[[0, -1]]
        return (
            f"frontier: {len(self.points)} decisions, from a privacy of {first:.4f} at a regret of {least:.4g} to {last:.4f} "
            f"at {most:.4g}; lotteries between {len(self.corners)} of them"
        )

    def deterministic(self, regret: ArrayLike) -> float | Array:
        """Return the privacy of the best single decision at a regret, or at many; −∞ where none is affordable."""
        limits = _regrets(regret)
        place = np.searchsorted(self.points[:, 0], limits, side="right") - 1
        values = np.where(place >= 0, self.points[np.maximum(place, 0), 1] if len(self.points) else -np.inf, -np.inf)
        return _as_given(values, regret)

    def randomized(self, regret: ArrayLike) -> float | Array:
        """Return the expected privacy of the best lottery at an expected regret, or at many."""
        limits = _regrets(regret)
        if not len(self.corners):
            return _as_given(np.full(limits.shape, -np.inf), regret)
        values = np.interp(limits, self.corners[:, 0], self.corners[:, 1])
        return _as_given(np.where(limits < self.corners[0, 0], -np.inf, values), regret)

    def price(self, regret: ArrayLike) -> float | Array:
        """Return the privacy that one more unit of expected regret buys; zero where it buys none."""
        limits = _regrets(regret)
        if len(self.corners) < 2:
            return _as_given(np.zeros(limits.shape), regret)
        slopes = np.append(np.diff(self.corners[:, 1]) / np.diff(self.corners[:, 0]), 0.0)
        place = np.searchsorted(self.corners[:, 0], limits, side="right") - 1
        return _as_given(np.where(place >= 0, slopes[np.maximum(place, 0)], 0.0), regret)


def _regrets(regret: ArrayLike) -> Array:
    limits = validation.finite_array(regret, "regret", ndim=(0, 1))
    if np.any(limits < 0):
        raise InputError(f"regret must be at least 0, got {limits.min():g}")
    return limits


def _as_given(values: Array, like: ArrayLike) -> float | Array:
    return float(values) if np.ndim(like) == 0 else np.asarray(values)


def privacy_frontier(
    problem: DecisionProblem,
    belief: ArrayLike,
    measure: PrivacyMeasure | None = None,
    candidates: Candidates | ArrayLike | None = None,
) -> Frontier:
    """Return the privacy-utility trade-off of a belief: the best privacy at every regret, for decisions and for lotteries.

    Formula: max {Ψ(u_l) : ρ_l ≤ r} and the concave envelope of the points (ρ_l, Ψ_l), both as functions of r.

    Args:
        problem: The decision problem.
        belief: π, shape (X,).
        measure: The privacy measure; None is `MaximalObfuscation()`.
        candidates: Decisions to choose from; None is about 5,000 decoys.

    Raises:
        InputError: The belief is not one point of the simplex.
        ModelError: The measure favours decisions that no belief explains, and the feasible set is unbounded.

    Cost: one pass over the candidates, some 0.5 µs each; larger sets are judged only where they can be on the frontier.
    Source: the paper's eq. (12) and Figure 7.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> frontier = privacy_frontier(problem, [0.5, 0.5])
        >>> frontier.deterministic(0.0), round(frontier.deterministic(1.0), 3)
        (0.0, 0.707)
    """
    held = validation.one_belief(belief, checked_problem(problem).n_states, names=problem.state_names)
    chosen = checked_measure(measure)
    given = candidates_for(problem, chosen, candidates)
    own = decision_for(problem, held, problem.solve(held), chosen, DecisionStatus.OPTIMAL)
    scores = with_extra(score(held, own.optimal_cost, given, chosen, "exclude"), [own])
    single, hull = scores.settled(undominated), scores.settled(concave_envelope)
    points = np.column_stack([scores.regrets, scores.privacies])
    return Frontier(held, own.optimal_cost, points[single], points[hull], single)
