"""The aware observer, who knows the mechanism and a prior: Bayes' rule, decision by decision."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.adversaries.decision_tables import near_enough, nearest_count
from inscrutable.axes import Axis, ordered_array
from inscrutable.errors import InputError
from inscrutable.mechanisms import Disclosure, Mechanism, Prior
from inscrutable.mechanisms.disclosed import disclosed, single_decisions
from inscrutable.mechanisms.joint import Joint, joint_law, top_states
from inscrutable.mechanisms.matching import checked_mechanism
from inscrutable.saved import Saved, Summarised, saved_choice
from inscrutable.validation import Array


@saved_choice
class PosteriorStatus(Enum):
    """Whether the mechanism plays the observed decision; the text says what to do.

    Example:
        >>> PosteriorStatus.PLAYED.value
        "Bayes' rule: the mechanism plays this decision"
    """

    PLAYED = "Bayes' rule: the mechanism plays this decision"
    NEVER_PLAYED = (
        "never played under any belief the prior holds possible, so Bayes' rule says nothing: "
        "check the mechanism and the decision's digits, or ask for the nearest played decision with nearest=True"
    )
    NEAREST_PLAYED = "never played: read as the nearest decisions that are; see `distance` before trusting it"


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(Summarised, Saved):
    """An observer's posterior of the belief after one decision.

    Formula: p(π_b|u) = w_b K(u|π_b) / Σ_b' w_b' K(u|π_b').

    Args:
        weights: p(π_b|u), shape (B,); all NaN where the decision is never played.
        mean: E[π|u] = Σ p(π_b|u) π_b, shape (X,); NaN where the decision is never played.
        beliefs: π_b, the mechanism's beliefs, shape (B,X).
        status: Whether the mechanism plays the decision, and if not, what the numbers mean.
        probability: p(u), the probability under the prior of the decision, or of those that it is read as; 0 where unknown.
        distance: Euclidean distance from the decision to the nearest played one, in the decision's unit; 0 for a played one.

    Source: Bayes' rule; the paper's outlook in Section V.

    Example:
        >>> from inscrutable import BayesianAdversary, Mechanism, Prior
        >>> prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5])
        >>> plain = Mechanism(prior.beliefs, [[0.0], [1.0]], [[0.75, 0.25], [0.25, 0.75]], [[0.0, 1.0], [1.0, 0.0]])
        >>> print(BayesianAdversary(plain, prior).infer([0.0]).summary())
        mean          [0.7500 0.2500], error 0.6124
        most likely   state 0; entropy 0.8113 bits; 90% of the weight on 2 of 2 beliefs
        status        Bayes' rule: the mechanism plays this decision
    """

    weights: Array
    mean: Array
    beliefs: Array
    status: PosteriorStatus = PosteriorStatus.PLAYED
    probability: float = float("nan")
    distance: float = 0.0

    @property
    def is_known(self) -> bool:
        """Whether the weights are numbers."""
        return self.status is not PosteriorStatus.NEVER_PLAYED

    @property
    def top_state(self) -> int:
        """The state i of largest Σ_b p(π_b|u) [i is a likeliest state of π_b]; −1 where the posterior is unknown."""
        return int((self.weights @ top_states(self.beliefs)).argmax()) if self.is_known else -1

    @property
    def entropy(self) -> float:
        """−Σ p(π_b|u) log2 p(π_b|u), in bits; NaN where the decision is never played."""
        held = self.weights[self.weights > 0]
        return float(-(held * np.log2(held)).sum()) + 0.0 if self.is_known else float("nan")

    @property
    def error(self) -> float:
        """√Σ p(π_b|u) ‖π_b − mean‖², the root mean square error of the estimate; NaN where unknown."""
        return float(np.sqrt(self.weights @ ((self.beliefs - self.mean) ** 2).sum(axis=1)))

    def credible_indices(self, level: float = 0.9) -> np.ndarray:
        """Return the indices of the fewest beliefs that hold at least `level` of the weight, heaviest first.

        The result is empty for a decision that is never played. Raises `InputError` for a level outside (0, 1].
        """
        share = validation.positive(level, "level")
        if share > 1:
            raise InputError(f"level must be at most 1, got {share:g}")
        if not self.is_known:
            return np.zeros(0, dtype=np.intp)
        order = np.argsort(-self.weights, kind="stable")
        reached = np.cumsum(self.weights[order])
        count = 1 + int(np.searchsorted(reached, share - tolerances.BELIEF_SUM))
        return order[: min(count, int((self.weights > 0).sum()))]

    def credible_region(self, level: float = 0.9) -> Array:
        """Return the fewest beliefs that hold at least `level` of the weight, shape (k,X), heaviest first."""
        return np.asarray(self.beliefs[self.credible_indices(level)])

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        lines = [f"status        {self.status.value}"]
        if self.is_known:
            mean = "[" + " ".join(f"{share:.4f}" for share in self.mean) + "]"
            fewest = f"{len(self.credible_indices())} of {len(self.weights)} beliefs"
            lines = [
                f"mean          {mean}, error {self.error:.4f}",
                f"most likely   state {self.top_state}; entropy {self.entropy:.4f} bits; 90% of the weight on {fewest}",
                *lines,
            ]
        return "\n".join(lines)


class BayesianAdversary:
    """The aware observer: it knows the mechanism K(u|π) and a prior over beliefs.

    Formula: p(π_b|u) ∝ w_b K(u|π_b).

    Args:
        mechanism: K(u|π), public except for the random draws.
        prior: Weights of the mechanism's beliefs, in any order; it may hold only some of them.
        disclosure: What the observer sees of a decision, such as `rounded(2)`, also as text; None: all of it. With a disclosure
            the methods take disclosed values, `disclosure.shown(actions)`.

    Raises:
        InputError: The mechanism lacks a belief of the prior; or the disclosure does not suit the decisions, leaves some out,
            or needs returns.

    Cost: one pass over the nonzero entries of K; then one tree search and one sparse column per decision.

    Source: Kerckhoffs' principle with Bayes' rule.

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker, mechanism, uniform_prior
        >>> prior = uniform_prior(2, 3)
        >>> played = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), prior.beliefs)
        >>> BayesianAdversary(played, prior).infer(0).mean.round(4)
        array([0.8333, 0.1667])
    """

    def __init__(self, mechanism: Mechanism, prior: Prior, *, disclosure: Disclosure | str | None = None) -> None:
        self.mechanism = mechanism
        self.prior = prior
        self.disclosure = single_decisions(Disclosure.of(disclosure), "BayesianAdversary")
        self._seen = disclosed(checked_mechanism(mechanism), self.disclosure)
        self._joint: Joint = joint_law(self._seen, prior)
        self._played = np.flatnonzero(self._joint.played > 0)
        actions = np.asarray(self._seen.actions, dtype=np.float64)
        self._points = actions.reshape(len(actions), -1)

    def __repr__(self) -> str:
        return f"BayesianAdversary({len(self._joint.weights)} beliefs, {len(self._played)} played decisions)"

    @cached_property
    def _tree(self) -> Any:
        return cKDTree(self._points[self._played])

    @cached_property
    def _columns(self) -> Any:
        return self._joint.table.tocsc()

    def infer(self, action: ArrayLike, *, nearest: int = 0) -> Posterior:
        """Return the posterior after one decision.

        Args:
            action: u, shape (U,), in the decision's unit; a whole number where decisions are finite choices.
            nearest: k: a decision that is never played is read as one of the k nearest that are, p(π_b|u) ∝ w_b Σ_k K(u_k|π_b),
                without those ten thousand times farther than the nearest; 0: its posterior is unknown; True: k = 1.

        Raises:
            InputError: The decision has the wrong length or is not finite; or `nearest` is negative.
        """
        given = ordered_array(action, "action", None)
        wanted = np.asarray(self._seen.actions).ndim - 1
        if given.ndim != wanted:
            raise InputError(f"action must be one decision of rank {wanted}, got shape {given.shape}")
        return self.infer_many(given[None], nearest=nearest)[0]

    def infer_many(self, actions: ArrayLike, *, nearest: int = 0) -> tuple[Posterior, ...]:
        """Return the posterior after each of many decisions (M,U), each seen alone; as `infer`."""
        return tuple(self._posterior(*each) for each in zip(*self._read(actions, nearest), strict=True))

    def estimate(self, action: ArrayLike, *, nearest: int = 0) -> Array:
        """Return the posterior mean after one decision, shape (X,); NaN for one never played, unless `nearest`."""
        return self.infer(action, nearest=nearest).mean

    def estimates(self, actions: ArrayLike, *, nearest: int = 0) -> Array:
        """Return the posterior means after many decisions (M,U), shape (M,X); NaN for those never played."""
        places, status, _ = self._read(actions, nearest)
        found = np.array([self._mean(each) for each in places]).reshape(len(places), self._joint.means.shape[1])
        found[[each is PosteriorStatus.NEVER_PLAYED for each in status]] = np.nan
        return np.asarray(found)

    def _read(self, actions: ArrayLike, nearest: int) -> tuple[list[np.ndarray], list[PosteriorStatus], Array]:
        """Return the numbers of the played decisions that each action is read as, its status, and its distance."""
        count = nearest_count(nearest)
        rank = np.asarray(self._seen.actions).ndim
        given = validation.finite_array(actions, "actions", ndim=rank, axes=(None, Axis("asset"))[:rank])
        points = given if given.ndim == 2 else given[:, None]
        if points.shape[1] != self._points.shape[1]:
            raise InputError(f"action has {points.shape[1]} coordinates, expected {self._points.shape[1]}")
        apart, exact = self._tree.query(points, p=np.inf)
        distances, near = self._tree.query(points, k=range(1, 1 + min(max(count, 1), len(self._played))))
        same = apart <= tolerances.SAME_ACTION
        otherwise = PosteriorStatus.NEAREST_PLAYED if count else PosteriorStatus.NEVER_PLAYED
        status = [PosteriorStatus.PLAYED if each else otherwise for each in same]
        places = [
            self._played[[exact[i]] if same[i] else near[i, near_enough(distances[i])]] for i in range(len(points))
        ]
        return places, status, np.where(same, 0.0, distances[:, 0])

    def _mean(self, places: np.ndarray) -> Array:
        """Return E[π | one of these decisions], (X,)."""
        return np.asarray(np.average(self._joint.means[places], axis=0, weights=self._joint.played[places]))

    def _posterior(self, places: np.ndarray, status: PosteriorStatus, distance: float) -> Posterior:
        beliefs = self._joint.beliefs
        if status is PosteriorStatus.NEVER_PLAYED:
            unknown = np.full(len(beliefs), np.nan), np.full(beliefs.shape[1], np.nan)
            return Posterior(*unknown, beliefs, status, 0.0, float(distance))
        column = self._columns[:, places].toarray().sum(axis=1)
        total = float(self._joint.played[places].sum())
        return Posterior(column / total, self._mean(places), beliefs, status, total, float(distance))
