"""Decisions under several disclosures (how often, how late, which parts), read by the aware observer over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from inscrutable import tolerances, validation
from inscrutable.decision_makers import SequentialDecisionMaker
from inscrutable.decision_makers.results import Progress
from inscrutable.errors import InputError
from inscrutable.mechanisms import Disclosure, Mechanism, MechanismRule, Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.privacy import PathLeakage, path_leakage
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array

USUAL = (
    "exact",
    "delayed(1)",
    "delayed(2)",
    "every(3)",
    "every(3)|delayed(1)",
    "form_13f()",
    "every(6)|delayed(2)",
    "rounded(1)",
    "top(1)",
)
"""The disclosures compared by default, in steps of months."""
_MONTH = "month"
_IN_WEEKS = {"form_13f": "long_only()|every(13)|delayed(7)", "n_port": "every(13)|delayed(9)"}
"""Disclosures in steps of a month, written in weeks: 45 and 60 days are 7 and 9 of them, rounded up."""


_DIGITS = 15  # decimals of a regret: beyond them a difference of costs is rounding


@dataclass(frozen=True, eq=False)
class DisclosureRow(Saved):
    """The aware observer's leakage and error under one disclosure.

    Args:
        disclosure: The disclosure, as text.
        bits: Leakage per step about the beliefs so far, in bits, averaged over the counted steps.
        bits_se: Its standard error, at most.
        error: Root mean square error of the estimate of the present belief over the counted steps, Euclidean.
        error_se: Its standard error.
        errors: Root mean square error at every step, shape (T,).
        squared: Mean square error over the counted steps on every path, shape (D,), the same paths in all rows; one number
            where sequences were enumerated.
        total: Leakage of all steps together, in bits.
        total_se: Its standard error, at most.
        regret: Expected regret of the decisions a step, in the cost's unit; that of a rule is from its calibration, NaN where
            it has none.
    """

    disclosure: str
    bits: float
    bits_se: float
    error: float
    error_se: float
    errors: Array
    squared: Array
    total: float
    total_se: float
    regret: float


@dataclass(frozen=True, eq=False, repr=False)
class DisclosureTable(Summarised, Saved):
    """One mechanism under several disclosures, or a separate rule for each.

    Args:
        rows: One row per disclosure, in the given order.
        prior_error: Error without decisions, an upper bound for every disclosure.
        n_steps: Steps per path; the later half counts, in whole periods of the schedule.
        n_beliefs: Number of beliefs of positive probability.
        is_made_for_each: Whether each disclosure has its own rule, and therefore other decisions.

    Source: `path_leakage`.
    """

    rows: tuple[DisclosureRow, ...]
    prior_error: float
    n_steps: int
    n_beliefs: int
    is_made_for_each: bool = False

    def of(self, disclosure: Disclosure | str) -> DisclosureRow:
        """Return the row of one disclosure; raise `InputError` for an unknown one."""
        text = str(Disclosure.of(disclosure))
        for row in self.rows:
            if row.disclosure == text:
                return row
        raise InputError(f"no row of {text}; there are {[row.disclosure for row in self.rows]}")

    def frame(self) -> pd.DataFrame:
        """Return the figures, one row per disclosure: bits, errors, shares of the error without decisions, regrets."""
        return pd.DataFrame(
            [
                {
                    "disclosure": row.disclosure,
                    "bits_a_step": row.bits,
                    "bits_se": row.bits_se,
                    "error": row.error,
                    "error_se": row.error_se,
                    "share_of_prior_error": self._share(row),
                    "bits_in_all": row.total,
                    "bits_in_all_se": row.total_se,
                    "expected_regret": row.regret,
                }
                for row in self.rows
            ]
        )

    def lines(self) -> pd.DataFrame:
        """Return the same as text, with standard errors."""
        cells = {
            "bits a step": [f"{row.bits:.3f} ± {row.bits_se:.3f}" for row in self.rows],
            f"in {self.n_steps} steps": [f"{row.total:.1f} ± {row.total_se:.1f}" for row in self.rows],
            "error": [f"{row.error:.3f} ± {row.error_se:.3f}" for row in self.rows],
            "of the error without": [f"{self._share(row):.0%}" for row in self.rows],
            "regret": [_regret_text(row.regret) for row in self.rows],
        }
        return pd.DataFrame(cells, index=pd.Index([row.disclosure for row in self.rows], name="shown"))

    def _share(self, row: DisclosureRow) -> float:
        return row.error / self.prior_error if self.prior_error > tolerances.SAME_BELIEF else float("nan")

    def summary(self) -> str:
        """Return which disclosure hides the present belief best, and which least, as text."""
        if self.prior_error <= tolerances.SAME_BELIEF:
            return "Nothing can be hidden: the belief never moves in this market, so the prior determines it."
        same = "decisions are made for each" if self.is_made_for_each else "the decisions are the same"
        spent = dict.fromkeys(_regret_text(pick(row.regret for row in self.rows)) for pick in (min, max))
        cost = f"{same}, at an expected regret of {' to '.join(spent)}."
        low, high = self._ends()
        least = min(low or self.rows, key=lambda row: row.error)
        by = f"by {least.error:.3f} ({self._share(least):.0%} of {self.prior_error:.3f}, its error without decisions)"
        if not low:
            alike = "alike with each, " if len(self.rows) > 1 else ""
            return f"In short: the aware observer errs {alike}{by}; {cost}"
        most = max(high, key=lambda row: row.error)
        with_least, with_most = (" or ".join(row.disclosure for row in end) for end in (low, high))
        return (
            f"In short: the aware observer errs least with {with_least}, {by}, and most with {with_most}, by {most.error:.3f} "
            f"({self._share(most):.0%}); {cost}"
        )

    def _ends(self) -> tuple[list[DisclosureRow], list[DisclosureRow]]:
        """Rows with an error below another's and above none, and rows above another's and below none."""
        below = np.array([[_is_below(one, other) for other in self.rows] for one in self.rows])
        lower, higher = below.any(axis=1), below.any(axis=0)
        low, high = np.flatnonzero(lower & ~higher), np.flatnonzero(higher & ~lower)
        return [self.rows[k] for k in low], [self.rows[k] for k in high]


def _is_below(one: DisclosureRow, other: DisclosureRow) -> bool:
    """Whether an error is below another by more than two standard errors of their difference on the same paths."""
    first, second = (row.squared / (2.0 * row.error) if row.error > 0 else row.squared for row in (one, other))
    return other.error - one.error > 2.0 * _standard_error(second - first) + tolerances.SAME_BELIEF


def _standard_error(figures: Array) -> float:
    """Standard error of the mean over paths (D,); 0 for the one figure of an enumeration."""
    return float(figures.std(ddof=1) / np.sqrt(len(figures))) if len(figures) > 1 else 0.0


def _regret_text(regret: float) -> str:
    return f"{round(regret, _DIGITS) + 0.0:.3g}"


def usual_in(step: str) -> tuple[str, ...]:
    """Return the usual disclosures, without those of months where a step is known to be another; empty if not known."""
    return tuple(each for each in USUAL if step in ("", _MONTH) or not _of_months(Disclosure.of(each)))


def check_step(disclosure: Disclosure | str, step: str) -> None:
    """Raise `InputError` for a disclosure in steps of a month where a step is known to be another; empty if not known."""
    for name in _of_months(Disclosure.of(disclosure)) if step not in ("", _MONTH) else []:
        raise InputError(
            f"disclosure {disclosure}: {name} counts in steps of a month, and the steps here are {step}s: write it in these, "
            f"for weeks as {_IN_WEEKS[name]}"
        )


def _of_months(disclosure: Disclosure) -> list[str]:
    return [each.name for each in disclosure.operations if each.name in _IN_WEEKS]


def whole_ones(disclosures: Sequence[str], actions: Array) -> list[str]:
    """Return a caution for each disclosure, besides "exact", that shows all of these decisions (M,U) as they are, at once."""
    found = [Disclosure.of(each) for each in disclosures]
    return [
        f"Caution: {each} hides nothing of these decisions of {actions.shape[1]} weights: it is the same as exact."
        for each in found
        if each.maps
        and each.schedule.is_immediate
        and not each.needs_returns
        and _is_same(each.shown(actions), actions)
    ]


def _is_same(shown: Array, actions: Array) -> bool:
    return shown.shape == actions.shape and bool(np.abs(shown - actions).max() <= tolerances.SAME_ACTION)


def under_disclosures(
    chain: BeliefChain,
    mechanism: Mechanism | Callable[[Disclosure], MechanismRule],
    disclosures: Sequence[Disclosure | str] = USUAL,
    n_steps: int = 24,
    *,
    rng: np.random.Generator,
    n_draws: int = 100,
    progress: Progress | None = None,
) -> DisclosureTable:
    """Return what a mechanism leaks under several disclosures to the aware observer over time.

    Formula: that of `path_leakage`, averaged over the later half of the steps; every disclosure has the same paths.

    Args:
        chain: The chain of the belief; its prior has the mechanism's beliefs.
        mechanism: K(u|π), drawn independently at every step; or a function of a disclosure that returns a rule for it, such as
            a `SequentialDecisionMaker`.
        disclosures: The disclosures, also as text; no duplicates.
        n_steps: T, at least twice the longest period and above the longest delay.
        rng: The source of the paths.
        n_draws: Number of sampled paths, at least 10.
        progress: Called with (disclosures done, disclosures in all).

    Raises:
        InputError: An argument is malformed, a disclosure needs more steps, or it needs returns.

    Cost: one `path_leakage` per disclosure, or two where a sequential rule draws one of two prices, which is public.

    Source: see `path_leakage`.

    Example:
        >>> from inscrutable import Prior
        >>> from inscrutable.mechanisms.chains import resting_chain
        >>> chain = resting_chain(Prior(np.eye(2), [0.5, 0.5]), 0.8)
        >>> book = Mechanism(np.eye(2), [0, 1], np.eye(2), 1 - np.eye(2))
        >>> found = under_disclosures(chain, book, ["exact", "delayed(1)", "every(3)"], rng=np.random.default_rng(0))
        >>> print(found.lines().to_string())
                      bits a step in 24 steps          error of the error without regret
        shown
        exact       0.469 ± 0.000  11.8 ± 0.0  0.000 ± 0.000                   0%      0
        delayed(1)  0.469 ± 0.000  11.3 ± 0.0  0.424 ± 0.000                  60%      0
        every(3)    0.267 ± 0.000   6.6 ± 0.0  0.398 ± 0.000                  56%      0
    """
    asked = [Disclosure.of(each) for each in disclosures]
    if not asked or len(set(map(str, asked))) < len(asked):
        raise InputError("disclosures must be different ones, one at least")
    count = validation.count(n_steps, "n_steps")
    for each in asked:
        least = max(2 * each.schedule.period, 2 * (each.schedule.lag + 1))
        if count < least:
            raise InputError(f"n_steps is {count}, but {each} needs at least {least}")
    is_fixed = isinstance(mechanism, Mechanism)
    seed, rows, prior_error = int(validation.generator(rng).integers(2**62)), [], 0.0
    for done, each in enumerate(asked):
        played = mechanism if isinstance(mechanism, Mechanism) else mechanism(each)
        rules, shares = _known_rules(played)
        found = [
            path_leakage(chain, rule, count, rng=np.random.default_rng(seed), n_draws=n_draws, disclosure=each)
            for rule in rules
        ]
        rows.append(_row(each, found, shares, _regret(played, chain.prior)))
        prior_error = float(found[0].prior_error[-1])
        if progress is not None:
            progress(done + 1, len(asked))
    return DisclosureTable(tuple(rows), prior_error, count, int(np.count_nonzero(chain.prior.weights)), not is_fixed)


def _regret(played: Mechanism | MechanismRule, prior: Prior) -> float:
    if isinstance(played, Mechanism):
        return float(prior.weights @ played.expected_regrets)
    return played.calibration.regret if isinstance(played, SequentialDecisionMaker) else float("nan")


def _known_rules(played: Mechanism | MechanismRule) -> tuple[Sequence[Mechanism | MechanismRule], Array]:
    """The rules that the observer may face, of which it knows the one that was drawn, and their probabilities."""
    if isinstance(played, SequentialDecisionMaker):
        return played.at_each_price(), played.calibration.shares
    return [played], np.ones(1)


def _row(shown: Disclosure, found: Sequence[PathLeakage], shares: Array, regret: float) -> DisclosureRow:
    """The mean over a draw of one of several rules."""
    count, period = len(found[0]), shown.schedule.period
    window = slice(count - count // 2 // period * period, None)

    def mean(figures: Callable[[PathLeakage], Array]) -> Array:
        return np.asarray(shares @ [figures(each) for each in found])

    squared: Array = sum(share * each.squared for share, each in zip(shares, found, strict=True))
    counted = squared[:, window].mean(axis=1)
    error = float(np.sqrt(counted.mean()))
    return DisclosureRow(
        str(shown),
        float(mean(lambda each: each.added)[window].mean()),
        float(mean(lambda each: each.added_se)[window].mean()),
        error,
        _standard_error(counted) / (2.0 * error) if error > 0 else 0.0,
        np.sqrt(squared.mean(axis=0)),
        counted,
        float(mean(lambda each: each.cumulative)[-1]),
        float(mean(lambda each: each.cumulative_se)[-1]),
        regret,
    )
