"""From streamed lotteries to results: the optimal and the best single decision are always among the atoms."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.counter_adversarial import Case, best_decisions
from inscrutable.decision_makers.result_table import ResultTable, expected
from inscrutable.decision_makers.results import Decisions, DecisionStatus, MixedDecisions, Progress
from inscrutable.decision_makers.search.atlas import atlas_of
from inscrutable.decision_makers.search.streaming import KNOWN, Aims, Lotteries, farthest_corners, stream_lotteries
from inscrutable.kernels.lottery_polish import POLISHED
from inscrutable.validation import Array

_KINDS = np.array(
    [DecisionStatus.NO_AFFORDABLE_PRIVACY, DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE], dtype=object
)


def stream(case: Case, beliefs: Array, progress: Progress | None = None) -> MixedDecisions:
    """Return the lotteries of beliefs (T,X), each searched by itself, the best single decision among its atoms."""
    atlas, aims = atlas_of(case.problem, case.candidates), case.aims(beliefs)
    singles = best_decisions(case, beliefs, progress)
    found = stream_lotteries(atlas, beliefs, aims, singles=singles)
    # What is climbed from the single decision may miss a pair of atoms that is better still.
    without = stream_lotteries(atlas, beliefs, aims)
    better = expected(without.probabilities, without.privacies) > expected(found.probabilities, found.privacies)
    found.take(better, without)
    return _results(found, aims, singles)


def _results(found: Lotteries, aims: Aims, singles: Decisions) -> MixedDecisions:
    points, sign = aims.points, aims.sign
    alone = found.probabilities[:, 1] <= 0.0
    best = np.where(alone, found.privacies[:, 0], np.maximum(found.privacies[:, 0], found.privacies[:, 1]))
    known = np.array([status is DecisionStatus.POLISHED for status in singles.status])
    polished = ((found.index == POLISHED) | ((found.index == KNOWN) & known[:, None])).any(axis=1)
    nothing = best <= tolerances.NO_PRIVACY if sign > 0 else np.isneginf(best)
    codes = np.where(nothing, 0, np.where(polished, 1, 2))
    return MixedDecisions(
        ResultTable(
            found.problem,
            found.actions,
            found.probabilities,
            found.regrets,
            found.privacies,
            found.decoys.copy(),  # decisions are made from those that are kept
            found.optimal_costs,
            farthest_corners(points) if sign > 0 else np.zeros(len(codes)),
            tuple(_KINDS[codes]),
            found.prices,
        )
    )
