"""Anderson's extrapolation of fixed-point iterations: linear ones end after as many steps as there are unknowns."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable.alphas.extrapolation import Extrapolation


def steps_to(fixed: np.ndarray, contraction: np.ndarray, extrapolation: Extrapolation | None) -> int:
    """Count the steps x ← x* + M (x − x*) from zero until x is x* to nine digits."""
    point = np.zeros_like(fixed)
    for count in range(10_000):
        if np.abs(point - fixed).max() <= 1e-9 * np.abs(fixed).max():
            return count
        image = fixed + contraction @ (point - fixed)
        point = (
            image
            if extrapolation is None
            else np.concatenate(extrapolation.after([point[:2], point[2:]], [image[:2], image[2:]]))
        )
    return 10_000


@pytest.mark.parametrize("n", [2, 4, 6])
def test_a_linear_iteration_ends_after_as_many_steps_as_unknowns(n: int, fresh_rng: np.random.Generator) -> None:
    basis = np.linalg.qr(fresh_rng.standard_normal((n, n)))[0]
    contraction = (basis * np.linspace(-0.9, 0.99, n)) @ basis.T
    fixed = fresh_rng.standard_normal(n)
    assert steps_to(fixed, contraction, Extrapolation(n, [1.0, 10.0])) <= n + 4  # two for the start, two for rounding
    assert steps_to(fixed, contraction, None) > 100


def test_an_iteration_that_forgets_begins_again(fresh_rng: np.random.Generator) -> None:
    extrapolation = Extrapolation(3, [1.0])
    point, image = fresh_rng.standard_normal((2, 3))
    for _ in range(2):
        (after,) = extrapolation.after([point], [image])
        np.testing.assert_array_equal(after, image)
        (after,) = extrapolation.after([image], [0.5 * image])
        assert np.abs(after - 0.5 * image).max() > 0.0
        extrapolation.forget()
