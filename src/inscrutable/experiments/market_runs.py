"""One random market of the reproduction: the decisions of the paper's decision makers and of the global ones in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from inscrutable.budgets import Budget
from inscrutable.decision_makers import (
    Candidates,
    Frontier,
    LocalSearch,
    action_grid,
    decoy_grid,
    privacy_frontier,
    random_candidates,
)
from inscrutable.decision_makers.local_search import privacies_by_start
from inscrutable.experiments.episodes import DecisionMaker, Episode, Record, relative_increase, run_episode
from inscrutable.experiments.makers import MAKERS
from inscrutable.experiments.random_markets import Market, MarketLaw, random_market
from inscrutable.experiments.sections import AtLeastTwo, Count, PlanFile, Positive, Rising
from inscrutable.experiments.setting import Setting, path_prior
from inscrutable.geometry.grids import grid_size, largest_resolution
from inscrutable.privacy import MaximalObfuscation
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

PAPER, GLOBAL = "paper", "global"
DECISION_MAKERS: Mapping[str, tuple[Mapping[str, Any], ...]] = {
    PAPER: ({"name": "ODM"}, {"name": "CDM", "method": "local", "starts": 1}, {"name": "PDM", "method": "programme"}),
    GLOBAL: ({"name": "ODM"}, {"name": "CDM"}, {"name": "PDM"}),
}
"""The two variants: the paper's local CDM with the PDM's programme over an action grid, and the global ones on decoys."""

CANDIDATE_KINDS = ("action grid", "random actions", "decoy grid")
_MOST_CANDIDATES = 2_000_000
_MOST_MARKETS = 10_000_000

SIDES = 3
"""The paper plots actions and beliefs as triangles."""

COARSER = 4
"""The number-of-samples claim compares the given resolution with one this many times coarser."""


Steps = Annotated[int, Field(ge=2, le=1_000_000)]


class ReproductionSettings(PlanFile):
    """Settings of `reproduce`; the defaults are the paper's numbers, or documented choices where it gives none.

    Args:
        seed: Whole number of at least 0; every market has its own child seed, for any number of processes.
        budget: c_b, a share of |c*|, above 0.
        markets: Number of markets for the claims, at least 2.
        simulations: Number of markets for the means of the trade-off and of the number-of-samples study, at least 2.
        market_steps: Beliefs per market, at least 2.
        steps: Steps of the market in the figures, at least 2.
        resolution: Resolution of the action grid and the decoy grid, at least 2; 40 gives M = 861.
        budgets: Budgets of the trade-off, shares of |c*|, ascending, above 0, at least two.
        starts: Numbers of random starts of the local solver to compare, ascending from 1, at least two.
        sample_resolutions: Resolutions r of the number-of-samples study, ascending; M = (r + 1)(r + 2)/2.
        law: The law of random markets; three regimes and three assets, because both spaces are plotted as triangles.

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
                fits = largest_resolution(SIDES, _MOST_CANDIDATES)
                size = grid_size(SIDES, largest)
                raise ValueError(
                    f"{name} {largest:,} gives {size:,} candidates, more than fit; expected at most {fits:,}"
                )
        for name in ("markets", "simulations"):
            if getattr(self, name) > _MOST_MARKETS:
                raise ValueError(f"{name} should be at most {_MOST_MARKETS:,}, got {getattr(self, name):,}")
        if self.starts[0] != 1:
            raise ValueError(f"starts should begin with 1, the paper's, got {self.starts}")
        if (self.law.regimes, self.law.assets) != (SIDES, SIDES):
            raise ValueError(
                f"the pictures need 3 regimes and 3 assets, the law has {self.law.regimes} and {self.law.assets}"
            )
        return self


@dataclass(frozen=True, eq=False)
class PlayedSteps:
    """A decision maker's steps: the decision (of a lottery, the drawn one) and expectations over the lottery.

    All of shape (T,): privacy Ψ; `increase` (c̄ − c*)/|c*|; the expectations of both; the dimension of Π.
    """

    privacy: Array
    increase: Array
    expected_privacy: Array
    expected_increase: Array
    dimension: np.ndarray


@dataclass(frozen=True, eq=False)
class BudgetCurve:
    """Privacy and normalised cost increase at the first step by budget, shape (B,); for a lottery in expectation."""

    privacy: Array
    increase: Array


@dataclass(frozen=True, eq=False)
class VariantRun:
    """Results of one variant in one market.

    Args:
        cdm: The CDM at the budget c_b.
        pdm: The PDM at the budget c_b.
        cdm_curve: The CDM at every budget.
        pdm_curve: The PDM at every budget.
        mixing_gain: Gain of the lottery over the best affordable single candidate, shape (T,).
        refining_gain: Gain of the PDM over one on a grid `COARSER` times coarser, shape (T,).
    """

    cdm: PlayedSteps
    pdm: PlayedSteps
    cdm_curve: BudgetCurve
    pdm_curve: BudgetCurve
    mixing_gain: Array
    refining_gain: Array


@dataclass(frozen=True, eq=False)
class MarketRun:
    """Results in one market: the ODM, both variants, the starts and, if requested, the number of samples.

    Args:
        budget: c_b, a share of |c*|.
        budgets: Budgets of the curves, ascending.
        odm: The original decision maker.
        variants: `VariantRun` by variant name.
        starts: Privacy of the local CDM at the first step, best of the first 1, 5, … starts, shape (S,).
        samples: The PDM's expected privacy at the first step by kind of candidates and resolution; None if not requested.
    """

    budget: float
    budgets: tuple[float, ...]
    odm: PlayedSteps
    variants: Mapping[str, VariantRun]
    starts: Array
    samples: Mapping[str, Array] | None


@dataclass(frozen=True, eq=False)
class VariantEpisode:
    """One variant in a market: the episode, and the setting with the candidates that its PDM mixes."""

    episode: Episode
    setting: Setting

    @property
    def candidates(self) -> Candidates:
        """The candidates of its PDM."""
        return self.setting.candidates


class Walk(NamedTuple):
    """A market, its beliefs, and its episode by variant."""

    market: Market
    beliefs: Array
    episodes: Mapping[str, VariantEpisode]


def walked(settings: ReproductionSettings, n_steps: int, streams: Sequence[np.random.Generator]) -> Walk:
    """Return the decisions of ODM, CDM and PDM of both variants at c_b in a market.

    The streams draw the market, its beliefs, the local solver's starts, and the lotteries.
    """
    draw, path, local, lottery = streams
    market = random_market(settings.law, rng=draw)
    problem, beliefs = market.problem, market.beliefs(n_steps, rng=path)
    episodes = {}
    for variant, chosen in DECISION_MAKERS.items():
        setting = _setting(problem, beliefs, variant, settings.resolution)
        makers = {each["name"]: _made(setting, each, settings.budget, local) for each in chosen}
        episodes[variant] = VariantEpisode(run_episode(problem, beliefs, makers, rng=lottery), setting)
    return Walk(market, beliefs, episodes)


def _setting(problem: DecisionProblem, beliefs: Array, variant: str, resolution: int) -> Setting:
    grid = action_grid if variant == PAPER else decoy_grid
    return Setting(problem, path_prior(beliefs), grid(problem, resolution))


def _made(setting: Setting, chosen: Mapping[str, Any], share: float, rng: np.random.Generator) -> DecisionMaker:
    made: DecisionMaker = MAKERS[chosen["name"]].make(setting, chosen, Budget.relative(share), lambda: rng)
    return made


def run_market(settings: ReproductionSettings, seed: np.random.SeedSequence, count_samples: bool) -> MarketRun:
    """Return the record of one market drawn, walked and decided with the children of `seed`."""
    *streams, sampled = (np.random.default_rng(child) for child in seed.spawn(5))
    market, beliefs, episodes = walked(settings, settings.market_steps, streams)
    problem, local = market.problem, streams[2]
    variants = {}
    for variant, walk in episodes.items():
        coarser = _setting(problem, beliefs, variant, max(1, settings.resolution // COARSER)).candidates
        fine, coarse = (_frontiers(problem, beliefs, each) for each in (walk.candidates, coarser))
        mixed, cdm = _at_budget(fine, settings.budget), walk.episode.records["CDM"]
        searched = variant == PAPER
        variants[variant] = VariantRun(
            _played(cdm),
            _played(walk.episode.records["PDM"]),
            _searched_curve(walk, settings, local) if searched else _single_curve(fine[0], settings.budgets),
            _mixed_curve(fine[0], settings.budgets),
            mixed - np.array([_single_curve(each, (settings.budget,)).privacy[0] for each in fine]),
            mixed - _at_budget(coarse, settings.budget),
        )
    return MarketRun(
        settings.budget,
        settings.budgets,
        _played(episodes[PAPER].episode.records["ODM"]),
        variants,
        _best_of_starts(problem, beliefs[0], settings, float(variants[PAPER].cdm.privacy[0]), local),
        privacy_by_samples(problem, beliefs[0], settings, rng=sampled) if count_samples else None,
    )


def _best_of_starts(
    problem: DecisionProblem, belief: Array, settings: ReproductionSettings, first: float, rng: np.random.Generator
) -> Array:
    """Return the best privacy by number of starts: n starts are the best of n single ones, the first of which is given."""
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


def _searched_curve(walk: VariantEpisode, settings: ReproductionSettings, rng: np.random.Generator) -> BudgetCurve:
    """Return the local solver's curve at the first step, solved at every budget; at c_b the known decision."""
    first, local = walk.episode.beliefs[:1], DECISION_MAKERS[PAPER][1]
    found = [
        walk.episode.records["CDM"].decisions[0]
        if share == settings.budget
        else _made(walk.setting, local, share, rng).decide_many(first)[0]
        for share in settings.budgets
    ]
    names = ("privacy", "cost", "optimal_cost")
    privacies, costs, optimal = (np.array([getattr(each, name) for each in found]) for name in names)
    return BudgetCurve(privacies, relative_increase(costs - optimal, optimal))


def _played(record: Record) -> PlayedSteps:
    dimension = np.array([found.dimension for found in record.decisions.belief_set])
    expected = relative_increase(record.expected_regret, record.decisions.optimal_cost)
    return PlayedSteps(record.decisions.privacy, record.relative_increase, record.expected_privacy, expected, dimension)
