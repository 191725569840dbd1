"""Files of a backtest of private means: a table, a summary and a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd

from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.experiments.alpha_backtest import AlphaBacktest
from inscrutable.reports.style import BLUE, GREY, ORANGE, PAGE_WIDTH, drawing, save_figure


def write_alphas(found: AlphaBacktest, folder: Path) -> list[Path]:
    """Write table.csv, summary.json and the picture into a folder and return their paths.

    Example:
        >>> import tempfile
        >>> import numpy as np
        >>> from inscrutable import AlphaDecisionMaker, AlphaProblem, alpha_backtest
        >>> maker = AlphaDecisionMaker(AlphaProblem([[0.04]], 2.5), 0.25, prior_covariance=[[4e-4]])
        >>> means = pd.DataFrame([[0.02], [-0.01]], index=["May", "June"])
        >>> found = alpha_backtest(maker, means, rng=np.random.default_rng(0))
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sorted(path.name for path in write_alphas(found, Path(folder)))
        ['alphas.png', 'alphas.svg', 'summary.json', 'table.csv']
    """
    target = output_folder(folder)
    paths = [target / "table.csv", target / "summary.json"]
    write_table(found.table(), paths[0])
    write_json(found.figures(), paths[1])
    with drawing(PAGE_WIDTH, 2.6) as (figure, axes):
        draw_alphas(found, axes)
        return paths + save_figure(figure, target, "alphas")


def draw_alphas(found: AlphaBacktest, axes: Any) -> None:
    """Draw the cumulative regret of hiding, the gain of a rival who copies, and their sum, the worth of the alphas."""
    table = found.table()
    along = list(found.index) if isinstance(found.index[0], pd.Timestamp) else list(range(len(table)))
    given, taken, worth = (table[name].cumsum().to_numpy() for name in ("given up", "taken", "worth"))
    axes.fill_between(along, 0.0, given, color=ORANGE, alpha=0.35, linewidth=0, label="given up to hide")
    axes.fill_between(along, given, worth, color=BLUE, alpha=0.35, linewidth=0, label="gained by a rival who copies")
    axes.plot(along, worth, color=GREY, linewidth=1.0, label="worth of the alphas")
    axes.set_ylabel("basis points, added up")
    axes.legend(loc="upper left")
    axes.set_title(
        f"given up {given[-1]:.0f}, gained by the rival {taken[-1]:.0f}, of {worth[-1]:.0f} basis points", loc="right"
    )
