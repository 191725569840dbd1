"""Contract checker for observation models: filters and samples of a world rely on these promises."""

from __future__ import annotations

import json

import numpy as np

from inscrutable.errors import InputError
from inscrutable.testing.promises import check_shape, promise, same, source_of
from inscrutable.validation import Array
from inscrutable.worlds import Emission

_DRAWS = 400  # of each state
_DEVIATIONS = 6.0  # standard errors by which a mean may be off


def check_emission(emission: Emission, *, rng: np.random.Generator | None = None) -> None:
    """Check on its own samples that an observation model keeps its promises; silent where it does.

    The promises are:

    - shapes are right;
    - no log-likelihood is NaN or +∞, and none is −∞ for a sample and its own state;
    - a row depends on its own observation alone, so filters are causal;
    - on average no other state explains a state's samples better, E_i log p_i ≥ E_i log p_j, which shows that samples and
      likelihoods have the same law;
    - equal seeds draw equal samples;
    - `to_dict` is plain data with a type.

    Args:
        emission: The observation model, from this library or written by a user.
        rng: Source of the states and observations; None: a fixed seed, the same at every call.

    Raises:
        AssertionError: A promise is broken; the message names it, with the state or the row and the number.
        InputError: `emission` lacks a part of an `Emission`.

    Cost: some hundred observations of every state. Source: Gibbs' inequality.

    Example:
        >>> from inscrutable import CategoricalEmission
        >>> check_emission(CategoricalEmission([[0.9, 0.1], [0.5, 0.5]]))
    """
    if not isinstance(emission, Emission):
        raise InputError(f"an Emission with n_states, log_likelihoods, sample and to_dict is needed, got {emission!r}")
    source = source_of(rng)
    n_states = emission.n_states
    whole = isinstance(n_states, (int, np.integer)) and n_states >= 1
    promise(whole, "n_states is a whole number of at least 1", f"found {n_states!r}")
    states = source.permutation(np.repeat(np.arange(n_states), _DRAWS))
    seed = int(source.integers(2**32))
    observations, again = (emission.sample(states, rng=np.random.default_rng(seed)) for _ in range(2))
    promise(
        len(observations) == len(states),
        "sample draws one observation a state",
        f"{len(states)} gave {len(observations)}",
    )
    repeated = bool(np.array_equal(observations, again))
    promise(repeated, "sample draws the same from the same rng", "two draws with one seed differ")
    _check_likelihoods(emission, states, np.asarray(observations), source)
    _check_plain(emission)


def _check_likelihoods(
    emission: Emission, states: np.ndarray, observations: np.ndarray, source: np.random.Generator
) -> None:
    table = np.asarray(emission.log_likelihoods(observations), dtype=np.float64)
    check_shape("log_likelihoods(observations)", table.shape, (len(states), emission.n_states))
    bad = np.isnan(table) | (table == np.inf)
    promise(not bad.any(), "a log-likelihood is below +∞ and no NaN", f"row {int(bad.any(axis=1).argmax())} has one")
    own = table[np.arange(len(states)), states]
    lost = int(np.isneginf(own).argmax())
    promise(
        bool(np.isfinite(own).all()),
        "what a state draws is possible in it",
        f"state {states[lost]} drew {observations[lost]}, which it calls impossible",
    )
    order = source.permutation(len(states))[: len(states) // 2]
    apart = np.asarray(emission.log_likelihoods(observations[order]))
    off = ~same(apart, table[order]).all(axis=1)
    promise(
        not off.any(),
        "a row depends on its own observation alone",
        f"{observations[order[off.argmax()]]} gives {table[order[off.argmax()]]}, among others {apart[off.argmax()]}",
    )
    for state in range(emission.n_states):
        _check_drawn(table[states == state], state)


def _check_drawn(table: Array, state: int) -> None:
    possible = np.flatnonzero(np.isfinite(table).all(axis=0))  # an impossible observation is not likelier
    ahead = table[:, [state]] - table[:, possible]
    means, errors = ahead.mean(axis=0), ahead.std(axis=0) / np.sqrt(len(table))
    rival = int((means + _DEVIATIONS * errors).argmin())
    promise(
        bool((means + _DEVIATIONS * errors >= 0.0).all()),
        "a state's draws are likeliest in that state",
        f"those of state {state} are likelier in state {possible[rival]}, by {-means[rival]:.3g} "
        f"± {errors[rival]:.2g} on average",
    )


def _check_plain(emission: Emission) -> None:
    data = emission.to_dict()
    try:
        json.dumps(data)
    except (TypeError, ValueError) as error:
        promise(False, "to_dict is plain data that json.dump accepts", str(error))
    promise(isinstance(data.get("type"), str), "to_dict has a text under `type`", f"found {data.get('type')!r}")
