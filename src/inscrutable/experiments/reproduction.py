"""The paper's numerical section in two variants, with its own solvers and with global ones, and the verdict on its claims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from math import comb

import numpy as np

from inscrutable import validation
from inscrutable.decision_makers.results import Progress
from inscrutable.experiments.claims import JudgedClaim, judge_claims
from inscrutable.experiments.episodes import Episode
from inscrutable.experiments.market_runs import PAPER, SIDES, MarketRun, VariantEpisode, Walk, walked
from inscrutable.experiments.market_runs import ReproductionSettings as ReproductionSettings
from inscrutable.experiments.random_markets import Market
from inscrutable.experiments.studies import Study
from inscrutable.experiments.studies.reproduction_tasks import run_of
from inscrutable.experiments.studies.tasks import Row
from inscrutable.experiments.studies.whole import all_rows, rows_of_whole
from inscrutable.files import PathLike
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class Reproduction:
    """Every result of the paper's numerical section.

    Args:
        settings: What was asked for.
        market: The market of the figures.
        beliefs: Its private beliefs, shape (T,X).
        step: The timestep of the action and belief pictures.
        episodes: `VariantEpisode` by variant: "paper" and "global".
        runs: One record per random market: the claims use the first `markets`, the means the first `simulations`.
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
        return self.runs[: self.settings.simulations]

    @property
    def sample_sizes(self) -> tuple[int, ...]:
        """M of the number-of-samples study."""
        return tuple(comb(r + SIDES - 1, SIDES - 1) for r in self.settings.sample_resolutions)

    def trade_off(self, variant: str) -> dict[str, Array]:
        """Return privacy by simulation and budget, shape (simulations, B), for ODM, CDM and PDM."""
        found = [run.variants[variant] for run in self.simulations]
        cdm = np.array([each.cdm_curve.privacy for each in found])
        pdm = np.array([each.pdm_curve.privacy for each in found])
        odm = np.repeat([[run.odm.privacy[0]] for run in self.simulations], cdm.shape[1], axis=1)
        return {"ODM": odm, "CDM": cdm, "PDM": pdm}

    def convergence(self) -> dict[str, Array]:
        """Return the PDM's expected privacy by simulation and M, shape (simulations, K), by kind of candidates."""
        found = [run.samples for run in self.simulations if run.samples is not None]
        return {kind: np.array([each[kind] for each in found]) for kind in found[0]}


def reproduce(
    settings: ReproductionSettings | None = None,
    *,
    jobs: int = -1,
    folder: PathLike | None = None,
    again: bool = True,
    progress: Progress | None = None,
) -> Reproduction:
    """Return every result of the paper's numerical section and each of its claims, judged over seeded random markets.

    The markets are the tasks of a study.

    Args:
        settings: The settings; None is `ReproductionSettings()`.
        jobs: Processes; −1 is one per core. It affects the time only.
        folder: Folder of the study's rows, from which a stopped run resumes; None stores nothing.
        again: Whether to repeat a finished run in the folder; otherwise its rows are used.
        progress: Called with (parts done, parts in all).

    Returns:
        A `Reproduction`; equal settings give equal results for any number of jobs.

    Raises:
        InputError: The folder cannot be written to, is in use, or holds another study.
        ModelError: The law admits no market with positive optimal costs.

    Cost: about 0.8 s of one core per market, most of it in the paper's local solver.
    Source: the paper, Section V.

    Example:
        >>> sizes = {"resolution": 6, "simulations": 2, "market_steps": 2, "starts": (1, 2), "sample_resolutions": (2, 4)}
        >>> small = reproduce(ReproductionSettings(steps=2, markets=2, **sizes), jobs=1)
        >>> small.claims[0].verdict.value
        'holds'
    """
    chosen = ReproductionSettings() if settings is None else settings
    validation.processes(jobs, "jobs")  # before the market of the figures begins
    with ThreadPoolExecutor(1) as beside:
        # With several processes, this one computes the market of the figures meanwhile.
        drawn = None if jobs == 1 else beside.submit(_drawn_market, chosen)
        rows, _ = all_rows(Study.of(chosen), folder, jobs=jobs, again=again, progress=progress)
        return _judged(chosen, rows, _drawn_market(chosen) if drawn is None else drawn.result())


def reproduction_of(study: Study) -> Reproduction:
    """Return the reproduction of a finished study of its kind; the market of the figures is computed again.

    Raises:
        InputError: The study is of another kind, was not run, or is not finished.

    Cost: about a second.
    """
    plan, rows, _ = rows_of_whole(study, ReproductionSettings, "study of the paper's numerical section")
    return _judged(plan, rows, _drawn_market(plan))


def _judged(settings: ReproductionSettings, rows: Sequence[Row], drawn: Walk) -> Reproduction:
    market, beliefs, episodes = drawn
    runs = tuple(run_of(settings, row) for row in rows)
    step = _telling_step(episodes[PAPER].episode)
    return Reproduction(settings, market, beliefs, step, episodes, runs, judge_claims(runs[: settings.markets]))


def _drawn_market(settings: ReproductionSettings) -> Walk:
    (seed,) = np.random.SeedSequence(settings.seed).spawn(1)
    return walked(settings, settings.steps, [np.random.default_rng(child) for child in seed.spawn(4)])


def _telling_step(episode: Episode) -> int:
    """Return the step of largest CDM privacy among those at which the PDM mixes several decisions that all hide the belief."""
    lotteries = episode.records["PDM"].lotteries
    hidden = episode.records["CDM"].decisions.privacy.copy()
    for step in range(len(hidden)):
        atoms = None if lotteries is None else lotteries[step]
        if atoms is None or len(atoms.probabilities) < 2 or atoms.privacies.min() <= 0:
            hidden[step] -= 2.0  # below every other step: no privacy exceeds √2
    return int(hidden.argmax())
