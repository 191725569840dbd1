"""Every claim of the paper's Section V as a test with a number; the criteria were fixed before any market was run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances
from inscrutable.errors import InputError
from inscrutable.experiments.market_runs import GLOBAL, PAPER, MarketRun, PlayedSteps
from inscrutable.validation import Array

MATERIAL = 0.01
"""A gain in privacy that counts: one percentage point of belief."""

SATURATED = 0.01
"""A privacy within this share of its value at the largest budget has saturated."""

ERRORS = 2.0
"""An average is on the claimed side when it is so by this many standard errors over the markets."""


class Rule(Enum):
    """When a claim holds over many markets."""

    ALWAYS = "in every market"
    ON_AVERAGE = f"on average over the markets, by {ERRORS:g} standard errors, or in every market"
    SOMETIMES = "in at least one market"


class Verdict(Enum):
    """What the markets say about a claim."""

    HOLDS = "holds"
    FAILS = "fails"
    ONLY_LOCAL = "holds only with the local solver"
    ONLY_GLOBAL = "holds only with the global solver"


@dataclass(frozen=True, eq=False)
class Claim:
    """A sentence of the paper as a quantity of one market that must be at least, or at most, a bound.

    Args:
        key: A short name.
        text: The claim in the paper's words.
        quantity: What is measured in one market.
        at_least: Whether the bound is from below.
        bound: The bound, in the quantity's unit.
        rule: Over which markets it must be met.
        measure: (market, variant) → the quantity, one number or several that must all meet the bound.
    """

    key: str
    text: str
    quantity: str
    at_least: bool
    bound: float
    rule: Rule
    measure: Callable[[MarketRun, str], ArrayLike]

    @property
    def criterion(self) -> str:
        """The test in words."""
        return f"{self.quantity} {'>=' if self.at_least else '<='} {self.bound:g} {self.rule.value}"


@dataclass(frozen=True)
class Finding:
    """One claim in one variant.

    Args:
        measured: The average, or for claims about every market the least favourable and about some the most favourable
            market's quantity; of several quantities the least favourable one.
        standard_error: Of an average over the markets; NaN otherwise.
        share: Share of the markets in which the claim holds.
        holds: Whether the rule is met.
    """

    measured: float
    standard_error: float
    share: float
    holds: bool


@dataclass(frozen=True)
class JudgedClaim:
    """A claim with what was found for the paper's decision makers and for the global ones."""

    key: str
    text: str
    criterion: str
    n_markets: int
    paper: Finding
    globally: Finding
    verdict: Verdict


def judge_claims(runs: Sequence[MarketRun]) -> tuple[JudgedClaim, ...]:
    """Return every claim, judged over the markets.

    Args:
        runs: One record per market, at least two.

    Raises:
        InputError: Fewer than two markets: an average would have no error.

    Cost: negligible. Source: the paper, Section V. Example: see `inscrutable.experiments.reproduction.reproduce`.
    """
    if len(runs) < 2:
        raise InputError(f"claims are judged over at least 2 markets, got {len(runs)}")
    return tuple(_judge(claim, runs) for claim in CLAIMS)


def _judge(claim: Claim, runs: Sequence[MarketRun]) -> JudgedClaim:
    found = {name: _finding(claim, runs, name) for name in (PAPER, GLOBAL)}
    verdict = {
        (True, True): Verdict.HOLDS,
        (True, False): Verdict.ONLY_LOCAL,
        (False, True): Verdict.ONLY_GLOBAL,
        (False, False): Verdict.FAILS,
    }[found[PAPER].holds, found[GLOBAL].holds]
    return JudgedClaim(claim.key, claim.text, claim.criterion, len(runs), found[PAPER], found[GLOBAL], verdict)


def _finding(claim: Claim, runs: Sequence[MarketRun], variant: str) -> Finding:
    sign = 1.0 if claim.at_least else -1.0
    # One row per market, turned so that more is better.
    values = sign * np.array([np.atleast_1d(np.asarray(claim.measure(run, variant), dtype=float)) for run in runs])
    bound = sign * claim.bound
    share = float((values >= bound).all(axis=1).mean())
    if claim.rule is not Rule.ON_AVERAGE:
        per_market = values.min(axis=1)
        extreme = per_market.min() if claim.rule is Rule.ALWAYS else per_market.max()
        holds = share == 1.0 if claim.rule is Rule.ALWAYS else share > 0.0
        return Finding(sign * float(extreme), float("nan"), share, holds)
    means = values.mean(axis=0)
    errors = values.std(axis=0, ddof=1) / np.sqrt(len(runs))
    worst = int((means - ERRORS * errors).argmin())
    # Ties in almost every market leave an average of a few rounding units: what every market meets, the average meets.
    holds = share == 1.0 or bool(means[worst] - ERRORS * errors[worst] >= bound)
    return Finding(sign * float(means[worst]), float(errors[worst]), share, holds)


def rank_agreement(first: ArrayLike, second: ArrayLike) -> float:
    """Return Kendall's τ_b of two sequences, 0 where one of them does not vary; rounding makes no difference.

    Example:
        >>> rank_agreement([1.0, 2.0, 3.0], [0.1, 0.5, 0.5]).__round__(3)
        0.816
    """
    signs = []
    for values in (np.asarray(first, dtype=float), np.asarray(second, dtype=float)):
        apart = values[:, None] - values
        signs.append(np.where(np.abs(apart) > tolerances.CLAIM_ROUNDING, np.sign(apart), 0.0))
    size = np.sqrt((signs[0] ** 2).sum() * (signs[1] ** 2).sum())
    return float((signs[0] * signs[1]).sum() / size) if size > 0 else 0.0


def saturation_budget(budgets: ArrayLike, privacies: ArrayLike) -> float:
    """Return the least budget whose privacy is within `SATURATED` of that at the largest one.

    Example:
        >>> saturation_budget([0.1, 1.0, 10.0], [0.5, 0.999, 1.0])
        1.0
    """
    shares, values = np.asarray(budgets, dtype=float), np.asarray(privacies, dtype=float)
    return float(shares[np.flatnonzero(values >= (1.0 - SATURATED) * values[-1])[0]])


def _cdm(run: MarketRun, variant: str) -> PlayedSteps:
    return run.variants[variant].cdm


def _pdm(run: MarketRun, variant: str) -> PlayedSteps:
    return run.variants[variant].pdm


def _apart(first: Array, second: Array) -> Array:
    """The difference; one of rounding size counts as none, so that equal decisions found twice are no gain or loss."""
    difference = first - second
    return np.where(np.abs(difference) > tolerances.CLAIM_ROUNDING, difference, 0.0)


def _more_private(run: MarketRun, variant: str) -> float:
    return float(_apart(_pdm(run, variant).privacy, _cdm(run, variant).privacy).mean())


def _dearer(run: MarketRun, variant: str) -> float:
    return float(_apart(_pdm(run, variant).increase, _cdm(run, variant).increase).mean())


def _more_private_by_budget(run: MarketRun, variant: str) -> Array:
    found = run.variants[variant]
    return _apart(found.pdm_curve.privacy, found.cdm_curve.privacy)


def _gain_of_starts(run: MarketRun, variant: str) -> Array:
    if variant == PAPER:
        return np.diff(run.starts)
    # What the local solver, given all its starts, finds beyond the global one.
    return np.array([max(run.starts[-1] - run.variants[GLOBAL].cdm.privacy[0], 0.0)])


def _together(run: MarketRun, variant: str) -> float:
    more, dearer = _more_private(run, variant), _dearer(run, variant)
    return float(np.sign(more) * np.sign(dearer)) if abs(more) > tolerances.CLAIM_ROUNDING else 0.0


def _over(played: Array, run: MarketRun) -> float:
    return float(played.max() - run.budget)


def _later(run: MarketRun, variant: str) -> float:
    found = run.variants[variant]
    reached = [saturation_budget(run.budgets, curve.privacy) for curve in (found.pdm_curve, found.cdm_curve)]
    return float(np.log10(reached[0] / reached[1]))


def _last_growth(privacy: Array) -> float:
    return float((privacy[-1] - privacy[-2]) / max(abs(privacy[-1]), tolerances.CLAIM_ROUNDING))


_ROUNDING = tolerances.CLAIM_ROUNDING

CLAIMS: tuple[Claim, ...] = (
    Claim(
        "odm_exposed",
        "The ODM's privacy is always compromised (the distance is zero)",
        "largest privacy of the ODM over the steps",
        False,
        tolerances.SAME_BELIEF,
        Rule.ALWAYS,
        lambda run, variant: run.odm.privacy.max(),
    ),
    Claim(
        "cdm_outside",
        "The CDM's private belief is never among those the adversary reconstructs",
        "least privacy of the CDM over the steps",
        True,
        _ROUNDING,
        Rule.ALWAYS,
        lambda run, variant: _cdm(run, variant).privacy.min(),
    ),
    Claim(
        "pdm_outside",
        "The PDM's private belief is never among those the adversary reconstructs",
        "least privacy of the PDM's sampled action over the steps",
        True,
        _ROUNDING,
        Rule.ALWAYS,
        lambda run, variant: _pdm(run, variant).privacy.min(),
    ),
    Claim(
        "sets_not_always_single",
        "The reconstructed sets often have a single element, but not always",
        "largest dimension of a reconstructed set",
        True,
        1.0,
        Rule.SOMETIMES,
        lambda run, variant: max(each.dimension.max() for each in (run.odm, _cdm(run, variant), _pdm(run, variant))),
    ),
    Claim(
        "pdm_more_private",
        "The PDM is, on average, better at obfuscating its private belief than the CDM",
        "mean privacy of the PDM's sampled action minus the CDM's, over the steps",
        True,
        0.0,
        Rule.ON_AVERAGE,
        _more_private,
    ),
    Claim(
        "pdm_more_private_at_every_budget",
        "The PDM has, on average, a higher privacy than the CDM for any cost budget",
        "expected privacy of the PDM minus the CDM's, at every budget",
        True,
        0.0,
        Rule.ON_AVERAGE,
        _more_private_by_budget,
    ),
    Claim(
        "local_optima",
        "The CDM falls short because it may end in a local optimum",
        "privacy gained by each increase of the number of starts (global solver: by starts beyond it)",
        True,
        MATERIAL,
        Rule.ON_AVERAGE,
        _gain_of_starts,
    ),
    Claim(
        "hard_budget",
        "The CDM falls short because its budget is hard, the PDM's holds on average",
        "expected privacy of a lottery minus that of the best single decision, same candidates",
        True,
        MATERIAL,
        Rule.ON_AVERAGE,
        lambda run, variant: run.variants[variant].mixing_gain.mean(),
    ),
    Claim(
        "suboptimal_costs",
        "A suboptimal action costs no less than the optimal one",
        "least (c̄ − c*)/|c*| of the CDM and the PDM over the steps",
        True,
        -_ROUNDING,
        Rule.ALWAYS,
        lambda run, variant: min(_cdm(run, variant).increase.min(), _pdm(run, variant).increase.min()),
    ),
    Claim(
        "cdm_within_budget",
        "The CDM never violates the cost budget",
        "largest (c̄ − c*)/|c*| of the CDM over the steps minus c_b",
        False,
        _ROUNDING,
        Rule.ALWAYS,
        lambda run, variant: _over(_cdm(run, variant).increase, run),
    ),
    Claim(
        "pdm_within_budget_on_average",
        "The PDM does not violate the cost budget on average",
        "largest expected (c̄ − c*)/|c*| of the PDM over the steps minus c_b",
        False,
        _ROUNDING,
        Rule.ALWAYS,
        lambda run, variant: _over(_pdm(run, variant).expected_increase, run),
    ),
    Claim(
        "pdm_over_budget_at_times",
        "A single action of the PDM may violate the cost budget",
        "largest (c̄ − c*)/|c*| of the PDM's sampled action over the steps minus c_b",
        True,
        _ROUNDING,
        Rule.SOMETIMES,
        lambda run, variant: _over(_pdm(run, variant).increase, run),
    ),
    Claim(
        "cdm_cheaper",
        "The CDM incurs, on average, a lower cost than the PDM",
        "mean (c̄ − c*)/|c*| of the PDM's sampled action minus the CDM's, over the steps",
        True,
        0.0,
        Rule.ON_AVERAGE,
        _dearer,
    ),
    Claim(
        "privacy_costs_cdm_steps",
        "For the CDM a higher privacy level entails a higher cost (from step to step)",
        "rank agreement τ of privacy and (c̄ − c*)/|c*| over the steps",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        lambda run, variant: rank_agreement(_cdm(run, variant).privacy, _cdm(run, variant).increase),
    ),
    Claim(
        "privacy_costs_pdm_steps",
        "For the PDM a higher privacy level entails a higher cost (from step to step)",
        "rank agreement τ of the sampled action's privacy and (c̄ − c*)/|c*| over the steps",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        lambda run, variant: rank_agreement(_pdm(run, variant).privacy, _pdm(run, variant).increase),
    ),
    Claim(
        "privacy_costs_cdm_budgets",
        "For the CDM a higher privacy level entails a higher cost (from budget to budget)",
        "rank agreement τ of privacy and (c̄ − c*)/|c*| over the budgets",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        lambda run, variant: rank_agreement(
            run.variants[variant].cdm_curve.privacy, run.variants[variant].cdm_curve.increase
        ),
    ),
    Claim(
        "privacy_costs_pdm_budgets",
        "For the PDM a higher privacy level entails a higher cost (from budget to budget)",
        "rank agreement τ of expected privacy and expected (c̄ − c*)/|c*| over the budgets",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        lambda run, variant: rank_agreement(
            run.variants[variant].pdm_curve.privacy, run.variants[variant].pdm_curve.increase
        ),
    ),
    Claim(
        "privacy_costs_between",
        "The PDM's higher cost is explained by its higher privacy",
        "1 where the decision maker of higher mean privacy has the higher mean cost, −1 where the lower",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        _together,
    ),
    Claim(
        "privacy_grows_cdm",
        "The CDM's privacy level increases with its cost budget",
        "rank agreement τ of privacy and budget",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        lambda run, variant: rank_agreement(run.variants[variant].cdm_curve.privacy, run.budgets),
    ),
    Claim(
        "privacy_grows_pdm",
        "The PDM's privacy level increases with its cost budget",
        "rank agreement τ of expected privacy and budget",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        lambda run, variant: rank_agreement(run.variants[variant].pdm_curve.privacy, run.budgets),
    ),
    Claim(
        "saturates_cdm",
        "At a certain budget the CDM's privacy level saturates",
        "growth of privacy from the second largest budget to the largest, as a share",
        False,
        SATURATED,
        Rule.ON_AVERAGE,
        lambda run, variant: _last_growth(run.variants[variant].cdm_curve.privacy),
    ),
    Claim(
        "saturates_pdm",
        "At a certain budget the PDM's privacy level saturates",
        "growth of expected privacy from the second largest budget to the largest, as a share",
        False,
        SATURATED,
        Rule.ON_AVERAGE,
        lambda run, variant: _last_growth(run.variants[variant].pdm_curve.privacy),
    ),
    Claim(
        "pdm_saturates_later",
        "The PDM saturates at a higher budget than the CDM",
        "log10 of the PDM's saturation budget over the CDM's",
        True,
        _ROUNDING,
        Rule.ON_AVERAGE,
        _later,
    ),
    Claim(
        "value_grows_with_samples",
        "The PDM tends to the solution over all distributions as the number of samples M grows",
        "expected privacy gained by a grid four times finer",
        True,
        0.0,
        Rule.ON_AVERAGE,
        lambda run, variant: run.variants[variant].refining_gain.mean(),
    ),
)
"""The claims, in the paper's order of topics."""
