"""Leakage of repeated decisions under one belief: independent draws reveal the probabilities of a lottery."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable import tolerances, validation
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.joint import Joint, joint_law
from inscrutable.privacy.leaks import entropy, leakage
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array

_BLOCK = 2**21
"""Posterior weights in memory at once."""
_MANY = 0.1
"""Share of nonzero entries from which a table is multiplied as a dense one."""
_LEAST_DRAWS = 10
SIDE = 1.96
"""Standard errors to either side of a 95 % interval."""


@dataclass(frozen=True, eq=False, repr=False)
class RepeatedLeakage(Summarised, Saved):
    """Leakage of n independent decisions under one belief to the aware observer.

    Formula: p(π_b|u_1..u_n) ∝ w_b Π_t K(u_t|π_b).

    Args:
        n_steps: Numbers of decisions n, shape (S,).
        mutual_information: I(π;u_1..u_n), in bits, shape (S,).
        bayes_error: √E‖π − E[π|u_1..u_n]‖², Euclidean, in units of belief, shape (S,).
        top_state_accuracy: How often the best guess of a most likely state is right, shape (S,).
        information_se: Standard errors of the sampled figures, shape (S,); 0 where exact: at n = 1, and without
            randomisation; otherwise at least 1/n_draws of the difference that infinitely many decisions make, because rarer
            sequences may not be drawn. Figures are cut at what infinitely many decisions reveal, and the error at that of one.
        error_se: Those of the Bayes error.
        accuracy_se: Those of the accuracy.
        prior_entropy: Entropy of the belief before any decision, in bits.
        prior_error: The error before any decision.
        limit_information: Leakage of infinitely many decisions, in bits; these reveal the lottery and nothing else.
        limit_error: The error after infinitely many decisions.
        n_draws: Number of sampled sequences.

    Source: Bayes' rule for independent draws; averages of conditional means have less variance than averages of draws
    (Blackwell, 1947), and control variates reduce it further: the mean posterior is the prior.

    Example:
        >>> from inscrutable import Mechanism, Prior
        >>> prior = Prior([[1.0, 0.0], [0.0, 1.0]], [0.5, 0.5])
        >>> coin = Mechanism(prior.beliefs, [[0.0], [1.0]], [[0.7, 0.3], [0.3, 0.7]], [[0.0, 1.0], [1.0, 0.0]])
        >>> found = repeated_leakage(coin, prior, (1, 100), rng=np.random.default_rng(0))
        >>> found.mutual_information.round(3), found.limit_information
        (array([0.119, 1.   ]), 1.0)
    """

    n_steps: np.ndarray
    mutual_information: Array
    bayes_error: Array
    top_state_accuracy: Array
    information_se: Array
    error_se: Array
    accuracy_se: Array
    prior_entropy: float
    prior_error: float
    limit_information: float
    limit_error: float
    n_draws: int

    @property
    def per_step(self) -> Array:
        """Bits that each further decision adds between one n and the next, from n = 0 on, shape (S,)."""
        added = np.diff(self.mutual_information, prepend=0.0)
        return np.asarray(added / np.diff(self.n_steps, prepend=0))

    def summary(self) -> str:
        """Return a line for each n, with 95 % intervals."""
        lines = [f"before any decision: error {self.prior_error:.4f}, {self.prior_entropy:.4f} bits to be learnt"]
        for s, n in enumerate(self.n_steps):
            lines.append(
                f"after {n:4d}: {self.mutual_information[s]:.4f} ± {SIDE * self.information_se[s]:.4f} bits, "
                f"error {self.bayes_error[s]:.4f} ± {SIDE * self.error_se[s]:.4f}, "
                f"top state {self.top_state_accuracy[s]:.1%} ± {SIDE * self.accuracy_se[s]:.1%}"
            )
        return "\n".join([*lines, f"for ever: {self.limit_information:.4f} bits, error {self.limit_error:.4f}"])


class _Sampled(NamedTuple):
    """Information, squared error and accuracy of every sampled sequence, and three control variates of mean zero, all times the
    probability of the sequence under the prior over that under the shares that beliefs are drawn with."""

    information: Array
    squared: Array
    accuracy: Array
    surprise: Array
    spread: Array
    excess: Array


def repeated_leakage(
    mechanism: Mechanism,
    prior: Prior,
    n_steps: int | Sequence[int] = (1, 10, 100),
    *,
    rng: np.random.Generator,
    n_draws: int = 1000,
) -> RepeatedLeakage:
    """Return the leakage of repeated decisions under one belief to the aware observer.

    Formula: those of `RepeatedLeakage`, as averages over sampled beliefs and decisions; all n use the same sequences. Half of
    the draws take every belief alike; a sequence weighs its probability under the prior over that under the draws.

    Args:
        mechanism: K(u|π), drawn independently at every step.
        prior: Weights of the mechanism's beliefs, in any order; it may hold only some of them.
        n_steps: One number of decisions, or several in increasing order, each at least 1.
        rng: The source of beliefs and decisions.
        n_draws: Sampled sequences, at least 10.

    Raises:
        InputError: A belief of the prior is none of the mechanism's, or a number is malformed.

    Cost: n_draws·B likelihoods for every n; 2 s for B = 500, three n and a thousand draws.

    Source: see `RepeatedLeakage`; importance sampling from a mixture: Owen, Zhou (Journal of the American Statistical
    Association 95, 2000).

    Example:
        >>> from inscrutable import FiniteProblem, OriginalDecisionMaker, mechanism, uniform_prior
        >>> prior = uniform_prior(2, 3)
        >>> played = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), prior.beliefs)
        >>> repeated_leakage(played, prior, (1, 5), rng=np.random.default_rng(0), n_draws=10).mutual_information
        array([1., 1.])
    """
    steps = _rising(n_steps)
    source, count = validation.generator(rng), validation.count(n_draws, "n_draws", least=_LEAST_DRAWS)
    joint = joint_law(mechanism, prior)
    once = leakage(mechanism, prior)
    found = np.zeros((3, len(steps)))
    errors = np.zeros((3, len(steps)))
    # Without randomisation a repeated decision adds no information to the first one.
    certain = bool((joint.conditional >= 1.0 - tolerances.PROBABILITY).all())
    sampled = _sample(joint, steps, count, source) if steps[-1] > 1 and not certain else []
    limit_information, limit_error = _limits(joint)
    # The possible effect of sequences whose probability is 1/n_draws: a third of the samples contain none of them.
    most = limit_information, once.prior_error**2 - limit_error**2, float(limit_information > tolerances.PROBABILITY)
    unseen = np.array(most) / count
    for s, n in enumerate(steps):
        if n == 1 or certain:
            found[:, s] = once.mutual_information, once.bayes_error, once.top_state_accuracy
            continue
        means, errors[:, s] = _averages(sampled[s], unseen)
        root = max(min(np.sqrt(means[1]), once.bayes_error), limit_error)
        found[:, s] = min(means[0], limit_information), root, min(means[2], 1.0)
        # √(a + e) − √a is about e/2√a, and at most √e; both errors lie between that of one decision and the limit.
        most = min(np.sqrt(errors[1, s]), max(once.bayes_error - limit_error, 0.0))
        errors[1, s] = min(errors[1, s] / (2 * root), most) if root > 0 else most
    return RepeatedLeakage(
        n_steps=np.array(steps),
        mutual_information=found[0],
        bayes_error=found[1],
        top_state_accuracy=found[2],
        information_se=errors[0],
        error_se=errors[1],
        accuracy_se=errors[2],
        prior_entropy=once.prior_entropy,
        prior_error=once.prior_error,
        limit_information=limit_information,
        limit_error=limit_error,
        n_draws=count,
    )


def _averages(sampled: _Sampled, unseen: Array) -> tuple[Array, Array]:
    """Means of the three figures and their standard errors, with control variates; the errors are at least `unseen`."""
    means, errors = adjusted_means(np.array(sampled[:3]).T, np.array(sampled[3:]).T)
    return np.maximum(means, 0.0), np.maximum(errors, unseen)


def _rising(n_steps: Any) -> list[int]:
    given = [n_steps] if np.ndim(n_steps) == 0 else list(n_steps)
    steps = [validation.count(n, "n_steps") for n in given]
    if not steps or any(later <= earlier for earlier, later in pairwise(steps)):
        raise InputError(f"n_steps must be whole numbers that rise, got {n_steps!r}")
    return steps


def _sample(joint: Joint, steps: list[int], n_draws: int, rng: np.random.Generator) -> list[_Sampled]:
    """Sampled sequences, judged after every number of steps."""
    held = np.flatnonzero(joint.weights > 0)
    shape = (len(joint.weights), joint.n_actions)
    table: Any = sparse.csr_array((joint.conditional, (joint.row, joint.column)), shape=shape)[held]
    weights, beliefs, top = joint.weights[held], joint.beliefs[held], joint.top_states[held]
    logs, possible = table.copy(), table.copy()
    logs.data, possible.data = np.log(table.data), np.ones(table.nnz)
    # Entries of both parts by action; a zero probability has no entry in the first, and is missing in the second.
    plain = table.nnz > _MANY * len(held) * joint.n_actions
    by_action = [np.ascontiguousarray(each.toarray().T) if plain else each.T.tocsr() for each in (logs, possible)]
    # Half of the draws take every belief alike: else few samples have a rare one, and none shows its error.
    shares = 0.5 * weights + 0.5 / len(held)
    drawn = rng.choice(len(held), size=n_draws, p=shares)
    parts: list[list[_Sampled]] = [[] for _ in steps]
    for chosen in np.array_split(drawn, max(-(-n_draws * len(held) // _BLOCK), 1)):
        log_likelihood, seen = np.zeros((len(chosen), len(held))), np.zeros((len(chosen), len(held)))
        for s, n in enumerate(steps):
            counts = _counts(table, chosen, n - (steps[s - 1] if s else 0), rng)
            log_likelihood += _plain(counts @ by_action[0])
            seen += _plain(counts @ by_action[1])
            parts[s].append(_judged(np.where(seen == n, log_likelihood, -np.inf), (weights, shares), beliefs, top))
    return [_Sampled(*(np.concatenate(each) for each in zip(*part, strict=True))) for part in parts]


def _counts(table: Any, chosen: np.ndarray, n: int, rng: np.random.Generator) -> Any:
    """How often each action is played in n draws under each chosen belief, sparse (D,M)."""
    rows, columns, numbers = [], [], []
    for b in np.unique(chosen):
        place = np.flatnonzero(chosen == b)
        support = slice(table.indptr[b], table.indptr[b + 1])
        shares = table.data[support]
        drawn = rng.multinomial(n, shares / shares.sum(), size=len(place))
        row, column = np.nonzero(drawn)
        rows.append(place[row])
        columns.append(table.indices[support][column])
        numbers.append(drawn[row, column])
    entries = (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_array((np.concatenate(numbers).astype(np.float64), entries), shape=(len(chosen), table.shape[1]))


def _plain(product: Any) -> Array:
    return np.asarray(product if isinstance(product, np.ndarray) else product.toarray())


def _judged(log_likelihood: Array, laws: tuple[Array, Array], beliefs: Array, top: Array) -> _Sampled:
    """Information, error and best guess of each posterior, in expectation given its sequence.

    `laws` are the prior's weights and the shares of the draws.
    """
    weights, shares = laws
    log_posterior = log_likelihood + np.log(weights)
    log_posterior -= log_posterior.max(axis=1, keepdims=True)
    posterior = np.exp(log_posterior)
    posterior /= posterior.sum(axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        gain = np.where(posterior > 0, posterior * np.log2(posterior / weights), 0.0).sum(axis=1)
    # In expectation over sequences a posterior is the prior.
    middle = weights @ beliefs
    apart = ((beliefs - middle) ** 2).sum(axis=1)
    surprise = posterior @ -np.log2(weights) - entropy(weights)
    squared = np.zeros(len(posterior))
    for belief, mean in zip(beliefs.T, (posterior @ beliefs).T, strict=True):
        squared += (posterior * (belief - mean[:, None]) ** 2).sum(axis=1)
    accuracy = np.minimum((posterior @ top).max(axis=1), 1.0)
    ratio = 1.0 / (posterior @ (shares / np.maximum(weights, tolerances.TINY)))
    figures = np.maximum(gain, 0.0), squared, accuracy, surprise, posterior @ apart - weights @ apart
    return _Sampled._make([*(ratio * each for each in figures), ratio - 1.0])


def _limits(joint: Joint) -> tuple[float, float]:
    """Information and error when the lottery is known: beliefs with the same lottery are indistinguishable."""
    shape = (len(joint.weights), joint.n_actions)
    table: Any = sparse.csr_array((joint.conditional, (joint.row, joint.column)), shape=shape)
    table.sort_indices()
    numbers = np.round(table.data / tolerances.PROBABILITY).astype(np.int64)
    known: dict[tuple[bytes, bytes], int] = {}
    group = np.zeros(len(joint.weights), dtype=np.intp)
    for b in np.flatnonzero(joint.weights > 0):
        support = slice(table.indptr[b], table.indptr[b + 1])
        group[b] = known.setdefault((table.indices[support].tobytes(), numbers[support].tobytes()), len(known))
    share: Array = np.bincount(group, weights=joint.weights, minlength=len(known)).astype(np.float64)
    means = np.zeros((len(known), joint.beliefs.shape[1]))
    np.add.at(means, group, joint.weights[:, None] * joint.beliefs)
    means /= share[:, None]
    squared = ((joint.beliefs - means[group]) ** 2).sum(axis=1)
    return entropy(share), float(np.sqrt(joint.weights @ squared))


_DISTINCT = 0.1
"""Least singular value of scaled controls that is fitted, as a share of the largest. Where a belief of the prior is too rare to
be drawn the two controls are the same for all draws but for rounding; fitted both, they missed the figures by more than four
stated standard errors in 98 of 100 samples. With .3 the error of a prior with a share of a tenth has a fifth more spread."""


def adjusted_means(values: Array, controls: Array) -> tuple[Array, Array]:
    """Return the means (k,) of sampled values (n,k) and their standard errors, with controls (n,c) whose mean is zero.

    Source: control variates; the slopes fitted on one half adjust the other, because slopes fitted on the same sample would
    bias its mean.
    """
    adjusted = np.array(values)
    for own, other in ((slice(0, None, 2), slice(1, None, 2)), (slice(1, None, 2), slice(0, None, 2))):
        centred = controls[other] - controls[other].mean(axis=0)
        spread = centred.std(axis=0)
        scale = np.where(spread > tolerances.RANK, spread, np.inf)  # one that is constant but for rounding is left out
        slopes = np.linalg.pinv(centred / scale, rcond=_DISTINCT) @ (values[other] - values[other].mean(axis=0))
        adjusted[own] -= controls[own] / scale @ slopes
    error = adjusted.std(axis=0, ddof=1) / np.sqrt(len(values))
    return np.asarray(adjusted.mean(axis=0)), np.asarray(error)
