"""One step of the joint law of state and private belief, on finitely many beliefs.

α_0(x,b) = p_0(x) Σ_y B[x,y] W_0[y,b],   α_{t+1}(x',b') = Σ_y B[x',y] Σ_b W_y[b,b'] Σ_x P[x,x'] α_t(x,b).
Row (y,b) of W holds the mixture of points that represents the agent's next belief T(π_b,y). The sums over y are computed once,
as one sparse matrix. A chain of beliefs has one state, which carries no information.

With a public sensor, y is the pair of private and public symbol. The observer's reading selects the pairs that agree with it:
there is one matrix for each public symbol, and the total weight of the law is the probability of the reading.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy import sparse

from inscrutable.adversaries.agent_steps import AgentModel
from inscrutable.adversaries.belief_points import BeliefPoints, PointMixture
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel
from inscrutable.worlds.public import UNREAD, JointSymbols, joint_symbols


class BeliefMoves:
    """The step from one joint law to the next, for C laws at once, shape (X,B,C).

    Args:
        points: The beliefs, shape (B,X).
        starts: The law before the first decision with each public symbol, shape (Z,X,B).
        transition: P; of a chain a single one.
        forwards: For each public symbol the sparse matrix (X·B, X·B) of Σ_y B[x',y] W_y, transposed.
        symbols: B[x,y], and the public symbol of each y.
        errors: Expected distance of T(π_b,y) from the points that represent it, shape (B,Y).
        start_errors: The same distance for the first belief, shape (Y,), times the probability of y.
        of_chain: Whether the world is a chain of beliefs, so that the law has no state.
    """

    def __init__(
        self,
        points: Array,
        starts: Array,
        transition: Array,
        forwards: Sequence[Any],
        *,
        symbols: JointSymbols,
        errors: Array,
        start_errors: Array,
        of_chain: bool = False,
    ) -> None:
        self.points, self.starts, self.errors = points, starts, errors
        self._transition, self._symbols, self._start_errors, self.of_chain = transition, symbols, start_errors, of_chain
        tables = [sparse.csr_array(each) for each in forwards]
        if len(tables) > 1:
            tables.append(sparse.csr_array(sum(tables[1:], start=tables[0])))  # at the place UNREAD
        self._forwards = tables
        self._backwards = [sparse.csr_array(each.T) for each in tables]

    @property
    def n_public(self) -> int:
        """The number of public symbols; 1 where nothing is public."""
        return len(self.starts)

    @property
    def start(self) -> Array:
        """The law before the first decision, without public observations, shape (X,B)."""
        return self.starts[0] if self.n_public == 1 else np.asarray(self.starts.sum(axis=0))

    def first(self, read: int = UNREAD) -> tuple[Array, float]:
        """Return the law (X,B) before the first decision, and the expected distance from the points times its weight."""
        some = self._agreeing(read)
        return self.start if read == UNREAD else self.starts[read], float(self._start_errors[some].sum())

    def ahead(self, laws: Array, read: int = UNREAD) -> tuple[Array, Array]:
        """Return laws (X,B,C) a step later, and the expected distances (C,) from the points, each times its law's weight."""
        n_states, n_points, count = laws.shape
        moved = self._transition.T @ laws.reshape(n_states, -1)
        errors = np.zeros(count)
        if self.errors.any():
            some = self._agreeing(read)
            spread = (self._symbols.probabilities[:, some].T @ moved).reshape(-1, n_points, count)
            errors = np.einsum("ybc,by->c", spread, self.errors[:, some])
        found = self._forwards[read] @ moved.reshape(-1, count)
        return np.asarray(found).reshape(laws.shape), np.asarray(errors)

    def toward(self, state: int) -> Any:
        """Return Σ_y B[x,y] W_y, sparse (B,B): the transition of the belief where x is the next state."""
        some = slice(state * len(self.points), (state + 1) * len(self.points))
        return self._backwards[UNREAD][some, some]

    def back(self, later: Array, read: int = UNREAD) -> Array:
        """Return the likelihoods (X,B,C) of later evidence one step earlier (backward pass)."""
        n_states, _, count = later.shape
        moved = np.asarray(self._backwards[read] @ later.reshape(-1, count))
        return np.asarray(self._transition @ moved.reshape(n_states, -1)).reshape(later.shape)

    def _agreeing(self, read: int) -> Any:
        """Return the indices of y that agree with the public symbol read."""
        return slice(None) if read == UNREAD else np.flatnonzero(self._symbols.public == read)


def moves_of(
    world: HiddenMarkovModel | BeliefChain, points: BeliefPoints, agent_world: HiddenMarkovModel | None = None
) -> BeliefMoves:
    """Return the step of the joint law for a chain of beliefs, or for a world whose sensors report symbols."""
    if isinstance(world, BeliefChain):
        world.checked_beliefs(points.points)
        return _of_chain(world)
    return _of_world(world, AgentModel(world if agent_world is None else agent_world), points)


def _of_world(world: HiddenMarkovModel, agent: AgentModel, points: BeliefPoints) -> BeliefMoves:
    symbols = joint_symbols(world.emission, world.public)
    assert symbols is not None
    reports, n_points = symbols.probabilities, len(points)  # (X, Y)
    n_states, n_symbols = reports.shape
    first = points.mixed(agent.first(agent.symbols()).reshape(-1, n_states))
    later = points.mixed(agent.next(points.points, agent.symbols()).reshape(-1, n_states))
    rows = _as_rows(later, n_points)  # row b·Y + y
    begun = _as_rows(first, n_points).toarray()
    agreeing = [np.where(symbols.public == z, reports, 0.0) for z in range(symbols.n_public)]
    return BeliefMoves(
        points.points,
        np.array([(world.initial[:, None] * each) @ begun for each in agreeing]),
        world.transition,
        [sparse.block_diag([_summed(rows, share, n_points).T for share in each], format="csr") for each in agreeing],
        symbols=symbols,
        errors=later.errors.reshape(n_points, n_symbols),
        start_errors=(world.initial @ reports) * first.errors,
    )


def _of_chain(chain: BeliefChain) -> BeliefMoves:
    count, one = len(chain.prior), np.ones((1, 1))
    weights = chain.prior.weights
    tables = [chain.transition] if chain.public is None else list(chain.public)
    starts = [weights] if chain.public is None else [weights @ each for each in tables]
    return BeliefMoves(
        chain.prior.beliefs,
        np.array(starts)[:, None],
        one,
        [each.T for each in tables],
        symbols=JointSymbols(one, np.zeros(1, dtype=np.int64), len(tables)),
        errors=np.zeros((count, 1)),
        start_errors=np.zeros(1),
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
    held = rows.tocoo()
    point, symbol = np.divmod(held.row, len(shares))
    some = shares[symbol] > 0.0
    entries = (held.data * shares[symbol])[some]
    return sparse.csr_array((entries, (point[some], held.col[some])), shape=(n_points, n_points))
