"""Every claim of the paper's Section V as a quantitative test; the criteria were fixed before any run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances
from inscrutable.errors import InputError
from inscrutable.experiments.market_runs import GLOBAL, PAPER, MarketRun, VariantRun
from inscrutable.validation import Array

MATERIAL = 0.01
"""Least gain in privacy that counts: one percentage point of belief."""

SATURATED = 0.01
"""Privacy within this share of its value at the largest budget counts as saturated."""

ERRORS = 2.0
"""Standard errors over the markets by which an average must be on the claimed side."""


class Rule(Enum):
    """The condition under which a claim holds over many markets."""

    ALWAYS = "in every market"
    ON_AVERAGE = f"on average over the markets, by {ERRORS:g} standard errors, or in every market"
    SOMETIMES = "in at least one market"


class Verdict(Enum):
    """The verdict on a claim."""

    HOLDS = "holds"
    FAILS = "fails"
    ONLY_LOCAL = "holds only with the local solver"
    ONLY_GLOBAL = "holds only with the global solver"
    OPEN_GLOBAL = "holds with the local solver, inconclusive with the global one"
    OPEN_LOCAL = "holds with the global solver, inconclusive with the local one"
    INCONCLUSIVE = "inconclusive"


@dataclass(frozen=True, eq=False)
class Claim:
    """A claim of the paper: a quantity of one market that must be at least, or at most, a bound.

    Args:
        key: A short name.
        text: The claim in the paper's words.
        rule: The markets in which the bound must hold.
        quantity: Description of the quantity measured in one market.
        measure: Function of a market and a variant's run in it; returns one number, or several that must all meet the bound.
        bound: The bound, in the quantity's unit.
        at_least: Whether the bound is a lower bound.
    """

    key: str
    text: str
    rule: Rule
    quantity: str
    measure: Callable[[MarketRun, VariantRun], ArrayLike]
    bound: float = 0.0
    at_least: bool = True

    @property
    def criterion(self) -> str:
        """The test in words."""
        return f"{self.quantity}: at {'least' if self.at_least else 'most'} {self.bound:g} {self.rule.value}"


@dataclass(frozen=True)
class Finding:
    """One claim in one variant.

    Args:
        measured: For claims on average: the mean. For claims about every market: the least favourable quantity. For claims
            about some market: the most favourable one. Of several quantities in a market, the least favourable counts.
        standard_error: Standard error of an average over the markets; NaN otherwise.
        share: Share of the markets in which the claim holds.
        holds: Whether the rule is met.
        is_open: Whether it is neither met nor missed: an average is within its standard errors of the bound.
    """

    measured: float
    standard_error: float
    share: float
    holds: bool
    is_open: bool = False


@dataclass(frozen=True)
class JudgedClaim:
    """A claim with the findings for the paper's decision makers and for the global ones."""

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
    is_open = found[PAPER].is_open or found[GLOBAL].is_open
    verdict = {
        (True, True): Verdict.HOLDS,
        (True, False): Verdict.OPEN_GLOBAL if is_open else Verdict.ONLY_LOCAL,
        (False, True): Verdict.OPEN_LOCAL if is_open else Verdict.ONLY_GLOBAL,
        (False, False): Verdict.INCONCLUSIVE if is_open else Verdict.FAILS,
    }[found[PAPER].holds, found[GLOBAL].holds]
    return JudgedClaim(claim.key, claim.text, claim.criterion, len(runs), found[PAPER], found[GLOBAL], verdict)


def _finding(claim: Claim, runs: Sequence[MarketRun], variant: str) -> Finding:
    measured = [np.atleast_1d(np.asarray(claim.measure(run, run.variants[variant]), dtype=float)) for run in runs]
    return finding_of(np.array(measured), claim.rule, claim.bound, at_least=claim.at_least)


def finding_of(measured: Array, rule: Rule, bound: float, *, at_least: bool = True) -> Finding:
    """Return the finding whether quantities (markets, n) meet a bound under a rule."""
    sign = 1.0 if at_least else -1.0
    # Signed so that larger is better.
    values, bound = sign * measured, sign * bound
    share = float((values >= bound).all(axis=1).mean())
    if rule is not Rule.ON_AVERAGE:
        per_market = values.min(axis=1)
        extreme = per_market.min() if rule is Rule.ALWAYS else per_market.max()
        holds = share == 1.0 if rule is Rule.ALWAYS else share > 0.0
        return Finding(sign * float(extreme), float("nan"), share, holds)
    means = values.mean(axis=0)
    errors = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    worst = int((means - ERRORS * errors).argmin())
    # With ties in almost every market the average is a rounding error: if every market meets the bound, so does the average.
    holds = share == 1.0 or bool(means[worst] - ERRORS * errors[worst] >= bound)
    is_open = not holds and bool((means + ERRORS * errors >= bound).all())
    return Finding(sign * float(means[worst]), float(errors[worst]), share, holds, is_open)


def rank_agreement(first: ArrayLike, second: ArrayLike) -> float:
    """Return Kendall's τ_b of two sequences, 0 where one is constant; differences of rounding size count as ties.

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


def _apart(first: Array, second: Array) -> Array:
    """Return the difference; one of rounding size counts as zero."""
    difference = first - second
    return np.where(np.abs(difference) > tolerances.CLAIM_ROUNDING, difference, 0.0)


def _more_private(run: MarketRun, did: VariantRun) -> float:
    return float(_apart(did.pdm.privacy, did.cdm.privacy).mean())


def _dearer(run: MarketRun, did: VariantRun) -> float:
    return float(_apart(did.pdm.increase, did.cdm.increase).mean())


def _gain_of_starts(run: MarketRun, did: VariantRun) -> Array:
    if did is run.variants[PAPER]:
        return np.diff(run.starts)
    # The privacy that the local solver with all its starts gains over the global one.
    return np.array([max(run.starts[-1] - did.cdm.privacy[0], 0.0)])


def _together(run: MarketRun, did: VariantRun) -> float:
    more, dearer = _more_private(run, did), _dearer(run, did)
    return float(np.sign(more) * np.sign(dearer)) if abs(more) > _ROUNDING else 0.0


def _later(run: MarketRun, did: VariantRun) -> float:
    reached = [saturation_budget(run.budgets, curve.privacy) for curve in (did.pdm_curve, did.cdm_curve)]
    return float(np.log10(reached[0] / reached[1]))


def _dearer_the_more_private(where: str, run: MarketRun, did: VariantRun) -> float:
    """Over the steps or the budgets of one decision maker: "cdm", "pdm", "cdm_curve" or "pdm_curve"."""
    found = getattr(did, where)
    return rank_agreement(found.privacy, found.increase)


def _least_privacy(where: str, run: MarketRun, did: VariantRun) -> float:
    return float(getattr(did, where).privacy.min())


def _rising(where: str, run: MarketRun, did: VariantRun) -> float:
    return rank_agreement(getattr(did, where).privacy, run.budgets)


def _last_growth(where: str, run: MarketRun, did: VariantRun) -> float:
    privacy = getattr(did, where).privacy
    return float((privacy[-1] - privacy[-2]) / max(abs(privacy[-1]), _ROUNDING))


_ROUNDING = tolerances.CLAIM_ROUNDING
_BOTH = (("CDM", "cdm", ""), ("PDM", "pdm", "expected "))
_COST = "(c̄ − c*)/|c*|"

CLAIMS: tuple[Claim, ...] = (
    Claim(
        "odm_exposed",
        "The ODM's privacy is always compromised (the distance is zero)",
        Rule.ALWAYS,
        "largest privacy of the ODM over the steps",
        lambda run, did: run.odm.privacy.max(),
        tolerances.SAME_BELIEF,
        at_least=False,
    ),
    *(
        Claim(
            f"{which}_outside",
            f"The {who}'s private belief is never among those the adversary reconstructs",
            Rule.ALWAYS,
            f"least privacy of the {what} over the steps",
            partial(_least_privacy, which),
            _ROUNDING,
        )
        for who, which, what in (("CDM", "cdm", "CDM"), ("PDM", "pdm", "PDM's sampled action"))
    ),
    Claim(
        "sets_not_always_single",
        "The reconstructed sets often have a single element, but not always",
        Rule.SOMETIMES,
        "largest dimension of a reconstructed set",
        lambda run, did: max(each.dimension.max() for each in (run.odm, did.cdm, did.pdm)),
        1.0,
    ),
    Claim(
        "pdm_more_private",
        "The PDM is, on average, better at obfuscating its private belief than the CDM",
        Rule.ON_AVERAGE,
        "mean privacy of the PDM's sampled action minus the CDM's, over the steps",
        _more_private,
    ),
    Claim(
        "pdm_more_private_at_every_budget",
        "The PDM has, on average, a higher privacy than the CDM for any cost budget",
        Rule.ON_AVERAGE,
        "expected privacy of the PDM minus the CDM's, at every budget",
        lambda run, did: _apart(did.pdm_curve.privacy, did.cdm_curve.privacy),
    ),
    Claim(
        "local_optima",
        "The CDM falls short because it may end in a local optimum",
        Rule.ON_AVERAGE,
        "privacy gained by each increase of the number of starts (global solver: by starts beyond it)",
        _gain_of_starts,
        MATERIAL,
    ),
    Claim(
        "hard_budget",
        "The CDM falls short because its budget is hard, the PDM's holds on average",
        Rule.ON_AVERAGE,
        "expected privacy of a lottery minus that of the best single decision, same candidates",
        lambda run, did: did.mixing_gain.mean(),
        MATERIAL,
    ),
    Claim(
        "suboptimal_costs",
        "A suboptimal action costs no less than the optimal one",
        Rule.ALWAYS,
        f"least {_COST} of the CDM and the PDM over the steps",
        lambda run, did: min(did.cdm.increase.min(), did.pdm.increase.min()),
        -_ROUNDING,
    ),
    Claim(
        "cdm_within_budget",
        "The CDM never violates the cost budget",
        Rule.ALWAYS,
        f"largest {_COST} of the CDM over the steps minus c_b",
        lambda run, did: did.cdm.increase.max() - run.budget,
        _ROUNDING,
        at_least=False,
    ),
    Claim(
        "pdm_within_budget_on_average",
        "The PDM does not violate the cost budget on average",
        Rule.ALWAYS,
        f"largest expected {_COST} of the PDM over the steps minus c_b",
        lambda run, did: did.pdm.expected_increase.max() - run.budget,
        _ROUNDING,
        at_least=False,
    ),
    Claim(
        "pdm_over_budget_at_times",
        "A single action of the PDM may violate the cost budget",
        Rule.SOMETIMES,
        f"largest {_COST} of the PDM's sampled action over the steps minus c_b",
        lambda run, did: did.pdm.increase.max() - run.budget,
        _ROUNDING,
    ),
    Claim(
        "cdm_cheaper",
        "The CDM incurs, on average, a lower cost than the PDM",
        Rule.ON_AVERAGE,
        f"mean {_COST} of the PDM's sampled action minus the CDM's, over the steps",
        _dearer,
    ),
    *(
        Claim(
            f"privacy_costs_{which}_{over}s",
            f"For the {which.upper()} a higher privacy level entails a higher cost (from {over} to {over})",
            Rule.ON_AVERAGE,
            f"rank agreement τ of {privacy} and {cost} over the {over}s",
            partial(_dearer_the_more_private, which if over == "step" else f"{which}_curve"),
            _ROUNDING,
        )
        for which, over, privacy, cost in (
            ("cdm", "step", "privacy", _COST),
            ("pdm", "step", "the sampled action's privacy", _COST),
            ("cdm", "budget", "privacy", _COST),
            ("pdm", "budget", "expected privacy", f"expected {_COST}"),
        )
    ),
    Claim(
        "privacy_costs_between",
        "The PDM's higher cost is explained by its higher privacy",
        Rule.ON_AVERAGE,
        "1 where the decision maker of higher mean privacy has the higher mean cost, −1 where the lower",
        _together,
        _ROUNDING,
    ),
    *(
        Claim(
            f"privacy_grows_{which}",
            f"The {who}'s privacy level increases with its cost budget",
            Rule.ON_AVERAGE,
            f"rank agreement τ of {of}privacy and budget",
            partial(_rising, f"{which}_curve"),
            _ROUNDING,
        )
        for who, which, of in _BOTH
    ),
    *(
        Claim(
            f"saturates_{which}",
            f"At a certain budget the {who}'s privacy level saturates",
            Rule.ON_AVERAGE,
            f"growth of {of}privacy from the second largest budget to the largest, as a share",
            partial(_last_growth, f"{which}_curve"),
            SATURATED,
            at_least=False,
        )
        for who, which, of in _BOTH
    ),
    Claim(
        "pdm_saturates_later",
        "The PDM saturates at a higher budget than the CDM",
        Rule.ON_AVERAGE,
        "log10 of the PDM's saturation budget over the CDM's",
        _later,
        _ROUNDING,
    ),
    Claim(
        "value_grows_with_samples",
        "The PDM tends to the solution over all distributions as the number of samples M grows",
        Rule.ON_AVERAGE,
        "expected privacy gained by a grid four times finer",
        lambda run, did: did.refining_gain.mean(),
    ),
)
"""The claims, in the paper's order of topics."""
