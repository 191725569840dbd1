"""Lotteries over three states, from belief to belief: a finer grid, the adversary's view, and degenerate input."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    MarkowitzProblem,
    MaximalObfuscation,
    MixedDecisions,
    ProbabilisticDecisionMaker,
    consistent_beliefs,
    decoy_grid,
)
from inscrutable.decision_makers.candidates import Candidates, make_candidates
from inscrutable.decision_makers.search import lottery_search, region_search
from inscrutable.geometry.hulls import sum_zero_basis
from oracles import markets
from sizes import audited, instances, paired, some

Array = NDArray[np.float64]

BASIS = sum_zero_basis(3)
SIGNS = pytest.mark.parametrize("sign", [1.0, -1.0], ids=["far", "near"])


# --- lotteries ----------------------------------------------------------------------------------------------------------


class Told(NamedTuple):
    """A decision maker, beliefs, the points it aims at, and the result."""

    maker: ProbabilisticDecisionMaker
    beliefs: Array
    points: Array
    sign: float
    mixed: MixedDecisions

    @property
    def problem(self) -> MarkowitzProblem:
        assert isinstance(self.maker.problem, MarkowitzProblem)
        return self.maker.problem

    @property
    def optimal_costs(self) -> Array:
        return np.asarray(self.problem.optimal_cost(self.beliefs))

    @property
    def limits(self) -> Array:
        return self.maker.budget.limits(self.optimal_costs)


def measure_for(points: Array, sign: float) -> MaximalObfuscation | DesiredObfuscation:
    return MaximalObfuscation() if sign > 0 else DesiredObfuscation(points)


def told(
    problem: MarkowitzProblem,
    candidates: Candidates | Array,
    beliefs: Array,
    sign: float,
    budget: Budget | float,
    targets: Array | None = None,
) -> Told:
    points = beliefs
    if sign < 0:
        drawn = np.random.default_rng(99).dirichlet(np.ones(3), len(beliefs))
        points = drawn if targets is None else np.broadcast_to(targets, beliefs.shape)
    maker = ProbabilisticDecisionMaker(problem, measure_for(points, sign), budget, candidates=candidates)
    return Told(maker, beliefs, points, sign, maker.decide_many(beliefs))


def budget_of(problem: MarkowitzProblem, share: float) -> Budget:
    """A share of the median regret of an optimal decision under another belief."""
    beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 200)
    regrets = problem.regret(beliefs, problem.solve(beliefs[::-1].copy()))
    return Budget.regret(share * float(np.median(regrets)))


def assert_told_truly(case: Told) -> None:
    """Privacy and regret recomputed from the actions alone; the budget kept; no worse than doing nothing."""
    problem, mixed, costs, limits = case.problem, case.mixed, case.optimal_costs, case.limits
    for t, belief in enumerate(case.beliefs):
        one, unit = mixed[t], max(1.0, abs(costs[t]))
        assert 1 <= len(one.probabilities) <= 2
        np.testing.assert_allclose(one.probabilities.sum(), 1.0, atol=1e-14)
        regrets, privacies = np.empty((2, len(one.probabilities)))
        for i, action in enumerate(one.actions):
            assert problem.constraints.is_admissible(action)
            seen = consistent_beliefs(problem, action)
            assert not seen.is_empty
            regrets[i] = problem.regret(belief, action)
            privacies[i] = case.sign * seen.distance(case.points[t])
        np.testing.assert_allclose(one.regrets, regrets, atol=1e-10 * unit)
        np.testing.assert_allclose(one.privacies, privacies, atol=1e-6)
        assert one.probabilities @ regrets <= limits[t] * (1 + 1e-9) + 1e-12 * unit
        np.testing.assert_allclose(one.expected_cost, costs[t] + one.probabilities @ regrets, atol=1e-10 * unit)
        np.testing.assert_allclose(one.expected_privacy, one.probabilities @ privacies, atol=1e-6)
        own = consistent_beliefs(problem, problem.solve(belief)).distance(case.points[t])
        assert one.expected_privacy >= case.sign * own - 1e-7
        assert one.expected_privacy <= mixed.privacy_bound[t] + 1e-12


def envelope(regrets: Array, privacies: Array, limit: float) -> float:
    """The concave envelope at the limit: least μ·limit + max_l (Ψ_l − μ ρ_l) over prices μ ≥ 0, by halving."""
    kept = np.isfinite(privacies)
    regrets, privacies = regrets[kept], privacies[kept]
    low, high, best = 0.0, 1e12, np.inf
    for _ in range(120):
        price = 0.5 * (low + high) if high < 1e-3 or low > 0 else np.sqrt(max(low, 1e-12) * high)
        top = int((privacies - price * regrets).argmax())
        best = min(best, float(privacies[top] - price * (regrets[top] - limit)))
        low, high = (price, high) if regrets[top] > limit else (low, price)
    return min(best, float(privacies.max()))


def envelopes(case: Told, candidates: Candidates) -> Array:
    """For every belief, what all mixtures of the candidates reach."""
    kept = candidates.usable & (candidates.sets.dimension >= 0)
    values = []
    for t, belief in enumerate(case.beliefs):
        regrets = np.maximum(candidates.state_costs[kept] @ belief - case.optimal_costs[t], 0.0)
        privacies = case.sign * candidates.sets.distances(case.points[t])[kept]
        values.append(envelope(regrets, privacies, float(case.limits[t])))
    return np.array(values)


MARKETS = [(4, True), (6, True), (3, False), (6, False)]


def drawn_market(seed: int, n_assets: int, spread: bool = True) -> markets.Market:
    """Means of ±0.1 leave most assets held; of ±0.6, few."""
    market = markets.random_market(np.random.default_rng([17, seed, n_assets]), 3, n_assets)
    return market._replace(means=market.means * (0.3 if spread else 2.0))


def market_problem(seed: int, n_assets: int, spread: bool) -> MarkowitzProblem:
    return MarkowitzProblem(*drawn_market(seed, n_assets, spread))


@pytest.mark.parametrize(("n_assets", "spread"), some(MARKETS, 4))
def test_a_lottery_is_as_good_as_a_grid_much_finer(n_assets: int, spread: bool) -> None:
    problem = market_problem(1, n_assets, spread)
    few = 100 if audited() else 50
    candidates, fine = decoy_grid(problem, few), decoy_grid(problem, 7 * few)
    beliefs = np.random.default_rng(7).dirichlet(np.ones(3), 6)
    gains = []
    for sign, share in paired((1.0, -1.0), (0.02, 0.3)):
        case = told(problem, candidates, beliefs, sign, budget_of(problem, share))
        gains.append(case.mixed.expected_privacy - envelopes(case, fine))
        assert_told_truly(case)
    assert np.min(gains) >= -1e-3
    assert np.mean(np.array(gains) >= -1e-4) >= 0.95, "climbs are local: a rare one misses a better face"
    assert np.max(gains) <= 3 / (7 * few)


@pytest.mark.parametrize(("market", "sign"), paired(MARKETS, [1.0, -1.0]))
def test_a_lottery_is_what_the_adversary_sees_and_no_worse_than_a_single_decision(
    market: tuple[int, bool], sign: float
) -> None:
    for seed in range(2, 2 + instances(2, least=1)):
        problem = market_problem(seed, *market)
        candidates, budget = decoy_grid(problem, 50 if audited() else 25), budget_of(problem, 0.1)
        beliefs = np.random.default_rng(seed).dirichlet(np.full(3, 0.7), instances(24, least=12))
        case = told(problem, candidates, beliefs, sign, budget)
        assert_told_truly(case)
        assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()
        for t in range(0, len(beliefs), 4):
            measure = measure_for(case.points[t], sign)
            single = CounterAdversarialDecisionMaker(problem, measure, budget, candidates=candidates)
            assert case.mixed.expected_privacy[t] >= single.decide(beliefs[t]).privacy - 1e-6


# --- the walk -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("n_assets", "spread", "sign"), some([(*each, sign) for each in MARKETS for sign in (1.0, -1.0)], 5)
)
def test_the_order_of_beliefs_does_not_matter(n_assets: int, spread: bool, sign: float) -> None:
    problem = market_problem(4, n_assets, spread)
    rng = np.random.default_rng(8)
    beliefs = rng.dirichlet(np.ones(3), instances(700, least=280))
    target = rng.dirichlet(np.ones(3))
    candidates, budget = decoy_grid(problem, 60), budget_of(problem, 0.1)
    case = told(problem, candidates, beliefs, sign, budget, target)
    order = rng.permutation(len(beliefs))
    shuffled = told(problem, candidates, beliefs[order], sign, budget, target).mixed.expected_privacy
    few = told(problem, candidates, beliefs[::7], sign, budget, target).mixed.expected_privacy
    off = np.abs(shuffled - case.mixed.expected_privacy[order])
    assert off.max() <= 1e-3
    assert (off <= 1e-6).mean() >= 0.99
    # With fewer beliefs each has other neighbours, from whose lotteries the climbs start.
    off = np.abs(few - case.mixed.expected_privacy[::7])
    assert off.max() <= 1e-2
    assert (off <= 1e-6).mean() >= 0.95


@SIGNS
def test_one_belief_and_many_times_the_same(sign: float) -> None:
    problem = market_problem(6, 5, True)
    candidates, budget = decoy_grid(problem, 40), budget_of(problem, 0.1)
    belief, target = np.array([[0.5, 0.3, 0.2]]), np.array([0.1, 0.2, 0.7])
    one = told(problem, candidates, belief, sign, budget, target)
    assert_told_truly(one)
    many = told(problem, candidates, np.repeat(belief, 600, axis=0), sign, budget, target).mixed
    np.testing.assert_allclose(many.expected_privacy, one.mixed.expected_privacy[0], atol=1e-7)
    among = np.vstack([belief, np.random.default_rng(0).dirichlet(np.ones(3), 30), belief])
    mixed = told(problem, candidates, among, sign, budget, target).mixed
    np.testing.assert_allclose(mixed.expected_privacy[[0, -1]], one.mixed.expected_privacy[0], atol=1e-6)


@SIGNS
@pytest.mark.parametrize(("n_assets", "spread"), MARKETS)
def test_corners_and_edges_of_the_simplex_as_beliefs(n_assets: int, spread: bool, sign: float) -> None:
    problem = market_problem(7, n_assets, spread)
    candidates = decoy_grid(problem, 40)
    beliefs = np.vstack([np.eye(3), [[0.5, 0.5, 0.0], [0.0, 0.3, 0.7], [1 - 1e-9, 1e-9, 0.0]]])
    case = told(problem, candidates, beliefs, sign, budget_of(problem, 0.1))
    assert_told_truly(case)
    assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()


@SIGNS
def test_no_budget_buys_nothing_and_a_huge_one_everything(sign: float) -> None:
    for n_assets, spread in MARKETS:
        problem = market_problem(8, n_assets, spread)
        candidates = decoy_grid(problem, 40)
        beliefs = np.random.default_rng(2).dirichlet(np.ones(3), 8)
        none = told(problem, candidates, beliefs, sign, Budget.regret(0.0))
        assert_told_truly(none)
        for t, belief in enumerate(beliefs):
            one = none.mixed[t]
            assert len(one.probabilities) == 1
            own = consistent_beliefs(problem, problem.solve(belief)).distance(none.points[t])
            if sign > 0:
                assert one.expected_privacy <= 1e-7
            else:
                np.testing.assert_allclose(one.expected_privacy, -own, atol=1e-6)

        huge = told(problem, candidates, beliefs, sign, Budget.regret(1e6))
        assert_told_truly(huge)
        assert (huge.mixed.probabilities[:, 1] == 0).all()
        np.testing.assert_allclose(huge.mixed.price, 0.0, atol=1e-9)
        kept = candidates.usable & (candidates.sets.dimension >= 0)
        for t in range(len(beliefs)):
            top = (sign * candidates.sets.distances(huge.points[t])[kept]).max()
            assert huge.mixed.expected_privacy[t] >= top - 1e-7
        if sign < 0:
            targeted = np.array([problem.constraints.is_admissible(problem.solve(point)) for point in huge.points])
            np.testing.assert_allclose(huge.mixed.expected_privacy[targeted], 0.0, atol=1e-7)


@SIGNS
@pytest.mark.parametrize("n_assets", [1, 2, 3, 5])
@pytest.mark.parametrize("alike", [2, 3])
def test_regimes_that_cost_the_same(n_assets: int, alike: int, sign: float) -> None:
    """Every decision has a segment of beliefs at least, and one decision all of them where all regimes are alike."""
    market = drawn_market(9, n_assets)
    for array in market[:2]:
        array[1:alike] = array[0]  # type: ignore[index]
    problem = MarkowitzProblem(*market)
    candidates = decoy_grid(problem, 20)
    beliefs = np.random.default_rng(3).dirichlet(np.ones(3), 12)
    case = told(problem, candidates, beliefs, sign, budget_of(problem, 0.2))
    assert_told_truly(case)
    assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()


@SIGNS
@pytest.mark.parametrize("n_assets", [3, 5])
def test_duplicated_assets(n_assets: int, sign: float) -> None:
    market = drawn_market(10, n_assets)
    means, covariances, _ = market
    means[:, -1] = means[:, 0]
    covariances[:, -1, :] = covariances[:, 0, :]
    covariances[:, :, -1] = covariances[:, :, 0]
    problem = MarkowitzProblem(*market)
    candidates = decoy_grid(problem, 20)
    beliefs = np.random.default_rng(4).dirichlet(np.ones(3), 12)
    case = told(problem, candidates, beliefs, sign, budget_of(problem, 0.2))
    assert_told_truly(case)
    assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()


@SIGNS
def test_many_corners_with_polygons_of_beliefs(sign: float) -> None:
    """Twelve assets, each the only one that is worth holding around a direction of belief of its own."""
    angles = 2 * np.pi * np.arange(12) / 12
    means = np.column_stack([np.cos(angles), np.sin(angles)]) @ BASIS.T + 1e-3
    problem = MarkowitzProblem(means.T, [1e-4 * np.eye(12)] * 3, 1.0)
    candidates = decoy_grid(problem, 40)
    beliefs = np.random.default_rng(4).dirichlet(np.ones(3), 12)
    case = told(problem, candidates, beliefs, sign, budget_of(problem, 0.2))
    assert_told_truly(case)
    assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()


@SIGNS
@pytest.mark.parametrize("n_assets", [1, 2])
def test_one_and_two_assets(n_assets: int, sign: float) -> None:
    for seed in range(instances(3, least=2)):
        problem = market_problem(seed, n_assets, seed > 0)
        candidates = decoy_grid(problem, 40)
        beliefs = np.random.default_rng(5).dirichlet(np.ones(3), 12)
        case = told(problem, candidates, beliefs, sign, budget_of(problem, 0.1))
        assert_told_truly(case)
        assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()
        if n_assets == 1:
            np.testing.assert_allclose(case.mixed.expected_privacy, 0.0, atol=1e-9)
            np.testing.assert_allclose(case.mixed.actions, 1.0, atol=1e-12)


@SIGNS
def test_an_asset_that_is_never_held_changes_nothing(sign: float) -> None:
    market = drawn_market(11, 4)
    means = np.column_stack([market.means, np.full(3, -10.0)])
    covariances = np.zeros((3, 5, 5))
    covariances[:, :4, :4], covariances[:, 4, 4] = market.covariances, 1.0
    beliefs = np.random.default_rng(6).dirichlet(np.ones(3), 60)
    found = []
    for problem in (MarkowitzProblem(*market), MarkowitzProblem(means, covariances, market.risk_aversion)):
        case = told(problem, decoy_grid(problem, 40), beliefs, sign, Budget.regret(0.002))
        assert_told_truly(case)
        found.append(case.mixed.expected_privacy)
        assert case.problem.n_actions == 4 or not case.mixed.actions[:, :, 4].any()
    np.testing.assert_allclose(*found, atol=1e-6)


@SIGNS
def test_candidates_given_as_plain_actions(sign: float) -> None:
    """No decoys; some of the actions are explained by no belief, some are not admissible."""
    problem = market_problem(12, 4, True)
    rng = np.random.default_rng(7)
    actions = np.vstack([problem.solve(rng.dirichlet(np.ones(3), 300)), rng.dirichlet(np.ones(4), 50)])
    candidates = make_candidates(problem, actions)
    beliefs = rng.dirichlet(np.ones(3), 24)
    case = told(problem, actions, beliefs, sign, budget_of(problem, 0.1))
    assert_told_truly(case)
    assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()


@pytest.mark.parametrize(("market", "share"), paired(MARKETS, [0.02, 0.3]))
def test_special_targets(market: tuple[int, bool], share: float) -> None:
    """A target equal to the belief and an affordable one are met exactly; corners are approached."""
    problem = market_problem(13, *market)
    candidates, budget = decoy_grid(problem, 40), budget_of(problem, share)
    beliefs = np.random.default_rng(8).dirichlet(np.ones(3), 10)
    meets = problem.constraints.is_admissible(problem.solve(beliefs))
    same = told(problem, candidates, beliefs, -1.0, budget, beliefs)
    assert_told_truly(same)
    np.testing.assert_allclose(same.mixed.expected_privacy[meets], 0.0, atol=1e-7)

    beside = 0.97 * beliefs + 0.03 * beliefs[::-1]
    affordable = problem.regret(beliefs, problem.solve(beside)) <= 0.99 * budget.limit(1.0)
    near = told(problem, candidates, beliefs, -1.0, budget, beside)
    assert_told_truly(near)
    affordable &= problem.constraints.is_admissible(problem.solve(beside))
    assert affordable.any()
    np.testing.assert_allclose(near.mixed.expected_privacy[affordable], 0.0, atol=1e-7)

    for corner in np.eye(3):
        case = told(problem, candidates, beliefs, -1.0, budget, corner)
        assert_told_truly(case)
        assert (case.mixed.expected_privacy >= envelopes(case, candidates) - 1e-6).all()


@SIGNS
def test_blocks_of_beliefs_are_all_filled(sign: float, monkeypatch: pytest.MonkeyPatch) -> None:
    problem = market_problem(14, 5, True)
    candidates, budget = decoy_grid(problem, 30), budget_of(problem, 0.1)
    beliefs, target = np.random.default_rng(9).dirichlet(np.ones(3), 100), np.array([0.6, 0.2, 0.2])
    whole = told(problem, candidates, beliefs, sign, budget, target).mixed.expected_privacy
    monkeypatch.setattr(lottery_search, "_BLOCK", 30)
    monkeypatch.setattr(region_search, "_BLOCK", 30)
    parts = told(problem, candidates, beliefs, sign, budget, target)
    assert_told_truly(parts)
    np.testing.assert_allclose(parts.mixed.expected_privacy, whole, atol=1e-12)
