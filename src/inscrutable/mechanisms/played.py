"""A mechanism: K(u|π) on finitely many beliefs and decisions, with what each costs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.geometry.equal_rows import first_equal
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_MOST_DENSE = 2**24
"""Entries up to which probabilities are a plain array; a larger table is kept sparse."""


class PlaysMany(Protocol):
    """A decision maker as far as a mechanism needs it."""

    problem: DecisionProblem

    def decide_many(self, beliefs: ArrayLike) -> Any:
        """Return decisions or lotteries for beliefs (B,X)."""


class HasActions(Protocol):
    """Candidates as far as a mechanism needs them."""

    actions: Array


@dataclass(frozen=True, eq=False)
class Mechanism:
    """How often each decision is played under each belief, and what it costs there.

    Formula: K(u_m | π_b) ≥ 0, Σ_m K(u_m | π_b) = 1; regrets ρ(π_b, u_m).

    Args:
        beliefs: π_b, shape (B,X).
        actions: u_m, shape (M,U); (M,) whole numbers where decisions are finite choices. No two are the same.
        probabilities: K, shape (B,M); a sparse array where it is too large for a plain one.
        regrets: ρ(π_b, u_m), shape (B,M), in the cost's unit; at least 0.

    Raises:
        InputError: The shapes do not agree, or a row of K is no probability vector.

    Source: Kerckhoffs' principle: the observer knows K.

    Example:
        >>> plain = Mechanism([[1.0, 0.0], [0.0, 1.0]], [[0.0], [1.0]], [[0.9, 0.1], [0.0, 1.0]], [[0.0, 1.0], [1.0, 0.0]])
        >>> print(plain.played([0.5, 0.5]))
        [0.45 0.55]
    """

    beliefs: Array
    actions: Array
    probabilities: Any
    regrets: Array

    def __post_init__(self) -> None:
        beliefs = validation.stochastic_rows(self.beliefs, "mechanism beliefs")
        actions = np.asarray(self.actions)
        regrets = validation.finite_array(self.regrets, "mechanism regrets", ndim=2)
        shape = (len(beliefs), len(actions))
        held: Any = self.probabilities if sparse.issparse(self.probabilities) else np.asarray(self.probabilities)
        if held.shape != shape or regrets.shape != shape:
            raise InputError(
                f"{shape[0]} beliefs and {shape[1]} actions need probabilities and regrets of shape {shape}, "
                f"got {held.shape} and {regrets.shape}"
            )
        if sparse.issparse(held):
            held = sparse.csr_array(held)  # type: ignore[call-overload]
            if held.data.min(initial=0.0) < 0 or np.abs(held.sum(axis=1) - 1.0).max() > tolerances.TRANSITION_SUM:
                raise InputError("probabilities must be at least 0, and each row must sum to 1")
        else:
            held = validation.stochastic_rows(held, "mechanism probabilities")
        for name, value in (("beliefs", beliefs), ("actions", actions), ("probabilities", held), ("regrets", regrets)):
            object.__setattr__(self, name, value)

    @property
    def sparse(self) -> Any:
        """K as a sparse array of rows."""
        return sparse.csr_array(self.probabilities)

    def played(self, weights: ArrayLike) -> Array:
        """Return how often each action is played under weights of the beliefs: Σ_b w_b K(u_m|π_b), shape (M,)."""
        return np.asarray(self.sparse.T @ np.asarray(weights, dtype=np.float64))

    @property
    def expected_regrets(self) -> Array:
        """Σ_m K(u_m|π_b) ρ(π_b,u_m) of every belief, shape (B,), in the cost's unit."""
        return np.asarray(self.sparse.multiply(self.regrets).sum(axis=1)).reshape(-1)


def mechanism(decision_maker: PlaysMany, beliefs: ArrayLike, candidates: HasActions | None = None) -> Mechanism:
    """Return what a decision maker amounts to on some beliefs.

    Formula: K(u|π_b) as `decide_many` plays it; decisions that agree to `tolerances.SAME_ACTION` are one.

    Args:
        decision_maker: Anything with `problem` and `decide_many`, such as `OriginalDecisionMaker(problem)`.
        beliefs: π_b, shape (B,X).
        candidates: Decisions to list first, in their order, played or not; None lists what is played alone.

    Raises:
        InputError: The beliefs are no probability vectors, or the decision maker cannot decide.

    Cost: one call of `decide_many`, and B·M regrets.

    Source: Kerckhoffs' principle: the observer knows K.

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker
        >>> played = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), [[0.9, 0.1], [0.2, 0.8]])
        >>> print(played.actions, played.probabilities.tolist())
        [0 1] [[1.0, 0.0], [0.0, 1.0]]
    """
    problem = getattr(decision_maker, "problem", None)
    if not isinstance(problem, DecisionProblem) or not hasattr(decision_maker, "decide_many"):
        raise InputError(f"a decision maker with `problem` and `decide_many` is needed, got {decision_maker!r}")
    held = validation.many_beliefs(beliefs, problem.n_states)
    points, shares = _atoms(problem, decision_maker.decide_many(held))
    n_beliefs, n_atoms = shares.shape
    flat = points.reshape(n_beliefs * n_atoms, -1)
    listed = np.empty((0, flat.shape[1])) if candidates is None else problem.as_points(candidates.actions)
    everything = np.vstack([listed, flat])
    same = first_equal(everything)
    used = np.zeros(len(everything), dtype=bool)
    used[: len(listed)] = True
    used[len(listed) :] = shares.reshape(-1) > 0
    kept = np.flatnonzero(np.bincount(same[used], minlength=len(same)) > 0)
    column = np.searchsorted(kept, same[len(listed) :])
    rows = np.repeat(np.arange(n_beliefs), n_atoms)
    some = shares.reshape(-1) > 0
    table = sparse.csr_array(
        (shares.reshape(-1)[some], (rows[some], column[some])), shape=(n_beliefs, len(kept))
    )  # repeated places are summed
    actions = everything[kept]
    regrets = np.maximum(held @ problem.state_costs(actions).T - problem.optimal_cost(held)[:, None], 0.0)
    table.sum_duplicates()
    probabilities = table if n_beliefs * len(kept) > _MOST_DENSE else table.toarray()
    return Mechanism(held, problem.as_actions(actions), probabilities, regrets)


def _atoms(problem: DecisionProblem, decided: Any) -> tuple[Array, Array]:
    """Played points (B,k,U) and their probabilities (B,k)."""
    if hasattr(decided, "probabilities"):
        return problem.as_points(decided.actions), np.asarray(decided.probabilities, dtype=np.float64)
    points = problem.as_points(decided.action)
    return points[:, None, :], np.ones((len(points), 1))
