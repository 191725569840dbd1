"""A mechanism as an observer sees it under a disclosure: decisions that look alike are one."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from scipy import sparse

from inscrutable.errors import InputError
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.mechanisms.memory import MechanismRule, MemoryMechanism
from inscrutable.mechanisms.played import Mechanism, merged
from inscrutable.mechanisms.priors import Prior
from inscrutable.validation import Array

_Known = TypeVar("_Known", Mechanism, MemoryMechanism)


def disclosed(mechanism: _Known, disclosure: Disclosure, returns: Array | None = None) -> _Known:
    """Return the mechanism of the disclosed values of decisions, whatever the schedule.

    The regret of a disclosed value is the mean regret of its decisions under the belief.

    Args:
        mechanism: The mechanism of decisions.
        disclosure: What is disclosed of them.
        returns: Returns of the period (U,), for `portfolio_return`.

    Raises:
        InputError: A map does not suit the decisions, or lacks the returns.
    """
    if not disclosure.maps:
        return mechanism
    values, place = shown_classes(mechanism.actions, disclosure, returns)
    count, memories = len(place), getattr(mechanism, "n_memories", 1)
    merging = sparse.csr_array((np.ones(count), (np.arange(count), place)), shape=(count, len(values)))
    wide: Any = merging if memories == 1 else sparse.kron(merging, sparse.eye_array(memories), format="csr")
    table: Any = sparse.csr_array(sparse.csr_array(mechanism.probabilities) @ wide)
    regrets = _mean_regrets(mechanism, merging)
    if isinstance(mechanism.probabilities, np.ndarray):
        table = table.toarray()
    return replace(mechanism, actions=values, probabilities=table, regrets=regrets)


def shown_classes(actions: Any, disclosure: Disclosure, returns: Array | None = None) -> tuple[Array, np.ndarray]:
    """Return the distinct disclosed values (N,V), or (N,) for choices, and the one of each of decisions (M,U).

    Decisions that are equal before an operation are equal after it, so that operations can be applied one after the other.
    """
    points, place = _distinct(np.asarray(actions))
    for operation in disclosure.maps:
        given = returns if operation.name == "portfolio_return" else None
        points, number = _distinct(np.asarray(Disclosure((operation,)).shown(points, returns=given)))
        place = number[place]
    return points, place


def _distinct(points: Array) -> tuple[Array, np.ndarray]:
    """The points that can be distinguished, and which of them each is."""
    first = merged(points)
    if first is None:
        return points, np.arange(len(points))
    kept, number = np.unique(first, return_inverse=True)
    return points[kept], number.reshape(-1)


def _mean_regrets(mechanism: Mechanism | MemoryMechanism, merging: Any) -> Array:
    """Mean regrets (B,N) of the decisions behind each value; 0 where it is never shown."""
    shares = sparse.csr_array(mechanism.probabilities)
    memories = getattr(mechanism, "n_memories", 1)
    if memories > 1:  # an unweighted mean over memories: observers do not use regrets
        count, n_beliefs = len(mechanism.actions), len(mechanism.beliefs)
        before = sparse.kron(sparse.eye_array(n_beliefs), np.ones((1, memories)) / memories, format="csr")
        after = sparse.kron(sparse.eye_array(count), np.ones((memories, 1)), format="csr")
        shares = sparse.csr_array(before @ shares @ after)
    weights = (shares @ merging).toarray()
    total = (shares.multiply(np.asarray(mechanism.regrets)) @ merging).toarray()
    return np.asarray(np.divide(total, weights, out=np.zeros_like(total), where=weights > 0))


def disclosed_rule(given: Any, disclosure: Disclosure) -> Any:
    """Return the mechanism or rule of disclosed values, for an observer of sequences who sees no returns.

    Raises:
        InputError: The disclosure needs returns, is not the one that a rule was made for, or hides steps of a public memory.
    """
    if disclosure.needs_returns:
        raise InputError(
            f"{disclosure} needs returns, which are not given here: use SequentialAdversary.filter, which takes them"
        )
    played = checked_for(given, disclosure)
    return played if isinstance(played, DisclosedRule) else disclosed(played, disclosure)


class DisclosedRule:
    """A rule made for a disclosure, with the disclosed values as decisions.

    Args:
        rule: The rule.
        disclosure: The disclosure it was made for.
    """

    def __init__(self, rule: MechanismRule, disclosure: Disclosure) -> None:
        self._rule, self._disclosure = rule, disclosure

    @property
    def beliefs(self) -> Array:
        """The grid of beliefs of its laws, shape (B,X)."""
        return self._rule.beliefs

    def mechanism_for(self, law: Prior, before: Any = None) -> Mechanism:
        """Return the mechanism of disclosed values; `before` is the value disclosed last."""
        return disclosed(self._rule.mechanism_for(law, before), self._disclosure)


def checked_for(given: Any, disclosure: Disclosure) -> Any:
    """Return a mechanism that the disclosure suits, or a rule made for it; raise `InputError` for others."""
    if isinstance(given, MechanismRule) and not isinstance(given, (Mechanism, MemoryMechanism)):
        goes_by = Disclosure.of(getattr(given, "disclosure", None))
        if (goes_by.maps, goes_by.schedule) != (disclosure.maps, disclosure.schedule):
            raise InputError(
                f"the rule was made for decisions disclosed as {goes_by}, not as {disclosure}: make it with "
                f"disclosure={str(disclosure)!r}"
            )
        return DisclosedRule(given, disclosure) if disclosure.maps else given
    if disclosure.is_exact:
        return given
    if not isinstance(given, (Mechanism, MemoryMechanism)):
        raise InputError(f"{disclosure} needs a mechanism, or a rule made for it, got {given!r}")
    if getattr(given, "is_public", False) and not disclosure.schedule.is_immediate:
        raise InputError(
            f"the mechanism's memory is public at every step, which {disclosure} contradicts: it leaves decisions out or "
            "delays them"
        )
    return given


def single_decisions(disclosure: Disclosure, what: str) -> Disclosure:
    """Return a disclosure of single decisions; raise `InputError` for one that leaves steps out, delays, or needs returns."""
    if not disclosure.schedule.is_immediate:
        raise InputError(
            f"{what} is about single decisions, which {disclosure} leaves out or delays: use path_leakage or "
            "SequentialAdversary"
        )
    if disclosure.needs_returns:
        raise InputError(
            f"{what} has no returns, through which {disclosure} shows decisions: use SequentialAdversary, whose filter "
            "takes them"
        )
    return disclosure
