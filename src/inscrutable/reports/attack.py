"""Beliefs inferred from published weights, as a table and as pictures."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.datasets.tables import FULL_PRECISION_DIGITS, decimal_places
from inscrutable.experiments.attack import Attack, Reading, RowReading, regret_text
from inscrutable.labels import label_text
from inscrutable.mechanisms.joint import top_states
from inscrutable.reports.style import (
    BLACK,
    GREY,
    ORANGE,
    REGIME_COLOURS,
    around,
    as_written,
    drawing,
    save_figure,
    ternary_labels,
)

_COLOURS_OVER_TIME = "viridis"
_MOST_TICKS = 8


def attack_table(attack: Attack) -> pd.DataFrame:
    """Return one row per published row: the estimate for each regime, with its interval.

    Args:
        attack: From `attack_weights`.

    Returns:
        A frame on the rows' labels: for each regime the observer's estimate and the least and greatest probability consistent
        with the weights; the most likely regime, or all of several as likely; the reading; the least regret of any belief, the
        bound on the regret that rounding can cause and the largest change of a weight to make the row feasible, in the unit of
        the cost or the weights.

    Example: see `write_attack`.
    """
    regimes = attack.model.regimes
    estimates, bounds = attack.estimates, attack.bounds
    columns: dict[str, Any] = {}
    for i, regime in enumerate(regimes):
        columns[regime] = estimates[:, i]
        columns[f"{regime} least"] = bounds[:, i, 0]
        columns[f"{regime} most"] = bounds[:, i, 1]
    columns["most likely"] = [_likeliest(attack, row) for row in attack.rows]
    columns["reading"] = [reading_of(attack, step) for step in range(len(attack))]
    columns["least regret"] = [row.gap for row in attack.rows]
    columns["regret allowed for rounding"] = [row.allowance for row in attack.rows]
    columns["KKT residual"] = [row.residual for row in attack.rows]
    columns["weights changed by"] = [row.adjustment for row in attack.rows]
    return pd.DataFrame(columns, index=attack.index)


def _likeliest(attack: Attack, row: RowReading) -> str:
    """Return the regime of largest estimate, or all of several as likely."""
    (tied,) = top_states(row.estimate[None])
    return " or ".join(regime for regime, is_top in zip(attack.model.regimes, tied, strict=True) if is_top)


def attack_lines(attack: Attack) -> pd.DataFrame:
    """Return the table in few columns of text, for a terminal: "0.280 [0.271, 0.289]" per regime, and the reading."""
    columns: dict[str, list[str]] = {}
    for i, regime in enumerate(attack.model.regimes):
        columns[regime] = [
            f"{row.estimate[i]:.3f} " + ("[ none ]" if np.isnan(low) else f"[{low:.3f}, {high:.3f}]")
            for row, (low, high) in zip(attack.rows, attack.bounds[:, i], strict=True)
        ]
    columns["most likely"] = [_likeliest(attack, row) for row in attack.rows]
    columns["reading"] = [_SHORT[row.reading].format(row.gap, row.allowance, 1e4 * row.gap) for row in attack.rows]
    return pd.DataFrame(columns, index=attack.index)


_SHORT = {
    Reading.EXACT: "exact",
    Reading.ROUNDED: "rounded, ε {1:.1e}",
    Reading.NEAR: "near-optimal, ε {1:.1e}",
    Reading.IMPLAUSIBLE: "nearest explanation, gap {2:.3g} bp",
}


def reading_notes(attack: Attack) -> list[str]:
    """Return the meaning of each reading that occurs, one line each."""
    digits = FULL_PRECISION_DIGITS if attack.decimals is None else attack.decimals
    notes = {
        Reading.EXACT: "exact: these beliefs, and no others, make the weights optimal.",
        Reading.ROUNDED: (
            f"rounded to {decimal_places(digits)}: the near-optimal set is read, every belief that leaves the weights at most "
            "ε of regret; rounding causes no more."
        ),
        Reading.NEAR: (
            f"near-optimal: every belief under which the weights cost at most {regret_text(attack.regret)} more than the best "
            "ones, and what rounding can cause."
        ),
        Reading.IMPLAUSIBLE: (
            "nearest explanation: no belief explains the weights, rounded or not: this model does not describe how they were "
            "chosen. Shown is the belief of least regret; the gap is that regret, in basis points (bp) of wealth per row of "
            "returns. What helps: the investor's limits (--max-weight, --min-weight), the regret that it accepts (--regret, at "
            "least the gap), or expected returns instead of regimes (inscrutable views)."
        ),
    }
    return [note for reading, note in notes.items() if attack.count(reading)]


def reading_of(attack: Attack, step: int) -> str:
    """Return the reading of a row in words, with its numbers."""
    row = attack.rows[step]
    if row.reading is Reading.EXACT:
        return "exact"
    if row.reading is Reading.ROUNDED:
        digits = FULL_PRECISION_DIGITS if attack.decimals is None else attack.decimals
        return f"near-optimal within regret {row.allowance:.1e} because weights are rounded to {decimal_places(digits)}"
    if row.reading is Reading.NEAR:
        return f"near-optimal within regret {row.allowance:.1e}, of which {attack.regret:.1e} was asked for"
    nearest = ", ".join(f"{share:.3f}" for share in row.estimate)
    return f"no belief explains this; nearest explanation ({nearest}), least regret {regret_text(row.gap)}"


def plot_attack(attack: Attack, axes: Any) -> Any:
    """Draw the set and centre of each row on ternary axes of three regimes, coloured by the row's position.

    Returns the artist of the colours, for a colour bar; None for a single row.
    """
    import matplotlib

    order = np.linspace(0.0, 1.0, len(attack)) if len(attack) > 1 else np.array([0.0])
    colours = matplotlib.colormaps[_COLOURS_OVER_TIME](0.9 * order)
    for row, colour in zip(attack.rows, colours, strict=True):
        if len(row.corners) > 2:
            axes.fill(*around(row.corners).T, facecolor=colour, edgecolor=colour, alpha=0.35, linewidth=0.8)
        elif len(row.corners) == 2:
            axes.plot(*row.corners.T, color=colour, linewidth=1.6, alpha=0.8, solid_capstyle="round")
    explained = np.array([row.reading is not Reading.IMPLAUSIBLE for row in attack.rows])
    estimates = attack.estimates
    dots = None
    if explained.any():
        dots = axes.scatter(
            *estimates[explained].T,
            c=np.flatnonzero(explained),
            cmap=_COLOURS_OVER_TIME,
            vmin=0,
            vmax=max((len(attack) - 1) / 0.9, 1),
            s=16,
            edgecolors="white",
            linewidths=0.4,
            zorder=3,
            clip_on=False,
            label="estimate: centre of the set",
        )
    if not explained.all():
        axes.scatter(
            *estimates[~explained].T,
            marker="x",
            s=20,
            color=ORANGE,
            linewidths=1.0,
            zorder=3,
            clip_on=False,
            label="not explained: nearest explanation",
        )
    ternary_labels(axes, attack.model.regimes)
    return dots if len(attack) > 1 else None


def plot_attack_bounds(attack: Attack, axes: Any) -> None:
    """Draw the interval and the estimate of each row's regime probability, one panel per regime."""
    estimates, bounds = attack.estimates, attack.bounds
    explained = np.array([row.reading is not Reading.IMPLAUSIBLE for row in attack.rows])
    places = positions(attack.index)
    for i, (panel, regime) in enumerate(zip(axes, attack.model.regimes, strict=True)):
        colour = REGIME_COLOURS[i % len(REGIME_COLOURS)]
        low, high = bounds[:, i, 0], bounds[:, i, 1]
        panel.vlines(places, low, high, color=colour, linewidth=bar_width(len(attack)), alpha=0.6)
        if explained.any():
            dots = {"color": BLACK, "markersize": dot_size(len(attack))}
            label = "estimate, in the interval that the weights allow"
            panel.plot(places[explained], estimates[explained, i], ".", label=label, **dots)
        if not explained.all():
            label = "not explained: nearest explanation"
            panel.plot(places[~explained], estimates[~explained, i], "x", color=ORANGE, markersize=4, label=label)
        panel.set_ylim(-0.04, 1.04)
        panel.set_yticks([0.0, 0.5, 1.0])
        panel.set_ylabel(as_written(regime))
    label_rows(axes[-1], attack.index)


def positions(index: pd.Index) -> Any:
    """Return the positions of the rows on a horizontal axis: their dates, or 0, 1, …"""
    return index.to_numpy() if isinstance(index, pd.DatetimeIndex) else np.arange(len(index))


def label_rows(panel: Any, index: pd.Index) -> None:
    """Label the horizontal axis with the rows' dates or labels, as many as fit."""
    if isinstance(index, pd.DatetimeIndex):
        from matplotlib import dates

        locator: Any = dates.AutoDateLocator(minticks=3, maxticks=_MOST_TICKS)  # type: ignore[no-untyped-call]
        panel.xaxis.set_major_locator(locator)
        panel.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))  # type: ignore[no-untyped-call]
        return
    shown = np.unique(np.linspace(0, len(index) - 1, min(len(index), _MOST_TICKS)).astype(int))
    panel.set_xticks(shown, [str(index[k])[:12] for k in shown])
    panel.set_xlim(-0.7, len(index) - 0.3)
    panel.set_xlabel(str(index.name or "row"))


def bar_width(rows: int) -> float:
    """Return the width of an interval's bar in points, narrow enough that many rows do not overlap at column width."""
    return float(np.clip(160.0 / rows, 0.6, 8.0))


def dot_size(rows: int) -> float:
    """Return the size of an estimate's dot in points."""
    return float(np.clip(160.0 / rows, 1.5, 6.0))


def write_attack(attack: Attack, folder: Path, *, more: Mapping[str, Any] | None = None) -> list[Path]:
    """Write the table, a summary and the pictures of an attack into a folder and return their paths.

    Args:
        attack: From `attack_weights`.
        folder: Created where needed.
        more: Plain data that summary.json has besides.

    Returns:
        attack.csv, summary.json, attack_bounds.png and .svg, and for three regimes attack_ternary.png and .svg.

    Raises:
        InputError: A file cannot be written.

    Example:
        >>> import tempfile
        >>> from inscrutable.experiments.attack import attack_weights
        >>> from inscrutable.experiments.investor_model import InvestorModel
        >>> from inscrutable.problems import MarkowitzProblem
        >>> from inscrutable.worlds import GaussianEmission, HiddenMarkovModel
        >>> means, spreads = [[0.02, 0.0], [-0.03, 0.0]], [0.01 * np.eye(2), 0.09 * np.eye(2)]
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission(means, spreads))
        >>> model = InvestorModel(world, MarkowitzProblem(means, spreads, 2.0), ("A", "B"), ("calm", "crisis"))
        >>> attack = attack_weights(model, pd.DataFrame([model.problem.solve([0.8, 0.2])], columns=["A", "B"]))
        >>> attack_table(attack)[["calm", "most likely", "reading"]].round(3)
           calm most likely reading
        0   0.8        calm   exact
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sorted(path.name for path in write_attack(attack, Path(folder)))
        ['attack.csv', 'attack_bounds.png', 'attack_bounds.svg', 'summary.json']
    """
    target = output_folder(folder)
    paths = [target / "attack.csv", target / "summary.json"]
    write_table(attack_table(attack), paths[0])
    write_json(attack_summary(attack) | dict(more or {}), paths[1])
    n_regimes = len(attack.model.regimes)
    with drawing(height=0.9 + 0.85 * n_regimes, nrows=n_regimes, sharex=True, squeeze=False) as (figure, axes):
        plot_attack_bounds(attack, axes[:, 0])
        figure.supylabel("probability of the regime", fontsize=8)
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center")
        paths += save_figure(figure, target, "attack_bounds")
    if n_regimes == 3:
        with drawing(height=3.4, subplot_kw={"projection": "ternary"}) as (figure, axes):
            dots = plot_attack(attack, axes)
            figure.legend(loc="outside lower center", ncols=1)
            if dots is not None:
                _colour_bar(figure, axes, dots, attack.index)
            paths += save_figure(figure, target, "attack_ternary")
    return paths


def attack_summary(attack: Attack) -> dict[str, Any]:
    """Return the attack's figures as plain data: the counts of readings, and each row's reading in the file's order."""
    regimes = attack.model.regimes
    return {
        "sentence": attack.summary(),
        "regimes": list(regimes),
        "decimals": attack.decimals,
        "readings": {
            reading.name.lower(): attack.count(reading)
            for reading in Reading
            if attack.regret or reading is not Reading.NEAR
        },
        "rows": [
            {
                "row": label_text(label),
                "reading": row.reading.name.lower(),
                "estimate": row.estimate,
                "bounds": row.bounds,
                "most_likely": _likeliest(attack, row),
                "least_regret": row.gap,
                "regret_allowed_for_rounding": row.allowance,
                "kkt_residual": row.residual,
                "weights_changed_by": row.adjustment,
            }
            for label, row in zip(attack.index, attack.rows, strict=True)
        ],
    }


def _colour_bar(figure: Any, axes: Any, dots: Any, index: pd.Index) -> None:
    bar = figure.colorbar(dots, ax=axes, orientation="horizontal", shrink=0.6, aspect=30, pad=0.12)
    ends = [0, len(index) - 1]
    bar.ax.set_xlim(*ends)
    bar.set_ticks(ends, labels=[label_text(index[k]) for k in ends])
    bar.outline.set_edgecolor(GREY)
