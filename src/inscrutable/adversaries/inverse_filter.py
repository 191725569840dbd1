"""The inverse filter and smoother on a grid of beliefs: forward and backward passes over (state, private belief).

α_0(x,b) = p_0(x) Σ_y B[x,y] W_0[y,b],   α_{t+1}(x',b') = Σ_y B[x',y] Σ_b W_y[b,b'] Σ_x P[x,x'] α_t(x,b),
each times what was seen of the state and K(u_t|π_b), then normalised. Row (y,b) of W holds the mixture of points that
stands for the agent's next belief T(π_b,y). The sums over y are taken once, in one sparse matrix.

Points that stand for the beliefs between them may all be excluded by a decision that the agent's own belief does play. Where
the law so far is interpolated, each point that was still possible then counts as the nearest one that plays the decision, if
that is hardly farther than for the point that has it nearest. This reading gets half of the law, and the other half stays
what it was before the decision: the square error of the estimate is then at most the mean of what believing the reading and
passing it over would leave, however wrong the grid led.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances
from inscrutable.adversaries.agent_steps import AgentModel
from inscrutable.adversaries.belief_points import BeliefPoints, PointMixture
from inscrutable.adversaries.sequence_evidence import UNSEEN, Evidence, impossible_step, played_shares
from inscrutable.adversaries.sequence_results import InferredBeliefs, SequenceStatus
from inscrutable.mechanisms import Mechanism
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel

_CELLS = 4.0
"""Largest interpolation errors by which a possible point may lie from one that plays the decision: they are neighbours."""

_BELIEVED = 0.5
"""Share of the law that a decision read with a tolerance gets."""


class DecisionReading(NamedTuple):
    """How a decision weighs the points: as K(u_t|·) at the point itself, or at another one that stands in for it."""

    shares: Array  # (B,), of the point or of its stand-in; ones where the decision was passed over
    places: np.ndarray | None = None  # (B,), the stand-ins; None: every point is read as itself
    error: float = 0.0  # expected distance of the stand-ins
    kept: float = 0.0  # weight of the law as it was, beside that of what was read

    def moved(self, law: Array) -> Array:
        """Return a law (X,B) times the shares, with what each point holds at its stand-in."""
        weighed = law * self.shares
        if self.places is None:
            return weighed
        found = np.zeros_like(weighed)
        for i, row in enumerate(weighed):
            found[i] = np.bincount(self.places, weights=row, minlength=len(row))
        return found + self.kept * law

    def back(self, later: Array) -> Array:
        """Return likelihoods (X,B) of what comes later, times the shares, as each point has them by its stand-in."""
        return np.asarray((later if self.places is None else later[:, self.places]) * self.shares + self.kept * later)


@dataclass(frozen=True, eq=False)
class ForwardPass:
    """Filtered laws (T,X,B) with what made them: the readings used, the errors made, the statuses."""

    laws: Array
    readings: list[DecisionReading]
    log_likelihood: Array
    errors: Array
    statuses: tuple[SequenceStatus, ...]


class InverseFilter:
    """The grid of a mechanism's beliefs, and how the agent moves on it: made once, used for any sequence."""

    def __init__(self, world: HiddenMarkovModel, agent: AgentModel, mechanism: Mechanism, points: BeliefPoints) -> None:
        self._mechanism, self._points = mechanism, points
        self._transition = world.transition
        reports = np.asarray(world.emission.probabilities)  # type: ignore[attr-defined]  # (X, Y)
        self._reports = reports
        n_states, n_symbols = reports.shape
        first = points.mixed(agent.first(agent.symbols()).reshape(-1, n_states))
        self._start = (world.initial[:, None] * reports) @ _as_rows(first, len(points)).toarray()
        self._start_error = float(((world.initial @ reports) * first.errors).sum())
        later = points.mixed(agent.next(points.points, agent.symbols()).reshape(-1, n_states))
        rows = _as_rows(later, len(points))  # row b·Y + y
        self.errors = later.errors.reshape(len(points), n_symbols)
        moves = [_summed(rows, share, len(points)) for share in reports]
        self._forward = sparse.csr_array(sparse.block_diag([move.T for move in moves], format="csr"))
        self._backward = sparse.csr_array(sparse.block_diag(moves, format="csr"))

    def forward(self, evidence: Evidence) -> ForwardPass:
        """Filter a sequence."""
        n_steps, shape = len(evidence), self._start.shape
        known = played_shares(self._mechanism, evidence.columns)
        laws, used, statuses = np.empty((n_steps, *shape)), [], []
        logs, errors = np.empty(n_steps), np.empty(n_steps)
        errors[0] = self._start_error
        predicted = self._start
        for t in range(n_steps):
            if t:
                moved = self._transition.T @ laws[t - 1]
                errors[t] = float(((self._reports.T @ moved) * self.errors.T).sum())
                predicted = (self._forward @ moved.reshape(-1)).reshape(shape)
            seen = predicted * evidence.states[t][:, None]
            whole = float(seen.sum())
            if not whole > 0:
                raise impossible_step(t)
            reading = DecisionReading(known[int(evidence.columns[t])])
            law = reading.moved(seen)
            status = evidence.status(t, float(law.sum()))
            if status is SequenceStatus.CONTRADICTED and errors[: t + 1].max() > tolerances.SAME_BELIEF:
                widened = self._widened(seen, reading.shares)
                if widened is not None:
                    reading, status = widened, SequenceStatus.WIDENED
                    law, errors[t] = reading.moved(seen), errors[t] + reading.error
            total = float(law.sum())
            with np.errstate(divide="ignore"):
                logs[t] = np.log(total) + evidence.offsets[t]
            statuses.append(status)
            used.append(reading if total > 0 else DecisionReading(known[UNSEEN]))
            laws[t] = law / total if total > 0 else seen / whole
        return ForwardPass(laws, used, logs, errors, tuple(statuses))

    def _widened(self, seen: Array, shares: Array) -> DecisionReading | None:
        """Read possible points as the nearest one that plays the decision, where that is nearest of all, or nearly so.

        None where it is too far for the grid to be the reason. The weights add up to what the stand-ins have.
        """
        points, mass = self._points.points, seen.sum(axis=0)
        plays = np.flatnonzero(shares > 0)
        gaps, place = cKDTree(points[plays]).query(points)
        gaps = np.asarray(gaps)
        least, step = float(gaps[mass > 0].min()), float(self.errors.max())
        if least > _CELLS * step:
            return None
        stand_in = plays[place]
        weights = np.where(gaps <= least + step, shares[stand_in], 0.0)
        held = mass * weights
        total = float(held.sum())
        kept = (1.0 - _BELIEVED) * total / float(mass.sum())
        return DecisionReading(_BELIEVED * weights, stand_in, float(held @ gaps) / total, kept)

    def smoothed(self, evidence: Evidence, passed: ForwardPass) -> Array:
        """Return the laws (T,X,B) given the whole sequence."""
        laws = passed.laws.copy()
        later = np.ones(laws.shape[1:])
        for t in range(len(evidence) - 2, -1, -1):
            later = passed.readings[t + 1].back(later) * evidence.states[t + 1][:, None]
            later = self._transition @ (self._backward @ later.reshape(-1)).reshape(later.shape)
            later /= later.max()
            laws[t] *= later
            laws[t] /= laws[t].sum()
        return laws

    def result(self, laws: Array, passed: ForwardPass) -> InferredBeliefs:
        """Return laws (T,X,B) as a result."""
        weights, points = laws.sum(axis=1), self._points.points
        mean = weights @ points
        spread = np.zeros(len(weights))
        for i, column in enumerate(points.T):
            spread += (weights * (column - mean[:, i, None]) ** 2).sum(axis=1)
        return InferredBeliefs(
            points,
            weights,
            mean,
            np.sqrt(spread),
            laws.sum(axis=2),
            passed.log_likelihood,
            passed.statuses,
            1.0 / (weights**2).sum(axis=1),
            passed.errors,
        )


def _as_rows(mixture: PointMixture, n_points: int) -> sparse.csr_array:
    """A sparse matrix (N,B) with one mixture a row."""
    count, width = mixture.places.shape
    rows = np.repeat(np.arange(count), width)
    shares = mixture.shares.reshape(-1)
    some = shares > 0
    return sparse.csr_array((shares[some], (rows[some], mixture.places.reshape(-1)[some])), shape=(count, n_points))


def _summed(rows: sparse.csr_array, shares: Array, n_points: int) -> sparse.csr_array:
    """Σ_y shares_y W_y for rows (B·Y,B) of W."""
    weights = sparse.kron(sparse.eye_array(n_points), shares[None], format="csr")
    return sparse.csr_array(weights @ rows)
