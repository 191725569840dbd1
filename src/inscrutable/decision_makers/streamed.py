"""From the lotteries of many beliefs to results: the optimal and the best single decision are always among the atoms."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.counter_adversarial import Case, best_decisions
from inscrutable.decision_makers.result_table import ResultTable, known
from inscrutable.decision_makers.results import DecisionStatus, MixedDecisions, Progress
from inscrutable.decision_makers.search.atlas import atlas_of
from inscrutable.decision_makers.search.lottery_search import best_lotteries
from inscrutable.decision_makers.search.scenes import farthest_corners
from inscrutable.validation import Array

_KINDS = np.array(
    [DecisionStatus.NO_AFFORDABLE_PRIVACY, DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE], dtype=object
)


def stream(case: Case, beliefs: Array, progress: Progress | None = None) -> MixedDecisions:
    """Return the lotteries of beliefs (T,X), each searched by itself, the best single decision among its atoms."""
    optimal_costs = np.asarray(case.problem.optimal_cost(beliefs))
    atlas, scene = atlas_of(case.problem, case.candidates), case.scene(beliefs, optimal_costs)
    singles = best_decisions(case, beliefs)
    found = best_lotteries(atlas, scene, singles, progress)
    alone = found.probabilities[:, 1] <= 0.0
    best = np.where(alone, found.privacies[:, 0], found.privacies.max(axis=1))
    nothing = best <= tolerances.NO_PRIVACY if scene.sign > 0 else np.isneginf(best)
    return MixedDecisions(
        ResultTable(
            case.problem,
            known(atlas.decisions(found.actions)),
            found.probabilities,
            found.regrets,
            found.privacies,
            found.decoys,
            optimal_costs,
            farthest_corners(scene.points) if scene.sign > 0 else np.zeros(len(beliefs)),
            tuple(_KINDS[np.where(nothing, 0, np.where(found.polished, 1, 2))]),
            found.prices,
        )
    )
