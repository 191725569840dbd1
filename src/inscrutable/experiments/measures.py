"""The measures of experiments: name, meaning and computation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from operator import attrgetter
from typing import Any, NamedTuple

from inscrutable.experiments.observers import NOTHING, Observed


class Measure(NamedTuple):
    """A figure of a mechanism.

    Args:
        title: Its name in tables.
        meaning: Its definition in one sentence.
        value: Function that returns it; None for a measure of a single observer, from `Observed.read_by`.
        sign: 1 if larger is more private, −1 if smaller is, 0 if it does not measure privacy.
        spoken: Its name within a sentence; empty: the title.
    """

    title: str
    meaning: str
    value: Callable[[Observed], float] | None = None
    sign: int = 0
    spoken: str = ""


def _cost_share(observed: Observed) -> float:
    mean = observed.setting.mean_cost
    return _expected_regret(observed) / mean if mean > 0 else float("nan")


def _expected_regret(observed: Observed) -> float:
    return observed.played.expected_regret * observed.paid


def _silence_share(observed: Observed) -> float:
    return observed.played.silence_share * observed.paid


MEASURES: Mapping[str, Measure] = {
    "error": Measure(
        "error",
        "error: root mean square of the observer's estimate of the belief, Euclidean; larger is more private.",
        sign=1,
    ),
    "top_state": Measure(
        "names the top state",
        "names the top state: how often the observer names a most likely state; smaller is more private.",
        sign=-1,
        spoken="naming of the top state",
    ),
    "naive_privacy": Measure(
        "naive privacy",
        "naive privacy: mean distance of the belief from those that would make the decision optimal.",
        attrgetter("naive_privacy"),
        1,
    ),
    "expected_regret": Measure(
        "expected regret",
        "expected regret: what hiding costs on average, in the cost's unit (a portfolio's: return per period).",
        _expected_regret,
    ),
    "worst_regret": Measure(
        "worst regret",
        "worst regret: the largest of any decision that is played, in the cost's unit.",
        attrgetter("played.worst_regret"),
    ),
    "cost_share": Measure(
        "share of E|c*| spent",
        "share of E|c*|: the expected regret as a share of the mean size of the optimal cost.",
        _cost_share,
    ),
    "silence_share": Measure(
        "share of the silence regret spent",
        "share of the silence regret: the expected regret over the least at which one constant decision suffices.",
        _silence_share,
    ),
    "mutual_information": Measure(
        "leakage, bits",
        "leakage: the mutual information of one decision and the belief, for the aware observer.",
        attrgetter("leakage.mutual_information"),
        -1,
        "leakage in bits",
    ),
    "min_entropy_leakage": Measure(
        "min-entropy leakage, bits",
        "min-entropy leakage: the bits by which one decision improves a single guess at the belief.",
        attrgetter("leakage.min_entropy_leakage"),
    ),
    "maximal_leakage": Measure(
        "maximal leakage, bits",
        "maximal leakage: the most of that under any prior on the same beliefs.",
        attrgetter("leakage.maximal_leakage"),
    ),
    "worth": Measure(
        "worth to the rival",
        "worth to the rival: by how much one decision lowers the loss of the rival of the section rival, in the rival's unit; "
        "of the square error without that section. 0 where the decision reveals nothing.",
        attrgetter("leakage.worth"),
        -1,
    ),
    "secret_worth": Measure(
        "worth of the secret",
        "worth of the secret: the same of the belief itself; no decision is worth more.",
        attrgetter("leakage.secret_worth"),
    ),
    "prior_error": Measure(
        "error without a decision",
        "error without a decision: of an observer who knows only the prior.",
        attrgetter("played.prior_error"),
    ),
    "prior_entropy": Measure(
        "entropy of the prior, bits",
        "entropy of the prior: the most bits that can leak.",
        attrgetter("played.prior_entropy"),
    ),
    "prior_top_state": Measure(
        "top state without a decision",
        "top state without a decision: how often it is right to name always the same state.",
        attrgetter("played.prior_top_state_accuracy"),
    ),
    "n_actions": Measure(
        "decisions played",
        "decisions played: how many different ones, over all beliefs.",
        attrgetter("played.n_actions"),
    ),
    "implausible_share": Measure(
        "share that no belief explains",
        "share that no belief explains: how often one decision alone gives the hiding away.",
        attrgetter("detectability.implausible_share"),
    ),
    "expected_gap": Measure(
        "expected plausibility gap",
        "expected plausibility gap: the least regret of a decision under any belief, on average.",
        attrgetter("detectability.expected_gap"),
    ),
    "read_auc": Measure(
        "detectability, AUC",
        "detectability: area under the curve of a test of one decision against an optimal one, by the naive reading; 0.5 is "
        "chance.",
        attrgetter("detectability.read_auc"),
        -1,
        "detectability",
    ),
}
"""All measures by their names in files. A page's verdict uses the first of `HEADLINES` that was measured."""

HEADLINES = ("error", "naive_privacy", "mutual_information", "top_state", "read_auc")

OF_OBSERVERS = tuple(name for name, measure in MEASURES.items() if measure.value is None)
"""Measures of an observer; all others are those of the mechanism, equal for every observer."""


WITHOUT = ("prior_error", "prior_top_state")
"""Measures without decisions: from the law of beliefs, and from public observations."""


def reads_beside(chosen: Mapping[str, object]) -> bool:
    """Return whether an observer, given by its keys, has observations of its own besides decisions."""
    return chosen.get("public", NOTHING) != NOTHING


def value_of(observed: Observed, name: str, kinds: Mapping[str, Measure] = MEASURES) -> float:
    """Return a measure of the mechanism."""
    value = kinds[name].value
    assert value is not None
    return float(value(observed))


def figures_of(
    observed: Observed,
    chosen: Mapping[str, object],
    measures: tuple[str, ...],
    *,
    observers: Mapping[str, Any] | None = None,
    kinds: Mapping[str, Measure] = MEASURES,
) -> dict[str, float]:
    """Return measures by name, including those of one observer given by its keys."""
    asked = any(name in OF_OBSERVERS or (name in WITHOUT and reads_beside(chosen)) for name in measures)
    read = observed.read_by(chosen, observers)._asdict() if asked else {}
    own = {name: value for name, value in read.items() if value is not None}
    return {name: own[name] if name in own else value_of(observed, name, kinds) for name in measures}
