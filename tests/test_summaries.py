"""Printing a result says in words what it is, and never spills its arrays."""

from __future__ import annotations

import inspect

import numpy as np
import pytest

import inscrutable
from inscrutable import (
    BudgetAwareAdversary,
    CategoricalEmission,
    FiniteProblem,
    HiddenMarkovModel,
    MarkowitzProblem,
    NaiveAdversary,
    consistent_beliefs,
    decoy_grid,
    filter_beliefs,
    grouped,
    near_optimal_beliefs,
)

PROBLEM = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
WORLD = HiddenMarkovModel([[0.9, 0.1], [0.3, 0.7]], CategoricalEmission([[0.8, 0.2], [0.1, 0.9]]))
CHOICES = FiniteProblem([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4]])


@pytest.mark.parametrize(
    ("result", "said"),
    [
        (consistent_beliefs(PROBLEM, [0.5, 0.5]), "one belief: state 0 0.500, state 1 0.500"),
        (consistent_beliefs(CHOICES, 0), "a segment of beliefs: state 0 0.600 to 1.000, state 1 0.000 to 0.400"),
        (consistent_beliefs(FiniteProblem([[0.0, 1.0, 0.6], [1.0, 0.0, 0.6]]), 2), "no belief over 2 states"),
        (near_optimal_beliefs(PROBLEM, [0.5, 0.5], 0.01), "costs at most 0.01 above the best"),
        (BudgetAwareAdversary(PROBLEM, 0.01).infer([0.5, 0.5]), "convex set(s)"),
        (decoy_grid(PROBLEM, 10), "11 candidate decisions of 2 coordinates, 11 distinct, 0 outside"),
        (filter_beliefs(WORLD, [0, 1]), "2 beliefs over 2 states, the last [0.6109 0.3891], log-likelihood -1.7190"),
        (WORLD.sample(5, rng=np.random.default_rng(0)), "path of 5 steps"),
        (
            NaiveAdversary(CHOICES, disclosure=grouped(["a", "a", "b"]), candidates=[0, 1, 2]).infer(0),
            "union of 2 sets",
        ),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_printed_results_are_sentences(result: object, said: str) -> None:
    assert said in str(result)
    assert "array(" not in str(result)


def test_every_public_result_with_a_summary_prints_it() -> None:
    """A dataclass writes a representation of its own unless it is told not to."""
    for name in inscrutable.__all__:
        thing = getattr(inscrutable, name)
        if inspect.isclass(thing) and hasattr(thing, "summary") and thing.__str__ is object.__str__:
            assert not hasattr(thing.__repr__, "__wrapped__"), (
                name
            )  # what a dataclass writes is wrapped against recursion
