"""What a disclosure makes of a step: which decisions look alike, and the observer's loss from when they are seen on.

A decision u_t that is shown at step t + d, the next one n steps later, is the latest that the observer knows of in steps
t + d … t + d + n − 1. Its mean loss in these, as a function of the law p of π_t after the decision, is

    L(p) = (1/n) Σ_j ( E_p ‖x_{t+j}‖² − ‖E_p x_{t+j}‖² ),   j = d … d + n − 1:

again a square error, of the points y_b = (E[x_{t+j} | b])_j / √n, plus what is uncertain whatever is known of b.
"""

from __future__ import annotations

from collections import deque
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable.decision_makers.aware.columns import Columns
from inscrutable.mechanisms.calendars import Schedule
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.disclosed import shown_classes
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.validation import Array


class Ahead(NamedTuple):
    """Points whose square error is the observer's mean loss while a decision is the latest it knows of."""

    points: Array  # (B,d)
    spare: Array  # (B,): what no decision tells


def ahead(points: Array, transition: Any, schedule: Schedule) -> Ahead:
    """Return what points (B,d) are expected to be while a decision of now is the latest known."""
    if schedule.is_immediate:
        return Ahead(points, np.zeros(len(points)))
    forward: Any = sparse.csr_array(transition)
    expected, squares, means = points, (points**2).sum(axis=1), []
    total = np.zeros(len(points))
    for step in range(schedule.lag + schedule.period):
        if step:
            expected, squares = forward @ expected, forward @ squares
        if step >= schedule.lag:
            means.append(expected)
            total = total + squares
    found = np.hstack(means) / np.sqrt(schedule.period)
    return Ahead(found, np.maximum(total / schedule.period - (found**2).sum(axis=1), 0.0))


class Classes(NamedTuple):
    """Decisions as they are shown: those that look alike are one, of which every belief plays the cheapest that it may."""

    values: Array  # (C,V) what is shown
    place: np.ndarray  # (M,) as which a decision is shown

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
    """The estimates of an observer to whom all decisions come so many steps late, from the laws after every decision."""

    def __init__(self, chain: BeliefChain, lag: int) -> None:
        self._beliefs = chain.prior.beliefs
        expected = ahead(self._beliefs, chain.transition, Schedule(lag=lag))
        self._expected, self._squares = expected.points, (expected.points**2).sum(axis=1) + expected.spare
        prior = chain.prior.weights
        self._laws = deque([prior] * (lag + 1), maxlen=lag + 1)

    def after(self, law: Array) -> tuple[Array, float]:
        """Return the present estimate (X,) and its mean square error, where the decision of now leads to a law."""
        self._laws.append(law)
        mean = self._laws[0] @ self._expected
        return mean, max(float(self._laws[0] @ self._squares - mean @ mean), 0.0)
