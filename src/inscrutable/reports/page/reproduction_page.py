"""The page of a reproduction: every claim of the paper judged, its pictures, and the numbers behind their means."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from inscrutable.experiments.market_runs import GLOBAL, PAPER
from inscrutable.experiments.reproduction import Reproduction
from inscrutable.labels import capital
from inscrutable.reports.page.content import PageContent, PagePicture, PageTable
from inscrutable.reports.page.manifest import keys_of, versions_told
from inscrutable.reports.reproduction import cautions, claims_table, draw_convergence, draw_variant, verdict
from inscrutable.validation import Array

_SOLVERS = {PAPER: "the paper's solvers", GLOBAL: "global solvers"}
_DRAWN = {
    "actions": (
        "Decisions of one step",
        "Each decision on the triangle of the three assets, the candidates, and the decisions that the probabilistic one draws "
        "from, with their probabilities p.",
    ),
    "beliefs": (
        "Beliefs that explain them",
        "The private belief on the triangle of the three regimes, and the beliefs that explain each decision; dashed: the "
        "distances.",
    ),
    "privacy": ("Privacy over time", "The distance of the private belief from those that explain the decision."),
    "costs": ("Cost over time", "The normalised increase of the cost, (c̄ − c*)/|c*|, with the budget."),
    "tradeoff": (
        "The trade-off",
        "Mean privacy against the cost budget over the simulated markets, with their spread.",
    ),
}
_NOTES = (
    "ODM: the original decision maker, who plays the optimal decision. CDM: the counter-adversarial one, the most private "
    "decision within the budget. PDM: the probabilistic one, a lottery within the budget on average.",
    "The paper's solvers: a local solver from one start, and the linear programme over a grid of actions. Global solvers: a "
    "search that leaves local optima, and decoy beliefs for candidates.",
    "First number of a cell: what the claim's criterion measures; ± its standard error where it is an average over the "
    "markets, otherwise the least favourable market's, or for “may” the most favourable one's. Then the share of markets in "
    "which the claim holds by itself.",
    "Privacy: the distance of the private belief from the beliefs under which the decision is optimal. The adversary takes "
    "each decision for optimal; the aware observer, who knows the rule, learns more.",
)


def reproduction_content(
    result: Reproduction, title: str | None, manifest: Mapping[str, str], drawn: Path | None = None
) -> PageContent:
    """Return the content of a reproduction's page.

    Args:
        result: What `reproduce` returned.
        title: The heading; None: a default.
        manifest: More lines for the manifest.
        drawn: Folder with the pictures that `write_reproduction` made of this result; None draws them.
    """
    settings, claims = result.settings, claims_table(result)
    rows = [[str(cell) for cell in row] for row in claims.to_numpy()]
    criteria = [[claim.text, claim.criterion] for claim in result.claims]
    return PageContent(
        title=title or "The paper's numerical section, reproduced",
        header=f"{len(result.claims)} claims of Lourenço, Mattila, Rojas and Wahlberg (2020), Section V, judged over "
        f"{settings.markets} random markets; budget c_b = {settings.budget:g} of |c*|.",
        verdict=[verdict(result)],
        limits=["ODM: optimal; CDM: counter-adversarial; PDM: probabilistic decision maker."],
        cautions=[each.removeprefix("Caution: ") for each in cautions(result)],
        tables=[PageTable("The claims", ["Claim", *map(capital, claims.columns[1:])], rows, is_prose=True)],
        pictures=list(_pictures(result, drawn)),
        details=[
            PageTable("What each claim is measured by", ["Claim", "Criterion"], criteria, is_prose=True),
            *(_tradeoff(result, variant) for variant in result.episodes),
            _samples(result),
        ],
        notes=_NOTES,
        manifest={
            **versions_told(),
            "seed": str(settings.seed),
            **keys_of(settings.model_dump(mode="json", exclude_none=True)),
            "step of the triangles": str(result.step),  # counted from 0, as in the pictures over time
            **manifest,
        },
    )


def _pictures(result: Reproduction, drawn: Path | None) -> Iterator[PagePicture]:
    if drawn is None:
        with TemporaryDirectory() as folder:
            for variant in result.episodes:
                draw_variant(result, variant, Path(folder))
            draw_convergence(result, Path(folder))
            yield from _pictures(result, Path(folder))
        return
    for name, (heading, caption) in _DRAWN.items():
        for variant in result.episodes:
            svg = (drawn / f"{variant}_{name}.svg").read_text("utf-8")
            yield PagePicture(f"{heading}: {_SOLVERS[variant]}", caption, svg)
    caption = "The PDM's mean expected privacy against the number M of candidates, by their kind."
    yield PagePicture("The number of samples", caption, (drawn / "convergence.svg").read_text("utf-8"))


def _tradeoff(result: Reproduction, variant: str) -> PageTable:
    settings = result.settings
    columns = ["Budget", *result.trade_off(variant)]
    cells = [_means(each) for each in result.trade_off(variant).values()]
    rows = [[f"{budget:g} of |c*|", *(each[place] for each in cells)] for place, budget in enumerate(settings.budgets)]
    heading = f"Mean privacy by budget, {_SOLVERS[variant]} ({settings.simulations} markets; ± standard error)"
    return PageTable(heading, columns, rows)


def _samples(result: Reproduction) -> PageTable:
    found = result.convergence()
    cells = [_means(each) for each in found.values()]
    rows = [[f"M = {size}", *(each[place] for each in cells)] for place, size in enumerate(result.sample_sizes)]
    return PageTable("Mean expected privacy of the PDM by number of samples", ["Samples", *found], rows)


def _means(values: Array) -> list[str]:
    """The mean over the rows with its standard error, one text per column."""
    errors = values.std(axis=0, ddof=1) / np.sqrt(len(values))
    return [f"{mean + 0.0:.3f} ± {error:.3f}" for mean, error in zip(values.mean(axis=0).round(3), errors, strict=True)]
