"""Many beliefs over three states: neighbours follow each other, so that each search starts from the last."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from inscrutable.decision_makers.search.face_search import rules_for
from inscrutable.kernels.threads import in_chunks
from inscrutable.kernels.three_leaves import Plane, Scene
from inscrutable.kernels.three_lotteries import lotteries_three, lottery_tools
from inscrutable.kernels.three_singles import single_tools, singles_three
from inscrutable.kernels.three_states import bench
from inscrutable.kernels.three_values import best_costs_three
from inscrutable.validation import Array

_CHUNK = 1024


def walk_lotteries(
    plane: Plane,
    scene: Scene,
    order: np.ndarray,
    out: tuple[Array, ...],
    progress: Callable[[int, int], None] | None,
) -> np.ndarray:
    """Fill the lotteries `out` and return which beliefs and budgets need the general search, shape (T,B).

    The points of the scene are beliefs (T,3) here. out: index, face, decoys, regrets, privacies, probabilities, prices,
    as `polish_lotteries` fills them, for every budget: (T,B,…).
    """
    failures = np.empty(scene.limits.shape, dtype=np.bool_)
    _walk((lotteries_three, lottery_tools), plane, scene, order, (*out, failures), progress)
    return failures


def walk_singles(
    plane: Plane,
    scene: Scene,
    order: np.ndarray,
    out: tuple[Array, ...],
    progress: Callable[[int, int], None] | None,
) -> None:
    """Fill the single decisions `out`: index, face, decoys, regrets, privacies, prices, for every budget: (T,B,…)."""
    _walk((singles_three, single_tools), plane, scene, order, out, progress)


def _walk(
    search: tuple[Callable[..., None], Callable[..., tuple[Any, ...]]],
    plane: Plane,
    scene: Scene,
    order: np.ndarray,
    out: tuple[Array, ...],
    progress: Callable[[int, int], None] | None,
) -> None:
    kernel, tools = search
    rules, n_budgets = rules_for(3), scene.limits.shape[1]
    walked = scene._replace(points=scene.points @ rules.basis)
    if len(order) > 1:
        # Read one after the other: a walk through memory at random would wait for it.
        walked = Scene._make(part[order] if isinstance(part, np.ndarray) else part for part in walked)

    def work(low: int, high: int) -> None:
        kernel(low, high, order, walked, plane, rules, out, tools(plane, n_budgets))

    in_chunks(work, len(order), _CHUNK, progress)


def walk_costs(plane: Plane, decoys: Array, beliefs: Array, order: np.ndarray) -> Array:
    """Return the costs (T,) under beliefs (T,3) of the optimal decisions of decoys (T,3); NaN: on no face of the plane."""
    out = np.empty(len(beliefs))

    def work(low: int, high: int) -> None:
        best_costs_three(low, high, order, decoys, beliefs, plane.ground, rules_for(3).pivot, out, bench(plane.ground))

    in_chunks(work, len(order), _CHUNK)
    return out


def walking_order(beliefs: Array) -> np.ndarray:
    """An order of beliefs (T,3) in which neighbours are near each other: strips of the plane, up and down in turn.

    Beliefs over other numbers of states stay as they are.
    """
    if len(beliefs) == 1 or beliefs.shape[1] != 3:
        return np.arange(len(beliefs))
    z = beliefs @ rules_for(3).basis
    first, second = z[:, 0] - z[:, 0].min(), z[:, 1] - z[:, 1].min()
    width = max(float(first.max()), float(second.max()), np.finfo(float).tiny)
    strip = np.floor(first / width * max(1.0, np.sqrt(0.5 * len(z))))
    along = second / (2.0 * width)  # below 1, so that one number tells strip and place
    turned = strip.astype(np.int64) & 1 == 1
    along[turned] = 0.5 - along[turned]
    return np.argsort(strip + along)
