"""The world: a hidden Markov chain of states and an observation model."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from inscrutable import validation
from inscrutable.axes import Axis
from inscrutable.errors import InputError, ModelError
from inscrutable.saved import saved_plainly
from inscrutable.validation import Array
from inscrutable.worlds.emissions import Emission, cumulative, emission_from_dict, frozen
from inscrutable.worlds.public import PublicPart, checked_public, part_of, public_from_dict


@dataclass(frozen=True)
class Trajectory:
    """A sampled path.

    Args:
        states: (T,) states x_0..x_{T-1}, counted from 0, or (T,n) real vectors.
        observations: (T,) symbols or (T,D) real vectors; row t was reported in state x_t.
        public: The public observations, (T,) or (T,Z); None where the world has none.

    Example:
        >>> import numpy as np
        >>> from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.0, 1.0], [1.0, 0.0]], CategoricalEmission(np.eye(2)), [1.0, 0.0])
        >>> path = world.sample(4, rng=np.random.default_rng(0))
        >>> path.states.tolist(), path.observations.tolist()
        ([0, 1, 0, 1], [0, 1, 0, 1])
    """

    states: NDArray[Any]
    observations: NDArray[Any]
    public: NDArray[Any] | None = None

    def __repr__(self) -> str:
        told = "" if self.public is None else ", with public observations"
        return f"path of {len(self.states)} steps through {len(np.unique(self.states))} states{told}"


@saved_plainly
@dataclass(frozen=True, init=False, eq=False, repr=False)
class HiddenMarkovModel:
    """A world of X hidden states, and a sensor: p(x_{t+1} = j | x_t = i) = transition[i, j], p(y_t | x_t).

    Args:
        transition: (X,X), rows of probabilities that sum to one. Labelled rows and columns are put in the order of
            `names`, or of a labelled sensor's states; where there are neither, they give the states their names.
        emission: The sensor, `CategoricalEmission`, `GaussianEmission` or any `Emission`, over X states.
        initial: (X,) law of x_0; None for the stationary law π = π P (states that the chain leaves for good get
            zero; a periodic chain has one too).
        names: X different labels of the states, in messages, tables and pictures; "regime 1", … by default.
        public: The public observations. An `Emission`, independent of the private one given the state: the agent filters
            both. Or a `PublicPart` of the private observation, which the agent filters alone. None: there are none.

    Raises:
        InputError: A row that does not sum to one (row and sum are named), shapes or names that do not fit.
        ModelError: `initial` is None and the chain has several closed classes, so several stationary laws.

    Example:
        >>> import numpy as np
        >>> from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.3, 0.7]], CategoricalEmission([[0.8, 0.2], [0.1, 0.9]]))
        >>> world.initial.round(3).tolist()
        [0.75, 0.25]
        >>> world.sample(3, rng=np.random.default_rng(0)).states.shape
        (3,)
    """

    transition: Array
    emission: Emission
    initial: Array
    names: tuple[str, ...]
    public: Emission | PublicPart | None
    public_emission: Emission | None

    def __init__(
        self,
        transition: ArrayLike,
        emission: Emission,
        initial: ArrayLike | None = None,
        *,
        names: Iterable[str] | None = None,
        public: Emission | PublicPart | None = None,
    ) -> None:
        told = getattr(public, "state_names", None)
        sensed, given = getattr(emission, "state_names", None) or told, None if names is None else tuple(names)
        if isinstance(names, str):
            raise InputError(f"names must be a sequence of strings, got {names!r}")
        states = Axis("state", given or sensed, learns=True)
        rows = validation.stochastic_rows(transition, "transition", axes=(states, states))
        n_states = rows.shape[0]
        if rows.shape != (n_states, n_states) or n_states == 0:
            raise InputError(f"transition has shape {rows.shape}, expected a square matrix (X,X)")
        if not isinstance(emission, Emission):
            raise InputError(
                f"emission must be an Emission such as GaussianEmission(means, covariances), got {emission!r}"
            )
        if emission.n_states != n_states:
            raise InputError(f"emission has {emission.n_states} states, transition has {n_states}")
        read, law = checked_public(public, emission)
        if initial is None:
            start = stationary_law(rows)
        else:
            start = validation.stochastic_rows(initial, "initial", ndim=1, axes=(states,))
            if start.size != n_states:
                raise InputError(f"initial has {start.size} entries, expected one per state: {n_states}")
        object.__setattr__(self, "transition", frozen(rows))
        object.__setattr__(self, "emission", emission)
        object.__setattr__(self, "initial", frozen(start))
        object.__setattr__(self, "names", _state_names(states.names, n_states))
        object.__setattr__(self, "public", read)
        object.__setattr__(self, "public_emission", law)
        for sensor, found in (("emission", sensed), ("the public emission", told)):
            if found is not None and found != self.names:
                raise InputError(
                    f"{sensor} has the states {list(found)}, the world {list(self.names)}; expected the same order"
                )

    def __repr__(self) -> str:
        read = "" if self.public is None else f", public={self.public!r}"
        return f"HiddenMarkovModel({self.n_states} states, {self.emission!r}{read})"

    @property
    def n_states(self) -> int:
        """Number of states X."""
        return int(self.transition.shape[0])

    def public_of(self, observations: Any) -> NDArray[Any]:
        """Return the public part of the agent's observations, (T,Z), or (T,) of symbols.

        Raises:
            InputError: The world has no `PublicPart`, or the observations are malformed.
        """
        if not isinstance(self.public, PublicPart):
            raise InputError(
                f"no part of the agent's observations is public: the world has public={self.public!r}, expected a PublicPart"
            )
        return part_of(self.public, self.emission, observations)

    def sample(self, n_steps: int, *, rng: np.random.Generator) -> Trajectory:
        """Draw a path x_0 ~ initial, x_{t+1} ~ transition[x_t], y_t ~ p(y | x_t), in O(n_steps (log X + D²)).

        Public observations are drawn last, p(z | x_t), or are part of y_t.

        Args:
            n_steps: Length T of the path, at least 1.
            rng: The only source of randomness; the same state of it gives the same path.

        Raises:
            InputError: `n_steps` is not a whole number of at least 1, or `rng` is not a generator.
        """
        n_steps = validation.count(n_steps, "n_steps")
        states = np.empty(n_steps, dtype=np.int64)
        sums, rows = cumulative(self.initial).tolist(), cumulative(self.transition).tolist()
        for t, uniform in enumerate(validation.generator(rng).random(n_steps).tolist()):
            states[t] = state = bisect_right(sums, uniform)
            sums = rows[state]
        observations = self.emission.sample(states, rng=rng)
        if self.public is None:
            return Trajectory(states, observations)
        if isinstance(self.public, PublicPart):
            return Trajectory(states, observations, self.public_of(observations))
        return Trajectory(states, observations, self.public.sample(states, rng=rng))

    def to_dict(self) -> dict[str, Any]:
        """Return the world as plain data for `json.dump`; `from_dict` restores every float to its last digit."""
        return {
            "transition": self.transition.tolist(),
            "initial": self.initial.tolist(),
            "names": list(self.names),
            "emission": self.emission.to_dict(),
            **({} if self.public is None else {"public": self.public.to_dict()}),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> HiddenMarkovModel:
        """Rebuild a world from `to_dict`.

        Raises:
            InputError: A key is missing, the emission is not one of this library's, or the numbers are no model.
            ModelError: A covariance of the emission is indefinite or singular.

        Example:
            >>> from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel
            >>> world = HiddenMarkovModel([[0.9, 0.1], [0.3, 0.7]], CategoricalEmission([[1.0], [1.0]]))
            >>> HiddenMarkovModel.from_dict(world.to_dict()).to_dict() == world.to_dict()
            True
        """
        keys = ("transition", "emission", "initial", "names")
        missing = [key for key in keys if not isinstance(data, dict) or key not in data]
        if missing:
            raise InputError(f"a saved world must be a dictionary with the keys {list(keys)}; missing: {missing}")
        emission = emission_from_dict(data["emission"])
        public = public_from_dict(data.get("public"))
        return cls(data["transition"], emission, data["initial"], names=data["names"], public=public)


def default_names(n_states: int) -> tuple[str, ...]:
    """Return the names that states have where none were given."""
    return tuple(f"regime {i + 1}" for i in range(n_states))


def _state_names(names: Iterable[Any] | None, n_states: int) -> tuple[str, ...]:
    if names is None:
        return default_names(n_states)
    labels = tuple(names)
    if not all(isinstance(label, str) for label in labels):
        raise InputError(f"names must be a sequence of strings, got {names!r}")
    if len(labels) != n_states or len(set(labels)) != n_states:
        raise InputError(f"names must be {n_states} different labels, one per state, got {list(labels)}")
    return labels


def stationary_law(transition: Array) -> Array:
    """Solve π = π P on the one closed class by state reduction, which never subtracts.

    Every entry is therefore right to rounding, however rare the switches (Grassmann, Taksar and Heyman, Operations
    Research 33, 1985).
    """
    closed = _closed_classes(transition)
    if len(closed) > 1:
        classes = " and ".join(str([int(i) for i in members]) for members in closed)
        raise ModelError(
            f"the stationary law is not unique: the chain never leaves any of the classes of states {classes}; "
            "give `initial`"
        )
    members = closed[0]
    reduced = transition[np.ix_(members, members)].copy()
    for last in range(members.size - 1, 0, -1):
        reduced[:last, last] /= reduced[last, :last].sum()
        reduced[:last, :last] += np.outer(reduced[:last, last], reduced[last, :last])
    weights = np.ones(members.size)
    for state in range(1, members.size):
        weights[state] = weights[:state] @ reduced[:state, state]
    law = np.zeros(transition.shape[0])
    law[members] = weights / weights.sum()
    return law


def _closed_classes(transition: Array) -> list[NDArray[np.int64]]:
    """List the classes of states that reach one another and nothing else."""
    n_states = transition.shape[0]
    reach = (transition > 0) | np.eye(n_states, dtype=bool)
    for _ in range(n_states.bit_length()):
        reach = (reach.astype(float) @ reach.astype(float)) > 0
    recurrent = np.flatnonzero((~reach | reach.T).all(axis=1))
    members = {int(np.flatnonzero(reach[i])[0]): np.flatnonzero(reach[i]) for i in recurrent}
    return list(members.values())
