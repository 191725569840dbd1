"""Files and a picture of social learning: what agents learn from each other's decisions, and the cost of hiding."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from inscrutable import __version__
from inscrutable.datasets.files import output_folder, write_json, write_table
from inscrutable.experiments.herding import HerdingTable
from inscrutable.reports.style import BLACK, as_written, drawing, looks_of, save_figure

_WIDTH, _HEIGHT = 7.4, 3.2


def write_herding(table: HerdingTable, folder: str | os.PathLike[str]) -> list[Path]:
    """Write herding.csv, summary.json and the picture into a folder, and return their paths.

    Raises:
        InputError: A file cannot be written.
    """
    target = output_folder(folder)
    figures, summary = target / "herding.csv", target / "summary.json"
    write_table(table.frame(), figures)
    pictures = draw_herding(table, target)
    rows = table.frame().reset_index().to_dict(orient="records")
    write_json({"version": __version__, "n_agents": table.found[0].n_agents, "rows": rows}, summary)
    return [figures, *pictures, summary]


def draw_herding(table: HerdingTable, folder: Path) -> list[Path]:
    """Draw the public probability of the true state by agent, and each rule's cost to others against its leakage."""
    looks, frame = looks_of(table.names), table.frame()
    with drawing(_WIDTH, _HEIGHT, ncols=2) as (figure, (left, right)):
        for name, found in zip(table.names, table.found, strict=True):
            look, label = looks[name], as_written(name)
            left.plot(np.arange(found.n_agents + 1), found.truths, look.line, color=look.colour, label=label)
            place = frame.loc[name]
            right.plot(place["bits"], place["others"], look.marker, color=look.colour)
            right.annotate(label, (place["bits"], place["others"]), (4, 4), textcoords="offset points", fontsize=6)
        left.set(xlabel="decisions seen", ylabel="public belief in the true state", ylim=(None, 1.0))
        left.legend(loc="upper left")
        right.axhline(0.0, color=BLACK, linestyle="--", linewidth=0.8)
        right.set(xlabel="leakage of the first decision, bits", ylabel="cost of hiding to the others")
        right.margins(x=0.2)
        return save_figure(figure, folder, "herding")
