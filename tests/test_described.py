"""Decision makers and how they show themselves."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from inscrutable import (
    Budget,
    CoinDecisionMaker,
    CounterAdversarialDecisionMaker,
    DelayedDecisionMaker,
    DirichletDecisionMaker,
    ExponentialDecisionMaker,
    MarkowitzProblem,
    OriginalDecisionMaker,
    PartialDecisionMaker,
    ProbabilisticDecisionMaker,
    RateDistortionDecisionMaker,
    RoundingDecisionMaker,
    StackelbergDecisionMaker,
    UniformDecisionMaker,
    uniform_prior,
)

PROBLEM = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
PRIOR = uniform_prior(2, 4)


@pytest.mark.parametrize(
    ("maker", "told"),
    [
        (OriginalDecisionMaker(PROBLEM), ""),
        (CounterAdversarialDecisionMaker(PROBLEM), ", measure MaximalObfuscation(), budget 0.1 of |c*|"),
        (ProbabilisticDecisionMaker(PROBLEM, None, 0.2), ", measure MaximalObfuscation(), budget 0.2 of |c*|"),
        (RateDistortionDecisionMaker(PROBLEM, 0.1, prior=PRIOR), ", budget 0.1 of |c*|, prior of 5 beliefs"),
        (
            StackelbergDecisionMaker(PROBLEM, Budget.regret(0.5), prior=PRIOR),
            ", budget regret of 0.5, prior of 5 beliefs",
        ),
        (UniformDecisionMaker(PROBLEM, 0.1), ", budget 0.1 of |c*|"),
        (ExponentialDecisionMaker(PROBLEM, 3.0), ", epsilon 3"),
        (CoinDecisionMaker(PROBLEM, 0.25), ", probability 0.25"),
        (DirichletDecisionMaker(PROBLEM, 20.0, rng=np.random.default_rng(0)), ", concentration 20"),
        (RoundingDecisionMaker(PROBLEM, 0.05), ", step 0.05"),
        (DelayedDecisionMaker(PROBLEM, 3), ", steps 3"),
        (PartialDecisionMaker(PROBLEM, 0.5), ", fraction 0.5"),
    ],
)
def test_decision_makers_say_what_they_are(maker: Any, told: str) -> None:
    assert repr(maker) == f"{type(maker).__name__}({PROBLEM!r}{told})"


@pytest.mark.parametrize("kind", [RateDistortionDecisionMaker, StackelbergDecisionMaker])
def test_showing_one_solves_nothing_and_solving_is_done_once(kind: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    maker, calls = kind(PROBLEM, Budget.regret(0.01), prior=PRIOR, candidates=PROBLEM.solve(PRIOR.beliefs)), []
    solve = maker._solve
    monkeypatch.setattr(maker, "_solve", lambda progress: calls.append(1) or solve(progress))
    repr(maker)
    assert not calls
    assert maker.solve() is maker
    assert len(maker.mechanism.beliefs) == len(PRIOR)
    assert maker.decide(PRIOR.beliefs[1]).probabilities.sum() == pytest.approx(1.0)
    assert calls == [1]
