"""The private belief: the law of the state given the observations so far."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Generic, TypeVar, overload

import numpy as np
from numpy.typing import ArrayLike

from inscrutable.axes import ordered_array
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array, time_order
from inscrutable.worlds.hidden_markov import HiddenMarkovModel
from inscrutable.worlds.observations import is_labelled, row_name
from inscrutable.worlds.public import public_log_likelihoods

if TYPE_CHECKING:
    import pandas as pd

Table = TypeVar("Table")


@dataclass(frozen=True)
class FilterResult(Generic[Table]):
    """Beliefs over time, each from the observations up to its own row.

    Args:
        beliefs: (T,X), beliefs[t] = p(x_t | y_0..t).
        predicted: (T,X), predicted[t] = p(x_{t+1} | y_0..t): a row's label is the time of its last observation.
        log_likelihood: Natural logarithm of p(y_0..T-1).

    Example:
        >>> from inscrutable.filtering import filter_beliefs
        >>> from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.3, 0.7]], CategoricalEmission([[0.8, 0.2], [0.1, 0.9]]))
        >>> result = filter_beliefs(world, [0, 1])
        >>> result.predicted.round(3).tolist(), round(result.log_likelihood, 3)
        ([[0.876, 0.124], [0.667, 0.333]], -1.719)
    """

    beliefs: Table
    predicted: Table
    log_likelihood: float

    def __repr__(self) -> str:
        held = np.asarray(self.beliefs)
        last = " ".join(f"{share:.4f}" for share in held[-1])
        return f"{len(held)} beliefs over {held.shape[1]} states, the last [{last}], log-likelihood {self.log_likelihood:.4f}"


@overload
def filter_beliefs(
    world: HiddenMarkovModel, observations: pd.DataFrame | pd.Series[Any], *, public: Any = None
) -> FilterResult[pd.DataFrame]: ...
@overload
def filter_beliefs(world: HiddenMarkovModel, observations: ArrayLike, *, public: Any = None) -> FilterResult[Array]: ...
def filter_beliefs(world: HiddenMarkovModel, observations: Any, *, public: Any = None) -> FilterResult[Any]:
    """Return the private beliefs of an agent after each of its `observations`.

    π_t(j) ∝ p(y_t | x_t = j) Σ_i π_{t-1}(i) P_ij, where x_0 has the law `world.initial` before y_0 is seen; times p(z_t |
    x_t = j) where the world has a public sensor, which the agent observes too. The computation is in log space, and right
    also for observations that favour one state after another by thousands of orders of magnitude. It is causal: more
    observations never change an earlier row, not even its last digit.

    Args:
        world: The hidden Markov model.
        observations: (T,) symbols or (T,D) real vectors, T >= 1. With a DataFrame or Series the beliefs come back as
            DataFrames with the same index and the states' names as columns.
        public: The T reports of the world's public sensor; labelled rows are put in the order of the observations'. For a
            `PublicPart`, which the observations contain, None, or the same reports, which are then checked.

    Returns:
        Beliefs (T,X), one-step predictions (T,X) and the log-likelihood.

    Raises:
        InputError: `world` is no hidden Markov model, dates of observations go back, or malformed observations; row and column
            are named.
        ModelError: An observation that no reachable state can report; its step is named.

    Cost: O(T X²) after the sensor's log-likelihoods.

    Source: Lourenço et al. (2020), equation (1); the recursion is that of Rabiner, Proceedings of the IEEE 77 (1989),
    equation (20), normalised.

    Example:
        >>> from inscrutable.filtering import filter_beliefs
        >>> from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.3, 0.7]], CategoricalEmission([[0.8, 0.2], [0.1, 0.9]]))
        >>> filter_beliefs(world, [0, 1]).beliefs.round(3).tolist()
        [[0.96, 0.04], [0.611, 0.389]]
    """
    if is_labelled(observations):
        time_order(observations.index, "observations")
    log_likelihoods = _log_likelihoods(_checked(world), observations, public)
    with np.errstate(divide="ignore"):
        log_prior = np.log(world.initial)
    _, _, beliefs, predicted, increments = _pass(world, log_prior, log_likelihoods)
    impossible = np.flatnonzero(np.isneginf(increments))
    if impossible.size:
        raise _impossible(row_name(observations, int(impossible[0])))
    total = float(np.cumsum(increments)[-1])
    if not is_labelled(observations):
        return FilterResult(beliefs, predicted, total)
    import pandas as pd

    labels = {"index": observations.index, "columns": list(world.names)}
    return FilterResult(pd.DataFrame(beliefs, **labels), pd.DataFrame(predicted, **labels), total)


class BeliefFilter:
    """The filter of an agent, one observation at a time; its beliefs equal those of `filter_beliefs` to the last bit.

    Args:
        world: The hidden Markov model.

    Example:
        >>> from inscrutable.filtering import BeliefFilter
        >>> from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.3, 0.7]], CategoricalEmission([[0.8, 0.2], [0.1, 0.9]]))
        >>> agent = BeliefFilter(world)
        >>> agent.update(0).round(3).tolist()
        [0.96, 0.04]
        >>> agent.predicted.round(3).tolist()
        [0.876, 0.124]
    """

    def __init__(self, world: HiddenMarkovModel) -> None:
        self._world = _checked(world)
        with np.errstate(divide="ignore"):
            self._log_prior = np.log(world.initial)
        self._predicted: Array = world.initial.copy()
        self._log_likelihood = 0.0
        self._n_updates = 0

    @property
    def predicted(self) -> Array:
        """Belief (X,) about the next observation's state: p(x_{t+1} | y_0..t), the initial law before any update."""
        return self._predicted.copy()

    @property
    def log_likelihood(self) -> float:
        """Natural logarithm of p(y_0..t), zero before any update."""
        return self._log_likelihood

    def update(self, observation: Any, *, public: Any = None) -> Array:
        """Take in one observation and return the belief p(x_t | y_0..t); the first has no transition before it.

        Args:
            observation: A symbol or a (D,) real vector; a Series, or a DataFrame of one row, is aligned by the sensor's
                asset names.
            public: The report of the world's public sensor at the same step; as for `filter_beliefs`.

        Returns:
            (X,) belief.

        Raises:
            InputError: A malformed observation, or more than one.
            ModelError: No reachable state can report it. In both cases the filter stays as it was.

        Cost: O(X²) after the sensor's log-likelihoods.
        """
        row = _one_row(observation)
        log_likelihoods = _log_likelihoods(self._world, row, None if public is None else _one_row(public))
        if log_likelihoods.shape[0] != 1:
            raise InputError(
                f"update takes one observation, got {log_likelihoods.shape[0]}; use filter_beliefs for many"
            )
        _, log_predicted, beliefs, predicted, increments = _pass(self._world, self._log_prior, log_likelihoods)
        if np.isneginf(increments[0]):
            raise _impossible(str(self._n_updates))
        self._log_prior, self._predicted = log_predicted[0], predicted[0]
        self._log_likelihood += float(increments[0])
        self._n_updates += 1
        return np.asarray(beliefs[0])


def _one_row(observation: Any) -> Any:
    if not is_labelled(observation):
        return ordered_array(observation, "observation", None)[None]
    return observation if hasattr(observation, "columns") else observation.to_frame().T


def _checked(world: Any) -> HiddenMarkovModel:
    if not isinstance(world, HiddenMarkovModel):
        raise InputError(f"world must be a HiddenMarkovModel, got {world!r}")
    return world


def _log_likelihoods(world: HiddenMarkovModel, observations: Any, public: Any) -> Array:
    """The sensors' log-likelihoods; they are checked, as a sensor may be the user's own."""
    values = _sensible(world.emission.log_likelihoods(observations), world, "the emission")
    told = public_log_likelihoods(world.emission, world.public, observations, public)
    if told is None:
        return values
    more = _sensible(told, world, "the public emission")
    if len(more) != len(values):
        raise InputError(f"public has {len(more)} entries, expected one per observation: {len(values)}")
    return values + more


def _sensible(found: Any, world: HiddenMarkovModel, what: str) -> Array:
    values = np.ascontiguousarray(found, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != world.n_states:
        raise InputError(f"{what}'s log-likelihoods have shape {values.shape}, expected (T,{world.n_states})")
    bad = np.argwhere(~(values < np.inf))
    if bad.size:
        t, i = (int(k) for k in bad[0])
        raise InputError(f"{what}'s log-likelihood at step {t} is {values[t, i]} in state {i}")
    return values


def _pass(world: HiddenMarkovModel, log_prior: Array, log_likelihoods: Array) -> tuple[Array, ...]:
    from inscrutable.kernels.hidden_markov import filter_pass

    with np.errstate(divide="ignore"):
        log_transition = np.log(world.transition)
    result: tuple[Array, ...] = filter_pass(log_prior, log_transition, log_likelihoods)
    return result


def _impossible(step: str) -> ModelError:
    return ModelError(
        f"the observation at step {step} has likelihood zero in every state that can be reached there: it is too far from "
        "all of them, or the sensor or the transition has zeros that rule it out; check the observation and the world"
    )
