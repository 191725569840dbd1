"""What the build makes before it reads: the pages of the API, the claims of the paper, curves, the first steps."""

from __future__ import annotations

import contextlib
import importlib
import io
import json
import logging
import pkgutil
import re
import shutil
import subprocess
import sys
import warnings
from pathlib import Path
from textwrap import indent
from typing import Any

import numpy as np
from made_keys import literal, model_keys, study_keys

import inscrutable
import inscrutable.reports

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
MADE = HERE / "made"
KEPT: list[Any] = []
WIDE = 1000  # pixels
WORTH_PROCESSES = 10  # markets; each process has to start first

# The steps of the story in its order, each with the modules whose public names belong to it.
STEPS = {
    "world": ("World", ("worlds",)),
    "filter": ("Filter", ("filtering",)),
    "problem": ("Decision problem", ("problems", "budgets")),
    "adversary": ("Adversary", ("adversaries", "geometry", "mechanisms")),
    "privacy": ("Privacy", ("privacy",)),
    "decision-maker": ("Decision maker", ("decision_makers",)),
    "alphas": ("Gaussian beliefs", ("alphas",)),
    "experiment": ("Experiment", ("experiments", "datasets")),
    "checks": ("Errors and contract checks", ("errors", "testing")),
}


def steps_of_names() -> dict[str, list[str]]:
    """Return the public names of every step; each name is in exactly one."""
    grouped: dict[str, list[str]] = {key: [] for key in STEPS}
    steps = {
        module: key for key, (_, modules) in STEPS.items() for module in modules
    }
    for name, module in inscrutable._EXPORTS.items():
        first = module.split(".")[0]
        if first not in steps:
            raise RuntimeError(f"{name}: {first} belongs to no step of the story")
        grouped[steps[first]].append(name)
    return grouped


def api_pages(folder: Path) -> None:
    """Write one page per step of the story with all its public names, each with its docstring."""
    folder.mkdir(parents=True)
    for key, names in steps_of_names().items():
        title = STEPS[key][0]
        parts = [f"{title}\n{'=' * len(title)}\n"]
        parts += [".. currentmodule:: inscrutable\n"]
        parts += [".. autosummary::\n   :nosignatures:\n"]
        parts += [*(f"   {name}" for name in names), ""]
        for name in names:
            value = getattr(inscrutable, name)
            kind = "class" if isinstance(value, type) else "function"
            parts.append(f"{name}\n{'-' * len(name)}\n\n.. auto{kind}:: {name}")
            parts += [*(["   :no-inherited-members:"] * is_foreign(value)), ""]
        folder.joinpath(f"{key}.rst").write_text("\n".join(parts), "utf-8")


def is_foreign(value: Any) -> bool:
    """Whether a class derives from one of another package, whose docstrings refer to pages that are not here."""
    known = {"inscrutable", "builtins", "enum", "abc", "typing"}
    bases = value.__mro__[1:] if isinstance(value, type) else ()
    return any(base.__module__.split(".")[0] not in known for base in bases)


def report_page(folder: Path) -> None:
    """Write the page of the functions that draw and write results; they are imported from their own modules."""
    parts = [
        "Report\n======\n",
        "Pictures, tables, folders and pages of results.\n",
    ]
    for found in pkgutil.walk_packages(
        inscrutable.reports.__path__, "inscrutable.reports."
    ):
        module = importlib.import_module(found.name)
        names = [
            name
            for name, value in vars(module).items()
            if name.startswith(("plot_", "draw_", "write_"))
            and getattr(value, "__module__", "") == found.name
        ]
        for name in names:
            full = f"{found.name}.{name}"
            parts.append(
                f"{full.removeprefix('inscrutable.')}\n{'-' * len(full)}\n"
            )
            parts.append(f".. autofunction:: {full}\n")
    folder.joinpath("report.rst").write_text("\n".join(parts), "utf-8")


def claims(folder: Path, n_markets: int) -> None:
    """Judge the paper's claims, and write the table and the figures."""
    from inscrutable.experiments.reproduction import (
        ReproductionSettings,
        reproduce,
    )
    from inscrutable.reports.reproduction import claims_table, write_reproduction

    simulations = min(20, n_markets)
    jobs = -1 if n_markets >= WORTH_PROCESSES else 1
    settings = ReproductionSettings(markets=n_markets, simulations=simulations)
    result = reproduce(settings, jobs=jobs)
    write_reproduction(result, folder, jobs=jobs)
    said = f"Over {n_markets} random markets, means over {simulations}, seed 0:"
    list_table(folder / "claims.rst", claims_table(result), said, (40, 22, 22, 16))


def introduction(folder: Path, n_markets: int) -> None:
    """Judge the claims of the paper's introduction, and write the table."""
    from inscrutable.experiments.introduction import introduction_claims
    from inscrutable.reports.reproduction import introduction_table

    found = introduction_claims(n_markets, rng=np.random.default_rng(0))
    said = f"Over {n_markets} random markets and sensors, seed 0:"
    table = introduction_table(found)
    list_table(folder / "introduction.rst", table, said, (22, 26, 18, 18, 16))


def list_table(page: Path, table: Any, said: str, widths: tuple[int, ...]) -> None:
    """Write a table, below a line of what is said of it, as a page to include."""
    shares = " ".join(map(str, widths))
    lines = [f"{said}\n", ".. list-table::"]
    lines += [f"   :header-rows: 1\n   :widths: {shares}\n"]
    for row in (tuple(table.columns), *table.itertuples(index=False)):
        lines += [
            f"   {'*' if place == 0 else ' '} - {literal(str(cell))}"
            for place, cell in enumerate(row)
        ]
    page.write_text("\n".join(lines) + "\n", "utf-8")


def measured(folder: Path) -> None:
    """Copy the table of the measurements that are kept."""
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "benchmarks" / "results" / "table.md", folder)


def curves(folder: Path) -> None:
    """Draw the growth curves from the same measurements."""
    from benchmarks.plots import draw_growth
    from benchmarks.table import Row

    kept = json.loads(
        ROOT.joinpath("benchmarks", "results", "growth.json").read_text("utf-8")
    )["rows"]
    rows = [
        Row(row["what"], row["size"], row["ours"], numbers=row["numbers"])
        for row in kept
    ]
    draw_growth(rows, folder)


def first_steps(page: Path, folder: Path) -> None:
    """Run the code and the commands of a page in a folder of its own; the page shows the pictures that they write."""
    folder.mkdir(parents=True)
    names: dict[str, object] = {"__name__": "__main__"}
    program = Path(sys.executable).with_name("inscrutable")
    shown = re.sub(r"<!--.*?-->", "", page.read_text("utf-8"), flags=re.S)
    blocks = re.findall(r"^```(\w+)(?: audit)?\n(.*?)^```$", shown, re.M | re.S)
    with contextlib.chdir(folder):
        for language, text in blocks:
            if language == "python":
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(compile(text, page.name, "exec"), names)
            elif language == "console":
                for command in re.findall(r"^\$ inscrutable (.+)$", text, re.M):
                    run_command([str(program), *command.split()])


def run_command(words: list[str]) -> None:
    """Run a command of a page; raise with what it said if it fails."""
    run = subprocess.run(words, capture_output=True, text=True)
    if run.returncode:
        raise RuntimeError(
            f"{' '.join(words)}: exit code {run.returncode}\n{run.stderr}"
        )


def strict(gallery_conf: dict[str, Any], script: str, when: str) -> None:
    """Make a warning in a script an error, as in the tests, and let it be a warning again after it."""
    if when == "before":
        KEPT.append(warnings.catch_warnings(action="error"))
        KEPT[-1].__enter__()
    elif KEPT:
        KEPT.pop().__exit__(None, None, None)


def pictures(block: Any, block_vars: Any, gallery_conf: dict[str, Any]) -> str:
    """Take what a block drew, or wrote as PNG beside its script, into the page: a scraper of the gallery."""
    from sphinx_gallery.scrapers import figure_rst, matplotlib_scraper

    drawn = matplotlib_scraper(
        block, block_vars, gallery_conf, bbox_inches="tight", dpi=160
    )
    taken = []
    for path in sorted(Path.cwd().glob("*.png")):
        taken.append(next(block_vars["image_path_iterator"]))
        shutil.move(path, taken[-1])
        path.with_suffix(".svg").unlink(missing_ok=True)
    if not taken:
        return drawn
    # A phone shows a wide picture at a size at which its letters can be read, and moves it sideways.
    kind = "drawn wide" if max(map(width_of, taken)) > WIDE else "drawn"
    figure = indent(figure_rst(taken, gallery_conf["src_dir"]), "   ")
    return f"{drawn}\n.. container:: {kind}\n\n{figure}\n"


def width_of(picture: Path | str) -> int:
    """Return the width of a PNG file in pixels, which are the four bytes from the seventeenth."""
    return int.from_bytes(Path(picture).read_bytes()[16:20], "big")


def make(app: Any) -> None:
    """Make everything afresh."""
    # That kernels are compiled on a new machine belongs on no page.
    logging.getLogger("inscrutable").setLevel(logging.ERROR)
    shutil.rmtree(MADE, ignore_errors=True)
    api_pages(MADE / "api")
    report_page(MADE / "api")
    measured(MADE / "benchmarks")
    study_keys(MADE / "studies")
    model_keys(MADE / "model")
    curves(MADE / "benchmarks")
    first_steps(HERE / "start-here.md", MADE / "start")
    claims(MADE / "claims", app.config.claims_markets)
    introduction(MADE / "claims", min(app.config.claims_markets, 50))


def setup(app: Any) -> dict[str, Any]:
    """Connect before the galleries are made."""
    app.add_config_value("claims_markets", 100, "env", types=[int])
    app.connect("builder-inited", make, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
