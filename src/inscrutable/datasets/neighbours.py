"""Weights of other packages as a frame with one row per decision; none of the packages is imported."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from inscrutable import tolerances
from inscrutable.axes import few
from inscrutable.errors import InputError

_CASH = ("cash", "usdollar")
"""cvxportfolio's name of its last column, the cash account."""


def weights_of(given: Any) -> pd.DataFrame:
    """Return the weights of other packages as `attack_weights` and `audit` read them: one row per decision.

    Formula: PyPortfolioOpt's mapping from asset to weight becomes one row. Riskfolio's frame has one row per asset and one
    column per portfolio, and is transposed unless its rows alone add up to one. cvxportfolio's result, or its frame `w`, has
    one row per time; a zero column of cash is dropped. A Series becomes one row.

    Args:
        given: The object.

    Raises:
        InputError: `given` is none of these, a weight is not finite, labels are duplicated, or cash is held, which is not an
            asset here.

    Cost: O(cells). Source: the packages' documents.

    Example:
        >>> weights_of({"Food": 0.25, "Oil": 0.75})
           Food   Oil
        0  0.25  0.75
    """
    frame = _frame(given)
    columns = [str(each) for each in frame.columns]
    if len(set(columns)) < len(columns):
        raise InputError(
            f"the weights have the asset {next(each for each in columns if columns.count(each) > 1)!r} more than once"
        )
    try:
        frame = frame.astype(np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"the weights must be numbers: {error}") from None
    if not np.isfinite(frame.to_numpy()).all():
        row, column = np.argwhere(~np.isfinite(frame.to_numpy()))[0]
        raise InputError(f"the weight of {columns[column]} in row {int(row)} is {float(frame.to_numpy()[row, column])}")
    cash = [label for label in frame.columns if str(label).lower() in _CASH]
    for label in cash:
        held = frame[label].abs().max()
        if held > tolerances.PUBLISHED_SUM:
            raise InputError(f"the weights hold up to {held:.3g} in {label!r}, which is no asset of a portfolio here")
    return frame.drop(columns=cash)


def _is_upright(held: pd.DataFrame) -> bool:
    """Whether a frame has a row per asset: portfolios are then numbered, named "weights", or columns alone add up to 1.

    It has none where rows alone add up to 1.
    """
    if not all(isinstance(each, str) for each in held.index):
        return False
    numbers = held.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=np.float64)
    columns, rows = (np.abs(numbers.sum(axis=axis) - 1.0) <= tolerances.PUBLISHED_SUM for axis in (0, 1))
    if rows.all() and not columns.all():
        return False
    if [str(each).lower() for each in held.columns] == ["weights"] or all(
        isinstance(each, int) for each in held.columns
    ):
        return True
    return bool(columns.all() and not rows.all())


def _frame(given: Any) -> pd.DataFrame:
    labelled = isinstance(given, (Mapping, pd.Series, pd.DataFrame))  # pandas gives the asset w as an attribute
    held = given if labelled else getattr(given, "w", given)
    if isinstance(held, Mapping):
        if not held:
            raise InputError("the weights are an empty mapping; expected one number per asset")
        return pd.DataFrame([dict(held)])
    if isinstance(held, pd.Series):
        return held.to_frame().T.reset_index(drop=True)
    if isinstance(held, pd.DataFrame) and held.size:
        return held.T.reset_index(drop=True) if _is_upright(held) else held
    raise InputError(
        "weights must be a mapping from assets (PyPortfolioOpt), a frame (Riskfolio, cvxportfolio) or a result with the frame "
        f"w, got {type(held).__name__}: {few([repr(held)[:60]])}"
    )
