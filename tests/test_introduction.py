"""The claims of the paper's introduction: what must be measured whatever the market, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

import inscrutable as ins
from inscrutable.experiments.introduction import IntroductionVerdict, introduction_claims
from inscrutable.reports.reproduction import introduction_table


def test_verdicts_that_theory_decides() -> None:
    """One who copies on the same problem needs nothing else; a known fraction of a trade gives its target away."""
    claims = {claim.key: claim for claim in introduction_claims(3, rng=np.random.default_rng(5))}
    assert claims["copying"].verdict is IntroductionVerdict.HOLDS
    assert claims["copying"].knowing.measured == pytest.approx(1.0, abs=1e-9)
    partial = claims["partial trades"]
    assert partial.verdict is IntroductionVerdict.AT_FACE_VALUE
    assert partial.knowing.measured == pytest.approx(0.0, abs=1e-6)
    assert claims["delay"].knowing.measured > 0.1
    assert claims["all hide"].knowing.share == 1.0
    table = introduction_table(list(claims.values()))
    assert list(table.index) == list(claims)
    assert table.loc["herding", "decisions taken for optimal"] == ""
    assert str(partial).endswith("holds only against the naive observer")


def test_too_few_markets_are_refused() -> None:
    """An average of one market has no error."""
    with pytest.raises(ins.InputError, match="at least 2 markets, got 1"):
        introduction_claims(1, rng=np.random.default_rng(0))
    with pytest.raises(ins.InputError, match=r"numpy\.random\.Generator"):
        introduction_claims(2, rng=3)  # type: ignore[arg-type]
