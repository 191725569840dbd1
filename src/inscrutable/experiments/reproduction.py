"""The numerical section of the paper, twice: its own way, and with the global CDM and decoys; and its claims judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from itertools import pairwise
from math import comb

import numpy as np

from inscrutable import validation
from inscrutable.decision_makers import Candidates, OriginalDecisionMaker
from inscrutable.decision_makers.results import Progress
from inscrutable.errors import InputError
from inscrutable.experiments.claims import JudgedClaim, judge_claims
from inscrutable.experiments.episodes import DecisionMaker, Episode, run_episode
from inscrutable.experiments.market_runs import GLOBAL, PAPER, MarketRun, Plan, decision_makers
from inscrutable.experiments.random_markets import Market, MarketLaw, random_market
from inscrutable.experiments.reproduction_study import ReproductionFile, law_section, run_of
from inscrutable.experiments.studies import Study
from inscrutable.experiments.studies.whole import all_rows, rows_of_whole, shipped
from inscrutable.experiments.studies.workshop import Row
from inscrutable.files import PathLike
from inscrutable.validation import Array

_SIDES = 3  # the paper draws actions and beliefs as triangles


@dataclass(frozen=True)
class Effort:
    """How much is computed beside the one market that is drawn.

    Args:
        resolution: Of the action grid and the decoy grid, at least 2; 40 gives M = 861.
        n_simulations: Markets behind the mean of the trade-off and of the number of samples, at least 2.
        n_market_steps: Beliefs per market, at least 2.
        budgets: Shares of |c*| of the trade-off, rising, above 0, at least two.
        starts: Numbers of random starts of the local solver to compare, rising from 1, at least two.
        sample_resolutions: Resolutions r of the number-of-samples study, rising; M = (r + 1)(r + 2)/2.

    Raises:
        InputError: A number is out of its range.
    """

    resolution: int = 40
    n_simulations: int = 20
    n_market_steps: int = 3
    budgets: tuple[float, ...] = (0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
    starts: tuple[int, ...] = (1, 5, 20)
    sample_resolutions: tuple[int, ...] = (5, 10, 20, 40, 80)

    def __post_init__(self) -> None:
        validation.count(self.resolution, "resolution", least=2)
        validation.count(self.n_simulations, "n_simulations", least=2)
        validation.count(self.n_market_steps, "n_market_steps", least=2)
        for number in self.starts:
            validation.count(number, "starts")
        for resolution in self.sample_resolutions:
            validation.count(resolution, "sample_resolutions")
        shares = validation.finite_array(self.budgets, "budgets", ndim=1)
        if shares.size and shares.min() <= 0:
            raise InputError(f"budgets must be above 0, got {shares.min():g}")
        for name, least in (("budgets", 2), ("starts", 2), ("sample_resolutions", 1)):
            values = getattr(self, name)
            if len(values) < least or any(a >= b for a, b in pairwise(values)):
                raise InputError(f"{name} must be at least {least} rising numbers, got {values}")
        if self.starts[0] != 1:
            raise InputError(f"starts must begin with 1, the paper's, got {self.starts}")


@dataclass(frozen=True)
class ReproductionSettings:
    """What `reproduce` does; the defaults are the paper's numbers, and documented choices where it gives none.

    Args:
        seed: Whole number of at least 0; every market has a child seed of its own, whatever the number of jobs.
        budget: c_b, a share of |c*|, above 0.
        n_steps: Steps of the market that is drawn, at least 2.
        n_markets: Markets over which the claims are judged, at least 2.
        n_jobs: Processes; −1 is one per core. It changes nothing but the time.
        law: How markets are drawn; three regimes and three assets, because both spaces are drawn as triangles.
        effort: The sizes of the studies.

    Raises:
        InputError: A number is out of its range.

    Source: the paper, Section V-A.

    Example:
        >>> ReproductionSettings().effort.resolution
        40
    """

    seed: int = 0
    budget: float = 0.1
    n_steps: int = 30
    n_markets: int = 100
    n_jobs: int = -1
    law: MarketLaw = field(default_factory=MarketLaw)
    effort: Effort = field(default_factory=Effort)

    def __post_init__(self) -> None:
        validation.count(self.seed, "seed", least=0)
        validation.positive(self.budget, "budget")
        validation.count(self.n_steps, "n_steps", least=2)
        validation.count(self.n_markets, "n_markets", least=2)
        validation.processes(self.n_jobs, "n_jobs")
        if (self.law.n_regimes, self.law.n_assets) != (_SIDES, _SIDES):
            raise InputError(
                f"the pictures need 3 regimes and 3 assets, the law has {self.law.n_regimes} and {self.law.n_assets}"
            )

    @property
    def plan(self) -> Plan:
        """What is done in every market."""
        effort = self.effort
        return Plan(
            self.law,
            float(self.budget),
            effort.resolution,
            effort.n_market_steps,
            tuple(float(share) for share in effort.budgets),
            tuple(effort.starts),
            tuple(effort.sample_resolutions),
        )


@dataclass(frozen=True, eq=False)
class VariantEpisode:
    """One variant in the drawn market: the episode and the candidates its PDM mixes."""

    episode: Episode
    candidates: Candidates


DrawnMarket = tuple[Market, Array, dict[str, VariantEpisode]]
"""A market, its beliefs, and its episode by variant."""


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Every result of the paper's numerical section.

    Args:
        settings: What was asked for.
        market: The market that is drawn.
        beliefs: Its private beliefs, shape (T,X).
        step: The timestep of the action and belief pictures.
        episodes: `VariantEpisode` by variant: "paper" and "global".
        runs: One record per random market: the claims use the first `n_markets`, the means the first `n_simulations`.
        claims: Every claim, judged.
    """

    settings: ReproductionSettings
    market: Market
    beliefs: Array
    step: int
    episodes: Mapping[str, VariantEpisode]
    runs: tuple[MarketRun, ...]
    claims: tuple[JudgedClaim, ...]

    @property
    def simulations(self) -> tuple[MarketRun, ...]:
        """The records behind the means."""
        return self.runs[: self.settings.effort.n_simulations]

    @property
    def sample_sizes(self) -> tuple[int, ...]:
        """M of the number-of-samples study."""
        return tuple(comb(r + _SIDES - 1, _SIDES - 1) for r in self.settings.effort.sample_resolutions)

    def trade_off(self, variant: str) -> dict[str, Array]:
        """Return privacy by simulation and budget, shape (n_simulations, B), for ODM, CDM and PDM."""
        found = [run.variants[variant] for run in self.simulations]
        cdm = np.array([each.cdm_curve.privacy for each in found])
        pdm = np.array([each.pdm_curve.privacy for each in found])
        odm = np.repeat([[run.odm.privacy[0]] for run in self.simulations], cdm.shape[1], axis=1)
        return {"ODM": odm, "CDM": cdm, "PDM": pdm}

    def convergence(self) -> dict[str, Array]:
        """Return the PDM's expected privacy by simulation and M, shape (n_simulations, K), by kind of candidates."""
        found = [run.samples for run in self.simulations if run.samples is not None]
        return {kind: np.array([each[kind] for each in found]) for kind in found[0]}


def reproduce(
    settings: ReproductionSettings | None = None,
    *,
    folder: PathLike | None = None,
    again: bool = True,
    progress: Progress | None = None,
) -> Reproduction:
    """Return every result of the paper's numerical section and each of its claims, judged over seeded random markets.

    The markets are a study: one task each, `studies/shipped/reproduction.toml` with the settings in place of its values.

    Args:
        settings: What to do; None is `ReproductionSettings()`.
        folder: Where the study's rows are kept while it runs, so that a run that was stopped is gone on with; None keeps
            nothing.
        again: Whether a finished run in the folder is done anew; otherwise its rows are taken.
        progress: Called with (parts done, parts in all).

    Returns:
        A `Reproduction`, the same for the same settings whatever the number of jobs.

    Raises:
        InputError: The folder cannot be written to, is in use, or holds another study.
        ModelError: The law admits no market with positive optimal costs.

    Cost: about a tenth of a second of one core per market, a third of it in the paper's local solver.
    Source: the paper, Section V.

    Example:
        >>> effort = Effort(resolution=6, n_simulations=2, n_market_steps=2, starts=(1, 2), sample_resolutions=(2, 4))
        >>> small = reproduce(ReproductionSettings(n_steps=2, n_markets=2, n_jobs=1, effort=effort))
        >>> small.claims[0].verdict.value
        'holds'
    """
    chosen = ReproductionSettings() if settings is None else settings
    with ThreadPoolExecutor(1) as beside:
        # Where there are processes, the market of the figures is done while they work.
        drawn = None if chosen.n_jobs == 1 else beside.submit(_drawn_market, chosen)
        rows, _ = all_rows(study_of(chosen), folder, jobs=chosen.n_jobs, again=again, progress=progress)
        return _judged(chosen, rows, _drawn_market(chosen) if drawn is None else drawn.result())


def reproduction_of(study: Study) -> Reproduction:
    """Return the reproduction that a finished study of its kind holds; the market of the figures is drawn again.

    Raises:
        InputError: The study is of another kind, was not run, or is not finished.

    Cost: about a second.
    """
    plan = study.plan
    if not isinstance(plan, ReproductionFile):
        raise InputError(f"{plan.name} is no study of the paper's numerical section")
    chosen = _settings_of(plan)
    rows, _ = rows_of_whole(study)
    return _judged(chosen, rows, _drawn_market(chosen))


def _settings_of(plan: ReproductionFile) -> ReproductionSettings:
    """The settings that `study_of` makes a plan of."""
    effort = Effort(
        plan.resolution,
        plan.simulations,
        plan.market_steps,
        tuple(plan.budgets),
        tuple(plan.starts),
        tuple(plan.sample_resolutions),
    )
    return ReproductionSettings(plan.seed, plan.budget, plan.steps, plan.markets, law=plan.market_law, effort=effort)


def _judged(settings: ReproductionSettings, rows: Sequence[Row], drawn: DrawnMarket) -> Reproduction:
    market, beliefs, episodes = drawn
    runs = tuple(run_of(settings.plan, row) for row in rows)
    step = _telling_step(episodes[PAPER].episode)
    return Reproduction(settings, market, beliefs, step, episodes, runs, judge_claims(runs[: settings.n_markets]))


def study_of(settings: ReproductionSettings) -> Study:
    """Return the study of the markets: the shipped one with the settings in place of its values."""
    effort = settings.effort
    return Study.of(
        shipped("reproduction")
        | {
            "seed": int(settings.seed),
            "budget": float(settings.budget),
            "markets": int(settings.n_markets),
            "simulations": int(effort.n_simulations),
            "market_steps": int(effort.n_market_steps),
            "steps": int(settings.n_steps),
            "resolution": int(effort.resolution),
            "budgets": [float(share) for share in effort.budgets],
            "starts": [int(number) for number in effort.starts],
            "sample_resolutions": [int(number) for number in effort.sample_resolutions],
            "law": law_section(settings.law),
        }
    )


def _drawn_market(settings: ReproductionSettings) -> DrawnMarket:
    (seed,) = np.random.SeedSequence(settings.seed).spawn(1)
    draw, path, local, lottery = (np.random.default_rng(child) for child in seed.spawn(4))
    market = random_market(settings.law, rng=draw)
    beliefs = market.beliefs(settings.n_steps, rng=path)
    episodes = {}
    for variant in (PAPER, GLOBAL):
        makers = decision_makers(market.problem, settings.plan, variant, local)
        by_name: dict[str, DecisionMaker] = {
            "ODM": OriginalDecisionMaker(market.problem),
            "CDM": makers.cdm,
            "PDM": makers.pdm,
        }
        episode = run_episode(market.problem, beliefs, by_name, rng=lottery)
        episodes[variant] = VariantEpisode(episode, makers.pdm.candidates)
    return market, beliefs, episodes


def _telling_step(episode: Episode) -> int:
    """Where the CDM hides best among the steps at which the PDM mixes several decisions that all hide the belief."""
    lotteries = episode.records["PDM"].lotteries
    hidden = episode.records["CDM"].decisions.privacy.copy()
    for step in range(len(hidden)):
        atoms = None if lotteries is None else lotteries[step]
        if atoms is None or len(atoms.probabilities) < 2 or atoms.privacies.min() <= 0:
            hidden[step] -= 2.0  # below every other step: no privacy exceeds √2
    return int(hidden.argmax())
