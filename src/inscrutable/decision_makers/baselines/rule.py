"""Deterministic rules."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers.arguments import Described
from inscrutable.decision_makers.original import certain, decision_for
from inscrutable.decision_makers.results import Decision, Decisions, DecisionStatus, Progress, counted, stack
from inscrutable.errors import InputError
from inscrutable.privacy import MaximalObfuscation
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array


class RuleDecisionMaker(Described, ABC):
    """A rule from beliefs to decisions; a subclass gives the decisions, the rest follows."""

    is_memoryless = True
    """Whether the decision depends on the present belief alone, so that it is a mechanism."""

    def __init__(self, problem: DecisionProblem) -> None:
        self.problem = checked_problem(problem)

    @abstractmethod
    def _points(self, beliefs: Array) -> Array:
        """Return the decisions for beliefs (T,X) as points (T,U)."""

    def decide(self, belief: ArrayLike) -> Decision:
        """Return the decision for one belief (X,); for a rule with memory the belief is the first one of a path."""
        return self.decide_many(validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names))[0]

    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> Decisions:
        """Return the decisions for beliefs (T,X), in the order of time where the rule has a memory.

        Privacy is the paper's measure (e), against the naive observer.
        """
        held = self._held(beliefs)
        points, measure, status = self._points(held), MaximalObfuscation(), DecisionStatus.RULE_OF_THUMB
        decided = [
            decision_for(self.problem, belief, points[step], measure, status)
            for step, belief in counted(held, progress)
        ]
        return stack(decided, self.problem)

    def table(self, beliefs: ArrayLike) -> tuple[Array, np.ndarray, Array]:
        """Return the decisions for beliefs (T,X) as points (T,U), the number of each belief's own and its share 1, (T,1).

        The same as `decide_many`, without the consistent beliefs of each decision.
        """
        return certain(self._points(self._held(beliefs)))

    def _held(self, beliefs: ArrayLike) -> Array:
        return validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)


class PathRule(RuleDecisionMaker):
    """A rule whose decision depends on earlier beliefs of the path as well, and on a decision before the first."""

    is_memoryless = False

    def __init__(self, problem: DecisionProblem, start: ArrayLike | None) -> None:
        super().__init__(problem)
        self.start = None if start is None else self.problem.check_action(self.problem.as_points(start))

    def _started(self, optimal: Array) -> Array:
        """The decision before the first step."""
        return optimal[0] if self.start is None else self.start


def checked_fraction(value: object) -> float:
    """Return a number in (0, 1], or raise `InputError`."""
    fraction = validation.positive(value, "fraction")
    if fraction > 1:
        raise InputError(f"fraction must be at most 1, got {fraction:g}")
    return fraction


def repeated(start: Array, count: int) -> Array:
    """Return a decision (U,) `count` times."""
    return np.tile(start, (count, 1))
