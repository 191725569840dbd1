"""The paper's numerical section as a study: one task is one random market."""

from __future__ import annotations

import json
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from inscrutable.experiments.market_runs import BudgetCurve, MarketRun, Plan, PlayedSteps, VariantRun, run_market
from inscrutable.experiments.random_markets import MarketLaw, SensorLaw
from inscrutable.experiments.studies.flat import flat, unflat
from inscrutable.experiments.studies.grid import Task, canonical, identity
from inscrutable.experiments.studies.kinds import Kind
from inscrutable.experiments.studies.layout import Count, Likely, Pair, PlanFile, Positive, PositivePair, Section
from inscrutable.experiments.studies.workshop import Row, Shop, Work

_AtLeastTwo = Annotated[int, Field(ge=2)]


class LawSection(Section):
    """How markets are drawn; see `experiments.random_markets.MarketLaw`."""

    regimes: _AtLeastTwo = 3
    assets: _AtLeastTwo = 3
    means: Pair = Field(default_factory=lambda: [-0.01, 0.02])
    volatilities: PositivePair = Field(default_factory=lambda: [0.04, 0.12])
    risk_aversion: Positive = 5.0
    persistence: Likely = 0.8
    sensor: Literal["categorical", "gaussian"] = "categorical"
    accuracy: Likely = 0.7


class ReproductionFile(PlanFile):
    """What is done in how many markets; see `experiments.reproduction.ReproductionSettings`."""

    kind: Literal["reproduction"]
    budget: Positive
    markets: _AtLeastTwo
    simulations: _AtLeastTwo
    market_steps: _AtLeastTwo
    steps: _AtLeastTwo = 30
    resolution: _AtLeastTwo
    budgets: Annotated[list[Positive], Field(min_length=2)]
    starts: Annotated[list[Count], Field(min_length=2)]
    sample_resolutions: Annotated[list[Count], Field(min_length=1)]
    law: LawSection = LawSection()

    @property
    def market_law(self) -> MarketLaw:
        """The law as markets are drawn by it."""
        given = self.law
        sensor = SensorLaw(given.sensor, given.accuracy)
        low_high = tuple(given.means), tuple(given.volatilities)
        return MarketLaw(given.regimes, given.assets, *low_high, given.risk_aversion, given.persistence, sensor)  # type: ignore[arg-type]

    @property
    def work(self) -> Plan:
        """What is done in every market."""
        return Plan(
            self.market_law,
            self.budget,
            self.resolution,
            self.market_steps,
            tuple(self.budgets),
            tuple(self.starts),
            tuple(self.sample_resolutions),
        )


def law_section(law: MarketLaw) -> dict[str, Any]:
    """Return a law as a study file holds it."""
    return {
        "regimes": law.n_regimes,
        "assets": law.n_assets,
        "means": [float(each) for each in law.means],
        "volatilities": [float(each) for each in law.volatilities],
        "risk_aversion": float(law.risk_aversion),
        "persistence": float(law.persistence),
        "sensor": law.sensor.kind,
        "accuracy": float(law.sensor.accuracy),
    }


class Markets:
    """The tasks: markets by number. The seed's first child draws the market of the figures, and the others these."""

    def __init__(self, plan: ReproductionFile, data_hash: str | None = None) -> None:
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


class MarketShop(Shop):
    """Does the markets."""

    grid: Markets

    def __init__(self, work: Work) -> None:
        self.grid = Markets(ReproductionFile.model_validate_json(work.study))
        self._plan = self.grid.plan.work

    def figures(self, task: Task) -> dict[str, float]:
        """Return every number of a market's record."""
        run = run_market(self._plan, self.grid.task_seed(task), task.number < self.grid.plan.simulations)
        return dict(flat({"odm": run.odm, **run.variants, "starts": run.starts, "samples": run.samples}))


def run_of(plan: Plan, row: Row) -> MarketRun:
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


REPRODUCTION = Kind(ReproductionFile, Markets, MarketShop)
"""Studies of random markets, on which the paper's claims are judged."""
