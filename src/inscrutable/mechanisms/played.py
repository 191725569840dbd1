"""A mechanism: K(u|π) on finitely many beliefs and decisions, with the regrets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, ordered_array
from inscrutable.errors import InputError
from inscrutable.mechanisms.priors import Prior, checked_prior
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array

_MOST_DENSE = 2**24
"""Entries up to which probabilities are a plain array; a larger table is kept sparse."""


class PlaysMany(Protocol):
    """The part of a decision maker that a mechanism needs."""

    problem: DecisionProblem

    def decide_many(self, beliefs: ArrayLike) -> Any:
        """Return decisions or lotteries for beliefs (B,X)."""


class HasActions(Protocol):
    """The part of candidates that a mechanism needs."""

    actions: Array


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism(Summarised, Saved):
    """A randomised mechanism K(u|π): the probability and the regret of each decision under each belief.

    Formula: K(u_m | π_b) ≥ 0, Σ_m K(u_m | π_b) = 1; regrets ρ(π_b, u_m).

    Args:
        beliefs: π_b, shape (B,X).
        actions: u_m, shape (M,U); (M,) whole numbers where decisions are finite choices. Those that agree to
            `tolerances.SAME_ACTION` are one decision to an observer.
        probabilities: K, shape (B,M); a sparse array where it is too large for a plain one.
        regrets: ρ(π_b, u_m), shape (B,M), in the cost's unit; at least 0.

    Raises:
        InputError: The shapes do not agree, a number is not finite, a regret is negative, or a row of K is no probability
            vector.

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
        table = Axis("belief", learns=True), Axis("action", learns=True)
        beliefs, actions, regrets = checked_costs(self.beliefs, self.actions, self.regrets, table)
        held: Any = self.probabilities
        if not sparse.issparse(held):
            held = ordered_array(held, "mechanism probabilities", table)
        if held.shape != regrets.shape:
            raise InputError(
                f"{len(beliefs)} beliefs and {len(actions)} actions need probabilities of shape {regrets.shape}, "
                f"got {held.shape}"
            )
        if sparse.issparse(held):
            held = stochastic_table(sparse.csr_array(held))  # type: ignore[call-overload]
        else:
            held = validation.stochastic_rows(held, "mechanism probabilities")
        for name, value in (("beliefs", beliefs), ("actions", actions), ("probabilities", held), ("regrets", regrets)):
            object.__setattr__(self, name, value)
        validation.read_only(self, "beliefs", "actions", "probabilities", "regrets")

    @property
    def sparse(self) -> Any:
        """K as a sparse array of rows."""
        return sparse.csr_array(self.probabilities)

    @cached_property
    def observed(self) -> Any:
        """K as an observer sees it, shape (B,M): indistinguishable decisions have their probabilities at the first."""
        first, count = merged(self.actions), len(self.actions)
        if first is None:
            return self.probabilities
        merging = sparse.csr_array((np.ones(count), (np.arange(count), first)), shape=(count, count))
        return sparse.csr_array(self.sparse @ merging)

    def played(self, weights: ArrayLike) -> Array:
        """Return the probability of each action under weights of the beliefs: Σ_b w_b K(u_m|π_b), shape (M,)."""
        held = validation.finite_array(weights, "weights", ndim=1)
        if len(held) != len(self.beliefs) or held.min(initial=0.0) < -tolerances.BELIEF_SUM:
            raise InputError(
                f"weights has {len(held)} entries, the least {held.min(initial=0.0):g}; expected one of at least 0 for each "
                f"of the {len(self.beliefs)} beliefs"
            )
        return np.asarray(self.sparse.T @ held)

    @property
    def expected_regrets(self) -> Array:
        """Σ_m K(u_m|π_b) ρ(π_b,u_m) of every belief, shape (B,), in the cost's unit."""
        table = self.probabilities
        if not isinstance(table, np.ndarray):
            return np.asarray(table.multiply(self.regrets).sum(axis=1)).reshape(-1)
        return np.asarray(np.einsum("bm,bm->b", table, self.regrets))

    def summary(self) -> str:
        """Return one line for a person to read."""
        entries = self.sparse.count_nonzero()
        costs = self.expected_regrets
        return (
            f"{len(self.beliefs)} beliefs, {len(self.actions)} actions, {entries / len(self.beliefs):.1f} played a belief; "
            f"expected regret at most {costs.max():.3g}, {costs.mean():.3g} on average over the beliefs"
        )


def checked_costs(
    beliefs: ArrayLike, actions: ArrayLike, regrets: ArrayLike, axes: tuple[Axis, Axis]
) -> tuple[Array, Any, Array]:
    """Return the beliefs, decisions and regrets of a mechanism in one order; raise `InputError` where they cannot be.

    `axes` are those of the regrets, and learn the labels.
    """
    belief_axis, action_axis = axes
    held = validation.stochastic_rows(beliefs, "mechanism beliefs", axes=(belief_axis, Axis("state")))
    played = ordered_array(actions, "mechanism actions", (action_axis, Axis("asset")))
    if played.dtype.kind not in "iu":
        played = validation.finite_array(played, "mechanism actions", ndim=2)
    elif played.ndim not in (1, 2):
        raise InputError(f"mechanism actions must be of shape (M,) or (M,U), got {played.shape}")
    costs = validation.finite_array(regrets, "mechanism regrets", ndim=2, axes=axes)
    shape = (len(held), len(played))
    if not all(shape):
        raise InputError(f"a mechanism needs a belief and an action at least, got {shape[0]} and {shape[1]}")
    if costs.shape != shape:
        raise InputError(f"{shape[0]} beliefs and {shape[1]} actions need regrets of shape {shape}, got {costs.shape}")
    # A little below zero are differences of equal costs; where all regrets are so, of costs of about one.
    if costs.min() < -max(tolerances.FEASIBILITY * abs(costs.max()), tolerances.COST_ROUNDING):
        b, m = np.unravel_index(int(costs.argmin()), shape)
        raise InputError(f"regrets must be at least 0, got {costs[b, m]:g} at index [{b}, {m}]")
    return held, played, np.maximum(costs, 0.0)


def merged(actions: Any) -> np.ndarray | None:
    """Return, for each decision of (M,) or (M,U), the first it cannot be distinguished from; None where all differ."""
    count = len(actions)
    first = first_same(np.asarray(actions, dtype=np.float64).reshape(count, -1))
    return None if (first == np.arange(count)).all() else first


def stochastic_table(table: Any) -> Any:
    """A sparse array whose rows are probability vectors, renormalised within the tolerance as plain ones are."""
    if not np.isfinite(table.data).all() or table.data.min(initial=0.0) < -tolerances.TRANSITION_SUM:
        raise InputError("mechanism probabilities must be finite and at least 0")
    table = table.astype(np.float64)
    table.data = np.maximum(table.data, 0.0)
    table.eliminate_zeros()
    sums = np.asarray(table.sum(axis=1)).reshape(-1)
    errors = np.abs(sums - 1.0)
    worst = int(errors.argmax())
    if errors[worst] > tolerances.TRANSITION_SUM:
        raise InputError(f"mechanism probabilities row {worst} sums to {sums[worst]:.10g}, expected 1")
    if errors[worst] > tolerances.SUM_ROUNDING:
        table = sparse.csr_array(sparse.diags_array(1.0 / sums) @ table)
    return table


def mechanism(
    decision_maker: PlaysMany, beliefs: ArrayLike | Prior, candidates: HasActions | ArrayLike | None = None
) -> Mechanism:
    """Return the randomised mechanism K(u|π) of a decision maker on some beliefs.

    Formula: K(u|π_b) as `decide_many` plays it; decisions that agree to `tolerances.SAME_ACTION` are one, the first of
    them in the order of candidates and then of beliefs.

    Args:
        decision_maker: Anything with `problem` and `decide_many`, such as `OriginalDecisionMaker(problem)`.
        beliefs: π_b, shape (B,X), or the prior that has them.
        candidates: Decisions to list first, in their order, even with probability 0: `Candidates`, or feasible decisions
            (M,U); None lists only decisions of positive probability.

    Raises:
        InputError: The beliefs are no probability vectors, the decision maker cannot decide, or depends on earlier decisions,
            or a candidate is no feasible decision.

    Cost: one call of `decide_many`, and B·M regrets.

    Source: Kerckhoffs' principle: the observer knows K.

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker
        >>> played = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), [[0.9, 0.1], [0.2, 0.8]])
        >>> print(played.actions, played.probabilities.tolist())
        [0 1] [[1.0, 0.0], [0.0, 1.0]]
    """
    problem = checked_memoryless(decision_maker).problem
    given = checked_prior(beliefs, problem).beliefs if isinstance(beliefs, Prior) else beliefs
    held = validation.many_beliefs(given, problem.n_states, names=problem.state_names)
    points, row, number, share = atoms_of(decision_maker, held)
    listed = np.empty((0, points.shape[-1])) if candidates is None else _listed(problem, candidates)
    everything = np.vstack([listed, points])
    kept, column = np.unique(first_same(everything), return_inverse=True)
    place = column.reshape(-1)[len(listed) :][number]
    table = sparse.csr_array((share, (row, place)), shape=(len(held), len(kept)))
    table.sum_duplicates()
    actions = everything[kept]
    regrets = regrets_of(problem, held, actions)
    probabilities = table if len(held) * len(kept) > _MOST_DENSE else table.toarray()
    return Mechanism(held, problem.as_actions(actions), probabilities, regrets)


def checked_memoryless(decision_maker: Any) -> PlaysMany:
    """Return a decision maker that decides by the present belief alone, or raise `InputError`."""
    problem = getattr(decision_maker, "problem", None)
    if not isinstance(problem, DecisionProblem) or not hasattr(decision_maker, "decide_many"):
        raise InputError(f"a decision maker with `problem` and `decide_many` is needed, got {decision_maker!r}")
    if not getattr(decision_maker, "is_memoryless", True):
        raise InputError(
            f"{type(decision_maker).__name__} depends on earlier decisions, not on the belief alone, so that it is no "
            "mechanism K(u|π); call its decide_many on a path of beliefs"
        )
    found: PlaysMany = decision_maker
    return found


def regrets_of(problem: DecisionProblem, beliefs: Array, points: Array) -> Array:
    """Return ρ(π_b, u_m) of decisions given as points (M,U), shape (B,M); 0 where it is a rounding of the costs."""
    costs = problem.state_costs(points).T
    regrets = beliefs @ costs - problem.optimal_cost(beliefs)[:, None]
    return np.where(regrets > tolerances.COST_ROUNDING * (beliefs @ np.abs(costs)), regrets, 0.0)


def _listed(problem: DecisionProblem, candidates: Any) -> Array:
    """Candidates as points (M,U)."""
    if hasattr(candidates, "actions"):
        return np.atleast_2d(problem.as_points(candidates.actions))
    return np.atleast_2d(problem.check_actions(candidates))


def atoms_of(decision_maker: Any, beliefs: Array) -> tuple[Array, np.ndarray, np.ndarray, Array]:
    """Points of positive probability in order of first use, and for every atom its belief, its point and its probability."""
    if hasattr(decision_maker, "table"):
        points, numbers, shares = decision_maker.table(beliefs)
        row, atom = np.nonzero(shares > 0)
        used, first, number = np.unique(numbers[row, atom], return_index=True, return_inverse=True)
        order = np.argsort(first)
        return points[used[order]], row, np.argsort(order)[number.reshape(-1)], shares[row, atom]
    problem, decided = decision_maker.problem, decision_maker.decide_many(beliefs)
    draws = hasattr(decided, "probabilities")
    if not hasattr(decided, "actions" if draws else "action"):
        raise InputError(
            f"{type(decision_maker).__name__}.decide_many returned {type(decided).__name__}; expected `action` (T,U), or "
            "`actions` (T,k,U) and `probabilities` (T,k) where it draws"
        )
    if draws:
        shares = validation.stochastic_rows(decided.probabilities, "probabilities")
        points = validation.finite_array(problem.as_points(decided.actions), "actions", ndim=3)
    else:
        points = validation.finite_array(problem.as_points(decided.action), "action", ndim=2)[:, None, :]
        shares = np.ones(points.shape[:2])
    if not shares.shape == points.shape[:2] == (len(beliefs), shares.shape[1]):
        raise InputError(
            f"{type(decision_maker).__name__}.decide_many returned decisions of shape {points.shape} and probabilities of "
            f"shape {shares.shape} for {len(beliefs)} beliefs"
        )
    row, atom = np.nonzero(shares > 0)
    problem.constraints.check_inside(points[row, atom], "action")
    return points[row, atom], row, np.arange(len(row)), shares[row, atom]
