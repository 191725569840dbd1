"""Parts of all contract checkers: the error for a broken promise, and beliefs and decisions to try."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.decision_makers.candidate_sources import random_actions
from inscrutable.errors import ModelError
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

INTERIOR = 12
"""Number of tried beliefs in the interior of the simplex."""
_DECISIONS = 12


def promise(kept: bool, what: str, detail: str) -> None:
    """Raise `AssertionError` with the promise and the values found, unless it is kept."""
    if not kept:
        raise AssertionError(f"broken promise: {what}; {detail}")


def check_shape(name: str, found: tuple[int, ...], wanted: tuple[int, ...]) -> None:
    """Promise a shape."""
    promise(found == wanted, f"the shape of {name}", f"found {found}, expected {wanted}")


def source_of(rng: Any) -> np.random.Generator:
    """Return the generator of the trials; None: a fixed seed, the same at every call."""
    return np.random.default_rng(0) if rng is None else validation.generator(rng)


def tried_beliefs(n_states: int, rng: np.random.Generator) -> Array:
    """Return beliefs (T,X): the interior first, then faces and corners."""
    flat = rng.dirichlet(np.ones(n_states), INTERIOR)
    faces = np.where(rng.uniform(size=flat.shape) < 0.5, flat, 0.0)
    faces = faces[faces.sum(axis=1) > 0]
    return np.vstack([flat, faces / faces.sum(axis=1, keepdims=True), np.eye(n_states)])


def tried_actions(problem: DecisionProblem, solved: Array, rng: np.random.Generator) -> Array:
    """Return feasible decisions (M,U), none of them optimal on purpose."""
    if problem.is_discrete:
        return np.eye(problem.n_actions)[rng.integers(problem.n_actions, size=_DECISIONS)]
    try:
        drawn = random_actions(problem, _DECISIONS, rng=rng)
    except ModelError:  # unbounded: mixtures of optimal decisions
        return np.asarray(rng.dirichlet(np.ones(len(solved)), _DECISIONS) @ solved)
    # Away from the boundary, where costs such as logarithms have no slope.
    return np.asarray(0.9 * drawn + 0.1 * drawn.mean(axis=0))


def same(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Return which numbers agree to `tolerances.CONTRACT` of their size, NaN and infinities with themselves."""
    return np.asarray(np.isclose(first, second, rtol=tolerances.CONTRACT, atol=tolerances.CONTRACT, equal_nan=True))
