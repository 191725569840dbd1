"""Leakage and error of decisions about private alphas by budget, for both objectives, beside the bound of any rule."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from inscrutable.alphas import AlphaDecisionMaker, AlphaProblem
from inscrutable.budgets import Budget
from inscrutable.experiments.sections import AtLeastTwo, Count, Grid, PlanFile, Positive
from inscrutable.validation import Array
from inscrutable.worlds import LinearGaussianWorld

Goal = Literal["information", "error"]
Share = Annotated[float, Field(gt=0.0, lt=1.0)]
Rate = Annotated[float, Field(ge=0.0, lt=1.0)]


class AlphaStudyFile(PlanFile):
    """Agents with private alphas, one market per repeat, and the aware observer.

    Alphas follow m_{t+1} = persistence · m_t + w; the agent observes them exactly. Budgets are shares of the silence regret.
    Risk and alphas both have factors, which differ.
    """

    kind: Literal["alphas"] = "alphas"
    objectives: Grid[Goal] = ("information", "error")
    budgets: Grid[Share] = (0.1, 0.25, 0.5, 0.75, 0.9)
    persistence: Grid[Rate] = (0.0, 0.9)
    assets: Annotated[AtLeastTwo, Field(le=60)] = 12
    factors: Annotated[int, Field(ge=0, le=60)] = 3
    risk_aversion: Positive = 5.0
    steps: Annotated[int, Field(ge=10, le=100_000)] = 500
    repeats: Count = 8


def market_of(
    plan: AlphaStudyFile, persistence: float, rng: np.random.Generator
) -> tuple[AlphaProblem, LinearGaussianWorld]:
    """Return a market: its risk and the world of the alphas; one seed gives the same market for every persistence."""
    n, k = plan.assets, plan.factors

    def spread(size: float) -> Array:
        loads = size * rng.standard_normal((n, k)) / max(np.sqrt(k), 1.0)
        return np.asarray(loads @ loads.T + size**2 * np.diag(rng.uniform(0.5, 1.5, n)))

    problem = AlphaProblem(spread(0.05), plan.risk_aversion)
    covariance, one = spread(0.005), np.eye(n)
    return problem, LinearGaussianWorld(persistence * one, (1.0 - persistence**2) * covariance, one, np.zeros((n, n)))


def figures_of(
    plan: AlphaStudyFile,
    persistence: float,
    budget: float,
    objective: Goal,
    seeds: tuple[np.random.SeedSequence, np.random.SeedSequence],
) -> dict[str, float]:
    """Return regret, leakage and error of one rule, by its law and along a simulated path, and the bounds of any rule.

    `seeds` are those of the market and of the path. Errors are shares of the variance of the alphas, regrets shares of the
    silence regret.
    """
    problem, world = market_of(plan, persistence, np.random.default_rng(seeds[0]))
    goals: tuple[Goal, Goal] = ("information", "error")
    makers = {goal: AlphaDecisionMaker(problem, Budget(budget), world=world, objective=goal) for goal in goals}
    maker, rng = makers[objective], np.random.default_rng(seeds[1])
    silence = maker.silence
    assert silence is not None
    means = np.asarray(world.sample(plan.steps, rng=rng).states)
    path = maker.decide_path(means, rng=rng)
    whole = float(np.trace(silence))
    return {
        "bits": maker.bits,
        "least_bits": makers["information"].plan.ceiling,
        "error_share": maker.error / whole,
        "most_error_share": makers["error"].plan.ceiling / whole,
        "regret_share": maker.regret / maker.silence_regret,
        "simulated_error_share": float(((means - path.estimates) ** 2).sum(axis=1).mean()) / whole,
        "simulated_regret_share": float(path.regrets.mean()) / maker.silence_regret,
        "gap": maker.gap,
    }
