"""The paper's numerical section as a study: one task is one random market."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

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
from inscrutable.experiments.studies.tasks import Row, Task, TaskRunner, Work, canonical, identity


class Markets:
    """The tasks: markets by number. The seed's first child draws the market of the figures, and the others these."""

    def __init__(self, plan: ReproductionSettings, data_hash: str | None = None) -> None:
        self.plan = plan
        outside = ("kind", "name", "note", "seed", "markets", "simulations", "steps")
        self._text = identity(canonical({k: v for k, v in plan.model_dump(mode="json").items() if k not in outside}))

    def __len__(self) -> int:
        return max(self.plan.markets, self.plan.simulations)

    def task(self, number: int) -> Task:
        """Return a market by its number."""
        parameters = {"market": number, "plan": self._text, "samples": number < self.plan.simulations}
        return Task(number, (number,), canonical(parameters))

    def task_seed(self, task: Task) -> np.random.SeedSequence:
        """Return the seed of a market: a child of the study's by the market's number."""
        return np.random.SeedSequence(self.plan.seed, spawn_key=(task.number + 1,))


class MarketRunner(TaskRunner):
    """Does the markets."""

    grid: Markets

    def __init__(self, work: Work) -> None:
        self.grid = Markets(ReproductionSettings.model_validate_json(work.study))

    def figures(self, task: Task) -> dict[str, float]:
        """Return every number of a market's record."""
        run = run_market(self.grid.plan, self.grid.task_seed(task), task.number < self.grid.plan.simulations)
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


REPRODUCTION = Kind(ReproductionSettings, Markets, MarketRunner)
"""Studies of random markets, on which the paper's claims are judged."""
