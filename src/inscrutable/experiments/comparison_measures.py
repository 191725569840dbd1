"""The measures of one mechanism against every observer: errors of estimates, leakage, detectability, repetition."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from inscrutable.experiments.comparison_sensor import sensor_error
from inscrutable.experiments.comparison_watchers import Learned, learned, watched
from inscrutable.experiments.measures import value_of
from inscrutable.experiments.observers import Observed
from inscrutable.experiments.setting import Behaviour, Repeated, Watched
from inscrutable.mechanisms import Disclosure, Prior
from inscrutable.mechanisms.disclosed import disclosed
from inscrutable.privacy import leakage, repeated_leakage
from inscrutable.saved import Saved
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class ComparisonRow(Saved):
    """One decision maker at one budget, against every observer.

    Errors are root mean squares under the prior and the mechanism, Euclidean, in units of belief; where no belief explains a
    decision to an observer, its estimate is the belief of least regret.

    Args:
        maker: The decision maker's name.
        budget: The requested expected regret, in the cost's unit.
        expected_regret: The expected regret spent, in the cost's unit; less than the budget where nothing more private is
            affordable.
        worst_regret: The largest regret of any decision played.
        cost_share: Expected regret as a share of E|c*|.
        silence_share: Expected regret as a share of the silence regret r₀.
        naive_privacy: Mean distance of the belief from Π(u), over decisions that some belief explains.
        naive_error: Error of the naive observer, whose estimate is the mean of the corners of Π(u).
        near_optimal_error: Error of the near-optimal observer, who allows the requested expected regret and knows the prior.
        budget_aware_error: Error of the budget-aware observer, who knows the largest regret of any decision and the prior.
        bayes_error: Error of the aware observer, who knows the mechanism and the prior.
        least_error: The least error of the aware observer over beliefs.
        mutual_information: In bits.
        min_entropy_leakage: In bits.
        maximal_leakage: In bits.
        naive_top_state: Probability that the naive observer names a most likely state.
        top_state_accuracy: Probability that the aware observer names a most likely state.
        auc: Area under the ROC curve of the test of altered against optimal decisions by likelihoods of single decisions; ½ is
            chance.
        read_auc: Area under the ROC curve of that test by naive estimates from single decisions; ½ is chance.
        expected_gap: Expected plausibility gap of the decisions, in the cost's unit.
        implausible_share: Probability of a decision that no belief explains.
        n_actions: Number of decisions of positive probability.
        repeated_errors: Bayes error after each number of repeated decisions, shape (S,).
        repeated_error_se: Their standard errors, shape (S,); 0 where exact.
        repeated_information: Bits after each number of repeated decisions, shape (S,).
        repeated_top_state: Probability that the aware observer then names a most likely state, shape (S,).
        told_errors: Bayes error after each of these numbers where the rule, like the observer, knows that the belief stays,
            shape (S,); it differs from `repeated_errors` for the sequential rule only.
        told_regret: The expected regret of the sequential rule in that case, at the same prices; NaN for others.
        strength: Steps of a delay, or the fraction traded; NaN for others.
        path_error: Error of the aware observer over time, who knows the chain of the belief and sees every decision; NaN
            without a chain. The prior's error bounds it too.
        path_error_se: Its standard error, over independent paths.
        path_top_state: Probability that this observer names a most likely state.
        path_bits: Leakage of a decision to that observer beyond those before it, in bits.
        path_bits_se: Its standard error, over independent paths.
        path_ceiling: Upper bound of the error over time of every rule of the same expected regret on the candidate
            decisions; only in rows of the sequential rule, else NaN.
        path_error_half: The error over time where beliefs stay half as long as the sequential rule assumes.
        path_error_double: The error over time where they stay twice as long.
        learned_low: Least risk aversion under which every decision of a path is optimal for some belief, the rest of the cost
            being known; NaN where no value explains all, and for costs without one.
        learned_high: The greatest such risk aversion.
        learned_holds: 1 where the true risk aversion is between these, 0 where it is not or there are none; NaN for costs
            without one.
        rival_worth: Worth of one decision to the rival, in its own unit; NaN without a rival.
        learned_error: Error of the observer who learns the risk aversion first and then reads single decisions like the naive
            observer; NaN where no value explains all.
        sensor_error: Error of the sensor estimated from a path of decisions taken for optimal, as a share of the error without
            decisions; NaN under a disclosure.
        data_errors: Error of the observer who has only data, for each number of pairs, shape (S,); one sample of pairs each.
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
    told_errors: Array
    told_regret: float = float("nan")
    strength: float = float("nan")
    path_error: float = float("nan")
    path_error_se: float = float("nan")
    path_top_state: float = float("nan")
    path_bits: float = float("nan")
    path_bits_se: float = float("nan")
    path_ceiling: float = float("nan")
    path_error_half: float = float("nan")
    path_error_double: float = float("nan")
    learned_low: float = float("nan")
    learned_high: float = float("nan")
    learned_holds: float = float("nan")
    learned_error: float = float("nan")
    rival_worth: float = float("nan")
    sensor_error: float = float("nan")
    data_errors: Array = field(default_factory=lambda: np.zeros(0))


def learned_from_data(observed: Observed, pairs: tuple[int, ...], disclosure: Disclosure) -> Array:
    """Return the errors (S,) of an observer who has only that many pairs of belief and disclosed decision."""
    shown = str(Disclosure(disclosure.maps))
    return np.array([observed.read_by({"name": "data", "pairs": n, "disclosure": shown}).error for n in pairs])


def measured(
    name: str,
    observed: Observed,
    repeats: tuple[tuple[int, ...], int],
    disclosure: Disclosure = Disclosure(),  # noqa: B008  # frozen
    *,
    rng: np.random.Generator,
) -> ComparisonRow:
    """Return every measure of a mechanism; `repeats` holds the numbers of repeated decisions and of sampled sequences.

    Under a disclosure observers see disclosed values; measures that need full decisions are then NaN.
    """
    setting, behaviour = observed.setting, observed.behaviour
    single = Disclosure(disclosure.maps)
    again = _repeated(setting.prior, behaviour, repeats, rng, single)
    told = again if behaviour.play is None else behaviour.play.repeated(repeats[0], told=True)
    of_mechanism: dict[str, Any] = {each: value_of(observed, each) for each in _OF_MECHANISM}
    seen = observed.leakage_shown(single)
    if not disclosure.is_exact:
        of_mechanism |= {each: getattr(seen, each) for each in _LEAKED} | dict.fromkeys(_IN_FULL, np.nan)
    readings = {
        each: observed.read_by({"name": each, "disclosure": str(single)})
        for each in ("naive", "near-optimal", "budget-aware", "bayesian")
    }
    over_time, of_cost, of_sensor = rng.spawn(3)
    path = watched(setting, behaviour, readings["bayesian"].error, over_time, disclosure)
    learner = Learned()
    if disclosure.is_exact:
        learner = learned(setting, behaviour, observed.joint, readings["naive"].error, of_cost)
    return ComparisonRow(
        maker=name,
        budget=observed.asked,
        naive_error=readings["naive"].error,
        near_optimal_error=readings["near-optimal"].error,
        budget_aware_error=readings["budget-aware"].error,
        bayes_error=readings["bayesian"].error,
        least_error=seen.least_error,
        naive_top_state=readings["naive"].top_state,
        top_state_accuracy=readings["bayesian"].top_state,
        auc=observed.detectability.auc if disclosure.is_exact else np.nan,
        n_actions=observed.played.n_actions,
        strength=behaviour.strength,
        rival_worth=seen.worth if setting.loss is not None else float("nan"),
        sensor_error=sensor_error(setting, behaviour, of_sensor) if disclosure.is_exact else np.nan,
        **of_mechanism,
        **_prefixed("repeated", again, without=("regret",)),
        told_errors=told.errors,
        told_regret=told.regret,
        **_prefixed("path", path),
        **_prefixed("learned", learner),
    )


_OF_MECHANISM = (
    *("expected_regret", "worst_regret", "cost_share", "silence_share", "naive_privacy", "mutual_information"),
    *("min_entropy_leakage", "maximal_leakage", "read_auc", "expected_gap", "implausible_share"),
)

_LEAKED = ("mutual_information", "min_entropy_leakage", "maximal_leakage")
_IN_FULL = ("naive_privacy", "read_auc", "expected_gap", "implausible_share")
"""Measures that need fully disclosed decisions."""


def _prefixed(name: str, figures: Repeated | Watched | Learned, without: tuple[str, ...] = ()) -> dict[str, Any]:
    return {f"{name}_{key}": value for key, value in figures._asdict().items() if key not in without}


def _repeated(
    prior: Prior,
    behaviour: Behaviour,
    repeats: tuple[tuple[int, ...], int],
    rng: np.random.Generator,
    disclosure: Disclosure,
) -> Repeated:
    steps, n_draws = repeats
    if behaviour.play is not None:
        return behaviour.play.repeated(steps, told=False)
    if behaviour.memory is None:
        found = repeated_leakage(disclosed(behaviour.mechanism, disclosure), prior, steps, rng=rng, n_draws=n_draws)
        return Repeated(found.bayes_error, found.error_se, found.mutual_information, found.top_state_accuracy)
    read = [leakage(behaviour.memory(n), prior) for n in steps]
    return Repeated(
        np.array([each.bayes_error for each in read]),
        np.zeros(len(steps)),
        np.array([each.mutual_information for each in read]),
        np.array([each.top_state_accuracy for each in read]),
    )
