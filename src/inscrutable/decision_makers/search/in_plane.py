"""Decisions and lotteries of many beliefs over three states, each searched by itself in the plane of beliefs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from inscrutable.decision_makers.search.face_search import rules_for
from inscrutable.kernels.threads import in_chunks
from inscrutable.kernels.three_leaves import Plane, Scene
from inscrutable.kernels.three_lotteries import lotteries_three, lottery_tools
from inscrutable.kernels.three_singles import single_tools, singles_three
from inscrutable.validation import Array

_CHUNK = 256


def lotteries_in_plane(
    plane: Plane, scene: Scene, out: tuple[Array, ...], progress: Callable[[int, int], None] | None
) -> np.ndarray:
    """Fill the lotteries `out` and return which beliefs and budgets need the general search, shape (T,B).

    The points of the scene are beliefs (T,3) here. out: index, face, decoys, regrets, privacies, probabilities, prices,
    as `polish_lotteries` fills them, for every budget: (T,B,…).
    """
    failures = np.empty(scene.limits.shape, dtype=np.bool_)
    _search((lotteries_three, lottery_tools), plane, scene, (*out, failures), progress)
    return failures


def singles_in_plane(
    plane: Plane, scene: Scene, out: tuple[Array, ...], progress: Callable[[int, int], None] | None
) -> None:
    """Fill the single decisions `out`: index, face, decoys, regrets, privacies, prices, for every budget: (T,B,…)."""
    _search((singles_three, single_tools), plane, scene, out, progress)


def _search(
    search: tuple[Callable[..., None], Callable[..., tuple[Any, ...]]],
    plane: Plane,
    scene: Scene,
    out: tuple[Array, ...],
    progress: Callable[[int, int], None] | None,
) -> None:
    kernel, tools = search
    rules = rules_for(3)
    flat = scene._replace(points=scene.points @ rules.basis)

    def work(low: int, high: int) -> None:
        kernel(low, high, flat, plane, rules, out, tools(plane))

    in_chunks(work, len(scene.beliefs), _CHUNK, progress)
