"""Observers of many decisions in a comparison: the first filters the belief over time, the second learns the cost first.

The first knows the rule, the transition T of the belief and every decision so far: α_{t+1} ∝ K(u_{t+1}|·) (α_t T), from α_0 ∝
K(u_0|·) w. The decisions of a rule with a memory are decoded first: they are then those of a mechanism applied to the belief d
steps ago, and the law of the present belief is α T^d. Without decisions the law is the prior at every step, so the error is
that of the prior.

The second knows the cost except for the risk aversion, and no rule. It takes every decision of a path for optimal, keeps the
values that explain all of them, and then reads decisions like the naive observer, with the midpoint of these values.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import sparse

from inscrutable.adversaries import CostLearningAdversary, LearnedCost
from inscrutable.experiments.comparison_sensor import published, read_at_face_value
from inscrutable.experiments.guesses import guess_error
from inscrutable.experiments.memory_rules import PAST
from inscrutable.experiments.setting import Behaviour, Setting, Watched
from inscrutable.mechanisms import Mechanism
from inscrutable.mechanisms.calendars import Schedule
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.disclosed import disclosed
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.mechanisms.drawing import RowDraws
from inscrutable.mechanisms.joint import Joint, top_states
from inscrutable.privacy.repeated import adjusted_means
from inscrutable.problems import MarkowitzProblem
from inscrutable.validation import Array

PATH_STEPS = 40
"""Decisions per path; errors count over the second half, to be long-run errors."""

N_PATHS = 100
"""Number of independent paths, the same for every decision maker."""

GAMMA_RANGE = 10.0
"""The observer considers risk aversions within this factor of the true one."""

_PATH_SEED = 1
_DENSE = 0.1
"""Share of nonzero entries above which a table is multiplied as a dense matrix."""


class Learned(NamedTuple):
    """The results of an observer who learns the risk aversion; NaN for costs without one or without an explaining value."""

    low: float = float("nan")
    high: float = float("nan")
    holds: float = float("nan")  # 1 where the true one is among them
    error: float = float("nan")


def watched(
    setting: Setting,
    behaviour: Behaviour,
    bayes_error: float,
    rng: np.random.Generator,
    disclosure: Disclosure = Disclosure(),  # noqa: B008  # frozen
    beside: BeliefChain | None = None,
) -> Watched:
    """Return the error of the aware observer who sees every decision of a path, or the disclosed part.

    `bayes_error`, the exact error given the last decision alone, is a control variate: its sampling error on these paths is
    subtracted, unless the disclosure omits or delays decisions. `beside` is the setting's chain with tables of the observer's
    own observations.
    """
    chain = setting.chain if beside is None else beside
    if chain is None:
        return Watched()
    if behaviour.play is not None:
        return behaviour.play.watched
    decided, n_late = (behaviour.mechanism, 0) if behaviour.memory is None else behaviour.memory.decided
    decided, schedule = disclosed(decided, disclosure), disclosure.schedule
    path, read = _read_paths(setting, chain, n_late + schedule.lag)
    drawn = RowDraws(sparse.csr_array(decided.observed))(path, rng)
    counted = _counted(schedule)
    over_time, alone, named, surprise = (
        each[-counted:].mean(axis=0)[:, None] for each in followed(chain, decided, drawn, schedule.moved(n_late), read)
    )
    # Information of a decision: its surprisal minus its conditional entropy given the belief.
    own = float(chain.prior.weights @ _entropies(decided.observed)) / schedule.period
    bits_se = float(surprise.std(ddof=1)) / np.sqrt(len(surprise))
    # Where decisions are omitted or late, the expected error given the last one is not `bayes_error`.
    known = alone - bayes_error**2 if schedule.is_immediate else np.zeros_like(alone)
    squared, spread = (float(each[0]) for each in adjusted_means(over_time, known))
    error = float(np.sqrt(max(squared, 0.0)))
    return Watched(
        error,
        spread / (2.0 * error) if error > 0 else 0.0,
        min(float(named.mean()), 1.0),
        max(float(surprise.mean()) - own, 0.0),
        bits_se,
    )


def unwatched(setting: Setting, beside: BeliefChain, disclosure: Disclosure) -> tuple[float, float]:
    """Return the error, and the probability of naming a most likely state, given public observations alone."""
    count = len(beside.prior)
    silent = Mechanism(beside.prior.beliefs, np.zeros((1, 1)), np.ones((count, 1)), np.zeros((count, 1)))
    path, read = _read_paths(setting, beside, disclosure.schedule.lag)
    squared, _, named, _ = followed(beside, silent, np.zeros_like(path), disclosure.schedule, read)
    counted = _counted(disclosure.schedule)
    return float(np.sqrt(squared[-counted:].mean())), min(float(named[-counted:].mean()), 1.0)


def _counted(schedule: Schedule) -> int:
    """Return the steps at the end of a path whose errors count: half of them, in whole periods."""
    return max((PATH_STEPS - PATH_STEPS // 2) // schedule.period, 1) * schedule.period


def _read_paths(setting: Setting, chain: BeliefChain, n_late: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Return paths of the belief (T,D), and the observer's own readings on them and during the delay, (T+late,D)."""
    if chain.public is None:
        return _paths(setting, PATH_STEPS, N_PATHS), None
    path, read = chain.public_paths(PATH_STEPS + n_late, N_PATHS, rng=np.random.default_rng(_PATH_SEED))
    return path[:PATH_STEPS], read


def _entropies(table: Any) -> Array:
    """H(K(·|π_b)) of every belief, shape (B,), in bits."""
    rows = sparse.csr_array(table)
    rows.data = -rows.data * np.log2(rows.data)
    return np.asarray(rows.sum(axis=1), dtype=np.float64).reshape(-1)


def followed(
    chain: BeliefChain,
    mechanism: Mechanism,
    columns: np.ndarray,
    schedule: Schedule = Schedule(),  # noqa: B008  # frozen
    read: np.ndarray | None = None,
) -> tuple[Array, Array, Array, Array]:
    """Return the expected squared errors given all decisions so far and given the last alone.

    The third array is the probability of naming a most likely state given all decisions so far, the fourth the surprisal of
    each decision, in bits.

    Formula: E[‖π_t − E[π_t|u_0..u_t]‖² | u_0..u_t], E[‖π_t − E[π_t|u_t]‖² | u_t],
    max_i P(i is a most likely state of π_t | u_0..u_t), and −log2 P(u_t | u_0..u_{t−1}). With `read`, all but the second are
    also given the readings up to the step of the belief.

    Args:
        chain: The chain of the belief.
        mechanism: The mechanism, on the chain's beliefs.
        columns: Indices of the observed decisions, shape (T,D) for D paths; each must be possible after those before it.
        schedule: The disclosed steps and the lag. Entries of a step then concern the belief `schedule.lag` steps after it.
        read: Symbols of the chain's public tables, shape (T+lag,D); None: no readings.

    Returns:
        Four arrays of shape (T,D), at least 0; the surprisal of an undisclosed decision is 0.
    """
    # Beliefs relative to the prior's mean, against cancellation in the difference of squares.
    points = chain.prior.beliefs - chain.prior.mean
    now = points, (points**2).sum(axis=1), top_states(chain.prior.beliefs)
    step, ahead, told = _plain(chain.transition), now, [_plain(each) for each in chain.public or ()]
    for _ in range(schedule.lag):
        ahead = np.asarray(step @ ahead[0]), np.asarray(step @ ahead[1]), np.asarray(step @ ahead[2])
    used, place = np.unique(columns, return_inverse=True)
    shares = np.ascontiguousarray(sparse.csc_array(mechanism.observed)[:, used].toarray().T)
    place = place.reshape(columns.shape)
    law = np.tile(chain.prior.weights, (columns.shape[1], 1))
    found, named, surprise = (np.empty(columns.shape) for _ in range(3))
    for t, seen in enumerate(place):
        if read is not None:
            law = _told(told, law, read[t])
        elif t > 0:
            law = np.asarray(law @ step)
        law = law * shares[seen] if schedule.shows(t) else law
        chance = law.sum(axis=1, keepdims=True)
        law /= chance
        present, of = law, ahead
        if read is not None:
            of = now
            for later in read[t + 1 : t + 1 + schedule.lag]:
                present = _told(told, present, later)
        found[t], named[t], surprise[t] = _expected(present, of), (present @ of[2]).max(axis=1), -np.log2(chance[:, 0])
    alone = shares * chain.prior.weights
    return found, _expected(alone / alone.sum(axis=1, keepdims=True), ahead)[place], named, surprise


def _told(tables: list[Any], law: Array, read: np.ndarray) -> Array:
    """Return the laws (D,B) one step later, given the symbol read there."""
    found = np.empty_like(law)
    for symbol in np.unique(read):
        mine = read == symbol
        found[mine] = law[mine] @ tables[symbol]
    return np.asarray(found / found.sum(axis=1, keepdims=True))


def _expected(laws: Array, of: tuple[Array, Array, Array]) -> Array:
    """Return E‖π − E π‖² of laws (L,B), from the points and their squares."""
    return np.asarray(np.maximum(laws @ of[1] - ((laws @ of[0]) ** 2).sum(axis=1), 0.0))


def learned(
    setting: Setting, behaviour: Behaviour, joint: Joint, naive_error: float, rng: np.random.Generator
) -> Learned:
    """Return the results of an observer who learns the risk aversion from a path, and then reads single decisions."""
    problem = setting.problem
    if not isinstance(problem, MarkowitzProblem):
        return Learned()
    found = learned_cost(problem, _published(setting, behaviour, rng))
    low, high = found.interval
    holds = float(found.contains(problem.risk_aversion))
    if np.isnan(found.parameter):
        return Learned(holds=0.0)
    if found.is_identified and holds:
        return Learned(low, high, holds, naive_error)
    return Learned(low, high, holds, guess_error(joint, _guesses(setting, behaviour, joint, found.parameter)))


def learned_cost(problem: MarkowitzProblem, actions: Array) -> LearnedCost:
    """Return the risk aversions under which decisions (T,U) are optimal for some beliefs, all else being known."""
    true = problem.risk_aversion
    limits = true / GAMMA_RANGE, true * GAMMA_RANGE
    adversary = CostLearningAdversary.risk_aversion(problem.means, problem.covariances, limits, problem.constraints)
    return adversary.learn(np.unique(actions, axis=0))


def _guesses(setting: Setting, behaviour: Behaviour, joint: Joint, parameter: float) -> Array:
    """Return the naive observer's estimates (M,X) under a risk aversion.

    Where no belief explains a decision, the estimate is the prior's belief of least regret.
    """
    true = setting.problem
    assert isinstance(true, MarkowitzProblem)
    problem = MarkowitzProblem(true.means, true.covariances, parameter, true.constraints)
    shown = np.flatnonzero(joint.played > 0)
    found = np.zeros((joint.n_actions, joint.beliefs.shape[1]))
    found[shown] = read_at_face_value(problem, setting.prior, np.asarray(behaviour.mechanism.actions)[shown])
    return found


def _published(setting: Setting, behaviour: Behaviour, rng: np.random.Generator) -> Array:
    """Return the decisions (T,U) published along a path of the belief, after a burn-in."""
    path = _paths(setting, PAST + PATH_STEPS, 1)[:, 0]
    if behaviour.play is None and behaviour.memory is None:
        return published(setting, behaviour, path[PAST:], rng)
    return published(setting, behaviour, path, rng)[PAST:]


def _paths(setting: Setting, n_steps: int, n_paths: int) -> np.ndarray:
    """Return paths of the belief (T,D), the same for every decision maker; independent draws without a chain."""

    def made() -> np.ndarray:
        rng = np.random.default_rng(_PATH_SEED)
        if setting.chain is not None:
            return setting.chain.paths(n_steps, n_paths, rng=rng)
        return rng.choice(len(setting.prior), size=(n_steps, n_paths), p=setting.prior.weights)

    paths: np.ndarray = setting.once(("paths", n_steps, n_paths), made)
    return paths


def _plain(table: Any) -> Any:
    return table.toarray() if table.nnz > _DENSE * table.shape[0] * table.shape[1] else table
