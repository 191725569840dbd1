"""What decisions give away step by step while the private belief moves: information and errors along sampled paths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.adversaries import SequentialAdversary
from inscrutable.errors import InputError
from inscrutable.filtering import filter_beliefs
from inscrutable.mechanisms import Mechanism
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.mechanisms.matching import checked_mechanism
from inscrutable.saved import Saved
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, HiddenMarkovModel

_LEAST_DRAWS = 10
_SIDE = 1.96
"""Standard errors to either side of a 95 % interval."""


@dataclass(frozen=True, eq=False, repr=False)
class PathLeakage(Saved):
    """What the decisions u_0..u_t on a belief that moves tell an observer who knows the mechanism and how beliefs move.

    All arrays have shape (T,), one entry a step; information is in bits, errors are in units of belief.

    Args:
        added: I(π_0..π_t; u_t | u_0..u_{t−1}) = E[log2 K(u_t|π_t) − log2 p(u_t|u_0..u_{t−1})]: what the decision of a step
            tells of the beliefs so far, beyond those before it.
        cumulative: I(π_0..π_t; u_0..u_t), the sum of `added` up to the step.
        belief_information: I(π_t; u_0..u_t): what all decisions so far tell of the present belief.
        state_information: I(x_t; u_0..u_t): the same of the present state.
        bayes_error: √E‖π_t − E[π_t|u_0..u_t]‖², Euclidean.
        added_se: Standard errors over the sampled paths.
        cumulative_se: The same.
        belief_information_se: The same.
        state_information_se: The same.
        error_se: The same of `bayes_error`.
        prior_error: The error of one who sees no decision, at each step: the ceiling. On a grid that of the grid's law, a
            little wider than the agent's own.
        interpolation_error: Largest expected distance, over steps and paths, of the agent's belief from the points of the
            mechanism that stand for it; 0 where all is exact but for the sampling.
        n_draws: Sampled paths.

    Where the interpolation error is not 0, `bayes_error` is the true distance from the estimate. `added` and `cumulative` rest
    on the chances that the observer gives to decisions: too many bits on average rather than too few, as any law but the true
    one is more surprised (Gibbs), but for decisions that its grid contradicts and that are passed over, which count as none.
    `belief_information` and `state_information` are what the observer believes to have learned.

    Source: the chain rule for mutual information (Shannon, 1948) with the inverse filter of `SequentialAdversary`.

    Example:
        >>> from inscrutable import Prior
        >>> from inscrutable.mechanisms.chains import resting_chain
        >>> chain = resting_chain(Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5]), 0.0)
        >>> open_book = Mechanism(chain.prior.beliefs, [0, 1], np.eye(2), [[0.0, 1.0], [1.0, 0.0]])
        >>> found = path_leakage(chain, open_book, 3, rng=np.random.default_rng(0), n_draws=10)
        >>> print(found.cumulative, found.belief_information, found.bayes_error)
        [1. 2. 3.] [1. 1. 1.] [0. 0. 0.]
    """

    added: Array
    cumulative: Array
    belief_information: Array
    state_information: Array
    bayes_error: Array
    added_se: Array
    cumulative_se: Array
    belief_information_se: Array
    state_information_se: Array
    error_se: Array
    prior_error: Array
    interpolation_error: float
    n_draws: int

    def __repr__(self) -> str:
        return self.summary()

    def __len__(self) -> int:
        return len(self.added)

    def summary(self) -> str:
        """Return a line for the first, the middle and the last step, with 95 % intervals."""
        lines = [f"{len(self)} decisions on a belief that moves, {self.n_draws} sampled paths"]
        for t in dict.fromkeys([0, len(self) // 2, len(self) - 1]):
            lines.append(
                f"after {t + 1:4d}: {self.cumulative[t]:.4f} ± {_SIDE * self.cumulative_se[t]:.4f} bits of all beliefs so far, "
                f"{self.belief_information[t]:.4f} ± {_SIDE * self.belief_information_se[t]:.4f} of the present one, "
                f"{self.state_information[t]:.4f} ± {_SIDE * self.state_information_se[t]:.4f} of the state; "
                f"error {self.bayes_error[t]:.4f} ± {_SIDE * self.error_se[t]:.4f} of {self.prior_error[t]:.4f}"
            )
        if self.interpolation_error > tolerances.SAME_BELIEF:
            lines.append(f"on a grid, with an interpolation error of up to {self.interpolation_error:.3g}")
        return "\n".join(lines)


class _Paths(NamedTuple):
    """Figures of D sampled paths at T steps, each (D,T), with what is known without sampling."""

    added: Array
    belief: Array
    state: Array
    squared: Array
    prior_error: Array  # (T,)
    interpolation_error: float = 0.0


def path_leakage(
    world: HiddenMarkovModel | BeliefChain,
    mechanism: Mechanism,
    n_steps: int,
    *,
    rng: np.random.Generator,
    n_draws: int = 200,
) -> PathLeakage:
    """Return what decisions on a belief that moves tell step by step, cumulated and of the present belief alone.

    Formula: those of `PathLeakage`, as averages over sampled paths of beliefs and decisions.

    Args:
        world: The world whose observations the agent filters, with a `CategoricalEmission`; or a `BeliefChain` on the
            mechanism's beliefs, such as `filtered_chain` makes of any world.
        mechanism: K(u|π), drawn afresh at every step. In a world exact on all `reachable_beliefs`, on other beliefs with the
            error stated: the agent then decides as at the nearest of them.
        n_steps: T, at least 1.
        rng: The source of paths and decisions.
        n_draws: Sampled paths, at least 10.

    Raises:
        InputError: An argument is malformed, the sensor reports real numbers, or a chain is on other beliefs.

    Cost: in a world `n_draws` runs of `SequentialAdversary.filter`, equal sequences once; on a chain of B beliefs
        T·n_draws·B² multiplications, or as many as its entries.

    Source: see `PathLeakage`.

    Example:
        >>> from inscrutable import CategoricalEmission, FiniteProblem, OriginalDecisionMaker, mechanism, reachable_beliefs
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.1, 0.9]], CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
        >>> agent = OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]))
        >>> played = mechanism(agent, reachable_beliefs(world, 3))
        >>> found = path_leakage(world, played, 3, rng=np.random.default_rng(0))
        >>> print(found.cumulative.round(1), (found.bayes_error < found.prior_error).all())
        [1.  1.9 2.3] True
    """
    count = validation.count(n_steps, "n_steps")
    draws, source = validation.count(n_draws, "n_draws", least=_LEAST_DRAWS), validation.generator(rng)
    played = checked_mechanism(mechanism)
    if isinstance(world, BeliefChain):
        found = _on_chain(world, world.lagged(played, 0), count, draws, source)
    else:
        found = _in_world(world, played, count, draws, source)
    return _averaged(found)


def _averaged(found: _Paths) -> PathLeakage:
    """The figures of sampled paths as means with their standard errors."""
    (added, total, belief, state, squared), errors = _averages(
        [found.added, found.added.cumsum(axis=1), found.belief, found.state, found.squared]
    )
    root = np.sqrt(squared)
    return PathLeakage(
        added=added,
        cumulative=total,
        belief_information=belief,
        state_information=state,
        bayes_error=root,
        added_se=errors[0],
        cumulative_se=errors[1],
        belief_information_se=errors[2],
        state_information_se=errors[3],
        error_se=np.divide(errors[4], 2.0 * root, out=np.zeros_like(root), where=root > 0),
        prior_error=found.prior_error,
        interpolation_error=found.interpolation_error,
        n_draws=len(found.added),
    )


def _averages(figures: list[Array]) -> tuple[list[Array], list[Array]]:
    """Means (T,) of figures (D,T), none of which is below zero, and their standard errors."""
    means = [np.maximum(each.mean(axis=0), 0.0) for each in figures]
    return means, [each.std(axis=0, ddof=1) / np.sqrt(len(each)) for each in figures]


def _on_chain(chain: BeliefChain, mechanism: Mechanism, n_steps: int, n_draws: int, rng: np.random.Generator) -> _Paths:
    """Paths of a chain, whose law is followed exactly."""
    weights, beliefs = chain.prior.weights, chain.prior.beliefs
    places = chain.paths(n_steps, n_draws, rng=rng)
    table = sparse.csr_array(mechanism.observed)
    columns = RowDraws(table)(places, rng)
    by_action = sparse.csr_array(table.T)
    found = np.empty((4, n_draws, n_steps))
    law = np.tile(weights, (n_draws, 1))
    middle = weights @ beliefs
    for t, (place, column) in enumerate(zip(places, columns, strict=True)):
        predicted = law if t == 0 else np.asarray(law @ chain.transition)
        law = predicted * by_action[column].toarray()
        chance = law.sum(axis=1)
        law /= chance[:, None]
        mean = law @ beliefs
        found[0, :, t] = np.log2(np.asarray(table[place, column])) - np.log2(chance)
        found[1, :, t] = _divergence(law, weights)
        found[2, :, t] = _divergence(mean, middle)
        found[3, :, t] = _spread(law, beliefs - middle)
    return _Paths(found[0], found[1], found[2], found[3], np.full(n_steps, chain.prior.error))


def _in_world(
    world: HiddenMarkovModel, mechanism: Mechanism, n_steps: int, n_draws: int, rng: np.random.Generator
) -> _Paths:
    """Paths of a world, whose observer filters on the mechanism's beliefs."""
    if not isinstance(world, HiddenMarkovModel) or not isinstance(world.emission, CategoricalEmission):
        raise InputError(
            f"a world with a CategoricalEmission is needed, or a BeliefChain such as filtered_chain makes, got {world!r}"
        )
    adversary = SequentialAdversary(world, mechanism)
    held = [filter_beliefs(world, world.sample(n_steps, rng=rng).observations).beliefs for _ in range(n_draws)]
    places = np.asarray(cKDTree(mechanism.beliefs).query(np.array(held))[1])  # (D, T)
    table = sparse.csr_array(mechanism.observed)
    columns = RowDraws(table)(places, rng)
    unseen = adversary.unseen(n_steps)
    found, worst = np.empty((4, n_draws, n_steps)), float(unseen.interpolation_error.max())
    own = np.log2(np.asarray(table[places.ravel(), columns.ravel()])).reshape(columns.shape)
    sequences, which = np.unique(columns, axis=0, return_inverse=True)
    for number, sequence in enumerate(sequences):
        seen = adversary.filter(np.asarray(mechanism.actions)[sequence])
        chance = seen.log_likelihood / np.log(2.0)
        worst = max(worst, float(seen.interpolation_error.max()))
        for d in np.flatnonzero(which.reshape(-1) == number):
            found[0, d] = np.where(np.isfinite(chance), own[d] - chance, 0.0)
            found[3, d] = seen.spread**2 if seen.is_exact else seen.errors_of(held[d]) ** 2
            found[1, d] = _divergence(seen.weights, unseen.weights)
            found[2, d] = _divergence(seen.states, unseen.states)
    return _Paths(found[0], found[1], found[2], found[3], unseen.spread, worst)


def _divergence(law: Array, prior: Array) -> Array:
    """Σ p log2(p/q) along the last axis, in bits."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(law > 0, law * np.log2(law / prior), 0.0).sum(axis=-1))


def _spread(law: Any, points: Array) -> Array:
    """E‖π − E π‖² under laws (D,B) of points (B,X)."""
    return np.asarray(np.maximum(law @ (points**2).sum(axis=1) - ((law @ points) ** 2).sum(axis=1), 0.0))
