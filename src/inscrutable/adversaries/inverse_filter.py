"""The inverse filter and smoother on a grid of beliefs: forward and backward passes over (state, private belief, memory).

`BeliefMoves` predicts α_t before a decision; the decision u_t then updates it:
α(x,b,n') = Σ_n K(u_t,n'|π_b,n) α(x,b,n), times the likelihood of the other evidence. Only memories of positive weight are kept.

A decision that the agent's belief plays may have probability 0 at every grid point that represents the belief. Where the law is
interpolated, each possible point is then replaced by the nearest point that plays the decision, if that lies within a
tolerance. The posterior is the mixture, half and half, of this reading and of the law before the decision. Its squared error is
therefore at most the mean of the errors of the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.adversaries.belief_moves import BeliefMoves
from inscrutable.adversaries.decision_tables import UNSEEN, DecisionTables, Entries, KnownRule
from inscrutable.adversaries.sequence_evidence import Evidence, impossible_step
from inscrutable.adversaries.sequence_results import InferredBeliefs, SequenceStatus
from inscrutable.validation import Array
from inscrutable.worlds.public import UNREAD

_CELLS = 4.0
"""Largest distance of a possible point from one that plays the decision, in interpolation errors: they are neighbours."""

_BELIEVED = 0.5
"""Weight of the reading in the mixture, for a decision read with a tolerance."""


class Laws(NamedTuple):
    """Joint laws of state, belief and memory of L observers; a column is one observer's law at one memory."""

    weights: Array  # (X, B, C)
    observer: np.ndarray  # (C,), ascending from 0 to L−1
    memory: np.ndarray  # (C,)

    def totals(self) -> Array:
        """Return the weight of each law, shape (L,)."""
        return np.asarray(np.bincount(self.observer, weights=self.weights.sum(axis=(0, 1))))

    def of_belief(self) -> Array:
        """Return the laws over beliefs, shape (L,B)."""
        starts = np.flatnonzero(np.diff(self.observer, prepend=-1))
        return np.asarray(np.add.reduceat(self.weights.sum(axis=0), starts, axis=1).T)

    def of_state(self) -> Array:
        """Return the laws over states, shape (L,X)."""
        starts = np.flatnonzero(np.diff(self.observer, prepend=-1))
        return np.asarray(np.add.reduceat(self.weights.sum(axis=1), starts, axis=1).T)

    def divided(self, totals: Array) -> Laws:
        """Return each law divided by its own number, (L,)."""
        return self._replace(weights=self.weights / totals[self.observer])

    def repeated(self, numbers: np.ndarray) -> Laws:
        """Return the laws of the observers with these numbers, repeated where a number is repeated."""
        first, last = (np.searchsorted(self.observer, numbers, side=side) for side in ("left", "right"))
        columns = np.repeat(first - np.cumsum(last - first) + last - first, last - first) + np.arange(
            (last - first).sum()
        )
        return Laws(self.weights[:, :, columns], np.repeat(np.arange(len(numbers)), last - first), self.memory[columns])


def side_by_side(laws: list[Laws]) -> Laws:
    """Return the laws of several groups of observers as one group."""
    before = np.cumsum([0, *(each.observer[-1] + 1 for each in laws[:-1])])
    return Laws(
        np.concatenate([each.weights for each in laws], axis=2),
        np.concatenate([each.observer + first for each, first in zip(laws, before, strict=True)]),
        np.concatenate([each.memory for each in laws]),
    )


class DecisionReading(NamedTuple):
    """The update by decisions, entry by entry: (b,c) → (b',c') with a likelihood."""

    source: np.ndarray  # (n,), b·C + c
    target: np.ndarray  # (n,), b'·C' + c'
    share: Array  # (n,)
    n_before: int  # C
    observer: np.ndarray  # (C',)
    memory: np.ndarray  # (C',)
    error: float = 0.0  # expected distance of points from those that replace them
    is_widened: bool = False  # whether points were replaced by others

    def moved(self, laws: Laws) -> Laws:
        """Return the laws after the decisions."""
        n_points = laws.weights.shape[1]
        found = np.empty((len(laws.weights), n_points * len(self.memory)))
        for row, held in zip(found, laws.weights.reshape(len(found), -1), strict=True):
            row[:] = np.bincount(self.target, weights=held[self.source] * self.share, minlength=found.shape[1])
        return Laws(found.reshape(len(found), n_points, -1), self.observer, self.memory)

    def back(self, later: Array) -> Array:
        """Return the likelihoods (X,B,C) of later evidence before the decision, from those (X,B,C') after it."""
        n_points = later.shape[1]
        found = np.empty((len(later), n_points * self.n_before))
        for row, held in zip(found, later.reshape(len(later), -1), strict=True):
            row[:] = np.bincount(self.source, weights=held[self.target] * self.share, minlength=found.shape[1])
        return found.reshape(len(later), n_points, -1)


def read_decisions(
    tables: DecisionTables, laws: Laws, columns: np.ndarray, told: np.ndarray | None = None
) -> DecisionReading:
    """Return the update by one decision of each observer (L,), given the public memory after it (L,) where there is one."""
    entries = tables.entries(columns[laws.observer], laws.memory)
    if told is not None:
        some = entries.after == told[laws.observer[entries.column]]
        entries = Entries(*(each[some] for each in entries))
    keys, place = np.unique(laws.observer[entries.column] * tables.n_memories + entries.after, return_inverse=True)
    count = len(laws.memory)
    return DecisionReading(
        entries.belief * count + entries.column,
        entries.belief * len(keys) + place.reshape(-1),
        entries.share,
        count,
        *np.divmod(keys, tables.n_memories),
    )


@dataclass(frozen=True, eq=False)
class ForwardPass:
    """The results of a forward pass at every step, and the laws and updates that the smoother needs."""

    beliefs: Array  # (T, B)
    states: Array  # (T, X)
    log_likelihood: Array
    errors: Array
    statuses: tuple[SequenceStatus, ...]
    laws: list[Laws]
    readings: list[DecisionReading]


class InverseFilter:
    """The observer's filter on the beliefs of a known rule, for any number of sequences."""

    def __init__(self, moves: BeliefMoves, rule: KnownRule) -> None:
        self.moves, self.rule = moves, rule

    def predicted(
        self, laws: Laws | None, told: int | None = None, *, read: np.ndarray | None = None
    ) -> tuple[Laws, Array]:
        """Return the laws before a decision, and the expected distances (L,) of the belief from the points.

        Where each observer reads a public symbol (L,), the total of its law is multiplied by the symbol's probability.
        """
        if laws is not None:
            weights, errors = self._ahead(laws, read)
            found = laws._replace(weights=weights)
            apart = np.bincount(laws.observer, weights=errors)
        else:
            initial = self.rule.initial if told is None else np.eye(len(self.rule.initial))[told]
            memory = np.flatnonzero(initial)
            start, error = self.moves.first(UNREAD if read is None else int(read[0]))
            found = Laws(start[:, :, None] * initial[memory], np.zeros(len(memory), dtype=np.intp), memory)
            apart = np.array([error])
        if read is not None:
            totals = found.totals()
            apart = np.divide(apart, totals, out=np.zeros_like(totals), where=totals > 0)
        return found, np.asarray(apart, dtype=np.float64)

    def _ahead(self, laws: Laws, read: np.ndarray | None) -> tuple[Array, Array]:
        if read is None:
            return self.moves.ahead(laws.weights)
        weights, errors = np.empty_like(laws.weights), np.empty(len(laws.memory))
        columns = read[laws.observer]
        for symbol in np.unique(columns):
            mine = columns == symbol
            weights[:, :, mine], errors[mine] = self.moves.ahead(laws.weights[:, :, mine], int(symbol))
        return weights, errors

    def later(self, laws: Laws, n_steps: int) -> tuple[Laws, Array]:
        """Return the predicted law some steps later, without further observations, and the summed interpolation errors (L,).

        The memory stays as it was: the transition of beliefs does not depend on it.
        """
        errors: Array = np.zeros(int(laws.observer[-1]) + 1)
        for _ in range(n_steps):
            laws, more = self.predicted(laws)
            errors = errors + more
        return laws, errors

    def forward(
        self, evidence: Evidence, *, tables: list[DecisionTables] | None = None, keep: bool = False
    ) -> tuple[ForwardPass, list[DecisionTables]]:
        """Filter a sequence; `tables` replaces the decision tables of this observer's law."""
        n_steps, first = len(evidence), None if evidence.told is None else int(evidence.told[0])
        beliefs, states = np.empty((n_steps, len(self.moves.points))), np.empty((n_steps, self.moves.starts.shape[1]))
        logs, errors = np.empty(n_steps), np.empty(n_steps)
        laws: Laws | None = None
        before = None
        kept, readings, statuses, used = [], [], [], []
        for t in range(n_steps):
            predicted, error = self.predicted(laws, first, read=evidence.read_at(t))
            errors[t] = error[0]
            seen = predicted._replace(weights=predicted.weights * evidence.states[t][:, None, None])
            if not seen.weights.sum() > 0:
                raise impossible_step(t)
            known = (
                tables[t] if tables is not None else self.rule.at(seen.of_belief()[0], before, seen=evidence.is_seen(t))
            )
            column, moved = known.column(evidence.points[t], evidence.nearest)
            if column != UNSEEN:  # ties go to the latest observation
                before = known.action(column)
            told = None if evidence.told is None else evidence.told[t + 1 : t + 2]
            laws, reading, total = self.read(known, seen, column, told, error=float(errors[: t + 1].max()))
            with np.errstate(divide="ignore"):
                logs[t] = np.log(total) + evidence.offsets[t]
            errors[t] += reading.error
            beliefs[t], states[t] = laws.of_belief()[0], laws.of_state()[0]
            status = evidence.status(column, moved, total)
            statuses.append(SequenceStatus.WIDENED if reading.is_widened else status)
            used.append(known)
            if keep:
                kept.append(laws)
                readings.append(reading)
        return ForwardPass(beliefs, states, logs, errors, tuple(statuses), kept, readings), used

    def read(
        self, tables: DecisionTables, seen: Laws, column: int, told: np.ndarray | None, *, error: float
    ) -> tuple[Laws, DecisionReading, float]:
        """Return one observer's normalised law after a decision, the update, and the decision's probability.

        A decision of probability 0 is read with a tolerance where the law has an interpolation `error`, and otherwise skipped.
        """
        reading = read_decisions(tables, seen, np.array([column]), told)
        law = reading.moved(seen)
        if column >= 0 and error > tolerances.SAME_BELIEF and not law.weights.sum() > 0:
            widened = self._widened(tables, seen, column, told)
            if widened is not None:
                reading, law = widened, widened.moved(seen)
        total = float(law.weights.sum())
        if not total > 0:
            reading = _passed_over(tables, seen, told)
            law = reading.moved(seen)
        return law.divided(law.totals()), reading, total

    def _widened(
        self, tables: DecisionTables, seen: Laws, column: int, told: np.ndarray | None
    ) -> DecisionReading | None:
        """Replace possible points by the nearest point that plays the decision, within a tolerance.

        None where the nearest is too far to be an error of the grid. The weights sum to the likelihood of the replacements.
        """
        points, mass, count = self.moves.points, seen.weights.sum(axis=0), len(seen.memory)
        plain = read_decisions(tables, seen, np.array([column]), told)
        shares = np.bincount(plain.source, weights=plain.share, minlength=mass.size).reshape(mass.shape)
        gaps, stand_in = np.full(mass.shape, np.inf), np.zeros(mass.shape, dtype=np.intp)
        for c in np.flatnonzero((shares > 0).any(axis=0)):
            plays = np.flatnonzero(shares[:, c] > 0)
            gaps[:, c], place = cKDTree(points[plays]).query(points)
            stand_in[:, c] = plays[place]
        least, step = float(gaps[mass > 0].min()), float(self.moves.errors.max())
        if least > _CELLS * step:
            return None
        near = np.where(gaps <= least + step, np.take_along_axis(shares, stand_in, axis=0), 0.0)
        held = mass * near
        total = float(held.sum())
        kept = (1.0 - _BELIEVED) * total / float(mass.sum())
        aside = read_decisions(tables, seen, np.array([UNSEEN]), told)
        after, place = np.unique(np.concatenate([plain.memory, aside.memory]), return_inverse=True)
        # Every replaced point and memory moves as its replacement does.
        moved = np.flatnonzero(near.reshape(-1) > 0)
        as_if = stand_in.reshape(-1)[moved] * count + moved % count
        order = np.argsort(plain.source, kind="stable")
        first, last = (np.searchsorted(plain.source[order], as_if, side=side) for side in ("left", "right"))
        entry = order[np.concatenate([np.arange(*each) for each in zip(first, last, strict=True)])]
        gap = np.where(np.isfinite(gaps), gaps, 0.0)
        return DecisionReading(
            np.concatenate([np.repeat(moved, last - first), aside.source]),
            np.concatenate(
                [_columns(plain, place, 0, len(after))[entry], _columns(aside, place, len(plain.memory), len(after))]
            ),
            np.concatenate([_BELIEVED * plain.share[entry], kept * aside.share]),
            count,
            np.zeros(len(after), dtype=np.intp),
            after,
            float((held * gap).sum()) / total,
            True,
        )

    def smoothed(self, evidence: Evidence, passed: ForwardPass) -> list[Laws]:
        """Return the laws given the whole sequence (forward-backward)."""
        laws = list(passed.laws)
        later = np.ones(laws[-1].weights.shape)
        for t in range(len(evidence) - 2, -1, -1):
            later = passed.readings[t + 1].back(later) * evidence.states[t + 1][:, None, None]
            later = self.moves.back(later, evidence.symbol_at(t + 1))
            later /= later.max()
            weights = laws[t].weights * later
            laws[t] = laws[t]._replace(weights=weights / weights.sum())
        return laws

    def result(self, passed: ForwardPass, laws: list[Laws] | None = None) -> InferredBeliefs:
        """Return a forward pass as a result, with smoothed laws where they are given."""
        points = self.moves.points
        weights = passed.beliefs if laws is None else np.array([each.of_belief()[0] for each in laws])
        states = passed.states if laws is None else np.array([each.of_state()[0] for each in laws])
        mean = weights @ points
        spread = np.zeros(len(weights))
        for i, column in enumerate(points.T):
            spread += (weights * (column - mean[:, i, None]) ** 2).sum(axis=1)
        return InferredBeliefs(
            points,
            weights,
            mean,
            np.sqrt(spread),
            mean if self.moves.of_chain else states,
            passed.log_likelihood,
            passed.statuses,
            1.0 / (weights**2).sum(axis=1),
            passed.errors,
        )


def _columns(reading: DecisionReading, place: np.ndarray, start: int, count: int) -> np.ndarray:
    """Return the target columns of one observer's update among those of all observers."""
    belief, column = np.divmod(reading.target, len(reading.memory))
    return np.asarray(belief * count + place.reshape(-1)[start + column])


def _passed_over(tables: DecisionTables, seen: Laws, told: np.ndarray | None) -> DecisionReading:
    """Return the law without an update; a public memory that the mechanism rules out is accepted nevertheless."""
    reading = read_decisions(tables, seen, np.array([UNSEEN]), told)
    if told is None or reading.moved(seen).weights.sum() > 0:
        return reading
    count = len(seen.memory)
    source = np.arange(seen.weights.shape[1] * count)
    return DecisionReading(source, source // count, np.ones(len(source)), count, np.zeros(1, dtype=np.intp), told)
