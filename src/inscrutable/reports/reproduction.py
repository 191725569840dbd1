"""Files of a reproduction: the paper's figures, the table of its claims, and all numbers."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.datasets.files import output_folder, write_json, write_table
from inscrutable.experiments.claims import Finding, JudgedClaim, Verdict
from inscrutable.experiments.episodes import Episode
from inscrutable.experiments.introduction import IntroductionClaim
from inscrutable.experiments.reproduction import Reproduction
from inscrutable.experiments.studies.executors import processes, renewed_quietly
from inscrutable.labels import listed
from inscrutable.reports.simplex_plots import plot_actions, plot_beliefs
from inscrutable.reports.style import COLUMN_WIDTH, drawing, save_figure
from inscrutable.reports.time_plots import plot_costs, plot_privacy
from inscrutable.reports.tradeoff_plots import plot_convergence, plot_tradeoff

_TRIANGLE_HEIGHT = 3.8
_CHART_HEIGHT = 2.9
_FEW = 30
"""Number of markets below which standard errors are too large to judge a claim."""


_VERDICTS = {
    Verdict.HOLDS: ("holds", "hold"),
    Verdict.ONLY_LOCAL: ("holds only with the local solver", "hold only with the local solver"),
    Verdict.ONLY_GLOBAL: ("holds only with the global solver", "hold only with the global solver"),
    Verdict.FAILS: ("fails", "fail"),
    Verdict.OPEN_GLOBAL: (
        "holds with the local solver and is inconclusive with the global one",
        "hold with the local solver and are inconclusive with the global one",
    ),
    Verdict.OPEN_LOCAL: (
        "holds with the global solver and is inconclusive with the local one",
        "hold with the global solver and are inconclusive with the local one",
    ),
    Verdict.INCONCLUSIVE: ("is inconclusive", "are inconclusive"),
}
"""Words for one claim and for several, by verdict."""


def write_reproduction(result: Reproduction, folder: str | os.PathLike[str], *, jobs: int = -1) -> list[Path]:
    """Write the figures, the claims and the summary of a reproduction.

    Args:
        result: What `reproduce` returned.
        folder: The folder, created if needed; files of the same names are replaced.
        jobs: Processes that draw; −1 is one per core.

    Returns:
        The paths written: per variant (paper and global) actions, beliefs, privacy, costs and tradeoff, then
        convergence, each as PNG and SVG; `claims.csv`; `summary.json`, the same bytes for the same settings.

    Raises:
        InputError: The folder or a file cannot be written.

    Cost: two or three seconds of one core, for the pictures.
    """
    from joblib import delayed

    place = output_folder(folder)
    apart = place.absolute()  # processes of earlier work may have another working folder
    tasks = [delayed(draw_variant)(result, variant, apart) for variant in result.episodes]
    with renewed_quietly():  # these processes computed the markets and use more memory
        drawn = processes(jobs)([*tasks, delayed(draw_convergence)(result, apart)])
    written = [place / path.name for paths in drawn for path in paths]
    write_table(claims_frame(result), place / "claims.csv")
    write_json(summary_of(result), place / "summary.json")
    return [*written, place / "claims.csv", place / "summary.json"]


def draw_variant(result: Reproduction, variant: str, folder: Path) -> list[Path]:
    """Draw the five result figures of one variant into a folder and return their paths."""
    found = result.episodes[variant]
    episode, step = found.episode, result.step
    records = episode.records
    written: list[Path] = []
    with drawing(COLUMN_WIDTH, _TRIANGLE_HEIGHT, subplot_kw={"projection": "ternary"}) as (figure, axes):
        actions = {name: record.decisions.action[step] for name, record in records.items()}
        mixed = records["PDM"].lotteries
        lottery = None if mixed is None else mixed[step]
        assets = tuple(f"asset {j + 1}" for j in range(episode.problem.n_actions))
        plot_actions(axes, actions, assets, candidates=found.candidates.actions, lottery=lottery)
        written += save_figure(figure, folder, f"{variant}_actions")
    with drawing(COLUMN_WIDTH, _TRIANGLE_HEIGHT, subplot_kw={"projection": "ternary"}) as (figure, axes):
        seen = {name: record.decisions.belief_set[step] for name, record in records.items()}
        plot_beliefs(axes, episode.beliefs[step], seen, result.market.world.names)
        written += save_figure(figure, folder, f"{variant}_beliefs")
    with drawing(COLUMN_WIDTH, _CHART_HEIGHT) as (figure, axes):
        plot_privacy(axes, {name: record.decisions.privacy for name, record in records.items()})
        written += save_figure(figure, folder, f"{variant}_privacy")
    with drawing(COLUMN_WIDTH, _CHART_HEIGHT) as (figure, axes):
        hiding = {name: record.relative_increase for name, record in records.items() if name != "ODM"}
        plot_costs(axes, hiding, budget=result.settings.budget)
        written += save_figure(figure, folder, f"{variant}_costs")
    with drawing(COLUMN_WIDTH, _CHART_HEIGHT) as (figure, axes):
        plot_tradeoff(axes, result.settings.budgets, result.trade_off(variant))
        written += save_figure(figure, folder, f"{variant}_tradeoff")
    return written


def draw_convergence(result: Reproduction, folder: Path) -> list[Path]:
    """Draw the privacy by number of samples into a folder and return the paths."""
    with drawing(COLUMN_WIDTH, _CHART_HEIGHT) as (figure, axes):
        plot_convergence(axes, result.sample_sizes, result.convergence())
        return save_figure(figure, folder, "convergence")


def claims_table(result: Reproduction) -> pd.DataFrame:
    """Return the claims as text: the claim, the measured quantity in either variant, the verdict."""
    rows = [
        {
            "claim": claim.text,
            "paper's solvers": _in_words(claim.paper),
            "global solvers": _in_words(claim.globally),
            "verdict": claim.verdict.value,
        }
        for claim in result.claims
    ]
    return pd.DataFrame(rows, index=pd.Index([claim.key for claim in result.claims], name="key"))


def verdict(result: Reproduction) -> str:
    """Return one sentence: how many of the paper's claims hold."""
    counts = Counter(claim.verdict for claim in result.claims)
    parts = [f"{counts[each]} {words[counts[each] > 1]}" for each, words in _VERDICTS.items() if counts[each]]
    said = listed(parts)
    return f"Of the paper's {len(result.claims)} claims, {said}, over {result.settings.markets} random markets."


def cautions(result: Reproduction) -> list[str]:
    """Return cautions on the verdict: few markets."""
    markets = result.settings.markets
    if markets >= _FEW:
        return []
    return [
        f"Caution: {markets} markets are few: averages have wide standard errors, and what holds in every one of them may "
        f"fail in others; {_FEW} or more say more."
    ]


def introduction_table(claims: Sequence[IntroductionClaim]) -> pd.DataFrame:
    """Return the claims of the introduction as text: the measured quantity against either observer, and the verdict."""
    rows = [
        {
            "claim": claim.text,
            "measured": claim.criterion,
            "decisions taken for optimal": "" if claim.naive is None else _in_words(claim.naive, "cases"),
            "rule known": _in_words(claim.knowing, "cases"),
            "verdict": claim.verdict.value,
        }
        for claim in claims
    ]
    return pd.DataFrame(rows, index=pd.Index([claim.key for claim in claims], name="key"))


def claims_frame(result: Reproduction) -> pd.DataFrame:
    """Return the claims with every number in full, one row per claim."""
    rows = []
    for claim in result.claims:
        row: dict[str, Any] = {"claim": claim.text, "criterion": claim.criterion, "markets": claim.n_markets}
        for variant, found in _findings(claim).items():
            row[f"{variant}: measured"] = found.measured
            row[f"{variant}: standard error"] = found.standard_error
            row[f"{variant}: share of markets"] = found.share
            row[f"{variant}: holds"] = found.holds
        rows.append({**row, "verdict": claim.verdict.value})
    return pd.DataFrame(rows, index=pd.Index([claim.key for claim in result.claims], name="key"))


def summary_of(result: Reproduction) -> dict[str, Any]:
    """Return all numbers of the figures and claims as plain data, independent of the number of jobs."""
    return {
        "settings": result.settings.model_dump(),
        "market": {
            "means": result.market.problem.means,
            "covariances": result.market.problem.covariances,
            "risk_aversion": result.market.problem.risk_aversion,
            "world": result.market.world.to_dict(),
        },
        "beliefs": result.beliefs,
        "step_of_the_simplex_figures": result.step,
        "variants": {name: _variant(result, name) for name in result.episodes},
        "samples": {
            "M": result.sample_sizes,
            "mean_expected_privacy": {kind: each.mean(axis=0) for kind, each in result.convergence().items()},
        },
        "claims": {
            claim.key: {
                "claim": claim.text,
                "criterion": claim.criterion,
                "markets": claim.n_markets,
                "verdict": claim.verdict,
                **_findings(claim),
            }
            for claim in result.claims
        },
        "cautions": cautions(result),
    }


def _findings(claim: JudgedClaim) -> dict[str, Finding]:
    return {"paper": claim.paper, "global": claim.globally}


def _in_words(found: Finding, what: str = "markets") -> str:
    error = "" if np.isnan(found.standard_error) else f" ± {found.standard_error:.3f}"
    # Adding zero keeps a rounded −0 from being written.
    return f"{round(found.measured, 3) + 0.0:.3f}{error}, {found.share:.0%} of {what}"


def _variant(result: Reproduction, variant: str) -> dict[str, Any]:
    episode = result.episodes[variant].episode
    return {
        "candidates": len(result.episodes[variant].candidates),
        "decision_makers": _decision_makers(episode),
        "mean_trade_off": {name: each.mean(axis=0) for name, each in result.trade_off(variant).items()},
    }


def _decision_makers(episode: Episode) -> Mapping[str, Any]:
    return {
        name: {
            "actions": record.decisions.action,
            "privacy": record.decisions.privacy,
            "normalised_cost_increase": record.relative_increase,
            "expected_privacy": record.expected_privacy,
            "expected_regret": record.expected_regret,
            "estimates": record.estimates,
            "status": [status.name.lower() for status in record.decisions.status],
        }
        for name, record in episode.records.items()
    }
