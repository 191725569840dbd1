"""The pictures of a backtest: beliefs and estimates, weights, privacy and cost over time, and one month in detail."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.decision_makers import Frontier, MixedDecision, privacy_frontier
from inscrutable.decision_makers.candidates import make_candidates
from inscrutable.errors import InputError
from inscrutable.experiments.backtest_results import Backtest
from inscrutable.experiments.episodes import relative_increase
from inscrutable.experiments.holding import Reached, Requirement
from inscrutable.geometry import BeliefSet
from inscrutable.reports.names import spelled
from inscrutable.reports.style import (
    BLACK,
    GREY,
    PAGE_WIDTH,
    PERCENT,
    REGIME_COLOURS,
    around,
    as_written,
    drawing,
    look_of,
    save_figure,
    ternary_labels,
)
from inscrutable.validation import Array

_HIDDEN_WIDTH = 4.4
"""Inches of the picture that a page begins with: its words stay legible on a phone."""

# Paul Tol's muted scheme, which colour-blind readers can tell apart, and a grey for all other assets together.
_ASSET_COLOURS = ("#332288", "#88CCEE", "#44AA99", "#117733", "#999933", "#DDCC77", "#CC6677", "#882255", "#AA4499")
_OTHERS = "#BBBBBB"
_APART = 400
"""Decisions over time whose marks have their full size: on the page's width more of them cover one another."""
_STEEP = 15.0
"""If regrets exceed this multiple of the budget, their axis is logarithmic beyond the budget."""
_WIDE = 4.0
"""Ratio of wealth from which its axis is logarithmic; below, it would have too few ticks."""


def draw_backtest(result: Backtest, folder: Path, *, month: str | None = None) -> list[Path]:
    """Draw all figures of a backtest into a folder and return their paths; the ternary one needs three regimes."""
    step = step_of(result, month)
    written = [
        *draw_hidden(result, folder),
        *draw_beliefs(result, folder),
        *draw_weights(result, folder),
        *draw_privacy_and_cost(result, folder),
        *draw_frontier(result, folder, step),
    ]
    return written + (draw_month(result, folder, step) if len(result.regimes) == 3 else [])


def step_of(result: Backtest, month: str | None = None) -> int:
    """Return the row of a month's last decision; for None the row in which the lottery gains most over the CDM."""
    if month is None:
        lottery, single = (result.episode.records[name].expected_privacy for name in ("PDM", "CDM"))
        gain = np.where(np.isfinite(lottery) & np.isfinite(single), lottery, 0.0)
        return int(np.where(np.isfinite(single), gain - single, 0.0).argmax())
    try:
        period = pd.Period(month)
        first, last = period.start_time, period.end_time
    except (ValueError, TypeError, AttributeError):
        raise InputError(f"month must be a date such as 2008-09 or 2008-09-30, got {month!r}") from None
    dates = result.dates.tz_localize(None)
    found = np.flatnonzero((dates >= first) & (dates <= last))
    if not found.size:
        raise InputError(f"no decision was made in {month}; they run from {dates[0]:%Y-%m-%d} to {dates[-1]:%Y-%m-%d}")
    return int(found[-1])


_LIFT = 0.2
"""Distance from a row of the naive observer's mark above it, and of the aware one's below it, where its ceiling is."""
_NAMED_TOO_OFTEN: dict[str, Any] = {"marker": "x", "markersize": 10, "color": BLACK, "markeredgewidth": 1.0}


def draw_hidden(result: Backtest, folder: Path) -> list[Path]:
    """Draw the errors of the naive and of the aware observer under each decision maker, as `hidden`; none without the
    latter."""
    if result.aware is None or len(result.names) == 1:
        return []
    own = result.figures[result.names[0]]
    asked = Requirement(own["error_without"], own["base_rate"])
    names, rows = result.names, np.arange(len(result.names))[::-1]
    kinds = {"face_value": "naive observer, at face value", "followed": "aware, from all weights"}
    namings = {"face_value": "share_regime_named", "followed": "share_regime_named_followed"}
    with drawing(_HIDDEN_WIDTH, 0.5 * len(names) + 1.7) as (figure, axis):
        for row, name in zip(rows, names, strict=True):
            for key, (size, fill, lift) in zip(kinds, ((8, "none", _LIFT), (6, "full", -_LIFT)), strict=True):
                style = {"marker": "o", "markersize": size, "fillstyle": fill, "color": look_of(name).colour}
                found = Reached(name, result.figures[name][f"error_{key}"], result.figures[name][namings[key]])
                axis.plot(found.error, row + lift, linestyle="none", clip_on=False, zorder=3, **style)
                if found.named > asked.most_named:
                    axis.plot(found.error, row + lift, linestyle="none", clip_on=False, zorder=4, **_NAMED_TOO_OFTEN)
            ceiling = result.figures[name]["error_ceiling"]
            axis.plot(ceiling, row - _LIFT, marker="|", markersize=11, color=BLACK, linestyle="none")
        axis.axvspan(0.0, asked.least_error, color=_OTHERS, alpha=0.3, linewidth=0, label="error too small: not hidden")
        axis.axvline(asked.error_without, color=GREY, linestyle="--", linewidth=0.9, label="error without weights")
        for label, look in zip(
            [*kinds.values(), "ceiling of the aware observer"],
            (("o", "none"), ("o", "full"), ("|", "full")),
            strict=True,
        ):
            axis.plot([], [], linestyle="none", color=BLACK, marker=look[0], fillstyle=look[1], label=label)
        axis.plot([], [], linestyle="none", label=f"regime named in over {asked.most_named:.0%}", **_NAMED_TOO_OFTEN)
        axis.set_yticks(rows, [spelled(name) for name in names])
        axis.set_ylim(-0.6, len(names) - 0.4)
        axis.set_xlim(left=0.0)
        axis.set_xlabel("error of the observer's estimate of the belief,\nroot mean square")
        figure.legend(loc="outside lower center", ncols=2, columnspacing=1.0, handletextpad=0.3)
        return save_figure(figure, folder, "hidden")


def draw_beliefs(result: Backtest, folder: Path) -> list[Path]:
    """Draw the investor's likeliest regime above the observers' estimates from each decision maker's weights, as `beliefs`."""
    panels = {"investor's belief": result.beliefs}
    panels |= {f"{_published(result, name)}: read at face value": result.estimates(name) for name in result.names}
    if result.aware is not None:
        panels |= {
            f"{_published(result, name)}: read by the aware observer from all weights so far": result.followed_estimates(
                name
            )
            for name in result.names[1:]
        }
    word = result.market.frequency.word
    rows = {"nrows": len(panels), "sharex": True, "sharey": True}
    with drawing(PAGE_WIDTH, 0.85 * len(panels) + 0.7, **rows) as (figure, axes):
        for axis, (title, frame) in zip(axes, panels.items(), strict=True):
            areas = _likeliest(axis, frame, result.earned[-1])
            axis.set_title(title, loc="left")
        figure.supylabel("probability of the likeliest regime", fontsize=8)
        figure.legend(
            areas, result.regimes, loc="outside upper right", ncols=len(result.regimes), title="likeliest regime"
        )
        axes[-1].set_xlabel(f"decided at the end of {word} t; beliefs are about {word} t+1 given data up to {word} t")
        return save_figure(figure, folder, "beliefs")


def draw_weights(result: Backtest, folder: Path) -> list[Path]:
    """Draw the published weights of every decision maker, as `weights`, short ones below zero; assets that matter least are
    drawn as one."""
    shown, others = _main_assets(result)
    shorts, tops = any((result.weights(name) < 0.0).any(axis=None) for name in result.names), list[float]()
    colours = (*_ASSET_COLOURS[: len(shown)], _OTHERS)
    word = result.market.frequency.word
    rows = {"nrows": len(result.names), "sharex": True, "sharey": True}
    with drawing(PAGE_WIDTH, 1.45 * len(result.names) + 0.5, **rows) as (figure, axes):
        for axis, name in zip(axes, result.names, strict=True):
            weights = result.weights(name)
            frame = _main(weights.clip(lower=0.0), shown, others)
            areas = _stack(axis, frame, colours, result.earned[-1])
            tops.append(frame.sum(axis=1).max())
            if shorts:
                owed = _main(weights.clip(upper=0.0), shown, others)
                _stack(axis, owed, colours, result.earned[-1])
                tops.append(owed.sum(axis=1).min())
            axis.set_title(_published(result, name), loc="left")
            axis.set_ylabel("weight")
        figure.legend(
            areas[::-1], [as_written(name) for name in frame.columns[::-1]], loc="outside right center", title="asset"
        )
        if shorts:
            axes[0].set_ylim(1.05 * min(tops), 1.05 * max(tops))
            axes[0].set_yticks(np.arange(np.ceil(min(tops)), np.floor(max(tops)) + 1.0))
            for axis in axes:
                axis.axhline(0.0, color=BLACK, linewidth=0.6)
        axes[-1].set_xlabel(f"published at the end of {word} t, held over {word} t+1")
        return save_figure(figure, folder, "weights")


def _main(weights: pd.DataFrame, shown: list[str], others: list[str]) -> pd.DataFrame:
    """The main assets, and the others as one."""
    if not others:
        return weights[shown]
    return pd.concat([weights[shown], weights[others].sum(axis=1).rename(f"{len(others)} others")], axis=1)


def draw_privacy_and_cost(result: Backtest, folder: Path) -> list[Path]:
    """Draw privacy, regret and wealth over time, as `privacy_and_cost`."""
    word, budget = result.market.frequency.word, result.budget
    with drawing(PAGE_WIDTH, 5.6, nrows=3, sharex=True) as (figure, (above, middle, below)):
        for name in result.names:
            look, path = look_of(name), result.path(name)
            # A cross stays visible on any other mark; each of them hides a cross.
            order = {"o": 2.0, "x": 4.0}.get(look.marker, 3.0)
            dots = {
                "color": look.colour,
                "marker": look.marker,
                "linestyle": "none",
                "markersize": 2.6 * min(1.0, np.sqrt(_APART / len(path))),
                "zorder": order,
            }
            privacy = path["privacy"].where(np.isfinite(path["privacy"]))
            above.plot(path.index, privacy, label=_published(result, name), **dots)
            middle.plot(path.index, PERCENT * relative_increase(path["regret"], path["optimal_cost"]), **dots)
            wealth = np.cumprod(1.0 + path["net_return"])
            below.plot(path["earned_in"], wealth, color=look.colour, linestyle={"PDM": "--"}.get(name, "-"))
        if budget.is_relative:
            middle.axhline(PERCENT * budget.amount, color=BLACK, linewidth=0.8, linestyle=":")
            middle.annotate(
                "budget", (1.0, PERCENT * budget.amount), xycoords=("axes fraction", "data"), va="center", fontsize=7
            )
        limit = PERCENT * budget.amount if budget.is_relative else 1.0
        if limit > 0 and middle.get_ylim()[1] > _STEEP * limit:
            middle.set_yscale("symlog", linthresh=limit)
            middle.set_ylim(-0.1 * limit, 1.6 * middle.get_ylim()[1])  # whole marks at the top
            middle.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        below.margins(x=0.01)
        above.set_ylabel("privacy Ψ")
        middle.set_ylabel("regret, % of the optimal cost")
        below.set_ylabel("wealth after costs,\nat the start 1")
        if np.divide(*below.get_ylim()[::-1]) > _WIDE or below.get_ylim()[0] <= 0:
            below.set_yscale("log")
            _plain_ticks(below.yaxis)
        below.set_xlabel(f"privacy and regret: decided at the end of {word} t; wealth: after {word} t+1")
        figure.legend(loc="outside upper center", ncols=len(result.names), markerscale=2.0)
        return save_figure(figure, folder, "privacy_and_cost")


def draw_frontier(result: Backtest, folder: Path, step: int) -> list[Path]:
    """Draw privacy against regret for one decision at every budget, with its price, as `frontier`.

    With a limit on turnover every rule decides near its own last weights: the curves and the decision are those of the CDM.
    """
    measure = result.settings.measure.at_step(step)
    problem = result.problem_at("CDM", step)
    is_shared = problem is result.problem
    names = result.names if is_shared else ("CDM",)
    candidates = result.candidates if is_shared else None
    if candidates is not None:  # the decisions played were found by a search: no curve lies below them
        played = [
            each.decisions.action[step] if each.lotteries is None else each.lotteries[step].actions
            for each in result.episode.records.values()
        ]
        candidates = candidates.joined(make_candidates(problem, np.vstack(played)))
    frontier = privacy_frontier(problem, result.beliefs.to_numpy()[step], measure, candidates=candidates)
    own = abs(frontier.optimal_cost)
    limit = result.budget.limit(frontier.optimal_cost)
    reach = (
        max(3.0 * limit, _largest_atom(result, names, step))
        if limit > 0
        else float(frontier.points[:, 0].max(initial=own))
    )
    regrets = np.linspace(0.0, 1.05 * reach, 1201)
    with drawing(PAGE_WIDTH, 3.0) as (figure, axis):
        single, mixed = (np.asarray(curve(regrets)) for curve in (frontier.deterministic, frontier.randomized))
        scale, unit = (PERCENT / own, "% of the optimal cost") if own > 0 else (1.0, "the cost's unit")
        for curve, name, line, label in (
            (single, "CDM", "-", "best single decision"),
            (mixed, "PDM", "--", "best lottery, in expectation"),
        ):
            shown = np.where(np.isfinite(curve), curve, np.nan)
            axis.plot(scale * regrets, shown, color=look_of(name).colour, linestyle=line, label=label)
        axis.axvline(scale * limit, color=GREY, linestyle=":", linewidth=0.9, label=f"budget, {result.budget}")
        _draw_price(axis, frontier, limit, scale)
        _mark_decisions(axis, result, names, (step, scale))
        axis.set_xlabel(f"regret, {unit}")
        axis.set_ylabel("privacy Ψ")
        near = "" if is_shared else f", near the {spelled('CDM')} weights before"
        axis.set_title(f"decision at the end of {result.dates[step]:%Y-%m-%d}{near}")
        figure.legend(loc="outside right center")
        return save_figure(figure, folder, "frontier")


def _draw_price(axis: Any, frontier: Frontier, limit: float, scale: float) -> None:
    """Draw the marginal privacy per unit of regret at the budget, as the tangent of the lottery's curve."""
    price, at = float(frontier.price(limit)), float(frontier.randomized(limit))
    if not (np.isfinite(at) and np.isfinite(price) and limit > 0):
        return
    ends = np.array([0.5, 1.5]) * limit
    word = "%" if scale != 1.0 else "unit"
    axis.plot(
        scale * ends,
        at + price * (ends - limit),
        color=BLACK,
        linewidth=0.8,
        label=f"slope: {price / scale:.2g} of privacy\nfor one more {word} of regret",
    )


def draw_month(result: Backtest, folder: Path, step: int) -> list[Path]:
    """Draw one decision on the belief simplex, as `month`: π, the belief read from each portfolio, and the distance dashed."""
    belief = result.beliefs.to_numpy()[step]
    with drawing(PAGE_WIDTH, 4.0, subplot_kw={"projection": "ternary"}) as (figure, axis):
        ternary_labels(axis, result.regimes)
        every = result.beliefs.to_numpy()
        axis.plot(*every.T, color=_OTHERS, marker=".", markersize=2, linestyle="none", label="beliefs at other times")
        for name in result.names:
            record, look = result.episode.records[name], look_of(name)
            found = record.decisions.belief_set[step]
            _draw_set(axis, found, look, _label_of(_published(result, name), found, belief))
            if record.lotteries is not None:
                lottery = replace(record.lotteries[step], problem=result.problem_at(name, step))
                _draw_atoms(axis, lottery, look, belief)
            if not found.is_empty and found.distance(belief) > 0:
                ends = np.vstack([belief, found.nearest(belief)])
                axis.plot(*ends.T, color=look.colour, linestyle="--", linewidth=0.9)
        axis.plot(
            *belief[:, None],
            color=BLACK,
            marker="*",
            markersize=6,
            linestyle="none",
            zorder=5,
            clip_on=False,
            label="π, the true belief",
        )
        axis.set_title(f"decision at the end of {result.dates[step]:%Y-%m-%d}", pad=22)
        axis.legend(loc="center left", bbox_to_anchor=(1.08, 0.6))
        return save_figure(figure, folder, "month")


def _label_of(name: str, found: BeliefSet, belief: Array) -> str:
    if found.is_empty:
        return f"{name}: no belief explains the weights"
    return f"{name}: distance {found.distance(belief):.2f}"


def _draw_set(axis: Any, found: BeliefSet, look: Any, label: str, *, faint: bool = False) -> None:
    corners = found.vertices()
    # A cross stays visible on a dot, a dot hides a cross.
    style = {"color": look.colour, "label": label, "zorder": 2 if faint else 4 if look.marker == "x" else 3}
    if len(corners) == 0:
        axis.plot([], [], [], linestyle="none", marker=look.marker, **style)
    elif len(corners) == 1:
        # The ODM's set lies on the true belief, so its marker is a hollow frame around it.
        hollow = {"fillstyle": "none"} if faint or look.marker == "^" else {}
        size = 9 if hollow else 6
        axis.plot(*corners.T, linestyle="none", marker=look.marker, markersize=size, clip_on=False, **hollow, **style)
    elif len(corners) == 2:
        axis.plot(*corners.T, linestyle=":" if faint else "-", linewidth=2.5, marker=look.marker, **style)
    else:
        axis.fill(*around(corners).T, alpha=0.2 if faint else 0.45, **style)


def _draw_atoms(axis: Any, lottery: MixedDecision, look: Any, belief: Array) -> None:
    for share, found in zip(lottery.probabilities, lottery.belief_sets, strict=True):
        _draw_set(
            axis, found, look, f"  atom of probability {share:.2f}, distance {found.distance(belief):.2f}", faint=True
        )


def _mark_decisions(axis: Any, result: Backtest, names: Sequence[str], at: tuple[int, float]) -> None:
    """The decisions at a step, on a scale of regrets; of a lottery its mean, its atoms hollow, and a line between them."""
    step, scale = at
    for name in names:
        record, look = result.episode.records[name], look_of(name)
        dots = {"color": look.colour, "marker": look.marker, "linestyle": "none", "markersize": 6, "zorder": 4}
        if record.lotteries is None:
            privacy = result.settings.measure.at_step(step)(
                result.beliefs.to_numpy()[step], record.decisions.belief_set[step]
            )
            if np.isfinite(privacy):
                axis.plot(
                    scale * record.decisions.regret[step],
                    privacy,
                    label=_published(result, name),
                    clip_on=False,
                    **dots,
                )
            continue
        lottery = record.lotteries[step]
        axis.plot(scale * lottery.regrets, lottery.privacies, fillstyle="none", label=f"{spelled(name)}, atoms", **dots)
        axis.plot(
            scale * lottery.expected_regret, lottery.expected_privacy, label=f"{spelled(name)},\nin expectation", **dots
        )


def _largest_atom(result: Backtest, names: Sequence[str], step: int) -> float:
    records = [result.episode.records[name] for name in names]
    lotteries = [record.lotteries for record in records if record.lotteries is not None]
    return max((float(mixed[step].regrets.max()) for mixed in lotteries), default=0.0)


def _likeliest(axis: Any, frame: pd.DataFrame, end: pd.Timestamp) -> list[Any]:
    """Draw steps of the likeliest regime's probability in its colour; a row of NaN stays empty."""
    values = frame.to_numpy()
    dates, known = frame.index.append(pd.DatetimeIndex([end])), ~np.isnan(values).any(axis=1)
    top = np.where(known, np.where(known[:, None], values, 0.0).argmax(axis=1), -1)
    heights = [np.where(top == i, values[:, i], 0.0) for i in range(values.shape[1])]
    areas = [
        axis.fill_between(
            dates,
            np.append(height, height[-1]),
            step="post",
            color=REGIME_COLOURS[i % len(REGIME_COLOURS)],
            linewidth=0,
        )
        for i, height in enumerate(heights)
    ]
    _unit_axis(axis, values)
    return areas


def _stack(axis: Any, frame: pd.DataFrame, colours: tuple[str, ...], end: pd.Timestamp) -> list[Any]:
    """Draw stacked areas, each row from its date to the next and the last to `end`; a row of NaN stays empty."""
    values = frame.to_numpy()
    areas: list[Any] = axis.stackplot(
        frame.index.append(pd.DatetimeIndex([end])),
        np.vstack([values, values[-1:]]).T,
        colors=[colours[i % len(colours)] for i in range(frame.shape[1])],
        step="post",
        linewidth=0,
    )
    _unit_axis(axis, values)
    return areas


def _unit_axis(axis: Any, values: Array) -> None:
    axis.set_ylim(0.0, 1.0)
    axis.set_yticks([0.0, 0.5, 1.0])
    axis.margins(x=0)
    if np.isnan(values).any():
        axis.annotate("gaps: no belief explains the weights", (0.01, 0.05), xycoords="axes fraction", fontsize=6)


def _main_assets(result: Backtest) -> tuple[list[str], list[str]]:
    """Return the main assets by mean and largest weight, and those drawn as one; assets never held are left out."""
    every = [result.weights(name).abs() for name in result.names]
    mean = pd.concat([weights.mean() for weights in every], axis=1).max(axis=1)
    ever = pd.concat([weights.max() for weights in every], axis=1).max(axis=1)
    ranked = (mean + ever).sort_values(ascending=False, kind="stable").index
    order = [label for label in ranked if ever[label] >= result.problem.constraints.min_slack]
    room = len(_ASSET_COLOURS) if len(order) <= len(_ASSET_COLOURS) else len(_ASSET_COLOURS) - 1
    return order[:room], order[room:]


def _published(result: Backtest, name: str) -> str:
    return f"{spelled(name)}, drawn" if result.episode.records[name].is_drawn else spelled(name)


def _plain_ticks(axis: Any) -> None:
    """Set plain numbers such as 0.5 and 20 on a logarithmic axis, without powers or overlap."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter, NullLocator

    low, high = axis.get_view_interval()
    crowded = high > 1000.0 * low
    axis.set_major_locator(LogLocator(subs=(1.0,) if crowded else (1.0, 2.0, 5.0)))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_locator(NullLocator())
    axis.set_minor_formatter(NullFormatter())
