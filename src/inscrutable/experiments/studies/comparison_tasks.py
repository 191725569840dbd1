"""The comparison of decision makers as a study: one task is one decision maker at one budget."""

from __future__ import annotations

import base64
import hashlib
import json
import zlib
from collections.abc import Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from pydantic import model_validator

from inscrutable.errors import InputError
from inscrutable.experiments.comparison import (
    COMPARED,
    Comparison,
    ComparisonSettings,
    ComparisonTasks,
    makers_of,
    pairs_of,
    refuse_unknown,
)
from inscrutable.experiments.comparison_markets import PAPER, RETURNS, ComparedMarket, market_of
from inscrutable.experiments.comparison_measures import ComparisonRow
from inscrutable.experiments.disclosing import check_step
from inscrutable.experiments.investor_model import problem_data, problem_of
from inscrutable.experiments.model_file import ProblemPart
from inscrutable.experiments.own_model import OwnModel
from inscrutable.experiments.sections import Count, Grid, PlanFile
from inscrutable.experiments.setting import Setting
from inscrutable.experiments.studies.flat import flat, unflat
from inscrutable.experiments.studies.kind import Kind
from inscrutable.experiments.studies.tasks import Listed, Row, Task, TaskGrid, TaskRunner, Work
from inscrutable.experiments.weight_limits import LimitsPart
from inscrutable.files import reason
from inscrutable.mechanisms import Prior
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.disclosures import EXACT

_NAMED = ("maker", "budget")
"""Fields that are parameters of a row and therefore not among its figures."""


class ComparisonFile(ComparisonSettings, PlanFile):
    """The file of a comparison: the market, and the decision makers that are compared on it."""

    kind: Literal["comparison"] = "comparison"
    market: str = PAPER
    resolution: Count = 30
    limits: LimitsPart = LimitsPart()
    decision_makers: Grid[str] = tuple(COMPARED)

    @model_validator(mode="after")
    def _known(self) -> Self:
        refuse_unknown(self.decision_makers)
        return self


def compared_pairs(plan: ComparisonFile, data_hash: str | None = None) -> Listed:
    """Return the tasks: decision makers, each at its budgets."""
    pairs = pairs_of(plan.decision_makers, plan.budgets)
    kept = plan.model_dump(mode="json", include={"unit", "market", "resolution", "repeats", "draws"})
    kept |= {"pairs": list(plan.pairs)} if plan.pairs else {}
    kept |= {} if data_hash is None else {"sha256": data_hash}
    kept |= {} if plan.disclosure == EXACT else {"disclosure": plan.disclosure}
    kept |= {} if plan.limits.is_empty else {"limits": plan.limits.model_dump(mode="json", exclude_none=True)}
    kept |= {} if plan.rival is None else {"rival": plan.rival.model_dump(mode="json", exclude_none=True)}
    named = [{"decision_maker": name, "budget": budget, **kept} for name, budget in pairs]
    return Listed(len(pairs), named.__getitem__, plan.seed, is_shared=True)


class ComparisonRunner(TaskRunner):
    """Does the decision makers of a comparison."""

    def __init__(self, work: Work) -> None:
        plan = ComparisonFile.model_validate_json(work.study)
        self.grid = compared_pairs(plan, work.data_hash)
        self.tasks = tasks_on(plan, market_from(json.loads(work.worlds)))

    def figures(self, task: Task) -> dict[str, float]:
        """Return every measure of one mechanism; none where the decision maker does not suit the problem."""
        rng = np.random.default_rng(self.grid.task_seed(task))
        row = self.tasks.row(*self.tasks.pairs[task.number], rng=rng)
        return {} if row is None else {name: each for name, each in flat(row) if name not in _NAMED}


def tasks_on(plan: ComparisonFile, market: ComparedMarket) -> ComparisonTasks:
    """Return the tasks of a study on a market."""
    return ComparisonTasks(Setting.of(market.problem, market.chain), plan, makers_of(plan.decision_makers))


def comparison_from(plan: ComparisonFile, market: ComparedMarket, rows: Sequence[Row]) -> Comparison:
    """Return the comparison from the rows of its study, in order."""
    tasks = tasks_on(plan, market)
    found = []
    for (name, budget), row in zip(tasks.pairs, rows, strict=True):
        figures = unflat(json.loads(row.figures))
        if figures:
            found.append(ComparisonRow(name, budget, **figures))
    return tasks.comparison(found)


def market_from(worlds: Sequence[dict[str, Any]]) -> ComparedMarket:
    """Return the market that was prepared for a study."""
    (data,) = worlds
    problem = problem_of(ProblemPart.model_validate(data["problem"]), lambda key: nullcontext())
    prior = Prior(data["beliefs"], data["weights"])
    transition = np.frombuffer(zlib.decompress(base64.b64decode(data["transition"]))).reshape(len(prior), len(prior))
    return ComparedMarket(problem, BeliefChain(prior, transition), data["note"])


def _market(plan: ComparisonFile, base: Path, grid: TaskGrid) -> list[dict[str, Any]]:
    name = plan.market if plan.market in (PAPER, RETURNS) else str(base / plan.market)
    found = market_of(name, plan.resolution, plan.seed, _limits_beside(plan, base))
    check_step(plan.disclosure, found.step)
    data = {
        "problem": problem_data(found.problem),
        "beliefs": found.prior.beliefs,
        "weights": found.prior.weights,
        "transition": base64.b64encode(zlib.compress(found.chain.transition.toarray().tobytes())).decode(),
        "note": found.note,
    }
    return [json.loads(json.dumps(data, default=lambda array: array.tolist()))]


def _limits_beside(plan: ComparisonFile, base: Path) -> LimitsPart:
    """The limits, with a file of sectors beside the study file by its whole path."""
    sectors = plan.limits.sectors
    return plan.limits.model_copy(
        update={"sectors": str((base / sectors).resolve())} if isinstance(sectors, str) else {}
    )


def _hash(plan: ComparisonFile, base: Path) -> str | None:
    """The SHA-256 of the model's file and the files that it and the limits name; None where there are none."""
    sectors = _limits_beside(plan, base).sectors
    files = [Path(sectors)] if isinstance(sectors, str) else []
    market = None if plan.market in (PAPER, RETURNS) else base / plan.market
    if market is not None:
        files += [market, *(OwnModel.load(market).files if market.suffix.lower() == ".toml" else ())]
    try:
        return hashlib.sha256(b"".join(each.read_bytes() for each in files)).hexdigest() if files else None
    except OSError as error:
        unread = f"{error.filename} cannot be read: {reason(error)}"
        if error.filename != str(market):
            raise InputError(unread) from None
        raise InputError(f"market: expected '{PAPER}', '{RETURNS}' or the model.json of a backtest; {unread}") from None


COMPARISON = Kind(ComparisonFile, compared_pairs, ComparisonRunner, _hash, _market)
"""Studies of decision makers at equal expected regret."""
