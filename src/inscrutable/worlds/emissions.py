"""Observation models p(y | x) of hidden Markov models."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inscrutable import tolerances, validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds.observations import Labels, labels_of, real_rows, symbols


@runtime_checkable
class Emission(Protocol):
    """An observation model p(y | x) over X states; derive your own for another sensor.

    A row of `log_likelihoods` must depend on that row's observation alone, or the filter is not causal.

    Example:
        >>> from inscrutable.worlds import CategoricalEmission
        >>> isinstance(CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]), Emission)
        True
    """

    @property
    def n_states(self) -> int:
        """Number of states X."""
        ...

    def log_likelihoods(self, observations: Any) -> Array:
        """Return log p(y_t | x_t = i) as (T,X), −inf for an impossible observation; refuse malformed ones."""
        ...

    def sample(self, states: ArrayLike, *, rng: np.random.Generator) -> NDArray[Any]:
        """Draw one observation for each state of a path (T,), the states counted from 0."""
        ...

    def to_dict(self) -> dict[str, Any]:
        """Return the model as plain data that `json.dump` accepts, with its type under the key ``type``."""
        ...


@dataclass(frozen=True, init=False, eq=False, repr=False)
class CategoricalEmission:
    """A sensor that reports one of Y symbols: p(y | x = i) = probabilities[i, y].

    Args:
        probabilities: (X,Y), rows of probabilities that sum to one.

    Raises:
        InputError: A row has a negative entry or does not sum to one; the row and the amount are named.

    Example:
        >>> from inscrutable.worlds import CategoricalEmission
        >>> sensor = CategoricalEmission([[0.9, 0.1], [0.5, 0.5]])
        >>> sensor.log_likelihoods([1, 0]).round(3).tolist()
        [[-2.303, -0.693], [-0.105, -0.693]]
    """

    probabilities: Array
    state_names: Labels | None

    def __init__(self, probabilities: ArrayLike) -> None:
        states = Axis("state", learns=True)
        rows = validation.stochastic_rows(probabilities, "probabilities", axes=(states, Axis("symbol")))
        if not len(rows):
            raise InputError("probabilities has no rows; expected one per state")
        object.__setattr__(self, "probabilities", frozen(rows))
        object.__setattr__(self, "state_names", states.names)

    def __repr__(self) -> str:
        return f"CategoricalEmission({self.n_states} states, {self.n_symbols} symbols)"

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return int(self.probabilities.shape[0])

    @property
    def n_symbols(self) -> int:
        """Number of symbols Y."""
        return int(self.probabilities.shape[1])

    def log_likelihoods(self, observations: Any) -> Array:
        """Return log p(y_t | x_t = i) as (T,X), −inf where a state cannot report the symbol.

        Args:
            observations: (T,) whole numbers in 0..Y-1.

        Raises:
            InputError: An observation is not a symbol; its row is named.
        """
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(self.probabilities.T[symbols(observations, self.n_symbols)]))

    def sample(self, states: ArrayLike, *, rng: np.random.Generator) -> NDArray[np.int64]:
        """Draw a symbol for each state of a path (T,), by inversion of the cumulative row."""
        path = symbols(states, self.n_states, "states")
        uniforms = validation.generator(rng).random(path.size)
        return np.asarray((uniforms[:, None] >= cumulative(self.probabilities)[path]).sum(axis=1), dtype=np.int64)

    def to_dict(self) -> dict[str, Any]:
        """Return the sensor as plain data; floats keep every digit."""
        return {"type": "categorical", "probabilities": self.probabilities.tolist()}


@dataclass(frozen=True, init=False, eq=False, repr=False)
class GaussianEmission:
    """A sensor that reports a real vector: p(y | x = i) = N(y; means[i], covariances[i]).

    Args:
        means: (X,D), in the observations' unit.
        covariances: (X,D,D), in the squared unit; symmetric positive definite. Asymmetry of rounding size is averaged.
        asset_names: D labels; None takes those of labelled means or covariances. Observations that come as a DataFrame are
            aligned by them.

    Raises:
        InputError: Shapes that do not fit, an entry that is not finite, an asymmetric covariance.
        ModelError: A covariance that is indefinite or singular, so that no density exists; the message has its
            smallest eigenvalue and condition number.

    Example:
        >>> from inscrutable.worlds import GaussianEmission
        >>> sensor = GaussianEmission(means=[[0.0], [1.0]], covariances=[[[1.0]], [[4.0]]])
        >>> sensor.log_likelihoods([0.0, 5.0]).round(3).tolist()
        [[-0.919, -1.737], [-13.419, -3.612]]
    """

    means: Array
    covariances: Array
    asset_names: Labels | None
    state_names: Labels | None
    _factors: Array = field(repr=False)

    def __init__(
        self, means: ArrayLike, covariances: ArrayLike, *, asset_names: Iterable[Hashable] | None = None
    ) -> None:
        states = Axis("state", learns=True)
        assets = Axis("asset", None if asset_names is None else tuple(asset_names), learns=True)
        centres = validation.finite_array(means, "means", ndim=2, axes=(states, assets))
        spreads = _symmetric(validation.finite_array(covariances, "covariances", ndim=3, axes=(states, assets, assets)))
        n_states, n_dims = centres.shape
        if spreads.shape != (n_states, n_dims, n_dims) or centres.size == 0:
            raise InputError(
                f"covariances have shape {spreads.shape}, "
                f"expected (X,D,D) = {(n_states, n_dims, n_dims)} from the means"
            )
        for state, covariance in enumerate(spreads):
            _check_definite(covariance, f"covariances[{state}]")
        names = assets.names
        if names is not None and len(names) != n_dims:
            raise InputError(f"asset_names has {len(names)} labels, expected one per dimension: {n_dims}")
        object.__setattr__(self, "means", frozen(centres))
        object.__setattr__(self, "covariances", frozen(spreads))
        object.__setattr__(self, "asset_names", names)
        object.__setattr__(self, "state_names", states.names)
        object.__setattr__(self, "_factors", np.linalg.cholesky(spreads))

    def __repr__(self) -> str:
        return f"GaussianEmission({self.n_states} states, {self.n_dims} dimensions)"

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return int(self.means.shape[0])

    @property
    def n_dims(self) -> int:
        """Number of dimensions D of an observation."""
        return int(self.means.shape[1])

    def log_likelihoods(self, observations: Any) -> Array:
        """Return log N(y_t; means[i], covariances[i]) as (T,X), in O(T X D²).

        Args:
            observations: (T,D) real numbers; (T,) is accepted where D is 1. The columns of a DataFrame are aligned
                with `asset_names` where the sensor has them.

        Raises:
            InputError: Wrong shape, missing or other columns, or an entry that is not finite, with its row and column.
        """
        from inscrutable.kernels.hidden_markov import gaussian_log_densities

        rows = real_rows(observations, Axis("asset", self.asset_names))
        if rows.shape[1] != self.n_dims:
            raise InputError(f"observations have {rows.shape[1]} columns, expected one per dimension: {self.n_dims}")
        return np.asarray(gaussian_log_densities(rows, self.means.copy(), self._factors))

    def sample(self, states: ArrayLike, *, rng: np.random.Generator) -> Array:
        """Draw a vector for each state of a path (T,): means[x_t] + L z with L L' = covariances[x_t]; (T,D).

        L is triangular by rising variance, so that what is simulated does not depend on the order of the dimensions.
        """
        path = symbols(states, self.n_states, "states")
        order = np.lexsort(np.vstack([self.means, np.diagonal(self.covariances, axis1=1, axis2=2)]))
        factors = np.linalg.cholesky(self.covariances[:, order][:, :, order])
        drawn = validation.generator(rng).standard_normal((path.size, self.n_dims))
        for state in range(self.n_states):
            rows = path == state
            drawn[np.ix_(rows, order)] = self.means[state, order] + drawn[rows] @ factors[state].T
        return drawn

    def to_dict(self) -> dict[str, Any]:
        """Return the sensor as plain data; floats keep every digit."""
        names = None if self.asset_names is None else list(self.asset_names)
        data = {"type": "gaussian", "means": self.means.tolist(), "covariances": self.covariances.tolist()}
        return {**data, "asset_names": names}


def emission_from_dict(data: Any) -> Emission:
    """Rebuild a sensor of this module from its `to_dict`."""
    kind = data.get("type") if isinstance(data, dict) else None
    try:
        if kind == "categorical":
            return CategoricalEmission(data["probabilities"])
        if kind == "gaussian":
            return GaussianEmission(data["means"], data["covariances"], asset_names=labels_of(data["asset_names"]))
    except KeyError as error:
        raise InputError(f"a {kind} emission needs the key {error}; it has {sorted(data)}") from None
    raise InputError(f"an emission's type must be 'categorical' or 'gaussian', got {kind!r}")


def cumulative(rows: Array) -> Array:
    """Return cumulative rows that end in exactly one, so that a uniform number below one always finds a place."""
    sums = np.cumsum(rows, axis=-1)
    return np.asarray(sums / sums[..., -1:])


def frozen(array: Array) -> Array:
    """Return `array` itself, read-only."""
    array.flags.writeable = False
    return array


def _symmetric(covariances: Array) -> Array:
    if covariances.shape[1] != covariances.shape[2]:
        raise InputError(f"covariances have shape {covariances.shape}, expected square matrices (X,D,D)")
    transposed = covariances.transpose(0, 2, 1)
    scale = np.abs(covariances).max(axis=(1, 2), keepdims=True, initial=0.0)
    bad = np.argwhere(np.abs(covariances - transposed) > tolerances.SYMMETRY * scale)
    if bad.size:
        i, d, e = (int(k) for k in bad[0])
        raise InputError(
            f"covariances[{i}] is not symmetric: {covariances[i, d, e]:g} at [{d}, {e}], "
            f"{covariances[i, e, d]:g} at [{e}, {d}]"
        )
    return np.asarray(np.ascontiguousarray((covariances + transposed) / 2.0))


def _check_definite(covariance: Array, name: str) -> None:
    """Test the matrix scaled to unit variances, so that units do not matter; report its own eigenvalues."""
    variances = np.diag(covariance)
    if (variances > 0).all():
        deviations = np.sqrt(variances)
        scaled = np.linalg.eigvalsh(covariance / deviations[:, None] / deviations)
        if scaled[0] > tolerances.DEFINITE:
            return
    eigenvalues = np.linalg.eigvalsh(covariance)
    kind = "indefinite" if eigenvalues[0] < -tolerances.DEFINITE * eigenvalues[-1] else "singular"
    raise ModelError(
        f"{name} is {kind}: smallest eigenvalue {eigenvalues[0]:.6g}, "
        f"condition number {np.linalg.cond(covariance):.3g}; a Gaussian density needs a positive definite covariance"
    )
