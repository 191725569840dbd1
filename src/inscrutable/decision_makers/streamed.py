"""From streamed lotteries to results: the optimal and the polished single decision are always among the atoms."""

from __future__ import annotations

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.counter_adversarial import Case, best_found
from inscrutable.decision_makers.results import Decision, DecisionStatus, MixedDecision, MixedDecisions, Progress
from inscrutable.decision_makers.search.atlas import Atlas, atlas_of
from inscrutable.decision_makers.search.streaming import OWN, Aims, Lotteries, Spot, farthest_corners, stream_lotteries
from inscrutable.kernels.lottery_polish import POLISHED
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation
from inscrutable.validation import Array

_KINDS = np.array(
    [DecisionStatus.NO_AFFORDABLE_PRIVACY, DecisionStatus.POLISHED, DecisionStatus.BEST_CANDIDATE], dtype=object
)

_COARSE = 1000  # candidates


def stream(case: Case, beliefs: Array, progress: Progress | None) -> MixedDecisions:
    """Return the lotteries of beliefs (T,X); `case` gives everything but the belief.

    Where the candidates are so coarse that the optimal decision would be an atom, the belief is searched as a single one.
    """
    atlas, aims = _atlas(case), _aims(case, beliefs)
    found = stream_lotteries(atlas, beliefs, aims, progress=progress)
    coarse = ((found.index == OWN) & (found.probabilities > 0)).any(axis=1)
    for step in np.flatnonzero(coarse):
        at_step = case._replace(belief=beliefs[step], measure=case.measure.at_step(int(step)))
        found.take(int(step), _one(atlas, at_step, _aims(at_step, at_step.belief[None])))
    return _results(found, aims)


def stream_one(case: Case) -> MixedDecision:
    """Return the lottery of one belief, the polished single decision among its atoms."""
    aims = _aims(case, case.belief[None])
    return _result(_one(_atlas(case), case, aims), aims)


def _one(atlas: Atlas, case: Case, aims: Aims) -> Lotteries:
    best = best_found(case)
    if isinstance(best, Decision):
        known = Spot(atlas.form.variables(best.action), best.decoy, best.regret, best.privacy, best.optimal_cost)
    else:
        known = best.spot()
    found = stream_lotteries(atlas, case.belief[None], aims, known=known)
    if len(case.candidates) > _COARSE:
        return found
    # With few candidates, what is climbed from the known decision may miss a better pair.
    without = stream_lotteries(atlas, case.belief[None], aims)
    return max(found, without, key=lambda each: float((each.probabilities * each.privacies).sum()))


def _atlas(case: Case) -> Atlas:
    return atlas_of(case.problem, case.candidates)


def _aims(case: Case, beliefs: Array) -> Aims:
    if isinstance(case.measure, MaximalObfuscation):
        return Aims(beliefs, 1.0, (case.budget,))
    assert isinstance(case.measure, DesiredObfuscation)
    return Aims(case.measure.targets_for(beliefs), -1.0, (case.budget,))


def _result(found: Lotteries, aims: Aims) -> MixedDecision:
    """The only belief's lottery as `_results` has it, without arrays for many."""
    kept = found.probabilities[0] > 0.0
    probabilities, regrets, privacies = found.probabilities[0, kept], found.regrets[0, kept], found.privacies[0, kept]
    optimal_cost, privacy = float(found.optimal_costs[0]), float(probabilities @ privacies)
    away = aims.sign > 0
    best = max(privacies.tolist())
    if best <= (tolerances.NO_PRIVACY if away else -np.inf):
        status = DecisionStatus.NO_AFFORDABLE_PRIVACY
    else:
        polished = POLISHED in found.index[0].tolist()
        status = DecisionStatus.POLISHED if polished else DecisionStatus.BEST_CANDIDATE
    return MixedDecision(
        found.actions((0, kept)),
        probabilities,
        regrets,
        privacies,
        optimal_cost + float(probabilities @ regrets),
        privacy,
        optimal_cost,
        max(float(farthest_corners(aims.points)[0]) if away else 0.0, privacy),
        float(found.prices[0]),
        found.decoys[0, kept],
        status,
        found.problem,
    )


def _results(found: Lotteries, aims: Aims) -> MixedDecisions:
    points, sign = aims.points, aims.sign
    privacy, regret = (_expected(found.probabilities, values) for values in (found.privacies, found.regrets))
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
        found.optimal_costs + regret,
        privacy,
        found.optimal_costs,
        np.maximum(bounds, privacy),
        found.prices,
        found.decoys.copy(),  # decisions are made from those that are kept
        tuple(_KINDS[codes]),
        found,
    )


def _expected(probabilities: Array, values: Array) -> Array:
    """Σ_l p_l v_l of lotteries (T,2): two columns are added faster than rows of two."""
    return np.asarray(probabilities[:, 0] * values[:, 0] + probabilities[:, 1] * values[:, 1])
