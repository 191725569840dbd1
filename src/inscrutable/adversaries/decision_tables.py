"""Likelihoods K(u, n'|π, n) of a mechanism's decisions, as sparse tables."""

from __future__ import annotations

from functools import cached_property
from threading import Lock
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.axes import check_same_order
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.mechanisms.memory import MechanismRule, MemoryMechanism, with_memory
from inscrutable.validation import Array

UNSEEN, NEVER_PLAYED = -1, -2
"""Numbers of a decision that was not observed, and of one that is never played."""
_FAR = 1e4
"""How many times farther than the nearest played decision another one is no explanation. Otherwise a played decision at a
distance of solver noise is read as one of eight, seven of which are far: on a market of 60 assets the error was .17, not .02.
Over 40 random markets of 2 to 6 assets and 2 to 4 states a factor of 1,000 changes mean errors by .2 % at most; a factor of 10
raises them by up to 12 %, because equal weights on eight decisions smooth the likelihood."""
_numbering = Lock()  # two threads must not give one number to two groups


def nearest_count(nearest: int) -> int:
    """Return how many of the nearest decisions replace one that is never played; True is 1."""
    return validation.count(int(nearest) if isinstance(nearest, bool) else nearest, "nearest", least=0)


def near_enough(distances: Array) -> np.ndarray:
    """Return which of the nearest decisions, at ascending distances (k,), are at most `_FAR` times as far as the first."""
    return np.asarray(distances <= _FAR * distances[0])


class Entries(NamedTuple):
    """The nonzero entries of K(u, n'|π_b, n_c) for the observed decision u."""

    column: np.ndarray  # (n,), c: index into the requested memories
    belief: np.ndarray  # (n,), b
    after: np.ndarray  # (n,), n'
    share: Array  # (n,)


class DecisionTables:
    """The decisions of a mechanism: their numbers and their likelihoods.

    A group of decisions that are read as one also has a number; its likelihood is the sum of theirs.

    Attributes:
        mechanism: The mechanism.
        n_memories: N.
        played: The numbers of the decisions of positive probability, ascending.
    """

    def __init__(self, mechanism: MemoryMechanism) -> None:
        self.mechanism, self.n_memories = mechanism, mechanism.n_memories
        count, n_actions, n_beliefs = mechanism.n_memories, len(mechanism.actions), len(mechanism.beliefs)
        held = mechanism.observed.tocoo()
        (belief, before), (action, after) = np.divmod(held.row, count), np.divmod(held.col, count)
        # Row u·N + n holds (b, n'); after the rows of decisions come N rows of sums over u, and N empty rows.
        rows = np.concatenate([action * count + before, n_actions * count + before])
        places = np.tile(belief * count + after, 2)
        shape = ((n_actions + 2) * count, n_beliefs * count)
        self._rows = sparse.csr_array((np.tile(held.data, 2), (rows, places)), shape=shape)
        self._rows.sum_duplicates()
        self._n_actions = n_actions
        self._groups: dict[tuple[int, ...], int] = {}  # the number of each group of decisions that are read as one
        self.played = np.unique(action[held.data > 0])
        points = np.asarray(mechanism.actions, dtype=np.float64).reshape(n_actions, -1)
        self._tree = cKDTree(points[self.played])

    @cached_property
    def draws(self) -> RowDraws:
        """Draws (u, n') as u·N + n' for rows b·N + n."""
        return RowDraws(self.mechanism.observed)

    def action(self, column: int) -> Any:
        """Return a decision by its number, of a group the nearest; None for one that was not observed or is never played."""
        return None if column < 0 else self.mechanism.actions[self._members(column)[0]]

    def column(self, point: Array, nearest: int) -> tuple[int, bool]:
        """Return the number of a decision (U,), and whether it was replaced by the `nearest` played ones; NaN: not observed."""
        if np.isnan(point[0]):
            return UNSEEN, False
        if len(point) != self._tree.m:
            raise InputError(f"the decision has {len(point)} entries, the mechanism's have {self._tree.m}")
        gap, place = self._tree.query(point, p=np.inf)
        if gap <= tolerances.SAME_ACTION:
            return int(self.played[place]), False
        if not nearest:
            return NEVER_PLAYED, False
        distances, places = map(np.asarray, self._tree.query(point, k=range(1, 1 + min(nearest, len(self.played)))))
        places = places[near_enough(distances)]
        return int(self.played[places[0]]) if len(places) == 1 else self._group(self.played[places]), True

    def entries(self, columns: np.ndarray, memories: np.ndarray) -> Entries:
        """Return the likelihoods given decisions (C,), where the memories before them are (C,)."""
        of, numbers = np.arange(len(columns)), np.where(columns >= 0, columns, self._n_actions - 1 - columns)
        if columns.max() >= self._n_actions:  # the entries of a group add up
            members = [self._members(int(number)) for number in numbers]
            of, numbers = np.repeat(of, [len(each) for each in members]), np.concatenate(members)
        found: Any = self._rows[numbers * self.n_memories + memories[of]]
        belief, after = np.divmod(found.indices, self.n_memories)
        return Entries(np.repeat(of, np.diff(found.indptr)), belief, after, found.data)

    def _group(self, members: np.ndarray) -> int:
        """Return the number of a group of decisions that are read as one; the first is the nearest."""
        with _numbering:
            return self._groups.setdefault(tuple(members.tolist()), self._n_actions + 2 + len(self._groups))

    def _members(self, number: int) -> np.ndarray:
        """Return the decisions of a number: one, or a group."""
        group = number - self._n_actions - 2
        return np.array([number] if group < 0 else list(self._groups)[group])


class KnownRule:
    """The mechanism of every step: a fixed one, or the one that a rule chooses given the observer's law."""

    def __init__(self, given: Mechanism | MemoryMechanism | MechanismRule) -> None:
        self.given = given
        self.beliefs = np.asarray(given.beliefs, dtype=np.float64)
        self.is_fixed = isinstance(given, (Mechanism, MemoryMechanism))
        played = given if self.is_fixed else _silent(self.beliefs)
        self._tables = DecisionTables(with_memory(played))  # type: ignore[arg-type]
        self.initial = self._tables.mechanism.initial
        self.is_public = self._tables.mechanism.is_public

    def at(self, law: Array, before: Any = None, *, seen: bool = True) -> DecisionTables:
        """Return the decision tables of a step; `law` (B,) is the observer's, `before` the last decision it saw, or None.

        A rule is not asked where no decision of the step is `seen`.
        """
        if self.is_fixed or not seen:
            return self._tables
        made = self.given.mechanism_for(Prior(self.beliefs, law / law.sum()), before)  # type: ignore[union-attr]
        if not isinstance(made, Mechanism):
            raise InputError(f"the rule's mechanism_for must return a Mechanism, got {made!r}")
        shape = self.beliefs.shape
        if made.beliefs.shape != shape or np.abs(made.beliefs - self.beliefs).max() > tolerances.SAME_BELIEF:
            raise InputError("the rule's mechanism_for must return a Mechanism on the law's beliefs, in their order")
        return DecisionTables(with_memory(made))


def checked_rule(given: Any) -> KnownRule:
    """Return a mechanism, with memory or without, or a rule; raise `InputError` for anything else."""
    if not isinstance(given, (Mechanism, MemoryMechanism, MechanismRule)):
        raise InputError(
            "expected a Mechanism, as mechanism(decision_maker, beliefs) makes it, a MemoryMechanism, or a rule with "
            f"`beliefs` and `mechanism_for`, got {given!r}"
        )
    return KnownRule(given)


def check_problem(owner: Any, world: Any) -> None:
    """Raise `InputError` where the problem of a rule or of a loss, if any, has other state labels than a world."""
    names = getattr(getattr(owner, "problem", None), "state_names", None)
    own = f"the problem of {type(owner).__name__}", names
    check_same_order("state", own, ("world", getattr(world, "names", None)))


def _silent(beliefs: Array) -> Mechanism:
    return Mechanism(beliefs, np.zeros((1, 1)), np.ones((len(beliefs), 1)), np.zeros((len(beliefs), 1)))
