"""Delayed and partial trading, which the paper's introduction names as usual ways to hide investments."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import validation
from inscrutable.decision_makers.baselines.rule import PathRule, checked_fraction, repeated
from inscrutable.errors import InputError
from inscrutable.mechanisms.memory import MemoryMechanism
from inscrutable.mechanisms.played import regrets_of
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


class DelayedDecisionMaker(PathRule):
    """The optimal decision of some steps ago.

    Formula: u_t = u*(π_{t−d}); before step d, `start`.

    `decide_many` takes a path of beliefs in the order of time. Nothing is kept between calls, so `decide` is the first step
    of a path. The decision depends on the past: the rule is no mechanism K(u|π), and `mechanism` refuses it.

    Args:
        problem: The decision problem.
        n_steps: d, at least 0; 0 is the original decision maker.
        start: The decision before step d, shape (U,); None is the optimal decision of the first belief.

    Raises:
        InputError: `n_steps` is not a whole number of at least 0, or `start` is no feasible decision.

    Cost: one forward solve per belief. Source: the paper, Section I: "delay information".

    Example:
        >>> from inscrutable import FiniteProblem
        >>> maker = DelayedDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), 1)
        >>> print(maker.decide_many([[0.9, 0.1], [0.1, 0.9], [0.1, 0.9]]).action)
        [0 0 1]
    """

    _shown = ("n_steps",)

    def __init__(self, problem: DecisionProblem, n_steps: int, *, start: ArrayLike | None = None) -> None:
        super().__init__(problem, start)
        self.n_steps = validation.count(n_steps, "n_steps", least=0)

    def _points(self, beliefs: Array) -> Array:
        optimal = np.atleast_2d(self.problem.solve_points(beliefs))
        waiting = min(self.n_steps, len(beliefs))
        return np.vstack([repeated(self._started(optimal), waiting), optimal[: len(beliefs) - waiting]])


class PartialDecisionMaker(PathRule):
    """At each step a fraction of the trade towards the optimal decision.

    Formula: u_t = u_{t−1} + f (u*(π_t) − u_{t−1}), from u_{−1} = `start`.

    `decide_many` takes a path of beliefs in the order of time. Nothing is kept between calls, so `decide` is the first step
    of a path. The decision depends on the past: the rule is no mechanism K(u|π), and `mechanism` refuses it. Decisions stay
    feasible, as the set is convex; the weight of an asset that is sold shrinks geometrically and may fall below `min_slack`,
    which an observer counts as zero.

    Args:
        problem: The decision problem, with decisions between choices.
        fraction: f in (0, 1]; 1 is the original decision maker.
        start: u_{−1}, shape (U,); None is the optimal decision of the first belief, which is then played first.

    Raises:
        InputError: The fraction is not in (0, 1], `start` is no feasible decision, or decisions are finite choices.

    Cost: one forward solve per belief. Source: the paper, Section I: "fractional investments".

    Example:
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> print(PartialDecisionMaker(problem, 0.5).decide_many([[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]).action[:, 0])
        [0.55   0.5    0.475]
    """

    _shown = ("fraction",)

    def __init__(self, problem: DecisionProblem, fraction: float, *, start: ArrayLike | None = None) -> None:
        super().__init__(problem, start)
        if self.problem.is_discrete:
            raise InputError(f"nothing lies between two choices of {problem!r}: there is no fraction of a trade")
        self.fraction = checked_fraction(fraction)

    def _points(self, beliefs: Array) -> Array:
        optimal = np.atleast_2d(self.problem.solve_points(beliefs))
        return partial_trades(optimal, self._started(optimal), self.fraction)

    def memory_mechanism(self, beliefs: ArrayLike, holdings: ArrayLike) -> MemoryMechanism:
        """Return the rule on beliefs (B,X) as a mechanism whose memory is the present holding, one of finitely many.

        Formula: u_t is the one of `holdings` nearest to u_{t−1} + f (u*(π_t) − u_{t−1}); there is no trade where u_{t−1} itself
        is the nearest.

        Memory 0 stands for no decision yet, memory 1 + m for the m-th holding. It counts as private, but the decisions reveal
        it.

        Args:
            beliefs: π_b, shape (B,X).
            holdings: Feasible decisions, shape (M,U).

        Raises:
            InputError: A belief or a holding is malformed.

        Cost: B·M nearest neighbours.
        """
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        points = np.atleast_2d(self.problem.check_actions(holdings))
        optimal = np.atleast_2d(self.problem.solve_points(held))[:, None]
        start = optimal if self.start is None else np.broadcast_to(self.start, optimal.shape)
        before = np.concatenate([start, np.broadcast_to(points, (len(held), *points.shape))], axis=1)
        _, nearest = cKDTree(points).query((1.0 - self.fraction) * before + self.fraction * optimal)
        count = len(points) + 1
        rows, after = np.arange(len(held) * count), np.asarray(nearest).reshape(-1)
        shape = (len(rows), len(points) * count)
        table = sparse.csr_array((np.ones(len(rows)), (rows, after * count + 1 + after)), shape=shape)
        regrets = regrets_of(self.problem, held, points)
        return MemoryMechanism(held, self.problem.as_actions(points), table, np.eye(count)[0], regrets)


def partial_trades(targets: Array, start: Array, fraction: float) -> Array:
    """Return u_t = (1 − f) u_{t−1} + f v_t for targets v (T,…,U) from u_{−1} = `start` (…,U), shape (T,…,U)."""
    held, points = start, np.empty(targets.shape)
    for step, target in enumerate(targets):
        # The convex form: with f = 1 the target is reached exactly.
        held = (1.0 - fraction) * held + fraction * target
        points[step] = held
    return points
