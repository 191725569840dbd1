"""Mechanisms with a memory, and rules that make a new mechanism from the observer's law."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from scipy import sparse

from inscrutable import validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.mechanisms.played import Mechanism, checked_costs, merged, stochastic_table
from inscrutable.mechanisms.priors import Prior
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@runtime_checkable
class MechanismRule(Protocol):
    """A rule with one mechanism for each law of the observer; ties go to the decision before.

    Source: Kerckhoffs' principle: the rule is public, hence the mechanism of each step.

    Example:
        >>> class Repeating:  # plays what the observer would play, whatever its own belief
        ...     beliefs = np.eye(2)
        ...
        ...     def mechanism_for(self, law, before=None):
        ...         return Mechanism(law.beliefs, [0, 1], [law.mean, law.mean], 1.0 - np.eye(2))
        >>> isinstance(Repeating(), MechanismRule)
        True
    """

    @property
    def beliefs(self) -> Array:
        """The grid of beliefs of its laws, shape (B,X)."""

    def mechanism_for(self, law: Prior, before: Any = None) -> Mechanism:
        """Return the mechanism on `law.beliefs`, in their order, where `law` is the observer's before the decision.

        `before` is the decision of the step before, (U,) or a choice, which may win ties; None where there is none.
        """


@dataclass(frozen=True, eq=False, repr=False)
class MemoryMechanism(Summarised, Saved):
    """A mechanism K(u, n'|π, n) with a finite memory: the law of decision and next memory given belief and memory.

    Formula: K(u_m, n' | π_b, n) ≥ 0, Σ_{m,n'} K(u_m, n' | π_b, n) = 1, for memories n = 0..N−1; before the first decision n has
    the law `initial`. A `Mechanism` is the case N = 1.

    Args:
        beliefs: π_b, shape (B,X).
        actions: u_m, shape (M,U); (M,) whole numbers where decisions are finite choices. Those that agree to
            `tolerances.SAME_ACTION` are one decision to an observer.
        probabilities: K, shape (B,N,M,N) with the memory before as second and the memory after as last axis; or a sparse array
            of shape (B·N, M·N) with the same entries in the same order. Kept sparse.
        initial: The law of the memory before the first decision, shape (N,).
        regrets: ρ(π_b, u_m), shape (B,M), in the cost's unit; at least 0.
        is_public: Whether observers see the memory too, before the first decision and after each.

    Raises:
        InputError: The shapes do not agree, a number is not finite, a regret is negative, or probabilities do not sum to one.

    Cost: memory and time in proportion to the entries of K that are not 0.

    Source: finite-state controllers of partially observed decision processes (Hansen, 1998); Kerckhoffs' principle.

    Example:
        >>> import numpy as np
        >>> table = np.zeros((2, 2, 2, 2))
        >>> table[:, 0] = np.eye(4).reshape(2, 2, 2, 2)[[0, 1], [0, 1]]  # the first decision reveals the belief
        >>> table[:, 1, 0, 1] = 1.0  # once the second was played, the first is for ever
        >>> MemoryMechanism(np.eye(2), [0, 1], table, [1.0, 0.0], 1.0 - np.eye(2))
        2 beliefs, 2 actions, 2 memories, private; 4 entries
    """

    beliefs: Array
    actions: Array
    probabilities: Any
    initial: Array
    regrets: Array
    is_public: bool = False

    def __post_init__(self) -> None:
        axes = Axis("belief", learns=True), Axis("action", learns=True)
        beliefs, actions, regrets = checked_costs(self.beliefs, self.actions, self.regrets, axes)
        initial = validation.stochastic_rows(self.initial, "initial law of the memory", ndim=1)
        n_beliefs, n_actions, count = len(beliefs), len(actions), len(initial)
        held: Any = self.probabilities
        flat = (n_beliefs * count, n_actions * count)
        if not sparse.issparse(held):
            held = np.asarray(held, dtype=np.float64)
            shape = (n_beliefs, count, n_actions, count)
            if held.shape != shape:
                raise InputError(
                    f"{n_beliefs} beliefs, {n_actions} actions and {count} memories need probabilities of shape {shape}, "
                    f"or sparse {flat}, got {held.shape}"
                )
            held = held.reshape(flat)
        if held.shape != flat:
            raise InputError(
                f"{n_beliefs} beliefs, {n_actions} actions and {count} memories need sparse probabilities of shape {flat}, "
                f"got {held.shape}"
            )
        table = stochastic_table(sparse.csr_array(held))
        for name, value in (
            ("beliefs", beliefs),
            ("actions", actions),
            ("probabilities", table),
            ("initial", initial),
            ("regrets", regrets),
        ):
            object.__setattr__(self, name, value)
        validation.read_only(self, "beliefs", "actions", "probabilities", "initial", "regrets")

    @property
    def n_memories(self) -> int:
        """Number of memories N."""
        return len(self.initial)

    @cached_property
    def observed(self) -> Any:
        """K as an observer sees it, sparse (B·N, M·N): indistinguishable decisions have their probabilities at the first."""
        first, count = merged(self.actions), self.n_memories
        if first is None:
            return self.probabilities
        entries = self.probabilities.tocoo()
        action, after = np.divmod(entries.col, count)
        table = sparse.csr_array(
            (entries.data, (entries.row, first[action] * count + after)), shape=self.probabilities.shape
        )
        table.sum_duplicates()
        return table

    def summary(self) -> str:
        """Return one line for a person to read."""
        return (
            f"{len(self.beliefs)} beliefs, {len(self.actions)} actions, {self.n_memories} memories, "
            f"{'public' if self.is_public else 'private'}; {self.probabilities.nnz} entries"
        )


def with_memory(mechanism: Mechanism | MemoryMechanism) -> MemoryMechanism:
    """Return a mechanism as one of a single memory; one with memories is returned as it is."""
    if isinstance(mechanism, MemoryMechanism):
        return mechanism
    return MemoryMechanism(mechanism.beliefs, mechanism.actions, mechanism.sparse, np.ones(1), mechanism.regrets)
