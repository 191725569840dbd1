"""What an observer sees at each step, as likelihoods: a decision, perhaps the state, perhaps a report of its own sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.adversaries.sequence_results import SequenceStatus
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError
from inscrutable.mechanisms import Mechanism
from inscrutable.validation import Array
from inscrutable.worlds import Emission

UNSEEN, NEVER_PLAYED = -1, -2


@dataclass(frozen=True, eq=False)
class Evidence:
    """T steps of evidence.

    `columns` (T,) are the decisions' numbers in the mechanism, or `UNSEEN`, `NEVER_PLAYED`; `states` (T,X) what else was
    seen, as a likelihood with largest entry one, whose logarithm is `offsets` (T,).
    """

    columns: np.ndarray
    moved: np.ndarray  # (T,) whether the nearest decision stands in
    states: Array
    offsets: Array

    def __len__(self) -> int:
        return len(self.columns)

    def status(self, step: int, total: float) -> SequenceStatus:
        """Return what a step's decision told, given its probability."""
        if self.columns[step] == UNSEEN:
            return SequenceStatus.UNSEEN
        if self.columns[step] == NEVER_PLAYED:
            return SequenceStatus.NEVER_PLAYED
        if not total > 0:
            return SequenceStatus.CONTRADICTED
        return SequenceStatus.NEAREST if self.moved[step] else SequenceStatus.USED


def decision_columns(
    mechanism: Mechanism, actions: ArrayLike, nearest: bool, steps: Axis
) -> tuple[np.ndarray, np.ndarray]:
    """Return the column (T,) of each decision in the mechanism, and whether the nearest played one stands in for it."""
    listed = np.asarray(mechanism.actions, dtype=np.float64)
    given = _rows(actions, listed, steps)
    unseen = np.asarray(np.isnan(given).all(axis=1))
    played = np.flatnonzero(np.asarray(mechanism.observed.sum(axis=0)) > 0)
    tree = cKDTree(listed.reshape(len(listed), -1)[played])
    gaps, place = tree.query(np.where(unseen[:, None], 0.0, given), p=np.inf)
    if nearest:
        place = tree.query(np.where(unseen[:, None], 0.0, given))[1]
    far: np.ndarray = np.asarray(gaps) > tolerances.SAME_ACTION
    columns = np.where(unseen, UNSEEN, np.where(far & (not nearest), NEVER_PLAYED, played[place]))
    return columns, far & nearest & ~unseen


def _rows(actions: ArrayLike, listed: Array, steps: Axis) -> Array:
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


def state_evidence(
    n_steps: int, n_states: int, sensor: Emission | None, known: np.ndarray | None, observations: Any
) -> tuple[Array, Array]:
    """Return the likelihood (T,X) of each state, largest entry one, and the logarithm (T,) taken out of it."""
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
        raise InputError("the adversary has a sensor of its own: pass what it reported as `observations`")
    offsets = logs.max(axis=1)
    impossible = np.flatnonzero(np.isneginf(offsets))
    if impossible.size:
        raise impossible_step(int(impossible[0]))
    return np.exp(logs - offsets[:, None]), offsets


def impossible_step(step: int) -> ModelError:
    """Return the error of a state or report that the observer's world rules out."""
    return ModelError(f"what was seen of the state at step {step} is impossible in the adversary's world")


def checked_sensor(sensor: Any, n_states: int) -> Emission | None:
    """Return the adversary's own sensor, or None; raise `InputError` for anything else."""
    if sensor is None:
        return None
    if not isinstance(sensor, Emission) or sensor.n_states != n_states:
        raise InputError(f"sensor must be an Emission over {n_states} states, got {sensor!r}")
    return sensor


def played_shares(mechanism: Mechanism, columns: np.ndarray) -> dict[int, Array]:
    """Return K(u|π_b), shape (B,), for each column that occurs; ones where nothing was seen."""
    by_column: Any = sparse.csc_array(mechanism.observed)
    found = {UNSEEN: np.ones(len(mechanism.beliefs)), NEVER_PLAYED: np.zeros(len(mechanism.beliefs))}
    for column in np.unique(columns[columns >= 0]):
        found[int(column)] = np.asarray(by_column[:, [int(column)]].toarray()).reshape(-1)
    return found


def _check_length(length: int, n_steps: int, name: str) -> None:
    if length != n_steps:
        raise InputError(f"{name} has {length} entries, expected one per decision: {n_steps}")
