"""Figures of the three long experiments on small input, held against those of the first release."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from inscrutable import reproduce
from inscrutable.experiments.comparison import ComparisonSettings
from inscrutable.experiments.comparison_study import compared, comparison_study
from inscrutable.experiments.reproduction import ReproductionSettings
from inscrutable.reports.backtest import table_of
from inscrutable.reports.reproduction import claims_frame
from test_backtest import found as backtest  # noqa: F401  # a fixture

DATA = Path(__file__).resolve().parent / "data"


def golden(name: str) -> pd.DataFrame:
    return pd.read_csv(DATA / f"golden_{name}.csv", index_col=0)


def assert_same(found: pd.DataFrame, wanted: pd.DataFrame, *, rtol: float, atol: float) -> None:
    assert list(found.index) == list(wanted.index)
    for column in wanted.columns:
        one, other = found[column], wanted[column]
        if pd.api.types.is_float_dtype(other):
            np.testing.assert_allclose(one.astype(float), other, rtol=rtol, atol=atol, err_msg=column)
        else:
            assert list(one) == list(other), column


def test_a_comparison_has_the_figures_it_had() -> None:
    """To 1e-3. Of the PDM's lotteries, which are equally private, others were found since: what else is made of them moves
    by 1.5e-3. The sequential rule is simulated: where a last digit moves a draw, its figures move with its prices."""
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1, 10), draws=100)
    study = comparison_study(settings, market="paper", resolution=6, seed=0)
    found, _ = compared(study, None, say=lambda text: None, progress=lambda done, total: None)
    wanted = golden("compare")
    frame = found.frame().set_index("maker")
    counted = ["n_actions"]  # moves with the last digits of a budget
    frame, wanted = frame.drop(columns=counted), wanted.drop(columns=counted)
    moved = ["PDM", "sequential"]
    assert_same(frame.drop(moved), wanted.drop(moved), rtol=1e-3, atol=1e-9)
    assert_same(frame.loc[["PDM"]], wanted.loc[["PDM"]], rtol=2e-3, atol=1e-9)
    assert_same(frame.loc[["sequential"]], wanted.loc[["sequential"]], rtol=1e-2, atol=1e-9)


def test_a_reproduction_has_the_claims_it_had() -> None:
    sizes = {"resolution": 10, "simulations": 2, "market_steps": 2, "sample_resolutions": (2, 4)}
    settings = ReproductionSettings(steps=4, markets=3, budgets=(0.1, 1.0, 10.0), starts=(1, 2), **sizes)
    found = claims_frame(reproduce(settings, jobs=1))
    assert_same(found, golden("reproduce"), rtol=1e-5, atol=1e-6)


def test_a_backtest_has_the_table_it_had(request: pytest.FixtureRequest) -> None:
    found = table_of(request.getfixturevalue("backtest"))
    wanted = golden("backtest")
    kept = [name for name in wanted.index if name in found.index]
    assert len(kept) >= len(wanted) - 3
    assert_same(found.loc[kept], wanted.loc[kept], rtol=1e-4, atol=1e-6)
