"""An episode: a sequence of beliefs, the decisions of several decision makers, and the observer's inference."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.decision_makers import Decisions, MixedDecisions
from inscrutable.decision_makers.results import Progress
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


def relative_increase(increase: ArrayLike, optimal_cost: ArrayLike) -> Array:
    """Return (c̄ − c*)/|c*| for increases c̄ − c* and optimal costs c* of one shape.

    At c* = 0 a zero increase gives 0 and any other gives +∞.

    Example:
        >>> relative_increase([0.1, 0.0, 0.1], [-2.0, 0.0, 0.0])
        array([0.05, 0.  ,  inf])
    """
    risen, scale = np.asarray(increase, dtype=np.float64), np.abs(np.asarray(optimal_cost, dtype=np.float64))
    return np.divide(risen, scale, out=np.where(risen > 0, np.inf, 0.0), where=scale > 0)


class DecisionMaker(Protocol):
    """The interface of decision makers: a belief gives a decision or a lottery over decisions."""

    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> Decisions | MixedDecisions:
        """Return the decisions for beliefs (T,X)."""


@dataclass(frozen=True, eq=False)
class Record:
    """The decisions of one decision maker in an episode; for a lottery, the drawn atom.

    Args:
        decisions: The played decisions, T of them.
        lotteries: The lotteries behind the draws, or None.
        expected: Regret in expectation over the draw, shape (T,), where the lotteries were not kept.
    """

    decisions: Decisions
    lotteries: MixedDecisions | None = None
    expected: Array | None = None

    @property
    def is_drawn(self) -> bool:
        """Whether the decisions were drawn."""
        return self.lotteries is not None or self.expected is not None

    @property
    def expected_regret(self) -> Array:
        """Regret in expectation over the lottery, shape (T,), in the cost's unit."""
        if self.expected is not None:
            return self.expected
        if self.lotteries is None:
            return self.decisions.regret
        return np.asarray((self.lotteries.probabilities * self.lotteries.regrets).sum(axis=1))

    @property
    def expected_privacy(self) -> Array:
        """Privacy in expectation over the lottery, shape (T,)."""
        return self.decisions.privacy if self.lotteries is None else self.lotteries.expected_privacy

    @property
    def relative_increase(self) -> Array:
        """(c̄ − c*)/|c*| of the played decision, shape (T,); at c* = 0 as `relative_increase` says."""
        return relative_increase(self.decisions.regret, self.decisions.optimal_cost)

    @property
    def estimates(self) -> Array:
        """Centre of the observer's set at every step, shape (T,X); NaN where it is empty."""
        return np.array([found.center() for found in self.decisions.belief_set])


@dataclass(frozen=True, eq=False)
class Episode:
    """A sequence of private beliefs and a record per decision maker, by name and in the order given."""

    problem: DecisionProblem
    beliefs: Array  # (T, X)
    records: Mapping[str, Record]


def run_episode(
    problem: DecisionProblem,
    beliefs: ArrayLike,
    decision_makers: Mapping[str, DecisionMaker],
    *,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Episode:
    """Let every decision maker decide on every belief (T,X), drawing lotteries with `rng`."""
    held = validation.many_beliefs(beliefs, problem.n_states, names=problem.state_names)
    validation.generator(rng)
    records: dict[str, Record] = {}
    for done, (name, decision_maker) in enumerate(decision_makers.items()):
        watch = part_of(progress, done, len(decision_makers))
        made = decision_maker.decide_many(held, progress=watch)
        if isinstance(made, MixedDecisions):
            records[name] = Record(made.sample(rng=rng), made)
        else:
            records[name] = Record(made)
    return Episode(problem, held, records)


def part_of(progress: Progress | None, done: int, parts: int) -> Progress:
    """Return a progress function for one of several equal parts of a whole."""

    def report(step: int, steps: int) -> None:
        if progress is not None:
            progress(done * steps + step, parts * steps)

    return report
