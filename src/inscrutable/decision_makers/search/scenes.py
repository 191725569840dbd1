"""What a search is given: beliefs to hide, the point that their privacy is measured from, and what may be spent."""

from __future__ import annotations

import numpy as np

from inscrutable.kernels.region_climb import Scene
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array


def scene_of(problem: QuadraticProblem, beliefs: Array, points: Array, sign: float, limits: Array) -> Scene:
    """Return the scene of beliefs (T,X), points (T,X), the sign of the distance from them, and budgets (T,) of regret.

    Costs are those of `problem`, an atlas's: what all decisions cost alike in a state is left out, and no digit is lost to it.
    """
    # Copies, all of one layout: kernels would be compiled anew for one that is read-only.
    held, aims, spent = (np.array(values, dtype=np.float64, order="C") for values in (beliefs, points, limits))
    return Scene(held, aims, sign, costs_at(problem, held, held)[0], spent, np.zeros(len(held)))


def costs_at(problem: QuadraticProblem, decoys: Array, beliefs: Array) -> tuple[Array, np.ndarray]:
    """Costs (T,) under beliefs (T,X) of the optimal decisions of decoys (T,X), and which of them are admissible."""
    actions = problem.solve_rows(decoys)
    return (problem.state_costs(actions) * beliefs).sum(axis=1), problem.constraints.is_admissible(actions)


def farthest_corners(points: Array) -> Array:
    """Return the distances of points (T,X) from the corners of the simplex that are farthest: ‖p‖² − 2 min p_i + 1."""
    least = points[:, 0]
    for column in points.T[1:]:
        least = np.minimum(least, column)
    return np.asarray(np.sqrt(np.einsum("ti,ti->t", points, points) - 2.0 * least + 1.0))
