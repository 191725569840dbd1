"""What decisions tell along paths of beliefs: by every sequence of decisions where they are few, otherwise by sampled ones.

Observers who have seen other decisions stand side by side, each with a law of state, belief and memory; those who have seen the
same are one.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable import tolerances
from inscrutable.adversaries.decision_tables import DecisionTables
from inscrutable.adversaries.inverse_filter import InverseFilter, Laws, read_decisions, side_by_side
from inscrutable.adversaries.sequence_evidence import Evidence, unseen_points
from inscrutable.adversaries.sequence_results import InferredBeliefs
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.privacy.losses import Loss
from inscrutable.validation import Array

_MOST_HELD = 2**22
"""Numbers in the laws held at once, 32 MB: of more paths one block follows after the other."""


class PathFigures(NamedTuple):
    """Figures of D paths at T steps, each (D,T); the paths are equally likely."""

    added: Array
    belief: Array
    state: Array
    squared: Array
    lost: Array
    interpolation_error: float = 0.0
    is_sampled: bool = True


class PathDraws(NamedTuple):
    """Sampled paths of private beliefs."""

    places: np.ndarray  # (T,D), the points that the agent decides at
    beliefs: Array | None  # (T,D,X), the beliefs themselves; None where they are the points


def unseen_beliefs(reader: InverseFilter, n_steps: int) -> InferredBeliefs:
    """Return what one holds who sees no decision."""
    states = np.ones((n_steps, len(reader.moves.start)))
    evidence = Evidence(unseen_points(n_steps), False, None, states, np.zeros(n_steps))
    return reader.result(reader.forward(evidence)[0])


class _Prior:
    """Figures of laws against those of one who sees no decision."""

    def __init__(self, reader: InverseFilter, unseen: InferredBeliefs, loss: Loss | None) -> None:
        self._points, self._of_chain, self._unseen = reader.moves.points, reader.moves.of_chain, unseen
        self._loss = loss
        self.interpolation_error = float(unseen.interpolation_error.max())

    def figures(self, laws: Laws, step: int) -> tuple[Array, Array, Array, Array, Array]:
        """Return information on belief and on state (L,) in bits, square errors (L,), losses (L,) and means (L,X).

        Losses are the square errors where no other loss is asked for.
        """
        belief = laws.of_belief()
        mean = belief @ self._points
        state = mean if self._of_chain else laws.of_state()
        centre = self._unseen.mean[step]
        squared = np.maximum(
            belief @ ((self._points - centre) ** 2).sum(axis=1) - ((mean - centre) ** 2).sum(axis=1), 0.0
        )
        return (
            _divergence(belief, self._unseen.weights[step]),
            _divergence(state, self._unseen.states[step]),
            squared,
            squared if self._loss is None else self._loss.bayes_risk(belief, self._points),
            mean,
        )

    def off_grid(self, beliefs: Array, means: Array) -> tuple[Array, Array]:
        """Return square errors (D,) and losses (D,) of estimates (D,X) of beliefs (D,X) that the points only stand for."""
        apart = ((beliefs - means) ** 2).sum(axis=1)
        if self._loss is None:
            return apart, apart
        return apart, self._loss.least(beliefs) + self._loss.excess(beliefs, means)


def enumerated(
    reader: InverseFilter, unseen: InferredBeliefs, n_steps: int, most: int, loss: Loss | None = None
) -> PathFigures | None:
    """Return exact figures (1,T) by every sequence of decisions.

    None where sequences leave more than `most` laws, where the observer does not know the memory, so that what a decision
    adds depends on the whole path, or where the beliefs are not the points.
    """
    if unseen.interpolation_error.max() > tolerances.SAME_BELIEF:
        return None
    prior, found = _Prior(reader, unseen, loss), np.zeros((5, n_steps))
    told = reader.rule.is_public
    laws = _told_starts(reader)[0] if told else reader.predicted(None)[0]
    chances = reader.rule.initial[laws.memory] if told else np.ones(1)
    last: list[Any] = [None] * len(chances)
    for t in range(n_steps):
        laws = reader.predicted(laws)[0] if t else laws
        if len(laws.memory) > len(chances):
            return None
        grown: list[tuple[Laws, Array]] = []
        count, seen = 0, []
        for i, chance in enumerate(chances):
            one = laws.repeated(np.array([i]))
            tables = reader.rule.at(one.of_belief()[0], last[i])
            after = _every_decision(tables, one, told)
            if after is None or count + len(after[1]) > most:
                return None
            found[0, t] += chance * after[2]
            grown.append((after[0], chance * after[1]))
            count += len(after[1])
            seen += [tables.action(column) for column in after[3]]
        known = np.zeros((count, 0)) if reader.rule.is_fixed else np.array(seen, dtype=np.float64).reshape(count, -1)
        laws, chances, kept = _merged(
            side_by_side([each for each, _ in grown]), np.concatenate([each for _, each in grown]), known
        )
        last = [seen[k] for k in kept]
        found[1:, t] = [chances @ each for each in prior.figures(laws, t)[:4]]
    rows = found[:, None]
    return PathFigures(rows[0], rows[1], rows[2], rows[3], rows[4], is_sampled=False)


def _told_starts(reader: InverseFilter) -> tuple[Laws, Array]:
    """The laws before the first decision of those who are told each of the memories that there may be, and their errors."""
    first = [reader.predicted(None, int(each)) for each in np.flatnonzero(reader.rule.initial)]
    return side_by_side([each[0] for each in first]), np.concatenate([each[1] for each in first])


def _every_decision(tables: DecisionTables, law: Laws, is_public: bool) -> tuple[Laws, Array, float, np.ndarray] | None:
    """Laws after every decision, their probabilities, what the decision tells, in bits, and the decisions' numbers.

    None where the observer would not know the memory.
    """
    numbers = np.zeros(len(tables.played), dtype=np.intp)
    laws = law.repeated(numbers)
    reading = read_decisions(tables, laws, tables.played)
    after = reading.moved(laws)
    if not is_public and len(np.unique(after.observer)) < len(after.observer):
        return None
    chance = after.weights.sum(axis=(0, 1))
    some = np.flatnonzero(chance > 0)
    joint = laws.weights.sum(axis=0).reshape(-1)[reading.source] * reading.share
    bits = float(joint @ np.log2(reading.share) - chance[some] @ np.log2(chance[some]))
    kept = Laws(after.weights[:, :, some] / chance[some], np.arange(len(some)), after.memory[some])
    return kept, chance[some], max(bits, 0.0), tables.played[after.observer[some]]


def _merged(laws: Laws, chances: Array, last: Array) -> tuple[Laws, Array, np.ndarray]:
    """Laws that agree to `tolerances.REACHED_BELIEF`, memory and last decision included, as one, with the first of each."""
    rows = np.column_stack([laws.weights.reshape(-1, len(chances)).T, laws.memory, last])
    kept, place = np.unique(first_equal(rows, tolerances.REACHED_BELIEF), return_inverse=True)
    merged = Laws(laws.weights[:, :, kept], np.arange(len(kept)), laws.memory[kept])
    return merged, np.asarray(np.bincount(place.reshape(-1), weights=chances)), kept


def sampled(
    reader: InverseFilter,
    unseen: InferredBeliefs,
    draws: PathDraws,
    rng: np.random.Generator,
    loss: Loss | None = None,
) -> PathFigures:
    """Return figures along sampled paths of beliefs, with decisions drawn at every step."""
    block = max(_MOST_HELD // reader.moves.start.size, 1)
    parts = []
    for first in range(0, draws.places.shape[1], block):
        mine = slice(first, first + block)
        beliefs = None if draws.beliefs is None else draws.beliefs[:, mine]
        parts.append(
            _Sampling(_Prior(reader, unseen, loss), reader, PathDraws(draws.places[:, mine], beliefs), rng).run()
        )
    added, belief, state, squared, lost = (
        np.concatenate(each) for each in zip(*(part[:5] for part in parts), strict=True)
    )
    return PathFigures(added, belief, state, squared, lost, max(part.interpolation_error for part in parts))


class _Sampling:
    """Some paths that are followed together."""

    def __init__(self, prior: _Prior, reader: InverseFilter, draws: PathDraws, rng: np.random.Generator) -> None:
        self._reader, self._draws, self._rng = reader, draws, rng
        self._prior = prior
        self._worst = prior.interpolation_error
        count = draws.places.shape[1]
        initial = reader.rule.initial
        self._count = len(initial)
        self._memory: np.ndarray = np.zeros(count, dtype=np.intp)
        if self._count > 1:
            self._memory[:] = rng.choice(self._count, size=count, p=initial)
        self._public = reader.rule.is_public
        # What the memory may be, given the path's own beliefs and decisions.
        own = np.eye(self._count)[self._memory] if self._public else np.tile(initial, (count, 1))
        self._own = sparse.csr_array(own)
        self._last: list[Any] = []  # the decision that each observer of a rule saw before

    def run(self) -> PathFigures:
        """Follow the paths to their end."""
        n_steps, count = self._draws.places.shape
        found = np.empty((5, count, n_steps))
        which, laws, error = self._started()
        errors = error
        for t in range(n_steps):
            if t:
                laws, error = self._reader.predicted(laws)
                errors = np.maximum(errors, error)
            made = self._decided(laws, which, np.stack([errors, error]), t)
            which, laws, totals, errors = made[:4]
            self._worst = max(self._worst, float(errors.max()))
            belief, state, squared, lost, mean = self._prior.figures(laws, t)
            own, seen = np.log2(made[4]), totals[which]
            with np.errstate(divide="ignore"):
                found[0, :, t] = np.where(seen > 0, own - np.log2(seen), 0.0)
            found[1, :, t], found[2, :, t], found[3, :, t] = belief[which], state[which], squared[which]
            found[4, :, t] = lost[which]
            if self._draws.beliefs is not None:
                off = np.stack(self._prior.off_grid(self._draws.beliefs[t], mean[which]))
                found[3:, :, t] = np.where(errors[which] > tolerances.SAME_BELIEF, off, found[3:, :, t])
        return PathFigures(found[0], found[1], found[2], found[3], found[4], self._worst)

    def _started(self) -> tuple[np.ndarray, Laws, Array]:
        """The observers before the first decision: one, or one for every public memory."""
        if not self._public:
            laws, errors = self._reader.predicted(None)
            return np.zeros(len(self._memory), dtype=np.intp), laws, errors
        laws, errors = _told_starts(self._reader)
        return np.searchsorted(laws.memory, self._memory), laws, errors

    def _decided(
        self, laws: Laws, which: np.ndarray, errors: Array, t: int
    ) -> tuple[np.ndarray, Laws, Array, Array, Array]:
        """Return observers, laws, probabilities and errors after a decision, and each path's own probability of it.

        `errors` (2,L) are the largest so far and the present one.
        """
        own, child = np.empty(len(which)), np.empty(len(which), dtype=np.intp)
        grown: list[Laws] = []
        totals: list[Array] = []
        worst: list[Array] = []
        last: list[Any] = []
        fixed = self._reader.rule.is_fixed
        groups = [np.arange(errors.shape[1])] if fixed else np.arange(errors.shape[1])[:, None]
        beliefs = None if fixed else laws.of_belief()
        for group in groups:
            mine = np.flatnonzero(np.isin(which, group)) if len(groups) > 1 else np.arange(len(which))
            if beliefs is None:
                tables = self._reader.rule.at(self._reader.moves.start[0])
            else:
                tables = self._reader.rule.at(beliefs[group[0]], self._last[group[0]] if self._last else None)
            columns, own[mine] = self._played(tables, mine, t)
            keys = (which[mine], columns, self._memory[mine]) if self._public else (which[mine], columns)
            seen, place = np.unique(np.column_stack(keys), axis=0, return_inverse=True)
            child[mine] = place.reshape(-1) + sum(len(each) for each in totals)
            told = seen[:, 2] if self._public else None
            found = self._read(tables, laws.repeated(seen[:, 0]), seen[:, 1], told, errors[:, seen[:, 0]])
            last += [] if fixed else [tables.action(column) for column in seen[:, 1]]
            grown.append(found[0])
            totals.append(found[1])
            worst.append(found[2])
        self._last = last
        return child, side_by_side(grown), np.concatenate(totals), np.concatenate(worst), own

    def _played(self, tables: DecisionTables, mine: np.ndarray, t: int) -> tuple[np.ndarray, Array]:
        """Draw decisions and memories, and return the decisions with their probabilities given each path."""
        table, count, places = tables.mechanism.observed, self._count, self._draws.places[t, mine]
        columns, self._memory[mine] = np.divmod(tables.draws(places * count + self._memory[mine], self._rng), count)
        held = self._own[mine].tocoo()
        chosen: Any = table[places[held.row] * count + held.col]
        entry = np.repeat(np.arange(len(held.row)), np.diff(chosen.indptr))
        played, after = np.divmod(chosen.indices, count)
        path = held.row[entry]
        some = played == columns[path]
        if self._public:
            some &= after == self._memory[mine][path]
        weights = (chosen.data * held.data[entry])[some]
        own = np.bincount(path[some], weights=weights, minlength=len(mine))
        if count > 1:  # the mechanism is then the same for all paths
            self._own = sparse.csr_array((weights / own[path[some]], (path[some], after[some])), shape=self._own.shape)
        return columns, np.asarray(own, dtype=np.float64)

    def _read(
        self, tables: DecisionTables, laws: Laws, columns: np.ndarray, told: np.ndarray | None, errors: Array
    ) -> tuple[Laws, Array, Array]:
        """Return the laws after a decision of each observer, its probability, and the errors so far."""
        reading = read_decisions(tables, laws, columns, told)
        after = reading.moved(laws)
        weights = after.weights.sum(axis=(0, 1))
        totals: Array = np.asarray(np.bincount(after.observer, weights, len(columns)), dtype=np.float64)
        worst, kept = errors[0].copy(), []
        if (totals > 0).all():
            return after.divided(totals), totals, worst
        for i, column in enumerate(columns):
            mine = np.array([i])
            if totals[i] > 0:
                kept.append(after.repeated(mine).divided(totals[mine]))
                continue
            one, asked = laws.repeated(mine), None if told is None else told[mine]
            law, how, totals[i] = self._reader.read(tables, one, int(column), asked, error=float(worst[i]))
            worst[i] = max(worst[i], errors[1, i] + how.error)
            kept.append(law)
        return side_by_side(kept), totals, worst


def _divergence(law: Array, prior: Array) -> Array:
    """Σ p log2(p/q) along the last axis, in bits."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(law > 0, law * np.log2(law / prior), 0.0).sum(axis=-1))
