"""Files of an audit of two tables: tables, a summary and a picture of the errors over time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from inscrutable.datasets import output_folder, write_json, write_table
from inscrutable.experiments.audit import PairsAudit, SecretAudit
from inscrutable.reports.style import BLUE, GREY, ORANGE, PAGE_WIDTH, as_written, drawing, save_figure

_PANEL_HEIGHT = 1.9
_MOST_PANELS = 6
_MOST_BARS = 12
_MOST_TICKS = 4


def write_audit(audit: PairsAudit, folder: Path) -> list[Path]:
    """Write the tables, a summary and the picture of an audit into a folder and return their paths.

    Args:
        audit: From `audit_pairs`.
        folder: Created where needed.

    Returns:
        audit.csv (one row per secret), blocks.csv (error of each block), sources.csv (share explained by single columns and
        lags), summary.json, and audit.png and .svg of the first six secrets.

    Raises:
        InputError: A file cannot be written.

    Example:
        >>> import tempfile
        >>> from inscrutable import audit_pairs
        >>> rng = np.random.default_rng(0)
        >>> audit = audit_pairs(rng.normal(size=100), rng.normal(size=(100, 2)), shifts=19)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     sorted(path.name for path in write_audit(audit, Path(folder)))
        ['audit.csv', 'audit.png', 'audit.svg', 'blocks.csv', 'sources.csv', 'summary.json']
    """
    target = output_folder(folder)
    paths = [target / name for name in ("audit.csv", "blocks.csv", "sources.csv", "summary.json")]
    write_table(audit.frame(), paths[0])
    write_table(audit.block_frame(), paths[1])
    write_table(audit.source_frame(), paths[2])
    write_json(audit_summary(audit), paths[3])
    shown = audit.secrets[:_MOST_PANELS]
    height = _PANEL_HEIGHT * len(shown) + 0.3
    with drawing(PAGE_WIDTH, height, nrows=len(shown), ncols=2, squeeze=False) as (figure, axes):
        for (over_time, alone), secret in zip(axes, shown, strict=True):
            _draw_blocks(secret, over_time)
            _draw_sources(secret, alone)
        axes[-1, 0].set_xlabel("last row of each block")
        handles, names = axes[0, 0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=2)
        return paths + save_figure(figure, target, "audit")


def audit_summary(audit: PairsAudit) -> dict[str, Any]:
    """Return the audit's figures as plain data."""
    kept = ("n_rows", "n_judged", "embargo", "lags", "n_shifts", "learners", "notes", "is_found", "secrets")
    return {"sentence": audit.summary(), **{name: getattr(audit, name) for name in kept}}


def _draw_blocks(secret: SecretAudit, panel: Any) -> None:
    """Draw the error of each block and that of the guess, and the limit over the test blocks."""
    blocks = secret.blocks
    places = np.arange(len(blocks))
    judged = np.array([each.is_judged for each in blocks])
    panel.plot(places, [each.guess_error for each in blocks], "--", color=GREY, label="without decisions")
    errors = np.array([each.error for each in blocks])
    panel.plot(places, errors, "-", color=BLUE, alpha=0.5)
    panel.plot(places[judged], errors[judged], "o", color=BLUE, label="learned from the rows before, tested")
    panel.plot(places[~judged], errors[~judged], "o", color=BLUE, markerfacecolor="white", label="learned, not tested")
    span = places[judged][[0, -1]]
    panel.plot(
        span,
        [secret.error_limit] * 2,
        color=ORANGE,
        label="upper limit for the best observer, all tested blocks together",
    )
    step = -(-len(blocks) // _MOST_TICKS)
    panel.set_xticks(places[::step], [each.last[:10] for each in blocks[::step]])
    panel.set_ylim(bottom=0.0)
    panel.set_ylabel("share wrong" if secret.kind == "classes" else "error, r.m.s.")
    panel.set_title(as_written(secret.name), loc="left")


def _draw_sources(secret: SecretAudit, panel: Any) -> None:
    """Draw the shares explained by single columns and lags, the largest first."""
    listed = sorted(secret.sources, key=lambda each: -each.explained)[:_MOST_BARS][::-1]
    names = [as_written(each.name if each.kind == "column" else f"lag {each.name}") for each in listed]
    shares = [100.0 * each.explained for each in listed]
    colours = [ORANGE if secret.is_found and each.tells else GREY for each in listed]
    errors = [100.0 * each.error for each in listed]
    panel.barh(np.arange(len(listed)), shares, xerr=errors, color=colours, height=0.6, error_kw={"linewidth": 0.8})
    panel.set_yticks(np.arange(len(listed)), names)
    panel.axvline(0.0, color="black", linewidth=0.6)
    panel.set_xlabel("explained alone, % (with standard error)")


def audit_table(audit: PairsAudit) -> pd.DataFrame:
    """Return the main figures as text, one row per secret, for a terminal."""
    rows = []
    for each in audit.secrets:
        style = "{:.1%}" if each.kind == "classes" else "{:.4g}"
        rows.append(
            {
                "leak": f"found, p {each.p_value:.2g}" if each.is_found else f"none found, p {each.p_value:.2g}",
                "without decisions": style.format(each.guess_error),
                "learned": style.format(each.error),
                "best errs at most": style.format(each.error_limit),
                "explained": f"{each.explained:.1%}",
                "would be found": f"{each.detectable:.1%}",
            }
        )
    names = [f"{each.name} ({each.kind})" for each in audit.secrets]
    return pd.DataFrame(rows, index=pd.Index(names, name="secret"))
