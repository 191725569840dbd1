"""How the joint law of state and private belief moves by a step, on finitely many beliefs.

α_0(x,b) = p_0(x) Σ_y B[x,y] W_0[y,b],   α_{t+1}(x',b') = Σ_y B[x',y] Σ_b W_y[b,b'] Σ_x P[x,x'] α_t(x,b).
Row (y,b) of W holds the mixture of points that stands for the agent's next belief T(π_b,y). The sums over y are taken once, in
one sparse matrix. Of a chain of beliefs there is one state, which says nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse

from inscrutable.adversaries.agent_steps import AgentModel
from inscrutable.adversaries.belief_points import BeliefPoints, PointMixture
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel


class BeliefMoves:
    """The step from one joint law to the next; laws (X,B,C) stand side by side.

    Args:
        points: The beliefs, shape (B,X).
        start: The law before the first decision, shape (X,B).
        transition: P; of a chain a single one.
        forward: The sparse matrix (X·B, X·B) of Σ_y B[x',y] W_y, transposed.
        reports: B[x,y].
        errors: Expected distance of T(π_b,y) from the points that stand for it, shape (B,Y).
        start_error: The same of the first belief.
        of_chain: Whether the state is no part of the law.
    """

    def __init__(
        self,
        points: Array,
        start: Array,
        transition: Array,
        forward: Any,
        *,
        reports: Array,
        errors: Array,
        start_error: float = 0.0,
        of_chain: bool = False,
    ) -> None:
        self.points, self.start, self.errors, self.start_error = points, start, errors, start_error
        self._transition, self._reports, self.of_chain = transition, reports, of_chain
        self._forward, self._backward = sparse.csr_array(forward), sparse.csr_array(forward.T)

    def ahead(self, laws: Array) -> tuple[Array, Array]:
        """Return laws (X,B,C) a step later, and the expected distances (C,) from the points, each times its law's weight."""
        n_states, n_points, count = laws.shape
        moved = self._transition.T @ laws.reshape(n_states, -1)
        spread = (self._reports.T @ moved).reshape(-1, n_points, count)
        errors = np.einsum("ybc,by->c", spread, self.errors) if self.errors.any() else np.zeros(count)
        return np.asarray(self._forward @ moved.reshape(-1, count)).reshape(laws.shape), np.asarray(errors)

    def back(self, later: Array) -> Array:
        """Return likelihoods (X,B,C) of what comes later, as they are a step before."""
        n_states, _, count = later.shape
        moved = np.asarray(self._backward @ later.reshape(-1, count))
        return np.asarray(self._transition @ moved.reshape(n_states, -1)).reshape(later.shape)


def moves_of(
    world: HiddenMarkovModel | BeliefChain, points: BeliefPoints, agent_world: HiddenMarkovModel | None = None
) -> BeliefMoves:
    """Return how the law moves on a chain of beliefs, or in a world whose sensors report symbols."""
    if isinstance(world, BeliefChain):
        world.checked_beliefs(points.points)
        return _of_chain(world)
    return _of_world(world, AgentModel(world if agent_world is None else agent_world), points)


def _of_world(world: HiddenMarkovModel, agent: AgentModel, points: BeliefPoints) -> BeliefMoves:
    reports = np.asarray(world.emission.probabilities)  # type: ignore[attr-defined]  # (X, Y)
    n_states, n_symbols = reports.shape
    first = points.mixed(agent.first(agent.symbols()).reshape(-1, n_states))
    later = points.mixed(agent.next(points.points, agent.symbols()).reshape(-1, n_states))
    rows = _as_rows(later, len(points))  # row b·Y + y
    return BeliefMoves(
        points.points,
        (world.initial[:, None] * reports) @ _as_rows(first, len(points)).toarray(),
        world.transition,
        sparse.block_diag([_summed(rows, share, len(points)).T for share in reports], format="csr"),
        reports=reports,
        errors=later.errors.reshape(len(points), n_symbols),
        start_error=float(((world.initial @ reports) * first.errors).sum()),
    )


def _of_chain(chain: BeliefChain) -> BeliefMoves:
    count, one = len(chain.prior), np.ones((1, 1))
    return BeliefMoves(
        chain.prior.beliefs,
        chain.prior.weights[None],
        one,
        chain.transition.T,
        reports=one,
        errors=np.zeros((count, 1)),
        of_chain=True,
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
