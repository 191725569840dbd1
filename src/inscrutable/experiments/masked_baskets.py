"""The rate at which an observer learns a masked basket: a fund publishes its weights daily plus a mask."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from inscrutable.adversaries.fund_values import infer_weights
from inscrutable.experiments.sections import AtLeastTwo, Count, Grid, PlanFile, Positive
from inscrutable.validation import Array

Shown = Literal["fresh mask", "kept mask", "value"]


class MaskedBasketFile(PlanFile):
    """Funds of constant weights, their number per repeat, and their daily disclosure.

    "fresh mask" draws a new mask every day, "kept mask" one mask for all days; masks sum to zero. "value" discloses the fund's
    return plus noise to an observer who knows the returns of its assets.
    """

    kind: Literal["masked basket"] = "masked basket"
    shown: Grid[Shown] = ("fresh mask", "kept mask", "value")
    assets: AtLeastTwo = 12
    days: Annotated[int, Field(ge=2, le=10_000)] = 250
    repeats: Count = 8
    funds: Annotated[Count, Field(le=10_000)] = 50
    mask: Positive = 0.02
    volatility: Positive = 0.01
    noise: Positive = 0.0005


def errors_by_day(plan: MaskedBasketFile, shown: str, rng: np.random.Generator) -> Array:
    """Return the root mean square error of a weight after each day, over the funds, shape (days,); NaN without an estimate.

    The observer averages masked baskets; from values it estimates the weights by least squares, once they are identified.
    """
    n_days, n_assets = plan.days, plan.assets
    squared = np.zeros(n_days)
    for _ in range(plan.funds):
        weights = rng.dirichlet(np.ones(n_assets))
        if shown == "value":
            squared += _by_value(plan, weights, rng)
            continue
        draws = rng.normal(scale=plan.mask, size=(n_days if shown == "fresh mask" else 1, n_assets))
        masks = np.broadcast_to(draws - draws.mean(axis=1, keepdims=True), (n_days, n_assets))
        average = np.cumsum(weights + masks, axis=0) / np.arange(1, n_days + 1)[:, None]
        squared += ((average - weights) ** 2).mean(axis=1)
    return np.asarray(np.sqrt(squared / plan.funds))


def _by_value(plan: MaskedBasketFile, weights: Array, rng: np.random.Generator) -> Array:
    returns = rng.normal(scale=plan.volatility, size=(plan.days, plan.assets))
    values = returns @ weights + rng.normal(scale=plan.noise, size=plan.days)
    found = np.full(plan.days, np.nan)
    for day in reported(plan):
        if day >= plan.assets - 1:
            estimate = infer_weights(values[:day], returns[:day], noise=plan.noise).weights
            found[day - 1] = ((estimate - weights) ** 2).mean()
    return found


def reported(plan: MaskedBasketFile) -> list[int]:
    """Return the reported days: evenly spaced on a logarithmic scale, including the last."""
    return sorted({round(day) for day in np.geomspace(1, plan.days, 24)})


def slope_of(errors: Array) -> float:
    """Return the slope of log error against log day, over all days with an error; NaN for fewer than two."""
    days = np.flatnonzero(np.isfinite(errors) & (errors > 0)) + 1
    return float(np.polyfit(np.log(days), np.log(errors[days - 1]), 1)[0]) if len(days) > 1 else float("nan")
