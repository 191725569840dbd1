"""What every observer makes of one mechanism: errors of their estimates, leakage, detectability, repetition."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from inscrutable.adversaries import BudgetAwareAdversary, NaiveAdversary, NearOptimalAdversary
from inscrutable.budgets import Budget
from inscrutable.experiments.comparison_makers import Play, Setting
from inscrutable.experiments.comparison_watchers import Learned, Watched, learned, watched
from inscrutable.experiments.guesses import guess_error, guesses_of, naive_privacy, top_state_share
from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.joint import joint_law
from inscrutable.privacy import detectability, leakage, repeated_leakage
from inscrutable.saved import Saved
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class ComparisonRow(Saved):
    """One decision maker at one budget, against every observer.

    Errors are root mean squares under the prior and the mechanism, Euclidean, in units of belief; where a decision makes
    no sense to an observer, its guess is the belief of least regret.

    Args:
        maker: The decision maker's name.
        budget: The expected regret asked for, in the cost's unit.
        expected_regret: The one spent, in the cost's unit; less than asked where nothing more private can be bought.
        worst_regret: The largest regret of any decision played.
        cost_share: Expected regret as a share of E|c*|.
        silence_share: Expected regret as a share of the silence regret r₀.
        naive_privacy: Mean distance of the belief from Π(u), over decisions that some belief explains.
        naive_error: Of the naive observer: the mean of the corners of Π(u).
        near_optimal_error: Of one who allows for the expected regret asked for, with the prior.
        budget_aware_error: Of one who knows the largest regret of any decision, with the prior.
        bayes_error: Of one who knows the mechanism and the prior.
        least_error: The same for the belief that is hidden worst.
        mutual_information: In bits.
        min_entropy_leakage: In bits.
        maximal_leakage: In bits.
        naive_top_state: How often the naive observer names a most likely state.
        top_state_accuracy: How often the one who knows the mechanism does.
        auc: Area under the curve of telling hiding from not hiding by the likelihoods of single decisions; ½ is nothing.
        read_auc: Area under the curve of telling hiding from not hiding by naive readings of single decisions; ½ is nothing.
        expected_gap: Expected plausibility gap of the decisions, in the cost's unit.
        implausible_share: How often a decision is played that no belief explains.
        n_actions: Decisions that are played.
        repeated_errors: Bayes error after each number of repeated decisions, shape (S,).
        repeated_error_se: Their standard errors, shape (S,); 0 where exact.
        repeated_information: Bits after each number of repeated decisions, shape (S,).
        repeated_top_state: How often the most likely state is then named, shape (S,).
        strength: Steps of a delay, or the fraction traded; NaN for others.
        path_error: Of one who knows the mechanism and how the belief moves, and follows it from decision to decision; NaN
            where that is not known. Its ceiling is the prior's error too.
        path_error_se: Its standard error, over independent paths.
        path_top_state: How often that one names a most likely state.
        learned_low: Least risk aversion that explains every decision of a path to one who knows all of the cost but that, and
            takes decisions for optimal; NaN where none explains them all, and for costs without one.
        learned_high: The greatest.
        learned_holds: 1 where the true risk aversion is among these, 0 where it is not or there are none; NaN for costs
            without one.
        learned_error: Of that observer, who then reads single decisions as the naive one does; NaN where none explains all.
    """

    maker: str
    budget: float
    expected_regret: float
    worst_regret: float
    cost_share: float
    silence_share: float
    naive_privacy: float
    naive_error: float
    near_optimal_error: float
    budget_aware_error: float
    bayes_error: float
    least_error: float
    mutual_information: float
    min_entropy_leakage: float
    maximal_leakage: float
    naive_top_state: float
    top_state_accuracy: float
    auc: float
    read_auc: float
    expected_gap: float
    implausible_share: float
    n_actions: int
    repeated_errors: Array
    repeated_error_se: Array
    repeated_information: Array
    repeated_top_state: Array
    strength: float = float("nan")
    path_error: float = float("nan")
    path_error_se: float = float("nan")
    path_top_state: float = float("nan")
    learned_low: float = float("nan")
    learned_high: float = float("nan")
    learned_holds: float = float("nan")
    learned_error: float = float("nan")


def measured(
    setting: Setting,
    name: str,
    regret: float,
    play: Play,
    repeats: tuple[tuple[int, ...], int],
    *,
    rng: np.random.Generator,
) -> ComparisonRow:
    """Return every measure of a mechanism; `repeats` are the numbers of repeated decisions and the sampled sequences."""
    problem, prior, played = setting.problem, setting.prior, play.mechanism
    joint = joint_law(played, prior)
    told = leakage(played, prior, problem)
    read = told if play.seen is None else leakage(play.seen(1), prior)
    again = _repeated(prior, play, repeats, rng)
    seen = detectability(played, prior, problem)
    promise = Budget.regret(told.worst_regret) if play.promise is None else play.promise
    near, aware_of_budget = (
        guess_error(joint, guesses_of(each, played.actions, joint))
        for each in (
            NearOptimalAdversary(problem, regret, prior=prior),
            BudgetAwareAdversary(problem, promise, prior=prior),
        )
    )
    naive = guesses_of(NaiveAdversary(problem), played.actions, joint, seen.excuses)
    naive_error = guess_error(joint, naive)
    over_time, of_cost = rng.spawn(2)
    path = watched(setting, play, read.bayes_error, over_time)
    learner = learned(setting, play, joint, naive_error, of_cost)
    mean_cost = setting.mean_cost
    return ComparisonRow(
        maker=name,
        budget=regret,
        expected_regret=told.expected_regret,
        worst_regret=told.worst_regret,
        cost_share=told.expected_regret / mean_cost if mean_cost > 0 else float("nan"),
        silence_share=told.silence_share,
        naive_privacy=naive_privacy(problem, played.actions, joint),
        naive_error=naive_error,
        near_optimal_error=near,
        budget_aware_error=aware_of_budget,
        bayes_error=read.bayes_error,
        least_error=read.least_error,
        mutual_information=read.mutual_information,
        min_entropy_leakage=read.min_entropy_leakage,
        maximal_leakage=read.maximal_leakage,
        naive_top_state=top_state_share(joint, naive),
        top_state_accuracy=read.top_state_accuracy,
        auc=seen.auc,
        read_auc=seen.read_auc,
        expected_gap=seen.expected_gap,
        implausible_share=seen.implausible_share,
        n_actions=told.n_actions,
        strength=play.strength,
        **_prefixed("repeated", again),
        **_prefixed("path", path),
        **_prefixed("learned", learner),
    )


def _prefixed(name: str, figures: _Repeated | Watched | Learned) -> dict[str, Any]:
    return {f"{name}_{key}": value for key, value in figures._asdict().items()}


class _Repeated(NamedTuple):
    """Figures after each number of decisions on one belief, each (S,)."""

    errors: Array
    error_se: Array
    information: Array
    top_state: Array


def _repeated(prior: Prior, play: Play, repeats: tuple[tuple[int, ...], int], rng: np.random.Generator) -> _Repeated:
    steps, n_draws = repeats
    if play.seen is None:
        found = repeated_leakage(play.mechanism, prior, steps, rng=rng, n_draws=n_draws)
        return _Repeated(found.bayes_error, found.error_se, found.mutual_information, found.top_state_accuracy)
    read = [leakage(play.seen(n), prior) for n in steps]
    return _Repeated(
        np.array([each.bayes_error for each in read]),
        np.zeros(len(steps)),
        np.array([each.mutual_information for each in read]),
        np.array([each.top_state_accuracy for each in read]),
    )
