"""Limits on weights as models' files and options give them, and the feasible set that they make."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from inscrutable.datasets import read_sectors
from inscrutable.errors import InputError
from inscrutable.experiments.sections import WRITTEN_SHARE, Label, Likely, NonNegative, Section, Share
from inscrutable.problems import Polyhedron, group_caps, long_short, max_weights, min_weights

Saying = Callable[[str], AbstractContextManager[Any]]

_MOST_TURNOVER = 10.0  # a larger value is probably a percentage: 30 for 30 %
_MOST_GROSS = 100.0  # likewise: 160 for 160 %


class LimitsPart(Section):
    """Limits on weights, each as 0.25 or "25%". Without `long_short` weights are nonnegative and sum to one."""

    max_weight: Annotated[Likely, WRITTEN_SHARE] | dict[Label, Share] | None = Field(
        default=None, description="most of every asset, or a table of assets and theirs"
    )
    min_weight: Share | dict[Label, Share] | None = Field(
        default=None, description="least of every asset, or a table of assets and theirs"
    )
    sectors: dict[Label, list[Label]] | str | None = Field(
        default=None, description="a table of sectors and their assets, or a CSV with the columns asset and sector"
    )
    sector_cap: Annotated[NonNegative, WRITTEN_SHARE] | dict[Label, Share] | None = Field(
        default=None, description="most of every sector, or a table of sectors and theirs"
    )
    long_short: Annotated[Share, Field(gt=0.0, le=_MOST_GROSS)] | None = Field(
        default=None, description="most that long and short holdings add up to"
    )
    net: float | None = Field(default=None, description="with `long_short`: what long less short holdings add up to; 1")
    shortable: list[Label] | None = Field(default=None, description="with `long_short`: assets that may be short; all")
    turnover: Annotated[Share, Field(ge=0.0, le=_MOST_TURNOVER)] | None = Field(
        default=None, description="most that is bought plus sold against the last published weights"
    )

    def region(self, assets: tuple[str, ...], folder: Path = Path(), saying: Saying = nullcontext) -> Polyhedron:
        """Return the feasible set of weights of these assets, without the limit on turnover; files lie in `folder`.

        Args:
            assets: Their names.
            folder: Folder of the file of sectors.
            saying: Adds where a key stands to the message of an error.

        Raises:
            InputError: A name is not an asset, a cap has no sectors, or a key needs `long_short`.
            ModelError: A limit excludes every decision by itself.
        """
        rows = self._signs(assets, saying)
        if self.max_weight is not None:
            with saying("max_weight"):
                rows = rows & max_weights(assets, self.max_weight)
        if self.min_weight is not None:
            with saying("min_weight"):
                rows = rows & min_weights(assets, self.min_weight)
        if (self.sectors is None) != (self.sector_cap is None):
            one, other = ("sectors", "sector_cap") if self.sector_cap is None else ("sector_cap", "sectors")
            with saying(one):
                raise InputError(
                    f"{one} and {other} go together: which assets a sector has (--sectors FILE, columns asset and sector), and "
                    "how much of it may be held (--sector-cap)"
                )
        if self.sectors is not None and self.sector_cap is not None:
            with saying("sectors"):
                known = self.resolved(assets, folder).sectors
                assert isinstance(known, dict)
                group_caps(assets, known, 1.0)  # their assets, before the caps
            with saying("sector_cap"):
                rows = rows & group_caps(assets, known, self.sector_cap)
        return rows

    def _signs(self, assets: tuple[str, ...], saying: Saying) -> Polyhedron:
        """Which weights may be negative, and what they add up to."""
        if self.long_short is not None:
            net = 1.0 if self.net is None else self.net
            with saying("long_short"):
                rows = long_short(assets, gross=self.long_short, net=net)
            if self.shortable is None:
                return rows
            with saying("shortable"):
                return long_short(assets, gross=self.long_short, net=net, shortable=self.shortable)
        for key in ("net", "shortable"):
            if getattr(self, key) is not None:
                with saying(key):
                    raise InputError(
                        f"{key} goes with long_short, the limit on long and short holdings: give that as well"
                    )
        least = self.min_weight if isinstance(self.min_weight, dict) else {"all": self.min_weight or 0.0}
        if min(least.values(), default=0.0) < 0.0:
            with saying("min_weight"):
                raise InputError(
                    f"min_weight is {min(least.values()):g}, and weights below 0 need long_short: give that as well"
                )
        return min_weights(assets, 0.0) & Polyhedron(
            A_eq=np.ones((1, len(assets))), b_eq=[1.0], names=["sum of weights = 1"], asset_names=assets
        )

    def resolved(self, assets: tuple[str, ...], folder: Path = Path()) -> LimitsPart:
        """Return the limits with the sectors of a file as a table, so that they no longer need it."""
        if not isinstance(self.sectors, str):
            return self
        return self.model_copy(update={"sectors": read_sectors(folder / self.sectors, assets=assets)})

    def over(self, other: LimitsPart) -> LimitsPart:
        """Return other limits, with the limits given here replacing theirs."""
        return other.model_copy(update=self.model_dump(exclude_none=True))

    @property
    def is_empty(self) -> bool:
        """Whether there are no limits."""
        return not self.model_dump(exclude_none=True)
