"""Observers of many decisions in a comparison: the first follows a belief that moves, the second learns the cost first.

The first knows the rule, the law of the belief's steps and every decision so far: α_{t+1} ∝ K(u_{t+1}|·) (α_t T), from
α_0 ∝ K(u_0|·) w. A rule with a memory is read backwards first: decisions are then those of a mechanism, of the belief some
steps ago, and the law of today's belief is α T^d. Without decisions the law is the prior at every step, so its error is that
of the prior.

The second knows all of the cost but the risk aversion, and no rule: it takes every decision of a path for optimal, keeps the
values that explain them all, and reads decisions as the naive observer does, with the middle of these values.
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
"""Decisions of a path; errors count over the second half, so that they are long-run errors."""

N_PATHS = 100
"""Independent paths, the same ones for every decision maker."""

GAMMA_RANGE = 10.0
"""Factor around the risk aversion that an observer who does not know it thinks possible."""

_PATH_SEED = 1
_DENSE = 0.1
"""Share of entries above zero from which a table is multiplied as a plain one."""


class Learned(NamedTuple):
    """The results of an observer who learns the risk aversion; all NaN where there is none, the interval where none
    explains."""

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
    """Return the error of the aware observer who sees every decision of a path, or what is disclosed of them.

    `bayes_error` is that of the aware observer who sees the last decision alone: its mean over paths is known, so what
    the paths at hand are off by there is taken off here, unless decisions are left out or late. `beside` is the setting's
    chain with tables of what the observer reads itself.
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
    # What a decision adds is the surprise that it is, less the one that is left where the belief is known.
    own = float(chain.prior.weights @ _entropies(decided.observed)) / schedule.period
    bits_se = float(surprise.std(ddof=1)) / np.sqrt(len(surprise))
    # Where decisions are left out or late, the mean over the last one is not that of `bayes_error`.
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
    """Return the error, and how often a most likely state is named, from public observations alone."""
    count = len(beside.prior)
    silent = Mechanism(beside.prior.beliefs, np.zeros((1, 1)), np.ones((count, 1)), np.zeros((count, 1)))
    path, read = _read_paths(setting, beside, disclosure.schedule.lag)
    squared, _, named, _ = followed(beside, silent, np.zeros_like(path), disclosure.schedule, read)
    counted = _counted(disclosure.schedule)
    return float(np.sqrt(squared[-counted:].mean())), min(float(named[-counted:].mean()), 1.0)


def _counted(schedule: Schedule) -> int:
    """Steps at the end of a path whose errors count: half of them, in whole periods."""
    return max((PATH_STEPS - PATH_STEPS // 2) // schedule.period, 1) * schedule.period


def _read_paths(setting: Setting, chain: BeliefChain, n_late: int) -> tuple[np.ndarray, np.ndarray | None]:
    """Paths of the belief (T,D), and what is read on them and on the steps by which decisions are late, (T+late,D)."""
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
    """Return the expected square error given all decisions so far, and given the last alone.

    The third are the first one's chances of naming a most likely state, the fourth how much each decision surprised, in bits.

    Formula: E[‖π_t − E[π_t|u_0..u_t]‖² | u_0..u_t], E[‖π_t − E[π_t|u_t]‖² | u_t],
    max_i P(i is a most likely state of π_t | u_0..u_t), and −log2 P(u_t | u_0..u_{t−1}); where something is read, all but the
    second given that as well, up to the step of the belief.

    Args:
        chain: How the belief moves.
        mechanism: What decides, on the chain's beliefs.
        columns: Which of its decisions were seen, shape (T,D) for D paths; each must be possible after those before it.
        schedule: Which of them are shown, and how late. Entries of a step are then of the belief `schedule.lag` steps after it.
        read: Symbols of the chain's public tables, shape (T+lag,D); None: nothing is read.

    Returns:
        Each of shape (T,D), at least 0; where a decision is not shown it does not surprise.
    """
    # Beliefs seen from the middle of the prior, so that little is lost in the difference of squares.
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
    """Laws (D,B) a step later, given the symbol that each reads there."""
    found = np.empty_like(law)
    for symbol in np.unique(read):
        mine = read == symbol
        found[mine] = law[mine] @ tables[symbol]
    return np.asarray(found / found.sum(axis=1, keepdims=True))


def _expected(laws: Array, of: tuple[Array, Array, Array]) -> Array:
    """E‖π − E π‖² of laws (L,B), by points and their squares."""
    return np.asarray(np.maximum(laws @ of[1] - ((laws @ of[0]) ** 2).sum(axis=1), 0.0))


def learned(
    setting: Setting, behaviour: Behaviour, joint: Joint, naive_error: float, rng: np.random.Generator
) -> Learned:
    """Return the results of an observer who does not know the risk aversion, from a path of decisions and then from single
    ones."""
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
    """Return the risk aversions that explain decisions (T,U) which are taken for optimal, all else being known."""
    true = problem.risk_aversion
    limits = true / GAMMA_RANGE, true * GAMMA_RANGE
    adversary = CostLearningAdversary.risk_aversion(problem.means, problem.covariances, limits, problem.constraints)
    return adversary.learn(np.unique(actions, axis=0))


def _guesses(setting: Setting, behaviour: Behaviour, joint: Joint, parameter: float) -> Array:
    """The naive observer's estimates (M,X) under a risk aversion; where nothing explains a decision, the belief of the prior
    under which it costs least."""
    true = setting.problem
    assert isinstance(true, MarkowitzProblem)
    problem = MarkowitzProblem(true.means, true.covariances, parameter, true.constraints)
    shown = np.flatnonzero(joint.played > 0)
    found = np.zeros((joint.n_actions, joint.beliefs.shape[1]))
    found[shown] = read_at_face_value(problem, setting.prior, np.asarray(behaviour.mechanism.actions)[shown])
    return found


def _published(setting: Setting, behaviour: Behaviour, rng: np.random.Generator) -> Array:
    """The decisions (T,U) published along a path of the belief, after a start that is left out."""
    path = _paths(setting, PAST + PATH_STEPS, 1)[:, 0]
    if behaviour.play is None and behaviour.memory is None:
        return published(setting, behaviour, path[PAST:], rng)
    return published(setting, behaviour, path, rng)[PAST:]


def _paths(setting: Setting, n_steps: int, n_paths: int) -> np.ndarray:
    """Paths of the belief (T,D), the same for every decision maker; independent draws where no chain is known."""

    def made() -> np.ndarray:
        rng = np.random.default_rng(_PATH_SEED)
        if setting.chain is not None:
            return setting.chain.paths(n_steps, n_paths, rng=rng)
        return rng.choice(len(setting.prior), size=(n_steps, n_paths), p=setting.prior.weights)

    paths: np.ndarray = setting.once(("paths", n_steps, n_paths), made)
    return paths


def _plain(table: Any) -> Any:
    return table.toarray() if table.nnz > _DENSE * table.shape[0] * table.shape[1] else table
