"""Leakage along paths of beliefs: over every sequence of decisions where they are few, otherwise over sampled ones.

Observers with different histories of decisions are processed together, each with a law of state, belief and memory; observers
with equal histories are one.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable import tolerances
from inscrutable.adversaries.decision_tables import UNSEEN, DecisionTables
from inscrutable.adversaries.inverse_filter import InverseFilter, Laws, read_decisions, side_by_side
from inscrutable.adversaries.sequence_evidence import Evidence, unseen_points
from inscrutable.adversaries.sequence_results import InferredBeliefs
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.mechanisms.calendars import Schedule
from inscrutable.privacy.losses import Loss
from inscrutable.validation import Array
from inscrutable.worlds.public import UNREAD

_MOST_HELD = 2**22
"""Numbers in the laws in memory at once, 32 MB; more paths are processed in blocks."""
_MOST_READ = 2**16
"""Most laws in an enumeration of the public symbols until a decision is seen."""
_BELIEF, _SQUARED, _LOST, _PRIOR, FIGURES = 1, 3, 4, 5, 7
"""Rows of figures: added bits, information on belief and on state, square error, loss, and the last two without decisions."""


class PathFigures(NamedTuple):
    """Figures of D paths at T steps, each (D,T); the paths are equally likely."""

    added: Array
    belief: Array
    state: Array
    squared: Array
    lost: Array  # a rival's loss; the square error where no other loss was given
    prior: Array | None = None  # square error from public observations alone, without decisions
    prior_lost: Array | None = None  # the loss without decisions
    interpolation_error: float = 0.0
    is_sampled: bool = True


class PathDraws(NamedTuple):
    """Sampled paths of private beliefs."""

    places: np.ndarray  # (T,D), the points that the agent decides at
    beliefs: Array | None  # (T,D,X), the beliefs themselves; None where they are the points
    public: np.ndarray | None = None  # (T,D), the public symbols; None where there are none

    def of(self, some: slice) -> PathDraws:
        """Return some of the paths."""
        return PathDraws(*(None if each is None else each[:, some] for each in self))  # type: ignore[arg-type]


def unseen_beliefs(reader: InverseFilter, n_steps: int) -> InferredBeliefs:
    """Return the law of an observer without decisions and public observations."""
    states = np.ones((n_steps, reader.moves.starts.shape[1]))
    read = np.full(n_steps, UNREAD) if reader.moves.n_public > 1 else None
    evidence = Evidence(unseen_points(n_steps), False, None, states, np.zeros(n_steps), read)
    return reader.result(reader.forward(evidence)[0])


class Baseline:
    """Figures of laws against those of an observer with the same public observations and no decisions."""

    def __init__(self, reader: InverseFilter, unseen: InferredBeliefs, loss: Loss | None) -> None:
        self._reader, self._unseen, self._loss = reader, unseen, loss
        self.interpolation_error = float(unseen.interpolation_error.max())
        self._points, self._of_chain = reader.moves.points, reader.moves.of_chain
        self._laws: Laws | None = None  # one of each observer, where something is public

    @property
    def rows(self) -> Array:
        """Rows that are equal for equal laws, one per observer."""
        assert self._laws is not None
        weights: Array = self._laws.weights
        return np.asarray(weights.reshape(-1, weights.shape[2]).T)

    def read(self, before: np.ndarray, symbols: np.ndarray) -> None:
        """Move a step for observers that each follow an earlier one and have a new symbol."""
        if self._laws is None:
            weights = self._reader.moves.starts[symbols].transpose(1, 2, 0)
            laws = Laws(weights, np.arange(len(symbols)), np.zeros(len(symbols), dtype=np.intp))
        else:
            laws = self._reader.predicted(self._laws.repeated(before), read=symbols)[0]
        self._laws = laws.divided(laws.totals())

    def followed(self, before: np.ndarray) -> None:
        """Replace the observers by ones that each follow an earlier one."""
        if self._laws is not None:
            self._laws = self._laws.repeated(before)

    def means(self, step: int) -> Array:
        """Return E[π_t] of those who see no decision, shape (L,X)."""
        if self._laws is None:
            return np.asarray(self._unseen.mean[step])[None]
        return np.asarray(self._laws.of_belief() @ self._points)

    def without(self, n_steps: int) -> Array:
        """Return the figures of each step before a decision is seen, shape (7,T)."""
        found = np.zeros((FIGURES, n_steps))
        found[_SQUARED] = found[_LOST] = self._unseen.spread**2
        if self._loss is not None:
            found[_LOST] = self._loss.bayes_risk(self._unseen.weights, self._points)
        return found

    def figures(self, laws: Laws, step: int) -> tuple[Array, Array, Array, Array, Array]:
        """Return information on belief and on state (L,) in bits, square errors (L,), losses (L,) and means (L,X).

        Losses are the square errors where no other loss is asked for.
        """
        belief = laws.of_belief()
        mean = belief @ self._points
        state = mean if self._of_chain else laws.of_state()
        known = self._unseen.weights[step], self._unseen.states[step]
        if self._laws is not None:
            known = self._laws.of_belief(), self._laws.of_state()
            known = known[0], known[0] @ self._points if self._of_chain else known[1]
        centre = self._unseen.mean[step]
        squared = self._squared(belief, centre)
        return _divergence(belief, known[0]), _divergence(state, known[1]), squared, self._lost(belief, squared), mean

    def own(self, step: int) -> tuple[Array, Array]:
        """Return the square errors (L,) and losses (L,) of those who see no decision."""
        assert self._laws is not None
        belief = self._laws.of_belief()
        squared = self._squared(belief, self._unseen.mean[step])
        return squared, self._lost(belief, squared)

    def _squared(self, belief: Array, centre: Array) -> Array:
        """E‖π − mean‖² of laws (L,B), computed about a centre to avoid cancellation."""
        off = ((belief @ self._points - centre) ** 2).sum(axis=1)
        return np.asarray(np.maximum(belief @ ((self._points - centre) ** 2).sum(axis=1) - off, 0.0))

    def _lost(self, belief: Array, squared: Array) -> Array:
        return squared if self._loss is None else self._loss.bayes_risk(belief, self._points)

    def off_grid(self, beliefs: Array, means: Array) -> tuple[Array, Array]:
        """Return square errors (D,) and losses (D,) of estimates (D,X) of beliefs (D,X) off the grid."""
        apart = ((beliefs - means) ** 2).sum(axis=1)
        if self._loss is None:
            return apart, apart
        return apart, self._loss.least(beliefs) + self._loss.excess(beliefs, means)


def enumerated(
    reader: InverseFilter, prior: Baseline, n_steps: int, most: int, schedule: Schedule
) -> PathFigures | None:
    """Return exact figures (1,T), by enumeration of all sequences of disclosed decisions.

    None if the sequences lead to more than `most` laws, if the beliefs are not the points, or if the observer does not know
    the memory: what a decision adds then depends on the whole path.
    """
    if prior.interpolation_error > tolerances.SAME_BELIEF:
        return None
    found = prior.without(n_steps)
    told, is_public = reader.rule.is_public, reader.moves.n_public > 1
    laws = _told_starts(reader)[0] if told else reader.predicted(None)[0]
    chances = reader.rule.initial[laws.memory] if told else np.ones(1)
    last, is_late = list[Any]([None] * len(chances)), is_public and schedule.lag > 0
    if is_public:
        _read_before(reader, prior, (laws, chances), found[:, : schedule.lag])
    for s in range(n_steps - schedule.lag):
        t = s + schedule.lag
        if is_public:
            laws, chances, before = _every_reading(reader, prior, laws, chances, is_first=s == 0)
            last = [last[k] for k in before]
        elif s:
            laws = reader.predicted(laws)[0]
        if len(laws.memory) > len(chances) or len(chances) > most:
            return None
        begun: _ReadOn | None = None
        if schedule.shows(s):
            begun = _read_on(reader, prior, (laws, chances), schedule.lag if is_late else 0)
            if begun is None:
                return None
            grown = _decided(reader, (laws, chances), last, told, most)
            if grown is None:
                return None
            found[0, t], seen, counts = grown.bits, grown.seen, grown.counts
            known = (
                np.zeros((len(seen), 0))
                if reader.rule.is_fixed
                else np.array(seen, dtype=np.float64).reshape(len(seen), -1)
            )
            if is_public:
                prior.followed(np.repeat(np.arange(len(chances)), counts))
                known = np.hstack([known, prior.rows])
            laws, chances, kept = _merged(grown.laws, grown.chances, known)
            last = [seen[k] for k in kept]
            prior.followed(kept)
        else:
            laws = _passed(reader, laws)
        if not is_public:
            held = prior.figures(reader.later(laws, schedule.lag)[0], t)
            found[_BELIEF:_PRIOR, t] = [chances @ each for each in held[:4]]
            continue
        later = _read_on(reader, prior, (laws, chances), schedule.lag)
        if later is None:
            return None
        if begun is not None:  # symbols until a decision is seen are information about it
            found[0, t] = max(found[0, t] - (later.bits - begun.bits), 0.0)
        found[_BELIEF:_PRIOR, t] = [later.chances @ each for each in later.prior.figures(later.laws, t)[:4]]
        found[_PRIOR:, t] = [later.chances @ each for each in later.prior.own(t)]
    return _made(found[:, None], is_public, is_sampled=False)


class _Grown(NamedTuple):
    """Laws after every possible next decision, with their probabilities, the actions, the number that follow each law before,
    and the bits that the decision leaks."""

    laws: Laws
    chances: Array
    seen: list[Any]
    counts: list[int]
    bits: float


def _decided(reader: InverseFilter, known: tuple[Laws, Array], last: list[Any], told: bool, most: int) -> _Grown | None:
    """Return the laws after one decision, and their probabilities; None where there are more than `most`."""
    laws, chances = known
    after_all: list[Laws] = []
    their: list[Array] = []
    seen: list[Any] = []
    bits = 0.0
    for i, chance in enumerate(chances):
        one = laws.repeated(np.array([i]))
        tables = reader.rule.at(one.of_belief()[0], last[i])
        after = _every_decision(tables, one, told)
        if after is None or len(seen) + len(after[1]) > most:
            return None
        after_all.append(after[0])
        their.append(chance * after[1])
        seen += [tables.action(column) for column in after[3]]
        bits += chance * after[2]
    return _Grown(side_by_side(after_all), np.concatenate(their), seen, [len(each) for each in their], bits)


class _ReadOn(NamedTuple):
    """Laws after every sequence of public symbols in some steps, with their probabilities, and the baseline without decisions.

    The bits are E log2 of the probability of these symbols given the history before.
    """

    laws: Laws
    chances: Array
    prior: Baseline
    bits: float


def _read_on(reader: InverseFilter, prior: Baseline, known: tuple[Laws, Array], n_steps: int) -> _ReadOn | None:
    """Move some steps without disclosed decisions, over all sequences of symbols; None where these are too many."""
    laws, chances = known
    begun, own = chances, copy(prior)
    for _ in range(n_steps):
        if len(chances) * reader.moves.n_public > _MOST_READ:
            return None
        laws, chances, before = _every_reading(reader, own, laws, chances, is_first=False)
        begun = begun[before]
    return _ReadOn(laws, chances, own, float(chances @ np.log2(chances / begun)))


def _read_before(reader: InverseFilter, prior: Baseline, known: tuple[Laws, Array], found: Array) -> None:
    """Fill in the figures (7,T) of the steps with symbols before the first decision is seen."""
    (laws, chances), own = known, copy(prior)
    for t in range(found.shape[1]):
        laws, chances, _ = _every_reading(reader, own, laws, chances, is_first=t == 0)
        found[_SQUARED:_PRIOR, t] = found[_PRIOR:, t] = [chances @ each for each in own.own(t)]


def _made(found: Array, is_public: bool, error: float = 0.0, *, is_sampled: bool = True) -> PathFigures:
    """Figures (7,D,T), of which the last two are used where there are public observations."""
    prior, lost = (found[_PRIOR], found[_PRIOR + 1]) if is_public else (None, None)
    return PathFigures(found[0], found[1], found[2], found[3], found[4], prior, lost, error, is_sampled)


def _every_reading(
    reader: InverseFilter, prior: Baseline, laws: Laws, chances: Array, *, is_first: bool
) -> tuple[Laws, Array, np.ndarray]:
    """Laws after every public symbol of a step, their probabilities, and which of the laws before each comes from."""
    count = reader.moves.n_public
    before, read = (each.reshape(-1) for each in np.divmod(np.arange(len(chances) * count), count))
    if is_first:  # the law of the first step needs no move, only the symbol
        told = laws.memory if reader.rule.is_public else [None]
        found = side_by_side([reader.predicted(None, m, read=np.array([z]))[0] for m in told for z in range(count)])
    else:
        found = reader.predicted(laws.repeated(before), read=read)[0]
    totals = found.totals()
    some = np.flatnonzero(totals > 0)
    prior.read(before[some], read[some])
    kept = found.repeated(some)
    return kept.divided(kept.totals()), (chances[before] * totals)[some], before[some]


def _told_starts(reader: InverseFilter) -> tuple[Laws, Array]:
    """The laws before the first decision, one for each public memory that is possible, and their errors."""
    first = [reader.predicted(None, int(each)) for each in np.flatnonzero(reader.rule.initial)]
    return side_by_side([each[0] for each in first]), np.concatenate([each[1] for each in first])


def _passed(reader: InverseFilter, laws: Laws) -> Laws:
    """The laws after a decision that was not seen; unchanged for a rule, which has no memory."""
    tables = reader.rule.at(reader.moves.start[0], seen=False)
    unseen = np.full(int(laws.observer[-1]) + 1, UNSEEN)
    return read_decisions(tables, laws, unseen).moved(laws)


def _every_decision(tables: DecisionTables, law: Laws, is_public: bool) -> tuple[Laws, Array, float, np.ndarray] | None:
    """Laws after every decision, their probabilities, what the decision leaks, in bits, and the decisions' numbers.

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
    reader: InverseFilter, prior: Callable[[], Baseline], draws: PathDraws, rng: np.random.Generator, schedule: Schedule
) -> PathFigures:
    """Return figures along sampled paths of beliefs, with decisions drawn at every step."""
    block = max(_MOST_HELD // reader.moves.start.size, 1)
    parts = []
    for first in range(0, draws.places.shape[1], block):
        part = draws.of(slice(first, first + block))
        parts.append(_Sampling(prior(), reader, part, rng))
        parts[-1].run(schedule)
    found = np.concatenate([part.found for part in parts], axis=1)
    return _made(found, draws.public is not None, max(part.worst for part in parts))


class _Observers(NamedTuple):
    """Observers side by side, and which of them follows each of D paths."""

    which: np.ndarray  # (D,)
    laws: Laws  # of L observers
    errors: Array  # (L,): the largest interpolation error so far
    prior: Baseline  # the baselines without decisions, in the same order
    logs: Any = 0.0  # (D,): log2 of the probability of the symbols
    error: Any = 0.0  # (L,): the interpolation error of the last step
    before: Any = None  # (L,): observers of the step before


class _Sampling:
    """Some paths that are followed together."""

    def __init__(self, prior: Baseline, reader: InverseFilter, draws: PathDraws, rng: np.random.Generator) -> None:
        self._reader, self._draws, self._rng = reader, draws, rng
        self._prior = prior
        self.worst = prior.interpolation_error
        count = draws.places.shape[1]
        initial = reader.rule.initial
        self._count = len(initial)
        self._memory: np.ndarray = np.zeros(count, dtype=np.intp)
        if self._count > 1:
            self._memory[:] = rng.choice(self._count, size=count, p=initial)
        self._public = reader.rule.is_public
        # The law of the memory, given the path's own beliefs and decisions.
        own = np.eye(self._count)[self._memory] if self._public else np.tile(initial, (count, 1))
        self._own = sparse.csr_array(own)
        self._last: list[Any] = []  # the decision that each observer of a rule saw before

    def run(self, schedule: Schedule) -> None:
        """Follow the paths to their end."""
        n_steps, count = self._draws.places.shape
        read = self._draws.public
        found = self.found = np.repeat(self._prior.without(n_steps)[:, None], count, axis=1)
        if schedule.lag:
            self._before(found[:, :, : schedule.lag])
        which, laws, error = self._started()
        errors = error
        for s in range(n_steps - schedule.lag):
            t = s + schedule.lag
            if s and read is None:
                laws, error = self._reader.predicted(laws)
                errors = np.maximum(errors, error)
            elif s and read is not None:
                step = self._read_public(_Observers(which, laws, errors, self._prior), read[s])
                which, laws, errors, error = step.which, step.laws, step.errors, step.error
                self._last = [self._last[k] for k in step.before] if self._last else []
            ahead = None if read is None else read[s + 1 : t + 1]
            if schedule.shows(s):
                begun = None if ahead is None else self._later(_Observers(which, laws, errors, self._prior), ahead)
                which, laws, totals, errors, shares = self._decided(laws, which, np.stack([errors, error]), s)
                with np.errstate(divide="ignore"):
                    found[0, :, t] = np.where(totals[which] > 0, np.log2(shares) - np.log2(totals[which]), 0.0)
                if begun is not None:
                    found[0, :, t] += begun.logs
            else:
                begun = None
                laws = self._unseen(laws, s)
            if ahead is None:
                held, more = self._reader.later(laws, schedule.lag)
                later = _Observers(which, held, np.maximum(errors, more), self._prior)
            else:
                later = self._later(_Observers(which, laws, errors, self._prior), ahead)
                found[_PRIOR:, :, t] = np.stack(later.prior.own(t))[:, later.which]
                if begun is not None:
                    found[0, :, t] -= later.logs
            self._measure(found, later, t)

    def _measure(self, found: Array, held: _Observers, t: int) -> None:
        """Enter the figures of the observers' laws at a step."""
        which, worst = held.which, held.errors
        self.worst = max(self.worst, float(worst.max()))
        belief, state, squared, lost, mean = held.prior.figures(held.laws, t)
        found[_BELIEF:_PRIOR, :, t] = np.stack([belief, state, squared, lost])[:, which]
        if self._draws.beliefs is not None:
            off = np.stack(self._prior.off_grid(self._draws.beliefs[t], mean[which]))
            rows = slice(_SQUARED, _PRIOR)
            found[rows, :, t] = np.where(worst[which] > tolerances.SAME_BELIEF, off, found[rows, :, t])

    def _before(self, found: Array) -> None:
        """Enter the steps before the first decision is seen: the public symbols, and the true distance from the estimate."""
        prior, which = copy(self._prior), np.zeros(found.shape[1], dtype=np.intp)
        for t in range(found.shape[2]):
            if self._draws.public is not None:
                seen, place = np.unique(np.column_stack([which, self._draws.public[t]]), axis=0, return_inverse=True)
                prior.read(*seen.T)
                which = place.reshape(-1)
                found[_SQUARED:_PRIOR, :, t] = found[_PRIOR:, :, t] = np.stack(prior.own(t))[:, which]
            if self._draws.beliefs is not None and self.worst > tolerances.SAME_BELIEF:
                found[_SQUARED:_PRIOR, :, t] = prior.off_grid(self._draws.beliefs[t], prior.means(t)[which])

    def _unseen(self, laws: Laws, s: int) -> Laws:
        """Return the laws after an undisclosed decision, with the memory updated."""
        if self._count > 1:
            tables = self._reader.rule.at(self._reader.moves.start[0])
            table, count, places = tables.mechanism.observed, self._count, self._draws.places[s]
            self._memory[:] = tables.draws(places * count + self._memory, self._rng) % count
            held = self._own.tocoo()
            chosen: Any = table[places[held.row] * count + held.col]
            entry = np.repeat(np.arange(len(held.row)), np.diff(chosen.indptr))
            moved = (chosen.data * held.data[entry], (held.row[entry], chosen.indices % count))
            self._own = sparse.csr_array(sparse.coo_array(moved, shape=self._own.shape))
        return _passed(self._reader, laws)

    def _started(self) -> tuple[np.ndarray, Laws, Array]:
        """The observers before the first decision: one for every public memory and public symbol that there is."""
        read = None if self._draws.public is None else self._draws.public[0]
        if read is None and not self._public:
            laws, errors = self._reader.predicted(None)
            return np.zeros(len(self._memory), dtype=np.intp), laws, errors
        if read is None:
            laws, errors = _told_starts(self._reader)
            return np.searchsorted(laws.memory, self._memory), laws, errors
        keys = np.column_stack([self._memory if self._public else np.zeros(len(self._memory), np.intp), read])
        seen, which = np.unique(keys, axis=0, return_inverse=True)
        first = [
            self._reader.predicted(None, int(memory) if self._public else None, read=np.array([symbol]))
            for memory, symbol in seen
        ]
        self._prior.read(np.arange(len(seen)), seen[:, 1])
        laws = side_by_side([each[0] for each in first])
        return which.reshape(-1), laws.divided(laws.totals()), np.concatenate([each[1] for each in first])

    def _read_public(self, known: _Observers, symbols: np.ndarray) -> _Observers:
        """Return the observers a step later, given each path's public symbol.

        A symbol of probability 0 on the grid is ignored.
        """
        seen, place = np.unique(np.column_stack([known.which, symbols]), axis=0, return_inverse=True)
        (before, read), which = seen.T, place.reshape(-1)
        found, error = self._reader.predicted(known.laws.repeated(before), read=read)
        totals = found.totals()
        lost = ~(totals > 0)
        if lost.any():
            found, error = self._reader.predicted(known.laws.repeated(before), read=np.where(lost, UNREAD, read))
            totals = found.totals()
        known.prior.read(before, read)
        logs = known.logs + np.log2(np.where(lost, 1.0, totals))[which]
        errors = np.maximum(known.errors[before], error)
        return _Observers(which, found.divided(totals), errors, known.prior, logs, error, before)

    def _later(self, known: _Observers, read: np.ndarray) -> _Observers:
        """Return the observers after steps (n,D) with their path's symbols and without decisions."""
        known = known._replace(prior=copy(known.prior), logs=np.zeros(len(known.which)))
        for symbols in read:
            known = self._read_public(known, symbols)
        return known

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
        before: list[np.ndarray] = []
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
            before.append(seen[:, 0])
        self._last = last
        self._prior.followed(np.concatenate(before))
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
    """Σ p log2(p/q) along the last axis, in bits.

    Points with q = 0 are left out: on a grid a decision that no possible belief plays is read as one of a belief nearby.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        bits = np.where((law > 0) & (prior > 0), law * np.log2(law / prior), 0.0).sum(axis=-1)
    return np.asarray(np.maximum(bits, 0.0))
