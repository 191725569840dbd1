"""Many beliefs over three states: neighbours follow each other, so that each search starts from the last."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from inscrutable.decision_makers.face_search import rules_for
from inscrutable.kernels.lotteries import Arena
from inscrutable.kernels.threads import in_chunks
from inscrutable.kernels.three_leaves import Plane, Scene
from inscrutable.kernels.three_lotteries import lotteries_three, lottery_tools
from inscrutable.kernels.three_singles import single_tools, singles_three
from inscrutable.validation import Array

_CHUNK = 1024


def walk_lotteries(
    plane: Plane, arena: Arena, scene: Scene, out: tuple[Array, ...], progress: Callable[[int, int], None] | None
) -> np.ndarray:
    """Fill the lotteries `out` and return which beliefs and budgets need the general search, shape (T,B).

    The points of the scene are beliefs (T,3) here. out: index, face, decoys, regrets, privacies, probabilities, prices,
    as `polish_lotteries` fills them, for every budget: (T,B,…).
    """
    failures = np.empty(scene.limits.shape, dtype=np.bool_)
    _walk((lotteries_three, lottery_tools), plane, arena, scene, (*out, failures), progress)
    return failures


def walk_singles(
    plane: Plane, arena: Arena, scene: Scene, out: tuple[Array, ...], progress: Callable[[int, int], None] | None
) -> None:
    """Fill the single decisions `out`: index, face, decoys, regrets, privacies, prices, for every budget: (T,B,…)."""
    _walk((singles_three, single_tools), plane, arena, scene, out, progress)


def _walk(
    search: tuple[Callable[..., None], Callable[..., tuple[Any, ...]]],
    plane: Plane,
    arena: Arena,
    scene: Scene,
    out: tuple[Array, ...],
    progress: Callable[[int, int], None] | None,
) -> None:
    kernel, tools = search
    rules, n_budgets = rules_for(3), scene.limits.shape[1]
    basis = rules.basis
    if len(scene.beliefs) == 1:
        alone = scene._replace(points=scene.points @ basis)
        kernel(0, 1, alone, plane, arena, rules, out, tools(plane, arena, n_budgets))
        return
    order = _order(scene.beliefs @ basis)
    sorted_out = tuple(np.empty_like(part) for part in out)
    walked = Scene._make(part[order] if isinstance(part, np.ndarray) else part for part in scene)
    walked = walked._replace(points=walked.points @ basis)

    def work(low: int, high: int) -> None:
        kernel(low, high, walked, plane, arena, rules, sorted_out, tools(plane, arena, n_budgets))

    in_chunks(work, len(order), _CHUNK, progress)
    for part, found in zip(out, sorted_out, strict=True):
        part[order] = found


def _order(z: Array) -> np.ndarray:
    """An order of points (T,2) in which neighbours are near each other: strips, up and down in turn."""
    first, second = z[:, 0] - z[:, 0].min(), z[:, 1] - z[:, 1].min()
    width = max(float(first.max()), float(second.max()), np.finfo(float).tiny)
    strip = np.floor(first / width * max(1.0, np.sqrt(0.5 * len(z))))
    along = second / (2.0 * width)  # below 1, so that one number tells strip and place
    return np.argsort(strip + np.where(strip % 2.0 == 0.0, along, 0.5 - along))
