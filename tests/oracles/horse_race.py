"""Where u* = π and the regret is the Kullback–Leibler divergence: the farthest affordable stake, by bisection along rays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_RAYS = 4000


def farthest_stake(belief: NDArray[np.float64], budget: float, rng: np.random.Generator) -> float:
    """Return the largest ‖u − π‖ with divergence at most `budget`, over many random directions."""
    directions = rng.normal(size=(_RAYS, belief.size))
    directions -= directions.mean(axis=1, keepdims=True)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    low = np.zeros(_RAYS)
    high = np.where(directions < 0, -belief / np.where(directions < 0, directions, -1.0), np.inf).min(axis=1)
    for _ in range(60):
        middle = 0.5 * (low + high)
        stakes = np.maximum(belief + middle[:, None] * directions, 1e-300)
        inside = (belief * np.log(belief / stakes)).sum(axis=1) <= budget
        low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return float(low.max())
