"""Figures of the three long experiments on small input, held against those of the first release.

Those of the reproduction and of the backtest stand where their results are: in test_reproduction.py and test_backtest.py.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd

from inscrutable.experiments.comparison import COMPARED, ComparisonSettings
from inscrutable.experiments.comparison_study import compared, comparison_study
from sizes import audited

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
    """To 1e-3; in `make test` the first four rows. Of the PDM's lotteries, which are equally private, others were found since:
    what else is made of them moves by 1.5e-3. The sequential rule is simulated: where a last digit moves a draw, its figures
    move with its prices. The rule of least rate is another one within its gap of 1e-3 bits, and what it leaks in ten draws
    moves by up to 2.2 %. Of the Stackelberg rules of largest error another is found since, which leaves more at equal spending.
    Where an estimate ties, the chance of naming is shared among the tied states since; the first release took the first of
    them. Since all rows use the same draws, what is drawn for six of them is another sample, at most 1.3 standard errors away:
    these figures are the present ones. So are those of the CDM among candidates alone: at the same privacies it spends 1.5 %
    less since."""
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1, 10), draws=100)
    makers = tuple(COMPARED)[: None if audited() else 4]
    study = comparison_study(settings, makers, market="paper", resolution=6, seed=0)
    found, _ = compared(study, None, say=lambda text: None, progress=lambda done, total: None)
    wanted = golden("compare").loc[list(makers)]
    frame = found.frame().set_index("maker")
    counted = ["n_actions"]  # moves with the last digits of a budget
    frame, wanted = frame.drop(columns=counted), wanted.drop(columns=counted)
    assert_same(frame.loc[["PDM"]], wanted.loc[["PDM"]], rtol=2e-3, atol=1e-9)
    if not audited():
        frame, wanted = frame.drop("PDM"), wanted.drop("PDM")
        assert_same(frame, wanted, rtol=1e-3, atol=1e-9)
        return
    moved = ["PDM", "rate-distortion", "sequential", "Stackelberg"]
    assert_same(frame.drop(moved), wanted.drop(moved), rtol=1e-3, atol=1e-9)
    simulated = ["path_bits", *(name for name in wanted if "after_10" in name)]
    rate = frame.loc[["rate-distortion"]], wanted.loc[["rate-distortion"]]
    assert_same(*(each.drop(columns=simulated) for each in rate), rtol=1e-3, atol=1e-9)
    assert_same(*(each[simulated] for each in rate), rtol=2.5e-2, atol=1e-9)
    assert_same(frame.loc[["sequential"]], wanted.loc[["sequential"]], rtol=1e-2, atol=1e-9)
    spent = ["expected_regret"]
    assert_same(frame.loc[["Stackelberg"], spent], wanted.loc[["Stackelberg"], spent], rtol=1e-3, atol=1e-9)
    assert float(frame.loc["Stackelberg", "bayes_error"]) >= float(wanted.loc["Stackelberg", "bayes_error"])
