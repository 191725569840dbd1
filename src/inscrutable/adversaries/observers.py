"""Observers who do not know the mechanism: naive, near-optimal and budget-aware."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.budget_aware import AffordableBeliefs, affordable_beliefs
from inscrutable.adversaries.consistent_sets import consistent_sets
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.adversaries.near_optimal import NearOptimalBeliefs, near_optimal_beliefs, regret_rounding
from inscrutable.adversaries.plausibility import nearest_explanations
from inscrutable.adversaries.shown_beliefs import ShownBeliefs, ShownReading
from inscrutable.axes import ordered_array
from inscrutable.budgets import Budget, as_budget
from inscrutable.errors import InputError
from inscrutable.geometry import BeliefSet
from inscrutable.geometry.hulls import LARGER
from inscrutable.mechanisms import Disclosure, Prior
from inscrutable.mechanisms.priors import checked_prior
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array

_BLOCK = 2**22
"""Most regrets in memory at once."""


class SetObserver(ABC):
    """An observer who infers a set of beliefs from each decision; a subclass defines the set and the estimate.

    Under a disclosure the set is the union over all candidates with the same disclosed value.
    """

    def __init__(self, problem: DecisionProblem, disclosure: Disclosure | str | None, candidates: Any) -> None:
        self.problem = checked_problem(problem)
        self._reading = ShownReading(problem, disclosure, candidates, type(self).__name__)

    @property
    def disclosure(self) -> Disclosure:
        """The part of a decision that it sees."""
        return self._reading.disclosure

    def estimate(self, action: ArrayLike, *, nearest: bool = False) -> Array:
        """Return the estimate of the belief, shape (X,).

        Where the set is empty: NaN, or with `nearest` the belief of least regret.
        """
        given = self.problem.check_action(action) if self._reading.is_plain else np.asarray(action)
        return np.asarray(self.estimates(given[None], nearest=nearest)[0])

    def estimates(self, actions: ArrayLike, *, nearest: bool = False) -> Array:
        """Return `estimate` for many decisions (M,U), shape (M,X); equal decisions are computed once.

        Under a disclosure the arguments are disclosed values (M,V), and the estimate is the mean over the candidates with that
        value.
        """
        if not self._reading.is_plain:
            made = lambda points: self._union_guess(points, nearest)  # noqa: E731
            return self._reading.guesses(actions, made, nearest, self.problem.n_states)
        points = _points(self.problem, actions)
        if not len(points):
            return np.zeros((0, self.problem.n_states))
        kept, place = np.unique(first_same(points), return_inverse=True)
        distinct = points[kept]
        found = self._guesses(distinct)
        lost = np.flatnonzero(np.isnan(found[:, 0])) if nearest else ()
        if len(lost):
            found[lost] = self._least_regret(distinct[lost])
        return np.asarray(found[place.reshape(-1)])

    def _union_guess(self, points: Array, nearest: bool) -> Array:
        """Return the estimate (X,) given several possible decisions."""
        found = self._guesses(points)
        known = ~np.isnan(found[:, 0])
        if not known.any() and nearest:
            return np.asarray(self._least_regret(points).mean(axis=0))
        return np.asarray(found[known].mean(axis=0)) if known.any() else found[0]

    @abstractmethod
    def _guesses(self, points: Array) -> Array:
        """Return the estimates (M,X) for distinct decisions (M,U), NaN where the set is empty."""

    def _least_regret(self, points: Array) -> Array:
        """Return the beliefs (M,X) of least regret for decisions (M,U)."""
        return nearest_explanations(self.problem, points)[0]


class NaiveAdversary(SetObserver):
    """The naive observer, who takes every decision for optimal: the paper's adversary.

    Formula: Π(u) = {π : u minimises π·s}; the estimate is the mean of its corners (see `BeliefSet.center`).

    Args:
        problem: The decision problem that the observer knows.
        disclosure: The part of a decision that it sees, such as `at_least(0.05)`, also as text; None: all of it. With a
            disclosure the methods take disclosed values, `disclosure.shown(actions)`, and the result is the union over the
            candidates with that value.
        candidates: The possible decisions, shape (M,U), (M,) choices or `Candidates`; only with a disclosure.

    Raises:
        InputError: `problem` is not a decision problem, or the disclosure does not suit its decisions, leaves some out, or
            needs returns or candidates.

    Cost: `estimates` computes points and segments in bulk, about 30 µs per decision; a larger set takes 1 ms, and with
    `nearest` a decision that no belief explains takes 3 ms.

    Source: the paper, Theorem 1.

    Example:
        >>> from inscrutable import FiniteProblem
        >>> NaiveAdversary(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])).estimates([0, 1])
        array([[0.75, 0.25],
               [0.25, 0.75]])
    """

    def __init__(
        self, problem: DecisionProblem, *, disclosure: Disclosure | str | None = None, candidates: Any = None
    ) -> None:
        super().__init__(problem, disclosure, candidates)

    def __repr__(self) -> str:
        return f"NaiveAdversary({self.problem!r})"

    def infer(self, action: ArrayLike) -> BeliefSet | ShownBeliefs:
        """Return Π(u) of one decision (U,), empty where no belief explains it; under a disclosure the union."""
        if self._reading.is_plain:
            return belief_set_of(self.problem, self.problem.check_action(action))
        return self._reading.union(action, lambda each: belief_set_of(self.problem, self.problem.check_action(each)))

    def _guesses(self, points: Array) -> Array:
        sets = consistent_sets(self.problem, points)
        found = np.where((sets.dimension < 0)[:, None], np.nan, 0.5 * (sets.start + sets.end))
        for i in np.flatnonzero(sets.dimension >= LARGER):
            found[i] = sets[int(i)].center()
        return np.asarray(found)


class PriorReader(SetObserver):
    """An observer of sets {π : ρ(π,u) ≤ limit at π}; it estimates the middle of the set, or the prior's mean over it."""

    def __init__(
        self, problem: DecisionProblem, prior: Prior | None, disclosure: Disclosure | str | None, candidates: Any
    ) -> None:
        super().__init__(problem, disclosure, candidates)
        self.prior = None if prior is None else checked_prior(prior, problem)

    @abstractmethod
    def infer(self, action: ArrayLike) -> NearOptimalBeliefs | AffordableBeliefs | ShownBeliefs:
        """Return the set of one decision (U,)."""

    @abstractmethod
    def _set_of(self, action: ArrayLike) -> NearOptimalBeliefs | AffordableBeliefs:
        """Return the set of one fully disclosed decision."""

    @abstractmethod
    def _limits(self, optimal_costs: Array) -> Array:
        """Return the limits (B,) at beliefs with these optimal costs (B,)."""

    def _guesses(self, points: Array) -> Array:
        if self.prior is not None:
            return self._weighted(points, self.prior)
        found = np.full((len(points), self.problem.n_states), np.nan)
        set_of: Any = self.infer if self._reading.is_plain else self._set_of
        for i, point in enumerate(points):
            held = set_of(point)
            if not held.is_empty:
                middle = held.bounds().mean(axis=1)
                found[i] = held.nearest(middle / middle.sum())
        return found

    def _weighted(self, points: Array, prior: Prior) -> Array:
        """The prior's mean over its beliefs under which each decision is within the limits."""
        found = np.full((len(points), self.problem.n_states), np.nan)
        for some in _blocks(len(points), len(prior)):
            held = np.where(self._within(points[some], prior), prior.weights, 0.0)
            with np.errstate(invalid="ignore"):
                found[some] = (held @ prior.beliefs) / held.sum(axis=1)[:, None]
        return found

    def _within(self, points: Array, prior: Prior) -> Array:
        """Return which of the prior's beliefs are in the sets of which decisions, shape (m,B)."""
        costs, excess, limits = self._excess(points, prior)
        # A decision that spends its budget to the last digit is within it.
        ruined = (costs >= self.problem.ruin_cost) @ prior.beliefs.T > 0
        apart = np.where(ruined, 0.0, np.abs(excess + limits)).max(axis=1, keepdims=True)
        allowed = tolerances.NEAR_OPTIMAL * np.maximum(apart, limits) + regret_rounding(self.problem, costs)[:, None]
        return np.asarray(excess <= allowed)

    def _union_guess(self, points: Array, nearest: bool) -> Array:
        """Return the prior's mean over the beliefs in any of the decisions' sets."""
        if self.prior is None:
            return super()._union_guess(points, nearest)
        held = np.zeros(len(self.prior), dtype=bool)
        for some in _blocks(len(points), len(self.prior)):
            held |= self._within(points[some], self.prior).any(axis=0)
        weights = np.where(held, self.prior.weights, 0.0)
        if not weights.sum() > 0:
            return super()._union_guess(points, nearest)
        return np.asarray((weights @ self.prior.beliefs) / weights.sum())

    def _least_regret(self, points: Array) -> Array:
        """Return the prior's belief that exceeds its limit least."""
        if self.prior is None:
            return super()._least_regret(points)
        found = np.empty((len(points), self.problem.n_states))
        for some in _blocks(len(points), len(self.prior)):
            excess = np.where(self.prior.weights > 0, self._excess(points[some], self.prior)[1], np.inf)
            found[some] = self.prior.beliefs[excess.argmin(axis=1)]
        return found

    def _excess(self, points: Array, prior: Prior) -> tuple[Array, Array, Array]:
        """Return state costs (m,X) of some decisions, without common ones, their regrets minus the limits (m,B), and the limits
        (B,)."""
        optimal, smaller = np.asarray(self.problem.optimal_cost(prior.beliefs)), self.problem.without_common_costs
        limits = self._limits(optimal)
        if smaller is not self.problem:
            optimal = np.asarray(smaller.optimal_cost(prior.beliefs))
        costs = smaller.state_costs(points)
        return costs, costs @ prior.beliefs.T - optimal - limits, limits


class NearOptimalAdversary(PriorReader):
    """The near-optimal observer, who allows for a regret: rounding, inexact optimisation, or an error of the model.

    Formula: Π_ε(u) = {π : ρ(π,u) ≤ ε}; the estimate is the member nearest to the middle of its bounds, or under a prior
    Σ w_b π_b / Σ w_b over the prior's beliefs in the set.

    Args:
        problem: The decision problem that the observer knows.
        regret: ε, at least 0, in the cost's unit.
        prior: The observer's prior; None: none. With a prior, `estimates` is one product of tables.
        disclosure: The part of a decision that it sees, such as `at_least(0.05)`, also as text; None: all of it. With a
            disclosure the methods take disclosed values, `disclosure.shown(actions)`, and the result is the union over the
            candidates with that value.
        candidates: The possible decisions, shape (M,U), (M,) choices or `Candidates`; only with a disclosure.

    Raises:
        InputError: An argument is malformed, or the prior has another number of states.

    Cost: without a prior, some tens of forward solves per distinct decision, 9 ms at three states; with a prior of B beliefs,
    B·M regrets.

    Source: near-optimal inverse optimisation.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> NearOptimalAdversary(problem, 0.0001).estimate([0.52, 0.48]).round(3)
        array([0.7, 0.3])
    """

    def __init__(
        self,
        problem: DecisionProblem,
        regret: float,
        *,
        prior: Prior | None = None,
        disclosure: Disclosure | str | None = None,
        candidates: Any = None,
    ) -> None:
        super().__init__(problem, prior, disclosure, candidates)
        self.regret = validation.non_negative(regret, "regret")

    def __repr__(self) -> str:
        return f"NearOptimalAdversary({self.problem!r}, {self.regret:g})"

    def infer(self, action: ArrayLike) -> NearOptimalBeliefs | ShownBeliefs:
        """Return Π_ε(u) of one decision (U,), empty where every belief leaves more regret; under a disclosure the union."""
        return self._set_of(action) if self._reading.is_plain else self._reading.union(action, self._set_of)

    def _set_of(self, action: ArrayLike) -> NearOptimalBeliefs:
        return near_optimal_beliefs(self.problem, action, self.regret)

    def _limits(self, optimal_costs: Array) -> Array:
        return np.full(len(optimal_costs), self.regret)


class BudgetAwareAdversary(PriorReader):
    """The budget-aware observer: the beliefs under which the decision is within the agent's budget.

    Formula: {π : ρ(π,u) ≤ budget at π}, which always contains the true belief; the estimate is the member nearest to the middle
    of its bounds, or under a prior Σ w_b π_b / Σ w_b over the prior's beliefs in the set.

    Args:
        problem: The decision problem that the observer knows.
        budget: A share of |c*|, or a `Budget`.
        prior: The observer's prior; None: none. With a prior, `estimates` is one product of tables.
        disclosure: The part of a decision that it sees, such as `at_least(0.05)`, also as text; None: all of it. With a
            disclosure the methods take disclosed values, `disclosure.shown(actions)`, and the result is the union over the
            candidates with that value.
        candidates: The possible decisions, shape (M,U), (M,) choices or `Candidates`; only with a disclosure.

    Raises:
        InputError: An argument is malformed, or the prior has another number of states.

    Cost: as `NearOptimalAdversary`.

    Source: the paper, eq. (8): the observer knows the constraint on the agent's regret.

    Example:
        >>> import numpy as np
        >>> from inscrutable import CounterAdversarialDecisionMaker, MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> hidden = CounterAdversarialDecisionMaker(problem, budget=0.001).decide([0.5, 0.5])
        >>> aware = BudgetAwareAdversary(problem, 0.001).infer(hidden.action)
        >>> hidden.belief_set.contains([0.5, 0.5]), aware.contains([0.5, 0.5])
        (False, True)
    """

    def __init__(
        self,
        problem: DecisionProblem,
        budget: Budget | float,
        *,
        prior: Prior | None = None,
        disclosure: Disclosure | str | None = None,
        candidates: Any = None,
    ) -> None:
        super().__init__(problem, prior, disclosure, candidates)
        self.budget = as_budget(budget)

    def __repr__(self) -> str:
        return f"BudgetAwareAdversary({self.problem!r}, {self.budget})"

    def infer(self, action: ArrayLike) -> AffordableBeliefs | ShownBeliefs:
        """Return the beliefs under which one decision (U,) is affordable, perhaps none; under a disclosure the union.

        Raises `InputError` for a share above 1 where the optimal cost is negative somewhere.
        """
        return self._set_of(action) if self._reading.is_plain else self._reading.union(action, self._set_of)

    def _set_of(self, action: ArrayLike) -> AffordableBeliefs:
        return affordable_beliefs(self.problem, action, self.budget)

    def _limits(self, optimal_costs: Array) -> Array:
        return self.budget.limits(optimal_costs)


def _blocks(n_points: int, n_beliefs: int) -> list[slice]:
    """Return slices of the decisions whose tables of regrets fit into memory."""
    size = max(_BLOCK // n_beliefs, 1)
    return [slice(start, start + size) for start in range(0, n_points, size)]


def _points(problem: DecisionProblem, actions: ArrayLike) -> Array:
    """Decisions as points (M,U)."""
    given = ordered_array(actions, "actions", (None, None))
    if given.ndim != (1 if given.dtype.kind in "iu" and problem.is_discrete else 2):
        raise InputError(f"actions must be many decisions of shape (M,{problem.n_actions}), got shape {given.shape}")
    return problem.check_actions(actions)
