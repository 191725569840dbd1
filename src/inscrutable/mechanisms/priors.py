"""An observer's prior law of the agent's belief, before any decision is seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from inscrutable import tolerances, validation
from inscrutable.axes import Axis, Names, check_same_order
from inscrutable.errors import InputError, ModelError
from inscrutable.filtering import filter_beliefs
from inscrutable.geometry import simplex_grid
from inscrutable.mechanisms.cycles import balanced_weights
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel
from inscrutable.worlds.hidden_markov import stationary_law

STEPS_OF_LAW = 100_000
"""Steps of the simulated path by which a long-run law is found."""

_COMMON = 0.01
"""Long-run share of a state that a simulated path must visit; a rarer one moves the mean of the beliefs by less."""


@dataclass(frozen=True, eq=False, repr=False)
class Prior(Summarised, Saved):
    """A law of the private belief on finitely many points of the simplex.

    Formula: p(π_b) = w_b, Σ w_b = 1.

    Args:
        beliefs: Points π_b, shape (B,X).
        weights: Their probabilities w_b, shape (B,).
        state_names: Labels of the states, with which labelled beliefs are aligned; None where there are none.

    Raises:
        InputError: A belief is no probability vector, a weight is negative, or the weights do not sum to one.

    Source: Bayes' rule with the belief as the unknown; the paper's outlook in Section V.

    Example:
        >>> prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.25, 0.75])
        >>> print(prior.entropy, prior.mean)
        0.8112781244591328 [0.25 0.75]
    """

    beliefs: Array
    weights: Array
    state_names: Names | None = None

    def __post_init__(self) -> None:
        rows, states = Axis("belief", learns=True), Axis("state", self.state_names)
        beliefs = validation.stochastic_rows(self.beliefs, "prior beliefs", axes=(rows, states))
        weights = validation.stochastic_rows(self.weights, "prior weights", ndim=1, axes=(rows,))
        if not len(beliefs) or len(beliefs) != len(weights):
            raise InputError(
                f"a prior needs one weight per belief, got {len(beliefs)} beliefs and {len(weights)} weights"
            )
        object.__setattr__(self, "beliefs", beliefs)
        object.__setattr__(self, "weights", weights)
        validation.read_only(self, "beliefs", "weights")

    def __len__(self) -> int:
        return len(self.weights)

    @property
    def mean(self) -> Array:
        """Σ w_b π_b, shape (X,)."""
        return np.asarray(self.weights @ self.beliefs)

    @property
    def entropy(self) -> float:
        """−Σ w_b log2 w_b, in bits."""
        held = self.weights[self.weights > 0]
        return float(-(held * np.log2(held)).sum()) + 0.0

    @property
    def error(self) -> float:
        """√Σ w_b ‖π_b − mean‖², the root mean square error of an observer who sees no decision."""
        return float(np.sqrt(self.weights @ ((self.beliefs - self.mean) ** 2).sum(axis=1)))

    def summary(self) -> str:
        """Return one line for a person to read."""
        mean = " ".join(f"{share:.4f}" for share in self.mean)
        return f"{len(self)} beliefs, entropy {self.entropy:.4f} bits, mean [{mean}], error {self.error:.4f}"


def uniform_prior(n_states: int, resolution: int) -> Prior:
    """Return equal weights on the regular grid of beliefs.

    Formula: w_b = 1/B on {k/r : k ∈ N^X, Σ k = r}, B = C(r+X−1, X−1).

    Args:
        n_states: X, at least 1.
        resolution: r, at least 1: beliefs are multiples of 1/r, vertices included.

    Raises:
        InputError: A number is not whole or below 1, or the grid is too large for the memory.

    Cost: B·X numbers. Source: the prior of an observer without knowledge of the world.

    Example:
        >>> len(uniform_prior(3, 30))
        496
    """
    points = simplex_grid(validation.count(n_states, "n_states"), resolution)
    return Prior(points, np.full(len(points), 1.0 / len(points)))


def filtered_prior(
    world: HiddenMarkovModel, resolution: int, *, rng: np.random.Generator, n_steps: int = STEPS_OF_LAW
) -> Prior:
    """Return the long-run law of the filtered belief p(x_t | y_0..t), binned on the regular grid of beliefs.

    Use it where the cost depends on the state at the time of the decision, as in the paper.

    Formula: w_b = weighted share of the steps t whose filtered belief π_t has π_b as the nearest point of the grid; grid
    points never met are left out. The weights of steps are near one and make the mean of the filtered beliefs a stationary law
    of the states, as it is for the true law: without them it errs by as much as the time that the path spent in each state. The
    grid moves each belief by less than its step 1/r, so that `mean` is off by a part of that, such as .01 with r = 10.

    Args:
        world: The hidden Markov model whose observations the agent filters.
        resolution: r, at least 1: beliefs are multiples of 1/r.
        rng: The source of the simulated path.
        n_steps: Length of the simulated path, at least 1; the first tenth is left out.

    Raises:
        InputError: `world` is no hidden Markov model, a number is not whole or below 1, `rng` is no generator, or the path
            never visits a state with a long-run share of 1 % or more.
        ModelError: The chain has several classes of states that it never leaves, so that its long-run law depends on the start.

    Cost: one simulated and filtered path.

    Source: ergodic averages of the filter, the paper's eq. (2).

    Example:
        >>> from inscrutable import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
        >>> prior = filtered_prior(world, 10, rng=np.random.default_rng(0), n_steps=1000)
        >>> prior.beliefs.shape[1]
        2
    """
    return grid_visits(world, resolution, rng=rng, n_steps=n_steps).prior


stationary_prior = filtered_prior
"""The former name of `filtered_prior`."""


def predicted_prior(
    world: HiddenMarkovModel, resolution: int, *, rng: np.random.Generator, n_steps: int = STEPS_OF_LAW
) -> Prior:
    """Return the long-run law of the belief about the next state, p(x_{t+1} | y_0..t), on the points of a moved grid.

    Use it where the cost depends on the state after the decision, as for holdings that earn the next row's return: the investor
    of `run_backtest`, `attack_weights`, `protect` and `compare` decides on this belief. It is nearer to the mean than the
    filtered one; an observer who confuses the two misjudges the information in decisions.

    Formula: weights of `filtered_prior`, each of its points π moved to P'π; points that become equal are one.

    Args:
        world: The hidden Markov model whose observations the agent filters.
        resolution: r, at least 1: filtered beliefs are multiples of 1/r.
        rng: The source of the simulated path.
        n_steps: Length of the simulated path, at least 1; the first tenth is left out.

    Raises:
        InputError: As `filtered_prior`.
        ModelError: As `filtered_prior`.

    Cost: one simulated and filtered path.

    Source: the prediction step of the filter, the paper's eq. (2).

    Example:
        >>> from inscrutable import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
        >>> print(predicted_prior(world, 10, rng=np.random.default_rng(0)).beliefs[:, 0].min().round(3))
        0.1
    """
    return predicted(filtered_prior(world, resolution, rng=rng, n_steps=n_steps), world)[0]


def predicted(prior: Prior, world: HiddenMarkovModel) -> tuple[Prior, np.ndarray]:
    """Return the law of the belief one step ahead of one with the law `prior`, and where each point of `prior` moves.

    Points that become one, because the transition has equal rows or others that depend on each other, are one.
    """
    return _merged(prior.beliefs @ world.transition, prior.weights, world.names)


def without_copies(prior: Prior) -> Prior:
    """Return a prior that lists every belief once, with all its weight; itself where it does."""
    found, _ = _merged(prior.beliefs, prior.weights, prior.state_names)
    return prior if len(found) == len(prior) else found


def _merged(beliefs: Array, weights: Array, names: Names | None) -> tuple[Prior, np.ndarray]:
    """Return the law of beliefs (B,X) with weights (B,), equal ones joined, and the place of each there."""
    first, place = np.unique(first_same(beliefs, tolerances.SAME_BELIEF), return_inverse=True)
    joined: Array = np.bincount(place, weights=weights).astype(np.float64)
    return Prior(beliefs[first], joined, names), place


def checked_prior(prior: Any, problem: DecisionProblem | None = None) -> Prior:
    """Return a prior, over the states of a problem where one is given; raise `InputError` otherwise."""
    if not isinstance(prior, Prior):
        raise InputError(f"prior must be a Prior such as uniform_prior(3, 30), got {prior!r}")
    if problem is not None:
        if prior.beliefs.shape[1] != problem.n_states:
            raise InputError(f"the prior has {prior.beliefs.shape[1]} states, the problem {problem.n_states}")
        check_same_order("state", ("the prior", prior.state_names), ("the problem", problem.state_names))
    return prior


class GridVisits(NamedTuple):
    """A simulated path of beliefs on a grid: its law, the point and weight of each step, and public observations, if any."""

    prior: Prior
    places: np.ndarray
    weights: Array
    public: np.ndarray | None


def grid_visits(world: HiddenMarkovModel, resolution: int, *, rng: np.random.Generator, n_steps: int) -> GridVisits:
    """Return `filtered_prior` with the path behind it, from the end of its first tenth on."""
    if not isinstance(world, HiddenMarkovModel):
        raise InputError(f"world must be a HiddenMarkovModel, got {world!r}")
    count = validation.count(n_steps, "n_steps")
    resolution = validation.count(resolution, "resolution")
    shares = _long_run_shares(world)
    path = world.sample(count, rng=validation.generator(rng))
    skipped = count // 10
    missed = np.setdiff1d(np.flatnonzero(shares >= _COMMON), path.states[skipped:])
    if missed.size:
        name, share = world.names[missed[0]], shares[missed[0]]
        raise InputError(
            f"a simulated path with n_steps = {count} never visits the state {name!r}, whose long-run share is {share:.0%}: "
            "expected more steps, or states that are left more often"
        )
    beliefs = filter_beliefs(world, path.observations, public=path.public).beliefs[skipped:]
    numbers, place = _different(rounded_to_grid(beliefs, resolution), resolution)
    weights = balanced_weights(place, beliefs, world.transition)
    law = np.bincount(place, weights=weights)
    read = None if path.public is None else path.public[skipped:]
    return GridVisits(Prior(numbers / resolution, law / law.sum(), world.names), place, weights, read)


def _long_run_shares(world: HiddenMarkovModel) -> Array:
    try:
        return stationary_law(world.transition)
    except ModelError as error:
        raise ModelError(f"the long-run law of beliefs depends on where the chain begins: {error}") from error


def _different(points: np.ndarray, resolution: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the different rows of points (T,X) of a grid, in order, and the place of each row among them.

    Each row is encoded as one integer with its entries as digits, which makes sorting ten times as fast.
    """
    base, n_digits = resolution + 1, points.shape[1]
    if base**n_digits > np.iinfo(np.int64).max:
        rows, place = np.unique(points, axis=0, return_inverse=True)
        return rows, place.reshape(-1)
    keys = points @ base ** np.arange(n_digits)[::-1]
    _, first, place = np.unique(keys, return_index=True, return_inverse=True)
    return points[first], place


def rounded_to_grid(beliefs: Array, resolution: int) -> np.ndarray:
    """Return the nearest grid point of each belief as whole numbers k with Σ k = resolution, shape (T,X).

    Largest remainders are rounded up, which is the Euclidean projection onto the grid.
    """
    scaled = beliefs * resolution
    whole = np.floor(scaled).astype(np.int64)
    missing = resolution - whole.sum(axis=1)
    order = np.argsort(whole - scaled, axis=1, kind="stable")
    rank = np.argsort(order, axis=1, kind="stable")
    return np.asarray(whole + (rank < missing[:, None]))
