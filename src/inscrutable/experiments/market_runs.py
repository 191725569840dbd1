"""One random market of the reproduction: what the paper's decision makers and the global ones do in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from inscrutable.budgets import Budget
from inscrutable.decision_makers import (
    Candidates,
    CounterAdversarialDecisionMaker,
    Decision,
    Decisions,
    Envelope,
    Frontier,
    LinearProgramme,
    LocalSearch,
    MixedDecisions,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    action_grid,
    decoy_grid,
    privacy_frontier,
    random_candidates,
)
from inscrutable.decision_makers.local_search import privacies_by_start
from inscrutable.experiments.episodes import relative_increase
from inscrutable.experiments.random_markets import MarketLaw, random_market
from inscrutable.experiments.sections import AtLeastTwo, Count, PlanFile, Positive, Rising
from inscrutable.geometry.grids import grid_size, resolution_for
from inscrutable.privacy import MaximalObfuscation
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

PAPER, GLOBAL = "paper", "global"
"""The two variants: the paper's local CDM with the PDM's programme over an action grid, and the global ones on decoys."""

CANDIDATE_KINDS = ("action grid", "random actions", "decoy grid")
_MOST_CANDIDATES = 2_000_000
_MOST_MARKETS = 10_000_000

SIDES = 3
"""The paper draws actions and beliefs as triangles."""

COARSER = 4
"""The number-of-samples claim compares the resolution asked for with one this many times coarser."""


Steps = Annotated[int, Field(ge=2, le=1_000_000)]


class ReproductionSettings(PlanFile):
    """What `reproduce` does; the defaults are the paper's numbers, and documented choices where it gives none.

    Args:
        seed: Whole number of at least 0; every market has a child seed of its own, whatever the number of processes.
        budget: c_b, a share of |c*|, above 0.
        markets: Markets over which the claims are judged, at least 2.
        simulations: Markets behind the mean of the trade-off and of the number of samples, at least 2.
        market_steps: Beliefs per market, at least 2.
        steps: Steps of the market that is drawn, at least 2.
        resolution: Of the action grid and the decoy grid, at least 2; 40 gives M = 861.
        budgets: Shares of |c*| of the trade-off, rising, above 0, at least two.
        starts: Numbers of random starts of the local solver to compare, rising from 1, at least two.
        sample_resolutions: Resolutions r of the number-of-samples study, rising; M = (r + 1)(r + 2)/2.
        law: How markets are drawn; three regimes and three assets, because both spaces are drawn as triangles.

    Raises:
        InputError: A number is out of its range.

    Source: the paper, Section V-A.

    Example:
        >>> ReproductionSettings().resolution
        40
    """

    kind: Literal["reproduction"] = "reproduction"
    name: Annotated[str, Field(min_length=1)] = "the paper's numerical section"
    budget: Positive = 0.1
    markets: AtLeastTwo = 100
    simulations: AtLeastTwo = 20
    market_steps: Steps = 3
    steps: Steps = 30
    resolution: AtLeastTwo = 40
    budgets: Annotated[Rising[Positive], Field(min_length=2)] = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
    starts: Annotated[Rising[Count], Field(min_length=2)] = (1, 5, 20)
    sample_resolutions: Annotated[Rising[Count], Field(min_length=1)] = (5, 10, 20, 40, 80)
    law: MarketLaw = MarketLaw()

    @model_validator(mode="after")
    def _fits(self) -> Self:
        for name, largest in (("resolution", self.resolution), ("sample_resolutions", max(self.sample_resolutions))):
            if grid_size(SIDES, largest) > _MOST_CANDIDATES:
                fits = resolution_for(SIDES, int(_MOST_CANDIDATES / 1.02))
                size = grid_size(SIDES, largest)
                raise ValueError(
                    f"{name} {largest:,} gives {size:,} candidates, more than fit; expected at most {fits:,}"
                )
        if max(self.markets, self.simulations) > _MOST_MARKETS:
            raise ValueError(f"markets and simulations should be at most {_MOST_MARKETS:,}")
        if self.starts[0] != 1:
            raise ValueError(f"starts should begin with 1, the paper's, got {self.starts}")
        if (self.law.regimes, self.law.assets) != (SIDES, SIDES):
            raise ValueError(
                f"the pictures need 3 regimes and 3 assets, the law has {self.law.regimes} and {self.law.assets}"
            )
        return self


@dataclass(frozen=True, eq=False)
class PlayedSteps:
    """A decision maker's steps: of a lottery the drawn decision, and what the lottery gives on average.

    All of shape (T,): privacy Ψ; `increase` (c̄ − c*)/|c*|; both again in expectation; the dimension of Π.
    """

    privacy: Array
    increase: Array
    expected_privacy: Array
    expected_increase: Array
    dimension: np.ndarray


@dataclass(frozen=True, eq=False)
class BudgetCurve:
    """Privacy and normalised cost increase at the first step by budget, shape (B,); of a lottery in expectation."""

    privacy: Array
    increase: Array


@dataclass(frozen=True, eq=False)
class VariantRun:
    """What one variant did in one market.

    Args:
        cdm: The CDM at the budget c_b.
        pdm: The PDM at the budget c_b.
        cdm_curve: The CDM at every budget.
        pdm_curve: The PDM at every budget.
        mixing_gain: What the lottery gains over the best affordable single one of the same candidates, shape (T,).
        refining_gain: What the PDM gains over a grid `COARSER` times coarser, shape (T,).
    """

    cdm: PlayedSteps
    pdm: PlayedSteps
    cdm_curve: BudgetCurve
    pdm_curve: BudgetCurve
    mixing_gain: Array
    refining_gain: Array


@dataclass(frozen=True, eq=False)
class MarketRun:
    """One market: the ODM, both variants, the starts and, where asked for, the number of samples.

    Args:
        budget: c_b, a share of |c*|.
        budgets: Those of the curves, rising.
        odm: The original decision maker.
        variants: `VariantRun` by variant name.
        starts: Privacy of the local CDM at the first step, best of the first 1, 5, … starts, shape (S,).
        samples: The PDM's expected privacy at the first step by kind of candidates and resolution; None if not asked.
    """

    budget: float
    budgets: tuple[float, ...]
    odm: PlayedSteps
    variants: Mapping[str, VariantRun]
    starts: Array
    samples: Mapping[str, Array] | None


def decision_makers(
    problem: DecisionProblem, settings: ReproductionSettings, variant: str, rng: np.random.Generator
) -> tuple[CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker]:
    """Return the CDM and PDM of one variant; the local solver draws its starts from `rng`."""
    budget = settings.budget
    if variant == PAPER:
        grid = action_grid(problem, settings.resolution)
        return (
            CounterAdversarialDecisionMaker(problem, budget=budget, method=LocalSearch(1, rng)),
            ProbabilisticDecisionMaker(problem, budget=budget, candidates=grid, method=LinearProgramme()),
        )
    decoys = decoy_grid(problem, settings.resolution)
    return (
        CounterAdversarialDecisionMaker(problem, budget=budget, candidates=decoys),
        ProbabilisticDecisionMaker(problem, budget=budget, candidates=decoys, method=Envelope()),
    )


def run_market(settings: ReproductionSettings, seed: np.random.SeedSequence, count_samples: bool) -> MarketRun:
    """Return the record of one market drawn, walked and decided with the children of `seed`."""
    draw, path, local, lottery, sampled = (np.random.default_rng(child) for child in seed.spawn(5))
    market = random_market(settings.law, rng=draw)
    problem, beliefs = market.problem, market.beliefs(settings.market_steps, rng=path)
    makers = {name: decision_makers(problem, settings, name, local) for name in (PAPER, GLOBAL)}
    single = {name: cdm.decide_many(beliefs) for name, (cdm, _) in makers.items()}
    variants = {}
    for name, (_, pdm) in makers.items():
        grid = action_grid if name == PAPER else decoy_grid
        fine = _frontiers(problem, beliefs, pdm.candidates)
        coarse = _frontiers(problem, beliefs, grid(problem, max(1, settings.resolution // COARSER)))
        mixed = _at_budget(fine, settings.budget)
        searched = _searched_curve(problem, single[PAPER][0], beliefs[:1], settings, local) if name == PAPER else None
        variants[name] = VariantRun(
            _played(single[name]),
            _lottery(pdm.decide_many(beliefs), lottery),
            _single_curve(fine[0], settings.budgets) if searched is None else searched,
            _mixed_curve(fine[0], settings.budgets),
            mixed - np.array([_single_curve(each, (settings.budget,)).privacy[0] for each in fine]),
            mixed - _at_budget(coarse, settings.budget),
        )
    return MarketRun(
        settings.budget,
        settings.budgets,
        _played(OriginalDecisionMaker(problem).decide_many(beliefs)),
        variants,
        _best_of_starts(problem, beliefs[0], settings, float(single[PAPER].privacy[0]), local),
        privacy_by_samples(problem, beliefs[0], settings, rng=sampled) if count_samples else None,
    )


def _local(problem: DecisionProblem, beliefs: Array, share: float, rng: np.random.Generator) -> Decisions:
    return CounterAdversarialDecisionMaker(problem, budget=share, method=LocalSearch(1, rng)).decide_many(beliefs)


def _best_of_starts(
    problem: DecisionProblem, belief: Array, settings: ReproductionSettings, first: float, rng: np.random.Generator
) -> Array:
    """A search from n starts is the best of n searches from one: the first is known, the others follow it."""
    found = np.array([first])
    if max(settings.starts) > 1:
        limit = Budget.relative(settings.budget).limit(float(problem.optimal_cost(belief)))
        others = LocalSearch(max(settings.starts) - 1, rng)
        reached = privacies_by_start(problem, belief, MaximalObfuscation(), limit, others)
        # Without a start the optimal decision is played, which hides nothing.
        found = np.concatenate([found, np.maximum(reached, 0.0)])
    return np.asarray(np.maximum.accumulate(found)[np.array(settings.starts) - 1])


def privacy_by_samples(
    problem: DecisionProblem, belief: Array, settings: ReproductionSettings, *, rng: np.random.Generator
) -> dict[str, Array]:
    """Return the PDM's expected privacy (K,) by kind of candidates, for every resolution of the settings."""
    values: dict[str, list[float]] = {kind: [] for kind in CANDIDATE_KINDS}
    for resolution in settings.sample_resolutions:
        grid = action_grid(problem, resolution)
        sets = (grid, random_candidates(problem, len(grid), rng=rng), decoy_grid(problem, resolution))
        for kind, candidates in zip(CANDIDATE_KINDS, sets, strict=True):
            found = _frontiers(problem, belief[None], candidates)
            values[kind].append(float(_at_budget(found, settings.budget)[0]))
    return {kind: np.array(each) for kind, each in values.items()}


def _frontiers(problem: DecisionProblem, beliefs: Array, candidates: Candidates) -> list[Frontier]:
    return [privacy_frontier(problem, belief, candidates=candidates) for belief in beliefs]


def _at_budget(frontiers: list[Frontier], share: float) -> Array:
    return np.array([_mixed_curve(each, (share,)).privacy[0] for each in frontiers])


def _limits(frontier: Frontier, shares: tuple[float, ...]) -> Array:
    return np.array([Budget.relative(share).limit(frontier.optimal_cost) for share in shares])


def _single_curve(frontier: Frontier, shares: tuple[float, ...]) -> BudgetCurve:
    limits = _limits(frontier, shares)
    place = np.searchsorted(frontier.points[:, 0], limits, side="right") - 1
    increase = relative_increase(frontier.points[place, 0], frontier.optimal_cost)
    return BudgetCurve(np.asarray(frontier.deterministic(limits)), increase)


def _mixed_curve(frontier: Frontier, shares: tuple[float, ...]) -> BudgetCurve:
    limits = _limits(frontier, shares)
    increase = relative_increase(np.minimum(limits, frontier.corners[-1, 0]), frontier.optimal_cost)
    return BudgetCurve(np.asarray(frontier.randomized(limits)), increase)


def _searched_curve(
    problem: DecisionProblem, known: Decision, first: Array, settings: ReproductionSettings, rng: np.random.Generator
) -> BudgetCurve:
    """The local solver anew at every budget; at c_b what it has already found."""
    found = [known if share == settings.budget else _local(problem, first, share, rng)[0] for share in settings.budgets]
    costs, optimal = (np.array([getattr(each, name) for each in found]) for name in ("cost", "optimal_cost"))
    return BudgetCurve(np.array([each.privacy for each in found]), relative_increase(costs - optimal, optimal))


def _increase(decisions: Decisions) -> Array:
    return relative_increase(decisions.cost - decisions.optimal_cost, decisions.optimal_cost)


def _played(decisions: Decisions) -> PlayedSteps:
    dimension = np.array([found.dimension for found in decisions.belief_set])
    increase = _increase(decisions)
    return PlayedSteps(decisions.privacy, increase, decisions.privacy, increase, dimension)


def _lottery(mixed: MixedDecisions, rng: np.random.Generator) -> PlayedSteps:
    drawn = _played(mixed.sample(rng=rng))
    expected = relative_increase(mixed.expected_cost - mixed.optimal_cost, mixed.optimal_cost)
    return PlayedSteps(drawn.privacy, drawn.increase, mixed.expected_privacy, expected, drawn.dimension)
