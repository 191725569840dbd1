"""Daily returns of twenty US stocks, from the prices that the optional package skfolio ships."""

from __future__ import annotations

import pandas as pd

from inscrutable.datasets.tables import simple_returns
from inscrutable.errors import InputError


def load_daily_returns() -> pd.DataFrame:
    """Load simple daily returns of 20 stocks of the S&P 500, 1990-01-03 to 2022-12-28, labels kept.

    r_t = P_t / P_{t-1} - 1 from adjusted closing prices, as fractions, not annualised. The prices are skfolio's
    `load_sp500_dataset`, which is part of that package and needs no network. The twenty companies were chosen with hindsight:
    use the data for tests, not to evaluate an investment.

    Returns:
        (8312,20), a DatetimeIndex of trading days, ticker symbols as columns.

    Raises:
        InputError: The package skfolio is not installed or cannot be loaded (the message says how to install it), or the
            installed version has to download the prices and cannot.

    Cost: about two seconds, nearly all of it the first import of skfolio. Source: skfolio, BSD-3-Clause.

    Example:
        >>> from inscrutable.datasets import load_daily_returns
        >>> returns = load_daily_returns()  # doctest: +SKIP
        >>> returns.shape  # doctest: +SKIP
        (8312, 20)
    """
    try:
        from skfolio.datasets import load_sp500_dataset
    except ImportError as error:
        raise InputError(
            "daily prices come from the optional package skfolio, which could not be loaded "
            f"({error}): pip install 'inscrutable[data]'"
        ) from None
    try:
        prices = load_sp500_dataset()
    except OSError as error:
        raise InputError(
            f"skfolio could not read its S&P 500 prices ({error}); its current version ships them with the package: "
            "pip install --upgrade 'inscrutable[data]'"
        ) from None
    return simple_returns(prices)
