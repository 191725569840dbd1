"""The paper's numerical section as a study: one task is one random market."""

from __future__ import annotations

import json
from typing import Any

from inscrutable.experiments.market_runs import (
    BudgetCurve,
    MarketRun,
    PlayedSteps,
    ReproductionSettings,
    VariantRun,
    run_market,
)
from inscrutable.experiments.studies.flat import flat, unflat
from inscrutable.experiments.studies.kind import Kind
from inscrutable.experiments.studies.tasks import Listed, Row, Task, TaskRunner, Work, canonical, identity


def markets_of(plan: ReproductionSettings, data_hash: str | None = None) -> Listed:
    """Return the tasks: markets by number. The seed's first child draws the market of the figures, the others these."""
    outside = {"kind", "name", "note", "seed", "markets", "simulations", "steps"}
    text = identity(canonical(plan.model_dump(mode="json", exclude=outside)))
    count = max(plan.markets, plan.simulations)
    return Listed(count, lambda k: {"market": k, "plan": text, "samples": k < plan.simulations}, plan.seed, first=1)


class MarketRunner(TaskRunner):
    """Does the markets."""

    def __init__(self, work: Work) -> None:
        self.plan = ReproductionSettings.model_validate_json(work.study)
        self.grid = markets_of(self.plan)

    def figures(self, task: Task) -> dict[str, float]:
        """Return every number of a market's record."""
        run = run_market(self.plan, self.grid.task_seed(task), task.number < self.plan.simulations)
        return dict(flat({"odm": run.odm, **run.variants, "starts": run.starts, "samples": run.samples}))


def run_of(plan: ReproductionSettings, row: Row) -> MarketRun:
    """Return the record of a market from its row."""
    found = unflat(json.loads(row.figures))
    odm, starts, samples = (found.pop(name, None) for name in ("odm", "starts", "samples"))
    variants = {name: _variant(each) for name, each in found.items()}
    assert odm is not None
    assert starts is not None
    return MarketRun(plan.budget, plan.budgets, PlayedSteps(**odm), variants, starts, samples)


def _variant(data: dict[str, Any]) -> VariantRun:
    steps = {name: PlayedSteps(**data[name]) for name in ("cdm", "pdm")}
    curves = {name: BudgetCurve(**data[name]) for name in ("cdm_curve", "pdm_curve")}
    return VariantRun(**(data | steps | curves))


REPRODUCTION = Kind(ReproductionSettings, markets_of, MarketRunner)
"""Studies of random markets, on which the paper's claims are judged."""
