"""Twelve US industry portfolios, the market and the riskless rate, monthly 1949-01 to 2017-03, shipped with the package.

``PROVENANCE.md`` beside the file states its source and the selection.
"""

from __future__ import annotations

import bz2
import hashlib
from dataclasses import dataclass
from importlib import resources
from io import StringIO
from types import MappingProxyType

import pandas as pd

_FILE = "us_industries.csv.bz2"

INDUSTRIES = MappingProxyType(
    {
        "NoDur": "Non-durables",
        "Durbl": "Durables",
        "Manuf": "Manufacturing",
        "Enrgy": "Energy",
        "Chems": "Chemicals",
        "BusEq": "Business equipment",
        "Telcm": "Telecoms",
        "Utils": "Utilities",
        "Shops": "Retail",
        "Hlth": "Health care",
        "Money": "Finance",
        "Other": "Other",
    }
)
"""The data library's short name of each industry, which is the column label, and its full name."""


@dataclass(frozen=True)
class IndustryReturns:
    """Monthly returns of industries, market and riskless rate, on one index of month ends.

    Args:
        returns: (T,12) simple monthly returns as fractions, raw (not in excess of the riskless rate), one column per
            industry.
        market: (T,) simple monthly return of the whole market, raw.
        riskless: (T,) return of the one-month Treasury bill over the same month.
        provenance: Source, vintage, and the SHA-256 of the file that was read.
    """

    returns: pd.DataFrame
    market: pd.Series
    riskless: pd.Series
    provenance: str

    def summary(self) -> str:
        """Return coverage and source of the data as two lines."""
        first, last = self.returns.index[0], self.returns.index[-1]
        size = f"{self.returns.shape[1]} industries, {len(self.returns)} months"
        return f"{size} ({first:%Y-%m} to {last:%Y-%m}), simple monthly returns, raw\n{self.provenance}"


def load_industry_returns() -> IndustryReturns:
    """Load the embedded returns of 12 US industries with the market and the riskless rate.

    819 months from 1949-01 to 2017-03 without a gap. Row t is the simple return of the month that ends at its label,
    r_t = P_t / P_{t-1} - 1 with dividends, as a fraction in US dollars, not annualised. The industries are raw returns:
    subtract `riskless` for excess returns. The library states the market in excess, so market = MktRF + RF here.

    Returns:
        `returns` (819,12) with the library's short names as columns (`INDUSTRIES` spells them out), `market` (819,),
        `riskless` (819,), and `provenance`.

    Cost: a few milliseconds; every call returns fresh frames. Source: Kenneth R. French's data library, as shipped
    in linearmodels 7.1.

    Example:
        >>> from inscrutable.datasets import load_industry_returns
        >>> data = load_industry_returns()
        >>> data.returns.shape, str(data.returns.index[0].date()), str(data.returns.index[-1].date())
        ((819, 12), '1949-01-31', '2017-03-31')
    """
    packed = resources.files("inscrutable.datasets").joinpath(_FILE).read_bytes()
    frame = pd.read_csv(StringIO(bz2.decompress(packed).decode("ascii")), index_col="month")
    frame.index = pd.DatetimeIndex(
        pd.PeriodIndex(frame.index, freq="M").to_timestamp(how="end").normalize(), name="month", freq="ME"
    )
    provenance = (
        "Kenneth R. French's data library, vintage of linearmodels 7.1 (french.csv.bz2); "
        f"{_FILE} sha256 {hashlib.sha256(packed).hexdigest()}"
    )
    return IndustryReturns(
        returns=frame[list(INDUSTRIES)].copy(),
        market=(frame["MktRF"] + frame["RF"]).rename("market"),
        riskless=frame["RF"].rename("riskless"),
        provenance=provenance,
    )
