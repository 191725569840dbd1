"""A step under a disclosure: which decisions look alike, and the observer's estimates when they are disclosed."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from inscrutable.decision_makers.aware.columns import Columns
from inscrutable.decision_makers.sequential.laws import ChainLaw
from inscrutable.mechanisms.disclosed import shown_classes
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.privacy import Loss
from inscrutable.validation import Array


class Classes(NamedTuple):
    """Classes of decisions with the same disclosed value, of which every belief plays the cheapest allowed one."""

    values: Array  # (C,V) the disclosed values
    place: np.ndarray  # (M,) the class of each decision

    def cheapest(self, costs: Array) -> tuple[Array, np.ndarray]:
        """Return the least of costs (B,M) in every class, shape (B,C), and which decision has it."""
        order = np.argsort(self.place, kind="stable")
        first = np.searchsorted(self.place[order], np.arange(len(self.values)))
        ends = np.append(first[1:], len(order))
        number = np.empty((len(costs), len(self.values)), dtype=np.int64)
        for c, (low, high) in enumerate(zip(first, ends, strict=True)):
            some = order[low:high]
            number[:, c] = some[costs[:, some].argmin(axis=1)]
        return np.take_along_axis(costs, number, axis=1), number


def classes_of(columns: Columns, disclosure: Disclosure) -> Classes:
    """Return the decisions as they are shown."""
    if not disclosure.maps:
        return Classes(columns.points, np.arange(len(columns)))
    values, place = shown_classes(columns.problem.as_actions(columns.points), disclosure)
    return Classes(np.asarray(values, dtype=np.float64).reshape(len(values), -1), place)


class Knowledge:
    """The estimates of an observer who sees all decisions with a lag, from the laws after every decision.

    Public information comes at once.
    """

    def __init__(self, law: ChainLaw, lag: int, loss: Loss) -> None:
        self._law, self._loss = law, loss
        self._laws = deque([law.prior.weights] * (lag + 1), maxlen=lag + 1)  # of the present belief

    def after(self, law: Array, read: int | None = None) -> tuple[Array, float]:
        """Return the present estimate (X,) and its mean loss, where the decision of now leads to a law.

        `read` is the public symbol before it.
        """
        self._laws = deque([self._law.moved(each, read) for each in self._laws], maxlen=self._laws.maxlen)
        self._laws.append(law)
        present, beliefs = self._laws[0], self._law.prior.beliefs
        return present @ beliefs, float(self._loss.bayes_risk(present, beliefs))
