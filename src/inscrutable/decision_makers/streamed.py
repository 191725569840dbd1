"""From streamed lotteries to results: the optimal and the polished single decision are always among the atoms."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.atlas import Atlas, atlas_of
from inscrutable.decision_makers.counter_adversarial import Case, best_decision
from inscrutable.decision_makers.results import DecisionStatus, MixedDecision, MixedDecisions, Progress
from inscrutable.decision_makers.streaming import OWN, Aims, Lotteries, Spot, farthest_corners, stream_lotteries
from inscrutable.kernels.lottery_polish import POLISHED
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation
from inscrutable.problems import QuadraticProblem
from inscrutable.validation import Array

_KINDS = np.array(
    [DecisionStatus.NO_AFFORDABLE_PRIVACY, DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE], dtype=object
)


def stream(case: Case, beliefs: Array, progress: Progress | None) -> MixedDecisions:
    """Return the lotteries of beliefs (T,X); `case` gives everything but the belief.

    Where the candidates are so coarse that the optimal decision would be an atom, the belief is searched as a single one.
    """
    atlas, aims = _atlas(case), _aims(case, beliefs)
    found = stream_lotteries(atlas, beliefs, aims, progress=progress)
    coarse = ((found.index == OWN) & (found.probabilities > 0)).any(axis=1)
    for step in np.flatnonzero(coarse):
        at_step = case._replace(belief=beliefs[step], measure=case.measure.at_step(int(step)))
        found.take(int(step), _one(atlas, at_step))
    return _results(found, aims)


def stream_one(case: Case) -> MixedDecision:
    """Return the lottery of one belief, the polished single decision among its atoms."""
    return _results(_one(_atlas(case), case), _aims(case, case.belief[None]))[0]


def _one(atlas: Atlas, case: Case) -> Lotteries:
    best = best_decision(case)
    known = Spot(case.problem.constraints.tight_rows(best.action), best.decoy, best.regret, best.privacy)
    return stream_lotteries(atlas, case.belief[None], _aims(case, case.belief[None]), known=known)


def _atlas(case: Case) -> Atlas:
    assert isinstance(case.problem, QuadraticProblem)
    return atlas_of(case.problem, case.candidates)


def _aims(case: Case, beliefs: Array) -> Aims:
    if isinstance(case.measure, MaximalObfuscation):
        return Aims(beliefs, 1.0, (case.budget,))
    assert isinstance(case.measure, DesiredObfuscation)
    return Aims(case.measure.targets_for(beliefs), -1.0, (case.budget,))


def _results(found: Lotteries, aims: Aims) -> MixedDecisions:
    points, sign = aims.points, aims.sign
    privacy = np.einsum("ta,ta->t", found.probabilities, found.privacies)
    alone = found.probabilities[:, 1] <= 0.0
    best = np.where(alone, found.privacies[:, 0], np.maximum(found.privacies[:, 0], found.privacies[:, 1]))
    polished = (found.index[:, 0] == POLISHED) | (found.index[:, 1] == POLISHED)
    bounds = farthest_corners(points) if sign > 0 else np.zeros(len(privacy))
    nothing = best <= tolerances.NO_PRIVACY if sign > 0 else np.isneginf(best)
    codes = np.where(nothing, 0, np.where(polished, 1, 2))
    return MixedDecisions(
        found.probabilities,
        found.regrets,
        found.privacies,
        found.optimal_costs + np.einsum("ta,ta->t", found.probabilities, found.regrets),
        privacy,
        found.optimal_costs,
        np.maximum(bounds, privacy),
        found.prices,
        found.decoys,
        tuple(_KINDS[codes]),
        found,
    )
