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
    """Return the mechanism that plays what is shown of each decision; schedules are none of its concern.

    The regret of a value shown is the mean regret of the decisions behind it, as they are played under the belief.

    Args:
        mechanism: What is played.
        disclosure: What is shown of it.
        returns: Of the period (U,), where decisions are shown through them.

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
    """Return the different values shown (N,V), or (N,) of choices, and which of them each of decisions (M,U) is shown as.

    Decisions that cannot be distinguished before an operation cannot be after it, so that what two operations show in turn
    follows from what the first one shows.
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
    if memories > 1:  # over what may be remembered, before and after, alike: observers read no regrets
        count, n_beliefs = len(mechanism.actions), len(mechanism.beliefs)
        before = sparse.kron(sparse.eye_array(n_beliefs), np.ones((1, memories)) / memories, format="csr")
        after = sparse.kron(sparse.eye_array(count), np.ones((memories, 1)), format="csr")
        shares = sparse.csr_array(before @ shares @ after)
    weights = (shares @ merging).toarray()
    total = (shares.multiply(np.asarray(mechanism.regrets)) @ merging).toarray()
    return np.asarray(np.divide(total, weights, out=np.zeros_like(total), where=weights > 0))


def disclosed_rule(given: Any, disclosure: Disclosure) -> Any:
    """Return what plays values shown, for an observer of sequences who sees no returns.

    Raises:
        InputError: The disclosure needs returns, is not the one that a rule goes by, or hides the steps of a public memory.
    """
    if disclosure.needs_returns:
        raise InputError(
            f"{disclosure} shows decisions through returns, whose law is not known here: SequentialAdversary.filter takes them"
        )
    played = checked_for(given, disclosure)
    return played if isinstance(played, DisclosedRule) else disclosed(played, disclosure)


class DisclosedRule:
    """A rule that goes by a disclosure, playing values shown.

    Args:
        rule: The rule.
        disclosure: What it goes by.
    """

    def __init__(self, rule: MechanismRule, disclosure: Disclosure) -> None:
        self._rule, self._disclosure = rule, disclosure

    @property
    def beliefs(self) -> Array:
        """The beliefs on which it takes laws, shape (B,X)."""
        return self._rule.beliefs

    def mechanism_for(self, law: Prior, before: Any = None) -> Mechanism:
        """Return what is played as it is shown; `before` is the value shown last."""
        return disclosed(self._rule.mechanism_for(law, before), self._disclosure)


def checked_for(given: Any, disclosure: Disclosure) -> Any:
    """Return a mechanism whose decisions can be disclosed so, or a rule that goes by that; raise `InputError` for others."""
    if isinstance(given, MechanismRule) and not isinstance(given, (Mechanism, MemoryMechanism)):
        goes_by = Disclosure.of(getattr(given, "disclosure", None))
        if (goes_by.maps, goes_by.schedule) != (disclosure.maps, disclosure.schedule):
            raise InputError(
                f"the rule goes by what one holds who sees its decisions as {goes_by}, not as {disclosure}: make it with "
                f"disclosure={str(disclosure)!r}"
            )
        return DisclosedRule(given, disclosure) if disclosure.maps else given
    if disclosure.is_exact:
        return given
    if not isinstance(given, (Mechanism, MemoryMechanism)):
        raise InputError(f"{disclosure} needs a mechanism, or a rule that goes by it, got {given!r}")
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
