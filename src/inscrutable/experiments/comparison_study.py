"""The comparison of ways of hiding as a study: one task is one decision maker at one budget."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from inscrutable.errors import InputError
from inscrutable.experiments.comparison import Comparison, ComparisonSettings, Terms, pairs_of
from inscrutable.experiments.comparison_markets import PAPER, RETURNS, ComparedMarket, market_of
from inscrutable.experiments.comparison_measures import ComparisonRow
from inscrutable.experiments.comparison_paths import EVERY_MAKER
from inscrutable.experiments.investor_model import problem_data, problem_of
from inscrutable.experiments.model_file import ProblemPart
from inscrutable.experiments.studies.flat import flat, unflat
from inscrutable.experiments.studies.grid import Task, TaskGrid, canonical
from inscrutable.experiments.studies.kinds import Kind
from inscrutable.experiments.studies.layout import Count, Grid, NonNegative, PlanFile
from inscrutable.experiments.studies.study import Study
from inscrutable.experiments.studies.whole import Counted, all_rows, rows_of_whole, shipped
from inscrutable.experiments.studies.workshop import Row, Shop, Work
from inscrutable.files import PathLike, reason
from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.chains import BeliefChain

_NAMED = ("maker", "budget")
"""What a row's parameters say, so that its figures need not."""


class ComparisonFile(PlanFile):
    """What is compared on which market; see `experiments.comparison.ComparisonSettings`."""

    kind: Literal["comparison"]
    market: str = PAPER
    resolution: Count = 30
    unit: Literal["silence", "cost", "regret"] = "silence"
    budgets: Grid[NonNegative]
    repeats: Grid[Count] = (1, 10, 100)
    draws: Annotated[int, Field(ge=10)] = 500
    decision_makers: Grid[str] = tuple(EVERY_MAKER)

    @property
    def settings(self) -> ComparisonSettings:
        """Budgets and numbers of decisions."""
        return ComparisonSettings(self.budgets, self.unit, self.repeats, self.draws)

    def model_post_init(self, context: Any) -> None:
        """Refuse names of no decision maker, and numbers that do not rise."""
        unknown = [name for name in self.decision_makers if name not in EVERY_MAKER]
        if unknown:
            raise ValueError(f"there is no decision maker {unknown[0]!r}; expected some of {', '.join(EVERY_MAKER)}")
        try:
            _ = self.settings
        except InputError as error:
            raise ValueError(str(error)) from None


class Ways:
    """The tasks: decision makers, each at its budgets."""

    def __init__(self, plan: ComparisonFile, data_hash: str | None = None) -> None:
        self.plan = plan
        self.pairs = pairs_of(plan.decision_makers, plan.budgets)
        kept = ("market", "resolution", "repeats", "draws")
        self._market = {name: value for name, value in plan.model_dump(mode="json").items() if name in kept}
        self._market |= {} if data_hash is None else {"sha256": data_hash}

    def __len__(self) -> int:
        return len(self.pairs)

    def task(self, number: int) -> Task:
        """Return a decision maker at a budget."""
        name, share = self.pairs[number]
        parameters = {"decision_maker": name, "budget": share, "unit": self.plan.unit, **self._market}
        return Task(number, (number,), canonical(parameters))

    def task_seed(self, task: Task) -> np.random.SeedSequence:
        """Return the seed of the sequences sampled for a task: a child of the study's by the task's number."""
        return np.random.SeedSequence([self.plan.seed, len(self.plan.budgets)], spawn_key=(task.number,))


class WayShop(Shop):
    """Does the decision makers of a comparison."""

    grid: Ways

    def __init__(self, work: Work) -> None:
        plan = ComparisonFile.model_validate_json(work.study)
        self.grid = Ways(plan, work.data_hash)
        self.terms = terms_on(plan, market_from(json.loads(work.worlds)))

    def figures(self, task: Task) -> dict[str, float]:
        """Return every measure of one mechanism; none where the decision maker does not suit the problem."""
        rng = np.random.default_rng(self.grid.task_seed(task))
        row = self.terms.row(*self.terms.tasks[task.number], rng=rng)
        return {} if row is None else {name: each for name, each in flat(row) if name not in _NAMED}


def terms_on(plan: ComparisonFile, market: ComparedMarket) -> Terms:
    """Return what a study compares on a market."""
    makers = {name: EVERY_MAKER[name] for name in plan.decision_makers}
    return Terms.of(market.problem, market.chain, plan.settings, makers, None)


def comparison_from(plan: ComparisonFile, market: ComparedMarket, rows: Sequence[Row]) -> Comparison:
    """Return the comparison from the rows of its study, in order."""
    terms = terms_on(plan, market)
    found = []
    for (name, budget), row in zip(terms.tasks, rows, strict=True):
        figures = unflat(json.loads(row.figures))
        if figures:
            found.append(ComparisonRow(name, budget, **figures))
    return terms.comparison(found)


def market_from(worlds: Sequence[dict[str, Any]]) -> ComparedMarket:
    """Return the market that was prepared for a study."""
    (data,) = worlds
    problem = problem_of(ProblemPart.model_validate(data["problem"]), lambda key: nullcontext())
    prior = Prior(data["beliefs"], data["weights"])
    transition = np.frombuffer(zlib.decompress(base64.b64decode(data["transition"]))).reshape(len(prior), len(prior))
    return ComparedMarket(problem, BeliefChain(prior, transition), data["note"])


def _market(plan: ComparisonFile, base: Path, grid: TaskGrid) -> list[dict[str, Any]]:
    name = plan.market if _hash(plan, base) is None else str(base / plan.market)
    found = market_of(name, plan.resolution, plan.seed)
    data = {
        "problem": problem_data(found.problem),
        "beliefs": found.prior.beliefs,
        "weights": found.prior.weights,
        "transition": base64.b64encode(zlib.compress(found.chain.transition.toarray().tobytes())).decode(),
        "note": found.note,
    }
    return [json.loads(json.dumps(data, default=lambda array: array.tolist()))]


def _hash(plan: ComparisonFile, base: Path) -> str | None:
    """The SHA-256 of the model's file, where the market is one."""
    if plan.market in (PAPER, RETURNS):
        return None
    try:
        return hashlib.sha256((base / plan.market).read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(
            f"market: expected '{PAPER}', '{RETURNS}' or the model.json of a backtest; {base / plan.market} cannot be read: "
            f"{reason(error)}"
        ) from None


def comparison_study(settings: ComparisonSettings, *, market: str, resolution: int, seed: int) -> Study:
    """Return the shipped study with these settings, market and seed in place of its values."""
    return Study.of(
        shipped("comparison")
        | {
            "seed": seed,
            "market": market,
            "resolution": resolution,
            "unit": settings.unit,
            "budgets": list(settings.budgets),
            "repeats": list(settings.repeats),
            "draws": settings.n_draws,
        }
    )


def compared(
    study: Study,
    folder: PathLike | None = None,
    *,
    jobs: int = 1,
    again: bool = True,
    say: Callable[[str], None],
    progress: Counted,
) -> tuple[Comparison, str]:
    """Run a study of this kind as `all_rows` does, and return the comparison with a line on its market.

    `say` is told that line as soon as it is known.
    """
    plan = study.plan
    assert isinstance(plan, ComparisonFile)

    def prepared(worlds: Sequence[dict[str, Any]]) -> None:
        say(f"{worlds[0]['note']}; {len(worlds[0]['weights'])} beliefs")

    return _whole(plan, *all_rows(study, folder, jobs=jobs, again=again, prepared=prepared, progress=progress))


def comparison_of(study: Study) -> tuple[Comparison, str]:
    """Return the comparison that a finished study of this kind holds, with a line on its market.

    Raises:
        InputError: The study is of another kind, was not run, or is not finished.
    """
    plan = study.plan
    if not isinstance(plan, ComparisonFile):
        raise InputError(f"{plan.name} is no comparison")
    return _whole(plan, *rows_of_whole(study))


def _whole(plan: ComparisonFile, rows: Sequence[Row], worlds: Sequence[dict[str, Any]]) -> tuple[Comparison, str]:
    market = market_from(worlds)
    return comparison_from(plan, market, rows), market.note


COMPARISON = Kind(ComparisonFile, Ways, WayShop, _hash, _market)
"""Studies of ways of hiding, at equal expected regret."""
