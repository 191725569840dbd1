"""The lotteries of many beliefs over three states: neighbours follow each other, so that each starts from the last."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from inscrutable.decision_makers.face_search import rules_for
from inscrutable.geometry.hulls import sum_zero_basis
from inscrutable.kernels.lotteries import Arena
from inscrutable.kernels.threads import in_chunks
from inscrutable.kernels.three_lotteries import Plane, Scene, lotteries_three
from inscrutable.validation import Array

_CHUNK = 512


def search_plane(
    plane: Plane, arena: Arena, scene: Scene, out: tuple[Array, ...], progress: Callable[[int, int], None] | None
) -> np.ndarray:
    """Fill the lotteries `out` and return which beliefs and budgets need the general search, shape (T,B).

    The points of the scene are beliefs (T,3) here. out: index, face, decoys, regrets, privacies, probabilities, prices,
    as `polish_lotteries` fills them, for every budget: (T,B,…).
    """
    basis = sum_zero_basis(3)
    order = _walk(scene.beliefs @ basis)
    sorted_out = tuple(np.empty_like(part) for part in out)
    failures = np.empty(scene.limits.shape, dtype=np.bool_)
    walked = Scene._make(part[order] if isinstance(part, np.ndarray) else part for part in scene)
    walked = walked._replace(points=np.ascontiguousarray(walked.points @ basis))
    rules = rules_for(3)

    def work(low: int, high: int) -> None:
        lotteries_three(low, high, walked, plane, arena, rules, sorted_out, failures)

    in_chunks(work, len(order), _CHUNK, progress)
    for part, found in zip(out, sorted_out, strict=True):
        part[order] = found
    failed = np.empty_like(failures)
    failed[order] = failures
    return failed


def _walk(z: Array) -> np.ndarray:
    """An order of points (T,2) in which neighbours are near each other: strips, up and down in turn."""
    low, width = z.min(axis=0), max(float(np.ptp(z, axis=0).max()), np.finfo(float).tiny)
    strip = ((z[:, 0] - low[0]) / width * max(1.0, np.sqrt(0.5 * len(z)))).astype(np.int64)
    return np.lexsort((np.where(strip % 2 == 0, z[:, 1], -z[:, 1]), strip))
