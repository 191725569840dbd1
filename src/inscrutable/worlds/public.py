"""Public observations of a world: a sensor of their own, or a part of the agent's observation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError
from inscrutable.validation import Array
from inscrutable.worlds.emissions import CategoricalEmission, Emission, GaussianEmission, emission_from_dict, frozen
from inscrutable.worlds.observations import Labels, in_rows, is_labelled, labels_of, real_rows, row_name, symbols

UNREAD = -1
"""Stands for a missing public symbol."""


@dataclass(frozen=True, init=False, eq=False, repr=False)
class PublicPart:
    """A public part z = C y of the agent's observation y.

    For a `GaussianEmission` z is a vector of linear combinations, such as the mean of returns. For a `CategoricalEmission`
    symbols are merged: C[z,y] = 1 where symbol y is public as z.

    Args:
        matrix: C, shape (Z,D) with independent rows; or (Z,Y) of zeros and ones with a single one in
            each column. Labelled columns are aligned with the sensor's asset names, row labels name the columns of z.

    Raises:
        InputError: The matrix is empty or holds a number that is not finite.

    Source: Kerckhoffs' principle for the observer's data: it knows all public observations.

    Example:
        >>> from inscrutable import GaussianEmission, HiddenMarkovModel
        >>> sensor = GaussianEmission([[0.0, 0.0], [1.0, 3.0]], [np.eye(2), np.eye(2)])
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], sensor, public=PublicPart([[0.5, 0.5]]))
        >>> print(world.public_emission.means, world.public_of([[1.0, 2.0]]))
        [[0.]
         [2.]] [[1.5]]
    """

    matrix: Array
    names: Labels | None
    asset_names: Labels | None

    def __init__(self, matrix: ArrayLike) -> None:
        rows, assets = Axis("public column", learns=True), Axis("asset", learns=True)
        held = validation.finite_array(matrix, "matrix", ndim=2, axes=(rows, assets))
        if not held.size:
            raise InputError(f"matrix has shape {held.shape}, expected (Z,D) with Z >= 1 and D >= 1")
        object.__setattr__(self, "matrix", frozen(held))
        object.__setattr__(self, "names", rows.names)
        object.__setattr__(self, "asset_names", assets.names)

    def __repr__(self) -> str:
        return f"PublicPart({self.matrix.shape[0]} of {self.matrix.shape[1]})"

    def to_dict(self) -> dict[str, Any]:
        """Return the part as plain data; floats keep every digit."""
        names, assets = (None if each is None else list(each) for each in (self.names, self.asset_names))
        return {"type": "part", "matrix": self.matrix.tolist(), "names": names, "asset_names": assets}


class JointSymbols(NamedTuple):
    """The S possible reports at a step where both sensors report symbols: pairs, or private symbols for a `PublicPart`."""

    probabilities: Array  # (X, S)
    public: NDArray[np.int64]  # (S,): which public symbol belongs to each
    n_public: int


def checked_public(public: Any, sensor: Emission) -> tuple[Emission | PublicPart | None, Emission | None]:
    """Return the public sensor or part with columns in the sensor's order, and its law; raise `InputError` for others."""
    if isinstance(public, PublicPart):
        return _part_for(public, sensor)
    if public is None:
        return None, None
    if not isinstance(public, Emission):
        raise InputError(f"public must be an Emission, a PublicPart, or None, got {public!r}")
    if public.n_states != sensor.n_states:
        raise InputError(f"the public sensor has {public.n_states} states, the private one {sensor.n_states}")
    return public, public


def public_from_dict(data: Any) -> Emission | PublicPart | None:
    """Rebuild a public sensor or part from its `to_dict`."""
    if not isinstance(data, dict) or data.get("type") != "part":
        return None if data is None else emission_from_dict(data)
    try:
        part = PublicPart(data["matrix"])
        object.__setattr__(part, "names", labels_of(data["names"]))
        object.__setattr__(part, "asset_names", labels_of(data["asset_names"]))
    except KeyError as error:
        raise InputError(f"a public part needs the key {error}; it has {sorted(data)}") from None
    return part


def part_of(part: PublicPart, sensor: Emission, observations: Any) -> NDArray[Any]:
    """Return z, shape (T,Z) of real observations, (T,) of symbols."""
    if isinstance(sensor, CategoricalEmission):
        return _merged(part)[symbols(observations, sensor.n_symbols)]
    assert isinstance(sensor, GaussianEmission)
    return np.asarray(real_rows(observations, Axis("asset", sensor.asset_names)) @ part.matrix.T)


def conditional_draws(
    part: PublicPart, sensor: Emission, states: NDArray[np.int64], values: Array, *, rng: np.random.Generator
) -> Array:
    """Draw y given its public part z (Z,) and each of the states (N,): an unconditional draw, corrected to C y = z.

    y + Σ C'(C Σ C')⁻¹(z − C y) has the conditional law (Matheron's rule).
    """
    assert isinstance(sensor, GaussianEmission)
    drawn = sensor.sample(states, rng=rng)
    for state in np.unique(states):
        mine, spread = states == state, sensor.covariances[state] @ part.matrix.T
        short = values - drawn[mine] @ part.matrix.T
        drawn[mine] += short @ np.linalg.solve(part.matrix @ spread, spread.T)
    return drawn


def joint_symbols(sensor: Emission, public: Emission | PublicPart | None) -> JointSymbols | None:
    """Return the pairs of symbols; None where a sensor reports something else."""
    if not isinstance(sensor, CategoricalEmission):
        return None
    reports = np.asarray(sensor.probabilities)
    if public is None:
        return JointSymbols(reports, np.zeros(sensor.n_symbols, dtype=np.int64), 1)
    if isinstance(public, PublicPart):
        return JointSymbols(reports, _merged(public), len(public.matrix))
    if not isinstance(public, CategoricalEmission):
        return None
    both = reports[:, :, None] * public.probabilities[:, None]
    return JointSymbols(
        both.reshape(len(reports), -1), np.tile(np.arange(public.n_symbols), sensor.n_symbols), public.n_symbols
    )


def public_log_likelihoods(
    sensor: Emission, public: Emission | PublicPart | None, observations: Any, given: Any
) -> Array | None:
    """Return the log-likelihoods (T,X) of public observations, to be added to the agent's; None where there are none.

    Raises `InputError` where they are missing, not expected, of another length, or not the public part of the agent's.
    """
    if public is None:
        if given is not None:
            raise InputError("public observations were given, but the world has none: make it with `public`")
        return None
    if given is None:
        if isinstance(public, PublicPart):
            return None
        raise InputError("the world has a public sensor: pass its reports as `public`")
    steps = Axis("row", learns=True)
    if is_labelled(observations):
        steps.order(tuple(observations.index), "observations")
    read = in_rows(given, steps, "public")
    if isinstance(public, PublicPart):
        _check_part(public, sensor, observations, read)
        return None
    return np.asarray(public.log_likelihoods(read), dtype=np.float64)


def _part_for(part: PublicPart, sensor: Emission) -> tuple[PublicPart, Emission]:
    """The part in the order of the sensor's assets, and the law of z."""
    if isinstance(sensor, CategoricalEmission):
        _check_merging(part, sensor)
        return part, CategoricalEmission(sensor.probabilities @ part.matrix.T)
    if not isinstance(sensor, GaussianEmission):
        raise InputError(f"a PublicPart is of a GaussianEmission or a CategoricalEmission, got {sensor!r}")
    if part.matrix.shape[1] != sensor.n_dims:
        raise InputError(
            f"the public part's matrix has {part.matrix.shape[1]} columns, expected one per dimension: {sensor.n_dims}"
        )
    if part.asset_names is not None:
        order = Axis("asset", sensor.asset_names).order(part.asset_names, "the public part's matrix")
        part = part if order is None else _reordered(part, order)
    rank = int(np.linalg.matrix_rank(part.matrix))
    if rank < len(part.matrix):
        raise InputError(
            f"the public part's matrix has {len(part.matrix)} rows but rank {rank}: leave out rows that depend on others"
        )
    covariances = part.matrix @ sensor.covariances @ part.matrix.T
    return part, GaussianEmission(sensor.means @ part.matrix.T, covariances, asset_names=part.names)


def _reordered(part: PublicPart, order: list[int]) -> PublicPart:
    found = PublicPart(part.matrix[:, order])
    object.__setattr__(found, "names", part.names)
    assert part.asset_names is not None
    object.__setattr__(found, "asset_names", tuple(part.asset_names[k] for k in order))
    return found


def _check_merging(part: PublicPart, sensor: CategoricalEmission) -> None:
    if part.asset_names is not None and part.asset_names != tuple(range(sensor.n_symbols)):
        raise InputError("symbols have no names: give the public part's matrix without column labels")
    if part.matrix.shape[1] != sensor.n_symbols:
        raise InputError(
            f"the public part's matrix has {part.matrix.shape[1]} columns, expected one per symbol: {sensor.n_symbols}"
        )
    wrong = np.flatnonzero(((part.matrix != 0).sum(axis=0) != 1) | (part.matrix.sum(axis=0) != 1.0))
    if wrong.size:
        raise InputError(
            f"column {wrong[0]} of the public part's matrix is {part.matrix[:, wrong[0]].tolist()}: expected a single 1 and "
            "zeros, because each symbol is public as one other symbol"
        )


def _check_part(part: PublicPart, sensor: Emission, observations: Any, given: Any) -> None:
    wanted = part_of(part, sensor, observations)
    if wanted.ndim == 1:
        found = symbols(given, len(part.matrix), "public").astype(np.float64)
    else:
        found = real_rows(given, Axis("public column", part.names))
    if found.shape != wanted.shape:
        raise InputError(f"public has shape {found.shape}, expected {wanted.shape}: one row per observation")
    apart = np.abs(found - wanted) > tolerances.PUBLIC_PART * np.maximum(np.abs(wanted).max(axis=0), np.abs(found))
    if apart.any():
        t = int(np.argwhere(apart)[0][0])
        raise InputError(
            f"public row {row_name(given, t)} is {found[t].tolist()}, but that part of the agent's observation is "
            f"{wanted[t].tolist()}"
        )


def _merged(part: PublicPart) -> NDArray[np.int64]:
    return np.asarray(part.matrix.argmax(axis=0), dtype=np.int64)
