"""The page of a backtest: data for sliders over time and budget, thinned and rounded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from inscrutable.decision_makers import Frontier
from inscrutable.decision_makers.envelope import concave_envelope, undominated
from inscrutable.experiments.backtest_results import SEQUENTIAL, Backtest
from inscrutable.experiments.holding import Requirement, estimate_quality
from inscrutable.experiments.investor_model import BASIS_POINTS
from inscrutable.geometry import BeliefSet
from inscrutable.reports.backtest import notes_of, timing_of, warnings_of, written_table
from inscrutable.reports.backtest_plots import draw_hidden, step_of
from inscrutable.reports.backtest_verdict import cautions, limits, verdict
from inscrutable.reports.names import FULL_NAMES, spelled
from inscrutable.reports.page.budget_sweep import BudgetSweep, PlayedAt
from inscrutable.reports.page.content import PageContent, PageFigure, PagePicture, PageSlider, PageTable
from inscrutable.reports.page.manifest import hash_of, versions_told
from inscrutable.reports.style import PERCENT, REGIME_COLOURS, around, looks_of
from inscrutable.validation import Array

_DIGITS = 4
_CURVE_POINTS = 64
_PER_MILLE = 1000.0
_MOST_ASSETS = 12
"""Most rows in the table of weights; one more row has the sum of the other assets."""
_TRIANGLE = 3
"""Number of regimes for a plot on a triangle."""


def backtest_content(result: Backtest, title: str | None, manifest: Mapping[str, str]) -> PageContent:
    """Return the content of a backtest's page; `manifest` has further lines for the page's manifest."""
    sweep = BudgetSweep(result)
    played = {name: [sweep.played(name, b) for b in range(len(sweep.amounts))] for name in sweep.names}
    figures = sweep_figures(sweep, played)
    word, market = result.market.frequency.word, result.market
    start = int(np.abs(sweep.steps - step_of(result)).argmin())
    budgets = budget_texts(result, sweep.amounts)
    budgets[sweep.own] += ", the backtest's own"
    return PageContent(
        title=title
        or f"What weights on {len(result.assets)} assets reveal of a belief over {len(result.regimes)} market regimes",
        header=f"Backtest over {len(result.beliefs)} {word}s, {result.dates[0]:%Y-%m-%d} to {result.dates[-1]:%Y-%m-%d}; "
        f"{timing_of(result)}.",
        verdict=verdict(result),
        lead=_lead(result),
        limits=limits(result),
        cautions=[*warnings_of(result), *cautions(result)],
        tables=[PageTable("Figures of the backtest", ["", *map(spelled, result.names)], written_table(result))],
        sliders=[
            PageSlider("step", f"Decision at the end of {word}", sweep.dates, start),
            PageSlider("budget", "Budget for privacy", budgets, sweep.own),
        ],
        figures=_figures(result, sweep),
        details=[_budget_table(sweep, figures, budgets), *_asset_tables(result)],
        failures=_failures(result),
        notes=[*notes_of(result), *_own_notes(result, sweep)],
        manifest={
            **versions_told(),
            "seed": str(result.settings.seed),
            "budget": str(result.budget),
            "privacy measure": repr(result.settings.measure),
            "regimes": ", ".join(result.regimes),
            "risk aversion": f"{result.settings.risk_aversion:g}",
            "cost of trading": f"{result.settings.cost_bps:g} bp a unit traded",
            "training sample": f"to {market.training.index[-1]:%Y-%m-%d}, {market.n_training} rows",
            "data": f"{len(market.returns)} rows, {market.returns.index[0]:%Y-%m-%d} to {market.returns.index[-1]:%Y-%m-%d}",
            "data, SHA-256 as CSV": hash_of(market.returns),
            "fit": f"log-likelihood {result.fit.log_likelihood:.2f}, best of {len(result.fit.restarts)} starts",
            **manifest,
        },
        script="backtest.js",
        data={**page_data(sweep, played), "sweep": figures},
    )


def _lead(result: Backtest) -> PagePicture | None:
    with TemporaryDirectory() as folder:
        pictures = [path for path in draw_hidden(result, Path(folder)) if path.suffix == ".svg"]
        drawn = [path.read_text("utf-8") for path in pictures]
    word, part = result.market.frequency.word, result.sequential
    there = "" if part is None else f", where the error without weights is {part.maker.chain.prior.error:.2f}"
    caption = (
        f"The marks are the errors of two observers under each decision maker, over {len(result.beliefs)} {word}s. A belief is "
        "hidden where its mark is right of the grey zone and not crossed out; a cross says that the observer names the regime "
        f"too often. The dashed line is the error without weights in these {word}s. The ceiling is the largest error that any "
        f"rule of the same long-run regret leaves the aware observer in the long run{there}; the naive one may err more, and "
        f"so may the aware one in few {word}s."
    )
    return PagePicture("Error of two observers", caption, drawn[0]) if drawn else None


def budget_texts(result: Backtest, amounts: Array) -> list[str]:
    """Return budgets as text, in the unit of the backtest's own."""
    if result.budget.is_relative:
        return [f"{PERCENT * amount:.3g}% of the optimal cost" for amount in amounts]
    return [f"regret of {amount:.3g}" for amount in amounts]


def page_data(sweep: BudgetSweep, played: Mapping[str, list[tuple[PlayedAt, ...]]]) -> dict[str, Any]:
    """Return the script's data: rounded numbers, every belief set once."""
    result, sets = sweep.result, _Sets()
    looks = looks_of(result.names)
    scale = np.where(sweep.scale > 0, sweep.scale, np.nan)
    relative = result.budget.is_relative
    published = [budgets[sweep.own] for name, budgets in played.items() if name != "ODM"]
    return {
        "regimes": result.regimes,
        "colours": [REGIME_COLOURS[i % len(REGIME_COLOURS)] for i in range(len(result.regimes))],
        "makers": sweep.names,
        "spelled": {name: spelled(name) for name in result.names},
        "looks": {name: look._asdict() for name, look in looks.items()},
        "lotteries": [name for name in sweep.names if result.episode.records[name].lotteries is not None],
        "word": result.market.frequency.word,
        "dates": sweep.dates,
        "unit": "% of the optimal cost" if relative else "the cost's unit",
        "factor": PERCENT if relative else 1.0,
        "amounts": [float(f"{amount:.6g}") for amount in sweep.amounts],
        "own": sweep.own,
        "beliefs": sweep.beliefs.round(_DIGITS),
        "played": {
            name: [
                [_entry(each, float(scale[t]), sets) for t, each in enumerate(at)]
                for at in (budgets if name != "ODM" else budgets[:1])
            ]
            for name, budgets in played.items()
        },
        "sets": sets.corners,
        "frontiers": [
            _curves(front, float(scale[t]), float(sweep.amounts[-1]), [at[t] for at in published])
            for t, front in enumerate(sweep.frontiers)
        ],
        "followed": _followed(sweep),
        "weights": _published_weights(sweep),
    }


def _published_weights(sweep: BudgetSweep) -> dict[str, Any]:
    """Return, per step, [assets, number of other held assets, weights per mille by decision maker].

    The last weight of a decision maker is the sum of the others.
    """
    result = sweep.result
    weights = np.stack([result.weights(name).to_numpy()[sweep.steps] for name in result.names])
    largest = np.abs(weights).max(axis=0)
    steps = []
    for t, most in enumerate(largest):
        held = int(np.count_nonzero(most >= result.problem.constraints.min_slack))
        shown = np.sort(np.argsort(-most, kind="stable")[: min(held, _MOST_ASSETS)])
        each = weights[:, t, shown]
        others = weights[:, t].sum(axis=1, keepdims=True) - each.sum(axis=1, keepdims=True)
        rows = [each] if held <= _MOST_ASSETS else [each, others]
        steps.append([shown, held - len(shown), np.rint(_PER_MILLE * np.hstack(rows)).astype(int)])
    return {"assets": result.assets, "makers": result.names, "steps": steps}


def _followed(sweep: BudgetSweep) -> dict[str, Any] | None:
    """Return the aware observer's belief over time, the bits leaked so far, and its error so far."""
    result = sweep.result
    if result.aware is None:
        return None
    read = {name: result.followed_estimates(name).to_numpy() for name in result.names}
    own = result.beliefs.to_numpy()
    counted = np.arange(1, len(own) + 1)
    figures = result.figures[result.names[0]]
    return {
        # Last first: the sequential rule is then next to the investor's own belief.
        "beliefs": {name: read[name][sweep.steps].round(_DIGITS) for name in result.names[:0:-1]},
        "bits": {name: result.aware.bits[name].cumsum()[sweep.steps].round(_DIGITS) for name in result.names},
        "errors": {
            name: np.sqrt(((rows - own) ** 2).sum(axis=1).cumsum() / counted)[sweep.steps].round(_DIGITS)
            for name, rows in read.items()
        },
        "ceilings": {name: _rounded(most) for name, most in result.aware.ceilings.items()},
        "without": _rounded(figures["error_without"]),
        "asked": _rounded(Requirement(figures["error_without"], figures["base_rate"]).least_error),
    }


class _Sets:
    """Belief sets as lists of corners, each listed once."""

    def __init__(self) -> None:
        self.corners: list[list[list[float]]] = []
        self._places: dict[bytes, int] = {}

    def place(self, found: BeliefSet) -> int:
        """Return the index of a set in the page's list of distinct sets."""
        corners = found.vertices()
        if found.dimension > 1 and found.n_states == _TRIANGLE:
            corners = around(corners)
        rounded = np.round(corners, _DIGITS) + 0.0
        key = rounded.tobytes()
        if key not in self._places:
            self._places[key] = len(self.corners)
            self.corners.append(rounded.tolist())
        return self._places[key]


def _entry(each: PlayedAt, scale: float, sets: _Sets) -> list[Any]:
    """[atoms [set, probability, regret in the budget's unit, privacy], drawn, estimate of the aware observer]."""
    atoms = [
        [sets.place(found), round(atom.probability, _DIGITS), _significant(atom.regret / scale), _rounded(atom.privacy)]
        for atom, found in zip(each.atoms, each.sets, strict=True)
    ]
    return [atoms, each.drawn, None if each.aware is None else np.round(each.aware, _DIGITS)]


def _significant(value: float) -> float:
    return float(f"{value:.4g}")


def _rounded(value: float) -> float:
    return round(value, _DIGITS) if np.isfinite(value) else value


def _curves(front: Frontier, scale: float, most: float, played: Sequence[PlayedAt]) -> dict[str, Any]:
    """Return both curves up to the largest budget, in the budget's unit: steps for single decisions, corners for lotteries.

    The published decisions, `played`, were found by a search and may be better than the candidates.
    """
    if not scale > 0:
        return {"single": [], "mixed": []}
    atoms = [(atom.regret / scale, atom.privacy) for each in played for atom in each.atoms]
    published, single = np.array(atoms).reshape(-1, 2), front.points / [scale, 1.0]
    published = published[np.isfinite(published[:, 1])]
    single = single[(single[:, 0] <= most) & np.isfinite(single[:, 1])]
    if len(single) > _CURVE_POINTS:
        # The last point of each cell; cells are finest at small budgets.
        cell = np.floor(np.sqrt(single[:, 0] / most) * _CURVE_POINTS)
        single = single[np.append(cell[1:] > cell[:-1], True)]
    single = np.vstack([single, published[published[:, 0] <= most]])
    single = single[undominated(*single.T)]
    corners = np.vstack([front.corners / [scale, 1.0], published])
    corners = corners[concave_envelope(*corners.T)]
    mixed = corners[corners[:, 0] <= most]
    if len(mixed) and len(mixed) < len(corners):
        mixed = np.vstack([mixed, [most, np.interp(most, *corners.T)]])
    return {"single": _points(single), "mixed": _points(mixed)}


def _points(points: Array) -> list[list[float]]:
    return [[_significant(x), round(float(y), _DIGITS)] for x, y in points]


def sweep_figures(sweep: BudgetSweep, played: Mapping[str, list[tuple[PlayedAt, ...]]]) -> dict[str, dict[str, Any]]:
    """Return means over the steps at every budget: privacy, regret, and errors of both observers (root mean square)."""
    found = {}
    for name, budgets in played.items():
        rows = [_means(sweep, at) for at in budgets]
        found[name] = {key: [row[key] for row in rows] for key in rows[0]}
    return found


def _means(sweep: BudgetSweep, at: tuple[PlayedAt, ...]) -> dict[str, float]:
    privacy = np.array([sum(a.probability * a.privacy for a in each.atoms) for each in at])
    regret = np.array([sum(a.probability * a.regret for a in each.atoms) for each in at])
    centres = np.array([each.sets[each.drawn].center() for each in at])
    aware = np.array([np.full(centres.shape[1], np.nan) if each.aware is None else each.aware for each in at])
    reached = np.isfinite(privacy)
    total = float(sweep.scale.sum())
    return {
        "privacy": _rounded(float(privacy[reached].mean())) if reached.any() else float("nan"),
        "regret": _significant(float(regret.sum()) / total) if total > 0 else float("nan"),
        **_read(centres, sweep.beliefs, "naive", "named"),
        **_read(aware, sweep.beliefs, "aware", "named_aware"),
    }


def _read(estimates: Array, beliefs: Array, error: str, named: str) -> dict[str, float]:
    found = estimate_quality(estimates, beliefs)
    return {error: _rounded(found.error), named: _rounded(found.named)}


def _figures(result: Backtest, sweep: BudgetSweep) -> list[PageFigure]:
    return [
        *_figures_of_one(result),
        *_figures_over_time(result),
        *_followed_figures(result),
        PageFigure(
            "sweep",
            "Both observers at every budget",
            "The curves are the error of the estimate, the root mean square over time.",
            True,
        ),
    ]


def _figures_of_one(result: Backtest) -> list[PageFigure]:
    """Return the figures of one decision."""
    shown, distance = "least and greatest probability, and the centre, of the beliefs", ""
    if len(result.regimes) == _TRIANGLE:
        shown, distance = (
            "the beliefs",
            " Dashed lines are their distances from π, grey dots the beliefs of other times.",
        )
    unlike = (
        ""
        if result.sequential is None
        else " The sequential rule depends on all earlier decisions and is not drawn here."
    )
    return [
        PageFigure(
            "simplex",
            "What the observer reads from one decision",
            f"The star is the investor's belief π. Coloured marks are {shown} that the naive observer reads from each "
            f"published decision.{distance} Hollow or faint marks are decisions that the lottery did not draw, with their "
            "probabilities in percent. A dashed ring in the colour of a rule is the estimate that an aware observer makes from "
            f"this decision alone.{unlike}",
        ),
        PageFigure(
            "frontier",
            "Privacy against regret, every budget",
            "Privacy counts for the naive observer alone. The solid line is the best single decision, the dashed one the best "
            "lottery, in expectation; the vertical line is the budget. The black line is the tangent of the dashed one at the "
            "budget: its slope is the privacy that one more unit of expected regret buys.",
        ),
        PageFigure(
            "now",
            "This decision in numbers",
            "The rows are the decisions at this budget, with their regret and the observers' estimates. Privacy Ψ is the "
            "distance from the belief to those that the naive observer reads.",
            True,
        ),
        PageFigure(
            "weights",
            "Published weights of this decision",
            "The weights are in % of wealth, at the backtest's own budget; for a lottery they are those of the draw. The table "
            f"has at most the {_MOST_ASSETS} largest holdings of any decision maker, and the sum of the others.",
            True,
        ),
    ]


def _figures_over_time(result: Backtest) -> list[PageFigure]:
    """Return the figures of all decisions at one budget."""
    word, absent = result.market.frequency.word, ""
    if result.sequential is not None:
        figures = result.figures[SEQUENTIAL]
        mean, most = (BASIS_POINTS * figures[name] for name in ("mean_regret", "largest_regret"))
        absent = (
            f" The {FULL_NAMES[SEQUENTIAL]} rule, whose budget holds in the long run, is not drawn: its regret is "
            f"{mean:.2g} basis points on average, at most {most:.2g} in a {word}."
        )
    return [
        PageFigure(
            "privacy",
            "Privacy over time, at this budget",
            f"There is one mark per {word}; for a lottery it is the expectation. The vertical line is "
            "the decision above.",
            True,
        ),
        PageFigure(
            "cost", "Regret over time, at this budget", f"For a lottery the mark is its expectation.{absent}", True
        ),
        PageFigure(
            "beliefs",
            "What each observer believes, at this budget",
            "The colour is the likeliest regime, the height its probability. The first row is the investor's own belief; the "
            "others are what is read from that decision alone (for a lottery, from the draw), at face value and by the aware "
            "observer. A gap is a decision that no belief explains.",
            True,
        ),
    ]


def _followed_figures(result: Backtest) -> list[PageFigure]:
    if result.aware is None:
        return []
    word, ceiling = result.market.frequency.word, ""
    if result.sequential is not None:
        without = result.sequential.maker.chain.prior.error
        ceiling = (
            " Dashed, over the later half, are the ceilings: the most that any rule of the same regret in the long run of the "
            f"model's regimes leaves there. The error without weights is {without:.2f} there."
        )
    return [
        PageFigure(
            "followed",
            f"What the aware observer believes who follows all {word}s",
            "The colour is the likeliest regime, the height its probability. The first row is the investor's own belief; the "
            "others are the belief of an aware observer who remembers all that was published and knows how the belief moves. "
            "All are drawn at the backtest's own budget.",
            True,
        ),
        PageFigure(
            "bits",
            f"Information that all {word}s have given the aware observer",
            f"The curves are the sums of the bits that each {word} adds to those before it, at the backtest's own budget. The "
            "numbers in the legend are the bits up to the decision above.",
        ),
        PageFigure(
            "errors",
            f"Error of the aware observer who follows all {word}s",
            f"The curves are the error of the estimate, the root mean square over all {word}s so far, at the backtest's own "
            f"budget. The numbers in the legend are the errors at the decision above.{ceiling}",
        ),
    ]


def _budget_table(sweep: BudgetSweep, figures: Mapping[str, Mapping[str, Any]], budgets: list[str]) -> PageTable:
    result, hiding = sweep.result, sweep.names[1:]
    columns = ["Budget"]
    keys = {
        "privacy": "privacy, mean",
        "regret": "regret, % of the optimal cost" if result.budget.is_relative else "regret, mean",
        "naive": "error, at face value",
        "aware": "error, aware observer",
    }
    for name in hiding:
        columns += [f"{spelled(name)}: {label}" for label in keys.values()]
    rows = []
    for b, text in enumerate(budgets):
        cells = [text]
        for name in hiding:
            for key in keys:
                value = figures[name][key][b] * (PERCENT if key == "regret" and result.budget.is_relative else 1.0)
                cells.append("-" if np.isnan(value) else f"{value:.3g}")
        rows.append(cells)
    return PageTable("Every budget, means over time", columns, rows)


def _asset_tables(result: Backtest) -> list[PageTable]:
    weights = {name: result.weights(name).mean() for name in result.names}
    rows = [[label, *(f"{PERCENT * weights[name][label]:.1f}" for name in result.names)] for label in result.assets]
    return [PageTable("Mean weights, % of wealth", ["Asset", *map(spelled, result.names)], rows)]


def _failures(result: Backtest) -> list[str]:
    word, found = result.market.frequency.word, []
    for name in result.names:
        figures = result.figures[name]
        for key, text in (
            ("n_nothing_affordable", "no privacy was affordable and the optimal decision was played"),
            ("n_empty_sets", "no belief explains the published weights"),
            ("n_privacy_not_finite", "the goal was missed or the set is empty, and privacy is left out of the mean"),
        ):
            if figures[key] > 0:
                found.append(f"{name}: in {figures[key]:.0f} of {len(result.beliefs)} {word}s {text}.")
    collapsed = sum(bool(each.collapsed) for each in result.fit.restarts)
    if collapsed:
        found.append(
            f"Fit: {collapsed} of {len(result.fit.restarts)} starts collapsed; such a start is used only if all do."
        )
    return found


def _own_notes(result: Backtest, sweep: BudgetSweep) -> list[str]:
    limits = sweep.amounts[sweep.own] * sweep.scale
    rough = np.array([front.deterministic(limit) for front, limit in zip(sweep.frontiers, limits, strict=True)])
    fine = result.privacy("CDM")[sweep.steps]
    both = np.isfinite(rough) & np.isfinite(fine)
    notes = []
    if both.any():
        notes.append(
            "At the backtest's own budget the page shows what was published. At other budgets it shows the best of "
            f"{len(result.candidates)} candidates without the last polish: at the own budget these reach a mean privacy of "
            f"{rough[both].mean():.3f} (CDM) where {fine[both].mean():.3f} was published. Lotteries are drawn by the same "
            "uniform number at every budget but the own one. The aware observer knows each budget as well."
        )
    if len(sweep.steps) < len(result.beliefs):
        notes.append(
            f"Figures show {len(sweep.steps)} of {len(result.beliefs)} decisions, evenly over time; tables of the backtest "
            "rest on all, those of every budget on the ones shown."
        )
    return notes
