"""An observer's evidence at each step, as likelihoods: a decision, and perhaps the state or a report of its own sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries.decision_tables import NEVER_PLAYED, UNSEEN
from inscrutable.adversaries.sequence_results import SequenceStatus
from inscrutable.axes import Axis, Names, check_same_order
from inscrutable.errors import InputError, ModelError
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.memory import MemoryMechanism
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, Emission, HiddenMarkovModel
from inscrutable.worlds.observations import in_rows, real_rows, symbols
from inscrutable.worlds.public import UNREAD


@dataclass(frozen=True, eq=False)
class Evidence:
    """T steps of evidence.

    `states` is the likelihood of all other evidence, scaled to a largest entry of one; `offsets` is the logarithm of the scale.
    `public` are the public observations, symbols (T,) or real rows (T,Z), `UNREAD` or NaN where this observer did not read
    them; None without a public sensor.
    """

    points: Array  # (T,U) decisions, NaN where none was seen
    nearest: int  # how many of the nearest played decisions replace one that is never played
    told: np.ndarray | None  # (T+1,) a public memory, before the first decision and after each
    states: Array  # (T,X)
    offsets: Array  # (T,)
    public: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.points)

    def is_seen(self, step: int) -> bool:
        """Whether the decision of a step was seen."""
        return not np.isnan(self.points[step, 0])

    def symbol_at(self, step: int) -> int:
        """Return the public symbol that was read at a step."""
        return UNREAD if self.public is None else int(self.public[step])

    def read_at(self, step: int) -> np.ndarray | None:
        """Return the same as an array (1,); None where nothing is public."""
        return None if self.public is None else self.public[step : step + 1]

    @property
    def is_all_read(self) -> bool:
        """Whether the observer read all public observations."""
        if self.public is None:
            return True
        return not bool(np.isnan(self.public).any() or (self.public.ndim == 1 and (self.public == UNREAD).any()))

    def without_states(self, *, has_public: bool) -> Evidence:
        """Return the likelihoods of the decisions, and of the public observations in a world that has them."""
        read = self.public if has_public else None
        return replace(self, states=np.ones_like(self.states), offsets=np.zeros_like(self.offsets), public=read)

    def status(self, column: int, moved: bool, total: float) -> SequenceStatus:
        """Return how a decision was read, from its number, whether the nearest replaced it, and its probability."""
        if column == UNSEEN:
            return SequenceStatus.UNSEEN
        if column == NEVER_PLAYED:
            return SequenceStatus.NEVER_PLAYED
        if not total > 0:
            return SequenceStatus.CONTRADICTED
        return SequenceStatus.NEAREST if moved else SequenceStatus.USED


def decision_points(actions: ArrayLike, like: Any, steps: Axis) -> Array:
    """Return decisions (T,U), NaN where none was seen, given as those of a mechanism; raise `InputError` otherwise.

    `like` is None where the mechanism's are not known yet.
    """
    listed = np.asarray(actions if like is None else like, dtype=np.float64)
    given = validation.real_array(actions, "actions", (steps, Axis("asset"))[: listed.ndim])
    expected = "(T,)" if listed.ndim == 1 else f"(T,{listed.shape[1]})"
    if given.ndim != listed.ndim or given.shape[1:] != listed.shape[1:] or not len(given):
        raise InputError(f"actions have shape {given.shape}, expected {expected} with T >= 1, as the mechanism's")
    rows = given.reshape(len(given), -1)
    bad = np.flatnonzero(~(np.isfinite(rows).all(axis=1) | np.isnan(rows).all(axis=1)))
    if bad.size:
        raise InputError(
            f"actions row {bad[0]} is {rows[bad[0]].tolist()}: finite, or NaN throughout where no decision was seen"
        )
    return rows


def unseen_points(n_steps: int) -> Array:
    """Return rows of NaN for decisions that were not observed, shape (T,1)."""
    return np.full((n_steps, 1), np.nan)


def state_evidence(
    n_steps: int, n_states: int, sensor: Emission | None, known: np.ndarray | None, observations: Any
) -> tuple[Array, Array]:
    """Return the likelihood (T,X) of each state, scaled to a largest entry of one, and the logarithm (T,) of the scale."""
    logs = np.zeros((n_steps, n_states))
    if known is not None:
        _check_length(len(known), n_steps, "states")
        logs[np.arange(n_states) != known[:, None]] = -np.inf
    if observations is not None:
        if sensor is None:
            raise InputError("observations were given, but the adversary has no sensor: pass `sensor` when it is made")
        reported = np.asarray(sensor.log_likelihoods(observations), dtype=np.float64)
        _check_length(len(reported), n_steps, "observations")
        logs = logs + reported
    elif sensor is not None:
        raise InputError("the adversary has a sensor of its own: pass its reports as `observations`")
    offsets = logs.max(axis=1)
    impossible = np.flatnonzero(np.isneginf(offsets))
    if impossible.size:
        raise impossible_step(int(impossible[0]))
    return np.exp(logs - offsets[:, None]), offsets


def public_evidence(
    world: HiddenMarkovModel | BeliefChain, public: Any, n_steps: int, steps: Axis
) -> np.ndarray | None:
    """Return the public observations: symbols (T,), or real rows (T,Z); raise `InputError` where it does not fit."""
    emission, has_public = None if isinstance(world, BeliefChain) else world.public_emission, world.public is not None
    if public is None:
        if has_public:
            raise InputError("the world has something public: pass it as `public`, NaN where it was not read")
        return None
    if not has_public:
        raise InputError("public observations were given, but the world has none: make it with `public`")
    given = in_rows(public, steps, "public")
    _check_length(len(given), n_steps, "public")
    plain = np.asarray(given, dtype=np.float64)
    unread = np.isnan(plain.reshape(n_steps, -1)).all(axis=1)
    if isinstance(world, BeliefChain) or isinstance(emission, CategoricalEmission):
        count = world.n_public if isinstance(world, BeliefChain) else emission.n_symbols  # type: ignore[union-attr]
        found = np.full(n_steps, UNREAD, dtype=np.int64)
        if not unread.all():
            found[~unread] = symbols(plain[~unread], count, "public")
        return found
    rows = np.full((n_steps, 1 if plain.ndim == 1 else plain.shape[1]), np.nan)
    if not unread.all():
        read: Any = given.iloc[np.flatnonzero(~unread)] if hasattr(given, "iloc") else plain[~unread]
        kept = real_rows(read, Axis("public column", getattr(emission, "asset_names", None)))
        rows = np.full((n_steps, kept.shape[1]), np.nan)
        rows[~unread] = kept
    return rows


def impossible_step(step: int) -> ModelError:
    """Return the error of a state or report that the observer's world rules out."""
    return ModelError(
        f"the state seen at step {step}, or the public observation, is impossible in the adversary's world"
    )


def checked_sensor(sensor: Any, n_states: int, names: Names | None) -> Emission | None:
    """Return the adversary's own sensor, or None; raise `InputError` for anything else."""
    if sensor is None:
        return None
    if not isinstance(sensor, Emission) or sensor.n_states != n_states:
        raise InputError(f"sensor must be an Emission over {n_states} states, got {sensor!r}")
    check_same_order("state", ("sensor", getattr(sensor, "state_names", None)), ("world", names))
    return sensor


def told_memories(memories: Any, n_steps: int, mechanism: Any) -> np.ndarray | None:
    """Return a public memory (T+1,), before the first decision and after each; None where the memory is not public."""
    if memories is None:
        if getattr(mechanism, "is_public", False):
            raise InputError(
                "the mechanism's memory is public: pass it as `memories`, before the first decision and after each"
            )
        return None
    if not isinstance(mechanism, MemoryMechanism):
        raise InputError("memories were given, but the mechanism has none")
    told = symbols(memories, mechanism.n_memories, "memories")
    _check_length(len(told) - 1, n_steps, "memories, without the first one,")
    if not mechanism.initial[told[0]] > 0:
        raise InputError(f"memories begin with {told[0]}, which the mechanism never begins with")
    return told


def _check_length(length: int, n_steps: int, name: str) -> None:
    if length != n_steps:
        raise InputError(f"{name} has {length} entries, expected one per decision: {n_steps}")
