"""Mixtures of decisions: the concave envelope and the linear programme against all pairs, tried one by one."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inscrutable import MarkowitzProblem, MaximalObfuscation, NonExistence, action_grid, decoy_grid, privacy_frontier
from inscrutable.decision_makers.envelope import (
    RatedPoints,
    best_mixture,
    best_mixtures,
    concave_envelope,
    mixture_by_linear_programme,
    undominated,
)
from inscrutable.errors import InputError, SolverError
from oracles import enumeration, markets
from sizes import instances
from strategies import SEEDS, belief_problem, drawn_problems


class Given(RatedPoints):
    """Points whose privacies are exact."""

    def __init__(self, regrets, privacies):
        self.regrets, self.privacies, self.exact = regrets, privacies, np.ones(len(regrets), dtype=bool)

    def refine(self, place):
        raise AssertionError("all are exact")


VALUES = st.sampled_from([0.0, 0.25, 0.5, 0.75, 1.0])


def points(draw_ties, rng, n):
    if draw_ties:  # few distinct values: vertical steps, equal points, three on a line
        regrets, privacies = rng.integers(0, 5, n) / 4, rng.integers(0, 5, n) / 4
    else:
        regrets, privacies = rng.exponential(size=n), rng.uniform(-1, 1.4, n)
    privacies = np.where(rng.uniform(size=n) < 0.2, -np.inf, privacies)
    return regrets.astype(float), privacies.astype(float)


@settings(max_examples=instances(300), deadline=None)
@given(SEEDS, st.integers(1, 25), st.booleans(), st.one_of(VALUES, st.floats(0, 4)))
def test_envelope_and_programme_equal_all_pairs(seed, n, ties, limit):
    regrets, privacies = points(ties, np.random.default_rng(seed), n)
    expected = enumeration.upper_concave_envelope(regrets, privacies, limit)
    found = best_mixture(regrets, privacies, limit)
    solved = mixture_by_linear_programme(regrets, privacies, limit)
    if np.isneginf(expected):
        assert found is None
        assert solved is None
        return
    for mixture in (found, solved):
        assert len(mixture.indices) == len(mixture.probabilities) <= 2
        assert mixture.probabilities.sum() == pytest.approx(1, abs=1e-12)
        assert (mixture.probabilities > 0).all()
        assert mixture.probabilities @ regrets[mixture.indices] <= limit + 1e-9
        assert mixture.probabilities @ privacies[mixture.indices] == pytest.approx(expected, abs=1e-7)
    assert found.probabilities @ regrets[found.indices] <= limit + 1e-12
    assert found.probabilities @ privacies[found.indices] == pytest.approx(expected, abs=1e-8)
    assert enumeration.pdm_lp(regrets, privacies, limit)[0] == pytest.approx(expected, abs=1e-7)
    step = 1e-4
    ahead = enumeration.upper_concave_envelope(regrets, privacies, limit + step)
    assert found.price * step >= ahead - expected - 1e-9  # a concave function lies below its slope
    assert found.price >= 0


def test_the_undominated_points_by_hand():
    regrets = np.array([0.3, 0.1, 0.2, 0.1, 0.4, 0.5])
    privacies = np.array([0.5, 0.2, 0.2, 0.1, 0.9, -np.inf])
    assert undominated(regrets, privacies).tolist() == [1, 0, 4]
    assert concave_envelope(regrets, privacies).tolist() == [1, 4]


def test_a_step_straight_up_and_points_on_a_line():
    assert concave_envelope(np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 2.0])).tolist() == [1, 2]
    assert concave_envelope(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 2.0])).tolist() == [0, 2]
    assert concave_envelope(np.array([1.0]), np.array([-np.inf])).size == 0
    assert concave_envelope(np.zeros(0), np.zeros(0)).size == 0


def test_without_a_budget_the_free_point_is_alone():
    found = best_mixture(np.array([0.0, 1.0]), np.array([0.2, 1.0]), 0.0)
    assert (found.indices.tolist(), found.probabilities.tolist()) == ([0], [1.0])


def test_the_price_is_the_dual_of_the_budget():
    regrets, privacies = np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 3.0])
    for limit, price in [(0.5, 2.0), (2.0, 0.5), (5.0, 0.0)]:
        assert best_mixture(regrets, privacies, limit).price == pytest.approx(price)
        assert mixture_by_linear_programme(regrets, privacies, limit).price == pytest.approx(price)


@pytest.mark.parametrize("top", [0.7, -0.7, 0.0, np.inf])
def test_of_almost_equal_points_the_cheapest_is_taken(top):
    """As by symmetry, where rounding decides which of them is the largest."""
    regrets, privacies = np.array([0.3, 0.1, 0.2, 0.0]), np.array([np.nextafter(top, np.inf), top, top, -1.0])
    privacies = privacies if top else np.array([0.0, 0.0, 0.0, -1.0])
    assert Given(regrets, privacies).best(1.0) == 1
    if np.isfinite(top):
        assert best_mixture(regrets, privacies, 1.0).indices.tolist() == [1]
        assert best_mixture(regrets, privacies, 0.05).indices.tolist() == [3, 1]


# --- the frontier -------------------------------------------------------------------------------------------------------


@settings(max_examples=instances(30), deadline=None)
@given(drawn_problems(states=(2, 3), assets=(2, 4), kinds=[{}], spread=1.0, min_slack=1e-4), st.booleans())
def test_the_frontier_is_brute_force_over_its_candidates(drawn, by_action):
    candidates = (action_grid if by_action else decoy_grid)(drawn.problem, 8)
    frontier = privacy_frontier(drawn.problem, drawn.belief, candidates=candidates)
    own = drawn.problem.solve(drawn.belief)
    actions = np.vstack([candidates.actions, own])
    usable = np.append(candidates.usable, True)
    regrets = drawn.problem.regret(drawn.belief, actions)
    measure = MaximalObfuscation()
    privacies = np.array(
        [measure(drawn.belief, candidates.sets[i]) for i in range(len(candidates))]
        + [0.0]  # the optimal decision tells everything
    )
    privacies = np.where(np.isinf(privacies) | ~usable, -np.inf, privacies)
    limits = np.concatenate([[0.0], np.quantile(regrets, [0.1, 0.3, 0.5, 0.9]), [2 * regrets.max() + 1]])
    deterministic, randomized = frontier.deterministic(limits), frontier.randomized(limits)
    scale = np.abs(candidates.state_costs).max()
    for limit, single, lottery in zip(limits, deterministic, randomized, strict=True):
        slack = 1e-12 * scale
        at_most = privacies[regrets <= limit + slack].max()
        at_least = privacies[regrets <= max(limit - slack, 0.0)].max(initial=-np.inf)
        assert at_least - 1e-9 <= single <= at_most + 1e-9
        mixed = enumeration.upper_concave_envelope(regrets, privacies, limit)
        more = enumeration.upper_concave_envelope(regrets, privacies, limit + slack)
        assert max(single, mixed) - 1e-6 <= lottery <= more + 1e-6
    assert (np.diff(deterministic) >= 0).all()
    assert (np.diff(randomized) >= -1e-12).all()
    prices = frontier.price(limits)
    assert (prices >= 0).all()
    assert prices[-1] == 0
    np.testing.assert_array_equal(frontier.points[:, 0], np.sort(frontier.points[:, 0]))
    assert (np.diff(frontier.points[:, 1]) > 0).all()


def test_the_frontier_in_closed_form():
    """ρ = d²/4 and Ψ = d: Ψ(r) = 2√r up to the farthest corner, straight lines where lotteries help: nowhere."""
    problem = belief_problem(3)
    belief = np.array([0.4, 0.35, 0.25])
    frontier = privacy_frontier(problem, belief)
    farthest = np.linalg.norm(belief - [0, 0, 1])
    for regret in (0.001, 0.01, 0.05):
        assert frontier.deterministic(regret) == pytest.approx(2 * np.sqrt(regret), abs=0.01)
        assert frontier.randomized(regret) == pytest.approx(2 * np.sqrt(regret), abs=0.005)
        assert frontier.price(regret) == pytest.approx(1 / np.sqrt(regret), rel=0.15)
    assert frontier.deterministic(1.0) == pytest.approx(farthest, abs=1e-9)
    assert frontier.randomized(1.0) == pytest.approx(farthest, abs=1e-9)
    assert frontier.price(1.0) == 0
    assert isinstance(frontier.deterministic(0.01), float)
    assert np.shape(frontier.randomized([0.01, 0.02])) == (2,)
    assert frontier.deterministic(0.0) == 0
    # Each point names its candidate: the same decision has that regret and that privacy.
    candidates = decoy_grid(problem, 20)
    named = privacy_frontier(problem, belief, candidates=candidates)
    for (regret, privacy), index in zip(named.points, named.indices, strict=True):
        if index == len(candidates):
            assert regret <= 1e-12
            continue
        assert float(problem.regret(belief, candidates.actions[index])) == pytest.approx(regret, abs=1e-12)
        assert candidates.sets[int(index)].distance(belief) == pytest.approx(privacy, abs=1e-9)


def test_the_frontier_of_an_indicator_is_a_step():
    problem = belief_problem(3)
    frontier = privacy_frontier(problem, [0.4, 0.35, 0.25], NonExistence(margin=0.2))
    assert frontier.deterministic(0.009) == -np.inf
    assert frontier.randomized(0.009) == -np.inf
    assert frontier.deterministic(0.0105) == 0  # margin²/4 = .01, and the grid's spacing
    assert frontier.price(0.5) == 0


def test_a_row_without_an_allowed_decision_is_refused():
    with pytest.raises(SolverError, match="not even its optimal one"):
        best_mixtures(np.eye(2), np.eye(2), np.ones(2), np.array([[True, True], [False, False]]))


def test_the_frontier_refuses_many_beliefs_and_negative_regrets():
    problem = MarkowitzProblem(*markets.random_market(np.random.default_rng(0), 2, 3))
    with pytest.raises(InputError, match="one belief"):
        privacy_frontier(problem, np.eye(2))
    frontier = privacy_frontier(problem, [0.5, 0.5])
    for query in (frontier.deterministic, frontier.randomized, frontier.price):
        with pytest.raises(InputError, match="at least 0"):
            query(-0.1)
        with pytest.raises(InputError, match="nan"):
            query([0.1, np.nan])
