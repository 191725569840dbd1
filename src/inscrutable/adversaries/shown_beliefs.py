"""Beliefs inferred from a disclosed part of a decision: the union over all candidates with the same disclosed value."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.axes import ordered_array
from inscrutable.errors import InputError
from inscrutable.mechanisms.disclosed import shown_classes, single_decisions
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class ShownBeliefs:
    """The union of the consistent beliefs of all decisions with one disclosed value; it need not be convex.

    Args:
        members: One set for each candidate with this disclosed value, if some belief explains it.

    Source: the paper, Theorem 1, for every candidate that is still possible.

    Example:
        >>> from inscrutable import FiniteProblem, NaiveAdversary, grouped
        >>> problem = FiniteProblem([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4]])
        >>> blurred = NaiveAdversary(problem, disclosure=grouped(["a", "a", "b"]), candidates=[0, 1, 2])
        >>> held = blurred.infer(0)
        >>> len(held.members), held.contains([0.9, 0.1]), held.contains([0.1, 0.9]), held.contains([0.5, 0.5])
        (2, True, True, False)
    """

    members: tuple[Any, ...]

    def __repr__(self) -> str:
        return f"union of {len(self.members)} sets of beliefs, one for each candidate with this disclosed value"

    @property
    def is_empty(self) -> bool:
        """Whether no belief explains a candidate with this disclosed value."""
        return not self.members

    def contains(self, belief: ArrayLike) -> bool:
        """Return whether a belief (X,) is in one of the sets."""
        return any(each.contains(belief) for each in self.members)

    def bounds(self) -> Array:
        """Return the least and greatest probability of each state, shape (X,2); raise `InputError` for an empty union."""
        if not self.members:
            raise InputError("no belief explains a candidate with this disclosed value: there are no bounds")
        each = np.stack([member.bounds() for member in self.members])
        return np.column_stack([each[:, :, 0].min(axis=0), each[:, :, 1].max(axis=0)])


class ShownCandidates:
    """Candidates by disclosed value.

    Args:
        problem: The decision problem.
        candidates: Decisions (M,U), choices (M,), or an object with such `actions`.
        disclosure: What is disclosed of them.

    Raises:
        InputError: The candidates are not decisions of the problem, or the disclosure does not suit them.
    """

    def __init__(self, problem: DecisionProblem, candidates: Any, disclosure: Disclosure) -> None:
        if candidates is None:
            raise InputError(
                f"{disclosure} hides parts of decisions: pass `candidates`, the decisions that the observer considers possible"
            )
        listed = ordered_array(getattr(candidates, "actions", candidates), "candidates", (None, None))
        self.points = problem.check_actions(listed)
        if not len(self.points):
            raise InputError("candidates must hold one decision at least")
        values, self._place = shown_classes(problem.as_actions(self.points), disclosure)
        self._width = 1 if values.ndim == 1 else values.shape[1]
        self._tree = cKDTree(np.asarray(values, dtype=np.float64).reshape(len(values), -1))

    def classes(self, values: ArrayLike, nearest: bool) -> np.ndarray:
        """Return the class of each disclosed value (M,V), shape (M,): −1 for none, or with `nearest` the nearest class."""
        given = validation.finite_array(values, "shown values", ndim=(1, 2))
        rows = given.reshape(len(given), -1)
        if rows.shape[1] != self._width:
            raise InputError(f"a disclosed value has {self._width} entries, got {rows.shape[1]}")
        apart, exact = self._tree.query(rows, p=np.inf)
        return np.where(apart <= tolerances.SAME_ACTION, exact, self._tree.query(rows)[1] if nearest else -1)

    def of_class(self, number: int) -> Array:
        """Return the candidates of a class as points (m,U)."""
        return np.asarray(self.points[self._place == number])


class ShownReading:
    """How a set observer uses a disclosed value: through candidates where parts are hidden, otherwise directly."""

    def __init__(self, problem: DecisionProblem, disclosure: Any, candidates: Any, what: str) -> None:
        self.disclosure = single_decisions(Disclosure.of(disclosure), what)
        if not self.disclosure.maps and candidates is not None:
            raise InputError("candidates were given, but the disclosure shows decisions as they are and needs none")
        self._problem, self._given = problem, candidates
        if self.disclosure.maps:
            self.candidates  # noqa: B018  # raises where they are malformed

    @property
    def is_plain(self) -> bool:
        """Whether decisions are fully disclosed."""
        return not self.disclosure.maps

    @cached_property
    def candidates(self) -> ShownCandidates:
        """The candidates, grouped by disclosed value."""
        return ShownCandidates(self._problem, self._given, self.disclosure)

    def union(self, value: ArrayLike, set_of: Callable[[Array], Any]) -> ShownBeliefs:
        """Return the union of the sets of all candidates with a disclosed value (V,)."""
        number = int(self.candidates.classes(np.asarray(value)[None], nearest=False)[0])
        found = [set_of(each) for each in self.candidates.of_class(number)]
        return ShownBeliefs(tuple(each for each in found if not each.is_empty))

    def guesses(self, values: ArrayLike, guess: Callable[[Array], Array], nearest: bool, n_states: int) -> Array:
        """Return estimates (M,X) at disclosed values, each from the candidates (m,U) of its class; NaN without a class."""
        numbers = self.candidates.classes(values, nearest)
        found = np.full((len(numbers), n_states), np.nan)
        for number in np.unique(numbers[numbers >= 0]):
            found[numbers == number] = guess(self.candidates.of_class(int(number)))
        return found
