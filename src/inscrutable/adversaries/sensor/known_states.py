"""The likelihood of decisions under known states, for many sequences at once: the inverse filter without the law of the state.

α_{t+1}(b') ∝ K(u_{t+1}|π_b') Σ_b S_x[b,b'] α_t(b) with S_x = Σ_y B[x,y] W_y for the state x = x_{t+1}: one small matrix per
step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from inscrutable.adversaries.belief_moves import moves_of
from inscrutable.adversaries.belief_points import BeliefPoints
from inscrutable.adversaries.decision_tables import UNSEEN, DecisionTables
from inscrutable.adversaries.sequence_evidence import decision_points
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.mechanisms.memory import with_memory
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel

_DENSE = 700
"""Most beliefs for which a step uses a dense matrix."""


class KnownStates:
    """The inverse filter of a fixed mechanism, given the states.

    Args:
        world: The agent's world, with a sensor of symbols and nothing public.
        mechanism: The agent's mechanism.
    """

    def __init__(self, world: HiddenMarkovModel, mechanism: Mechanism) -> None:
        self.world, self.mechanism = world, mechanism
        self._moves = moves_of(world, BeliefPoints(np.asarray(mechanism.beliefs)))
        self._plain = len(mechanism.beliefs) <= _DENSE
        self._steps: dict[int, Any] = {}

    def _step(self, state: int) -> Any:
        if state not in self._steps:
            found = self._moves.toward(state)
            self._steps[state] = found.toarray() if self._plain else found
        return self._steps[state]

    def _start(self, state: int) -> Array:
        law = self._moves.start[state]
        return np.asarray(law / law.sum())

    def log_likelihoods(self, columns: np.ndarray, states: np.ndarray) -> Array:
        """Return log Pr(u_0..u_{T−1} | x_0..x_{T−1}), shape (D,), of decisions by number (T,D); −inf where impossible."""
        used, places = np.unique(columns, return_inverse=True)
        table = self.mechanism.observed
        shares = np.ones((len(used), len(self.mechanism.beliefs)))
        for row, column in enumerate(used):
            if column != UNSEEN:
                shares[row] = np.zeros_like(shares[row]) if column < 0 else _column(table, int(column))
        places = places.reshape(columns.shape)
        laws = np.tile(self._start(int(states[0])), (columns.shape[1], 1))
        found: Array = np.zeros(columns.shape[1])
        for t, state in enumerate(states):
            laws = laws if t == 0 else np.asarray(laws @ self._step(int(state)))
            laws = laws * shares[places[t]]
            totals = laws.sum(axis=1)
            with np.errstate(divide="ignore"):
                found += np.log(totals)
            laws = np.divide(laws, totals[:, None], out=laws, where=totals[:, None] > 0)
        return found

    def drawn(self, states: np.ndarray, n_draws: int, rng: np.random.Generator) -> np.ndarray:
        """Return sampled sequences of decisions by number, shape (T, n_draws), by the same law."""
        plays = RowDraws(sparse.csr_array(self.mechanism.observed))
        steps = {int(state): RowDraws(self._moves.toward(int(state))) for state in np.unique(states[1:])}
        beliefs = rng.choice(len(self.mechanism.beliefs), size=n_draws, p=self._start(int(states[0])))
        found = np.empty((len(states), n_draws), dtype=np.intp)
        for t, state in enumerate(states):
            beliefs = beliefs if t == 0 else steps[int(state)](beliefs, rng)
            found[t] = plays(beliefs, rng)
        return found


def _column(table: Any, column: int) -> Array:
    found = table[:, [column]]
    return np.asarray(found.toarray() if hasattr(found, "toarray") else found).reshape(-1)


def is_simple(mechanism: Any, world: HiddenMarkovModel) -> bool:
    """Whether decisions depend on the present belief alone, and beliefs on private symbols alone."""
    return (
        isinstance(mechanism, Mechanism)
        and isinstance(world.emission, CategoricalEmission)
        and world.public is None
        and mechanism.beliefs.shape[1] == world.n_states
    )


def plays_in(mechanism: Mechanism, actions: ArrayLike, n_states: int) -> np.ndarray:
    """Return decisions by number, shape (T,1), as `SequentialAdversary` numbers them."""
    points = decision_points(actions, np.asarray(mechanism.actions), Axis("step", learns=True))
    if len(points) != n_states:
        raise InputError(f"states has {n_states} entries, expected one per decision: {len(points)}")
    tables = DecisionTables(with_memory(mechanism))
    return np.array([[tables.column(point, nearest=False)[0]] for point in points], dtype=np.intp)
