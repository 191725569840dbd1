"""Options for limits on weights: they override a model file's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from inscrutable.cli_values import INVESTOR, UsageError

if TYPE_CHECKING:
    import pandas as pd

    from inscrutable.datasets import WeightsTable
    from inscrutable.experiments.investor_model import InvestorModel
    from inscrutable.experiments.weight_limits import LimitsPart
    from inscrutable.problems import Polyhedron

Held = Literal["anything", "invested", "long-only"]
_LARGEST_WEIGHT = 1.0
_LARGEST = {"--sector-cap": 20.0, "--long-short": 20.0, "--turnover": 20.0}
"""Largest numbers that count as shares of the portfolio where no % is written."""


@Parameter(name="*", group=INVESTOR)
@dataclass(frozen=True)
class WeightOptions:
    """Limits on weights; each option overrides the model's.

    Args:
        max_weight: Largest weight of every asset, such as 0.25 or 25%.
        min_weight: Smallest weight of every asset.
        sectors: CSV with the columns asset and sector, for `--sector-cap`.
        sector_cap: Largest sum of weights of every sector.
        long_short: Gross exposure, the largest sum of long and short holdings, such as 1.6. Without it there are no short
            holdings.
        turnover: Largest sum of purchases and sales against the last published weights.
    """

    max_weight: Annotated[str | None, Parameter(name="--max-weight")] = None
    min_weight: Annotated[str | None, Parameter(name="--min-weight")] = None
    sectors: Annotated[Path | None, Parameter(name="--sectors")] = None
    sector_cap: Annotated[str | None, Parameter(name="--sector-cap")] = None
    long_short: Annotated[str | None, Parameter(name="--long-short")] = None
    turnover: Annotated[str | None, Parameter(name="--turnover")] = None

    def part(self) -> LimitsPart:
        """Return the limits as a section of a model file."""
        from inscrutable.errors import InputError
        from inscrutable.experiments.weight_limits import LimitsPart

        given: dict[str, Any] = {
            name: share_of(value, f"--{name.replace('_', '-')}")
            for name in ("max_weight", "min_weight", "sector_cap", "long_short", "turnover")
            if (value := getattr(self, name)) is not None
        }
        if self.sectors is not None:
            given["sectors"] = str(self.sectors.resolve())
        try:
            return LimitsPart(**given)
        except InputError as error:
            key, _, rest = str(error).partition(":")
            raise UsageError(f"--{key.partition('.')[0].replace('_', '-')}:{rest}") from None


def share_of(text: str, option: str) -> float:
    """Return the number of "0.25" or "25%"; what can only be a percentage needs its sign."""
    from inscrutable.experiments.sections import written_share

    share = written_share(text)
    if not isinstance(share, float):
        raise UsageError(f"{option} {text}: expected a number such as 0.25 or 25%")
    if not text.strip().endswith("%") and share > _LARGEST.get(option, _LARGEST_WEIGHT):
        raise UsageError(f"{option}: {text} is {share:.6g} times the portfolio; write {text}% for per cent of it")
    return share


def weights_of(path: Path, investor: InvestorModel, normalise: bool, map_: Path | None) -> WeightsTable:
    """Return the weights of a file, or with `normalise` holdings in any unit, by the names of a map."""
    from inscrutable.datasets import read_holdings, read_map, read_weights
    from inscrutable.errors import InputError

    if normalise:
        return read_holdings(path, assets=investor.assets, names=None if map_ is None else read_map(map_))
    try:
        return read_weights(path, assets=investor.assets, net=investor.net)
    except InputError as error:
        if investor.net != 1.0 or not path.is_file():
            raise
        raise InputError(f"{error}. Holdings in another unit, with cash or other tickers: --normalise") from None


def one_row(table: WeightsTable, path: Path) -> pd.Series:
    """Return the one portfolio of a file."""
    from inscrutable.errors import InputError

    if len(table.frame) != 1:
        raise InputError(f"{path} has {len(table.frame)} rows, expected the one portfolio that was published before")
    return table.frame.iloc[0]


def region_of(assets: list[str], held: Held, cap: str | None) -> Polyhedron | None:
    """Return the feasible set; None without limits."""
    import numpy as np

    from inscrutable.problems import Polyhedron, max_weights, simplex

    region = None
    if held == "long-only":
        region = simplex(len(assets))
    elif held == "invested":
        region = Polyhedron(A_eq=np.ones((1, len(assets))), b_eq=[1.0], names=["sum(u) = 1"])
    if cap is not None:
        most = share_of(cap, "--cap")
        if not 0.0 < most < np.inf:
            raise UsageError(f"--cap {cap}: expected a number above 0, such as 0.25 or 25%")
        capped = max_weights(assets, most)
        region = capped if region is None else region & capped
    return region
