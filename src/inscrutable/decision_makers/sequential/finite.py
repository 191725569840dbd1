"""The sequential rule as a mechanism with a memory, where the observer can reach finitely many laws."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np
from scipy import sparse

from inscrutable import tolerances, validation
from inscrutable.decision_makers.sequential.laws import ChainLaw
from inscrutable.decision_makers.sequential.prices import PriceCalibration
from inscrutable.decision_makers.sequential.step import Step, StepRule, StepTable
from inscrutable.mechanisms.memory import MemoryMechanism
from inscrutable.saved import Summarised
from inscrutable.validation import Array


class FiniteStatus(Enum):
    """Whether a sequential rule was written as a mechanism with a memory; the text says what to do about it.

    Example:
        >>> FiniteStatus.FINITE.value
        'finite: every law that the observer can reach is a memory'
    """

    FINITE = "finite: every law that the observer can reach is a memory"
    TOO_MANY = "too many: the observer can reach more laws, perhaps infinitely many; ask for more or use the rule"


@dataclass(frozen=True, eq=False, repr=False)
class FiniteRule(Summarised):
    """A sequential rule as a mechanism with a finite memory, or the reason why it has none.

    Args:
        mechanism: The mechanism. Its public memory is the observer's law before a decision, and the decision before it.
            None where there are too many laws.
        laws: The laws that were found, shape (N,B), in the order of the memories.
        status: Whether all laws were found.

    Example:
        >>> FiniteRule(None, np.full((1, 2), 0.5), FiniteStatus.TOO_MANY)
        laws found: 1; too many: the observer can reach more laws, perhaps infinitely many; ask for more or use the rule
    """

    mechanism: MemoryMechanism | None
    laws: Array
    status: FiniteStatus

    def __post_init__(self) -> None:
        validation.read_only(self, "laws")

    def summary(self) -> str:
        """Return one line for a person to read."""
        return f"laws found: {len(self.laws)}; {self.status.value}"


class _Memory(NamedTuple):
    """One memory: which price was drawn, the law before the decision, and the decision before."""

    price: int
    law: Array
    kept: int


@dataclass
class _Found:
    """Memories found so far, and the step of each."""

    memories: list[_Memory] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)
    after: list[np.ndarray] = field(default_factory=list)  # of each step's decisions, the memory that follows

    def number(self, memory: _Memory) -> int:
        """Return the place of a memory, which is added where none is like it."""
        for place, known in enumerate(self.memories):
            same = (known.price, known.kept) == (memory.price, memory.kept)
            if same and np.abs(known.law - memory.law).max() <= tolerances.SAME_MEMORY:
                return place
        self.memories.append(memory)
        return len(self.memories) - 1


def finite_rule(table: StepTable, law: ChainLaw, calibration: PriceCalibration, most: int) -> FiniteRule:
    """Return the rule as a mechanism with at most `most` memories, found by breadth-first search from the first law."""
    rules = [StepRule(table, calibration.prices(index)) for index in range(len(calibration.shares))]
    found = _Found([_Memory(index, law.start(), -1) for index in range(len(rules))])
    while len(found.steps) < len(found.memories) <= most:
        place = len(found.steps)
        price, state, kept = found.memories[place]
        step = rules[price].step(state, kept)
        after = np.full(len(step.numbers), place)  # a decision of probability 0 leaves the law unchanged
        for atom in np.flatnonzero(step.played >= tolerances.RARELY_PLAYED):
            ahead = law.moved(law.seen(state, step.rows[:, atom]))
            after[atom] = found.number(_Memory(price, ahead, int(step.numbers[atom])))
        found.steps.append(step)
        found.after.append(after)
    laws = np.array([each.law for each in found.memories])
    if len(found.steps) < len(found.memories):
        return FiniteRule(None, laws, FiniteStatus.TOO_MANY)
    return FiniteRule(_mechanism(table, found, calibration.shares), laws, FiniteStatus.FINITE)


def _mechanism(table: StepTable, found: _Found, shares: Array) -> MemoryMechanism:
    count, n_decisions = len(found.memories), len(table.columns)
    rows, columns, entries = [], [], []
    for memory, (step, after) in enumerate(zip(found.steps, found.after, strict=True)):
        belief, atom = np.nonzero(step.rows > 0)
        rows.append(belief * count + memory)
        columns.append(table.cheapest[belief, step.numbers[atom]] * count + after[atom])
        entries.append(step.rows[belief, atom])
    places = np.concatenate(rows), np.concatenate(columns)
    shape = (len(table.prior.beliefs) * count, n_decisions * count)
    held = sparse.csr_array(sparse.coo_array((np.concatenate(entries), places), shape=shape))
    actions = table.columns.problem.as_actions(table.columns.points)
    initial = np.concatenate([shares, np.zeros(count - len(shares))])
    regrets = table.columns.regrets(table.prior.beliefs, table.optimal_costs)
    return MemoryMechanism(table.prior.beliefs, actions, held, initial, regrets, is_public=True)
