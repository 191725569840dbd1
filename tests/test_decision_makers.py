"""ODM, CDM and PDM: what each promises, over random problems, all measures, both methods and both policies."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    Envelope,
    GlobalSearch,
    Infeasibility,
    LinearProgramme,
    LocalSearch,
    MarkowitzProblem,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    OriginalDecisionMaker,
    ProbabilisticDecisionMaker,
    action_grid,
    consistent_beliefs,
    decoy_grid,
    plausibility_gap,
)
from inscrutable.adversaries import consistent_sets
from oracles import enumeration, markets
from sizes import audited, instances, paired, some
from strategies import belief_problem, drawn_problems, line_problem

EXACT = 1e-12  # one inner product's rounding, relative to the cost's scale

MEASURES = [
    MaximalObfuscation(),
    DesiredObfuscation(lambda belief: np.roll(belief, 1)),
    NonExistence(),
    NonUniqueness(),
    Infeasibility(),
]


def rounding(problem, *actions):
    return EXACT * max(1e-300, *(float(np.abs(problem.state_costs(action)).max()) for action in actions))


def check_decision(problem, measure, belief, decision, limit):
    """Everything a `Decision` claims, recomputed from the action alone."""
    assert problem.constraints.is_admissible(decision.action) or decision.status is not DecisionStatus.BEST_CANDIDATE
    assert problem.constraints.violation(decision.action) <= 1e-9
    assert 0 <= decision.regret <= limit + rounding(problem, decision.action)
    assert decision.regret == pytest.approx(float(problem.regret(belief, decision.action)), rel=1e-13, abs=1e-14)
    assert decision.cost == pytest.approx(decision.optimal_cost + decision.regret, abs=1e-12)
    found = consistent_beliefs(problem, decision.action)
    assert decision.privacy == pytest.approx(measure(belief, found), abs=1e-9)
    assert decision.privacy <= decision.privacy_bound
    if not found.is_empty:
        assert found.distance(decision.decoy / decision.decoy.sum()) <= 1e-6
    assert decision.belief_set.is_empty == found.is_empty
    assert decision.status.value in decision.summary()


# --- properties over random problems ------------------------------------------------------------------------------------


@settings(max_examples=instances(15), deadline=None)
@given(drawn_problems(states=(2, 4), assets=(2, 8), spread=1.0, min_slack=1e-4), st.sampled_from([0.0, 0.02, 0.1, 1.0]))
def test_what_every_decision_maker_promises(drawn, share):
    problem, belief = drawn.problem, drawn.belief
    original = OriginalDecisionMaker(problem).decide(belief)
    assert original.privacy == 0
    assert original.privacy_bound == 0
    assert original.regret == 0
    assert original.status is DecisionStatus.OPTIMAL
    np.testing.assert_allclose(original.action, problem.solve(belief), atol=1e-13)
    limit = share * abs(original.optimal_cost)
    candidates = decoy_grid(problem, 12)
    measures = [MaximalObfuscation(), DesiredObfuscation(drawn.rng.dirichlet(np.ones(belief.size)))]
    for measure in [*measures, NonExistence(0.05), NonUniqueness()]:
        single = CounterAdversarialDecisionMaker(problem, measure, share, candidates=candidates).decide(belief)
        check_decision(problem, measure, belief, single, limit)
        mixed = ProbabilisticDecisionMaker(problem, measure, share, candidates=candidates).decide(belief)
        check_mixture(problem, measure, belief, mixed, limit)
        if measure in measures:
            assert mixed.expected_privacy >= single.privacy - 1e-12
            assert mixed.expected_privacy >= measure(belief, original.belief_set) - 1e-12


def check_mixture(problem, measure, belief, mixed, limit):
    assert len(mixed.probabilities) <= 2
    assert mixed.probabilities.sum() == pytest.approx(1, abs=1e-12)
    assert (mixed.probabilities > 0).all()
    assert mixed.expected_regret <= limit + 2 * rounding(problem, *mixed.actions)
    assert (mixed.regrets >= 0).all()
    np.testing.assert_allclose(
        mixed.regrets, problem.regret(belief, mixed.actions), atol=rounding(problem, *mixed.actions)
    )
    assert mixed.expected_cost == pytest.approx(
        float(mixed.probabilities @ problem.expected_cost(belief, mixed.actions)), abs=rounding(problem, *mixed.actions)
    )
    for action, privacy, found in zip(mixed.actions, mixed.privacies, mixed.belief_sets, strict=True):
        assert problem.constraints.violation(action) <= 1e-9
        assert privacy == pytest.approx(measure(belief, consistent_beliefs(problem, action)), abs=1e-6)
        assert privacy == pytest.approx(measure(belief, found), abs=1e-9)
    expected = mixed.probabilities @ mixed.privacies
    assert mixed.expected_privacy == pytest.approx(expected, rel=1e-15) or np.isinf(mixed.expected_privacy)
    assert mixed.expected_privacy <= mixed.privacy_bound
    assert mixed.price >= 0
    assert mixed.status.value in mixed.summary()


@settings(max_examples=instances(15), deadline=None)
@given(drawn_problems(states=(2, 3), assets=(2, 6), spread=1.0, min_slack=1e-4), st.booleans())
def test_more_budget_never_means_less_privacy(drawn, desired):
    measure = DesiredObfuscation(drawn.rng.dirichlet(np.ones(drawn.belief.size))) if desired else MaximalObfuscation()
    candidates = decoy_grid(drawn.problem, 20)
    scale = abs(float(drawn.problem.optimal_cost(drawn.belief))) or 1.0
    budgets = [Budget.regret(share * scale) for share in (0.0, 0.003, 0.03, 0.3, 3.0)]
    singles = [
        CounterAdversarialDecisionMaker(drawn.problem, measure, budget, candidates=candidates).decide(drawn.belief)
        for budget in budgets
    ]
    mixtures = [
        ProbabilisticDecisionMaker(drawn.problem, measure, budget, candidates=candidates).decide(drawn.belief)
        for budget in budgets
    ]
    # Searches end at slightly different places: as much as the optimum's own accuracy.
    assert np.diff([single.privacy for single in singles]).min() >= -1e-6
    assert np.diff([mixed.expected_privacy for mixed in mixtures]).min() >= -1e-6


@pytest.mark.parametrize("seed", [4, 12, 50, 81, None])
def test_a_small_budget_is_spent_where_the_costs_of_two_states_lie_decades_apart(seed, fresh_seed):
    """Against the decisions where the budget ends on the segment: the regret of u*(y) grows on the way from the belief."""
    rng = np.random.default_rng(fresh_seed if seed is None else seed)
    market, belief = markets.random_market(rng, 2, 4, scale_spread=1.0), rng.dirichlet(np.ones(2))
    problem = MarkowitzProblem(market.means * 0.01, market.covariances * 1e-4, market.risk_aversion)
    limit, best = 0.003 * abs(float(problem.optimal_cost(belief))), 0.0
    for corner in np.eye(2):
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            action = problem.solve((1.0 - middle) * belief + middle * corner)
            low, high = (middle, high) if problem.regret(belief, action) <= limit else (low, middle)
        action = problem.solve((1.0 - low) * belief + low * corner)
        if problem.constraints.is_admissible(action):
            best = max(best, consistent_beliefs(problem, action).distance(belief))
    maker = CounterAdversarialDecisionMaker(problem, MaximalObfuscation(), 0.003, candidates=decoy_grid(problem, 12))
    assert maker.decide(belief).privacy >= best - 1e-6


@pytest.mark.parametrize(("seed", "size"), paired([5, 14, None], [(4, 6), (3, 9), (2, 5)]), ids=str)
def test_budgets_near_the_rounding_of_costs_hide_more_the_larger_they_are(seed, size, fresh_seed):
    """A regret is a difference of costs: a billionth of these is known to seven digits. Once 34 of 180 such sequences broke."""
    rng = np.random.default_rng(fresh_seed if seed is None else seed)
    market = markets.random_market(rng, *size)
    problem = MarkowitzProblem(market.means, market.covariances, market.risk_aversion)
    belief = rng.dirichlet(np.ones(size[0]))
    limits = abs(float(problem.optimal_cost(belief))) * np.array(some(np.geomspace(1e-9, 1e-5, 13), 3))
    found = [CounterAdversarialDecisionMaker(problem, budget=Budget.regret(limit)).decide(belief) for limit in limits]
    privacies = np.array([each.privacy for each in found])
    assert all(each.regret <= limit for each, limit in zip(found, limits, strict=True))
    assert (privacies[1:] >= privacies[:-1] * (1.0 - 1e-6)).all()
    weights = problem.solve(belief)
    # Other beliefs may share a decision for one asset alone, and weights near zero have inadmissible ones around them.
    if weights.max() < 1.0 and weights[weights > 0.0].min() > 1e-4:
        assert privacies[0] > 0.0


@settings(max_examples=instances(30), deadline=None)
@given(drawn_problems(states=(2, 4), assets=(2, 4), kinds=[{}], spread=1.0, min_slack=1e-4), st.booleans())
def test_the_lottery_is_the_envelope_and_the_programme_on_its_candidates(drawn, by_action):
    candidates = action_grid(drawn.problem, 6) if by_action else decoy_grid(drawn.problem, 10)
    limit = 0.1 * abs(float(drawn.problem.optimal_cost(drawn.belief)))
    budget = Budget.regret(limit)
    programme = ProbabilisticDecisionMaker(
        drawn.problem, budget=budget, candidates=candidates, method=LinearProgramme()
    ).decide(drawn.belief)
    envelope = ProbabilisticDecisionMaker(
        drawn.problem, budget=budget, candidates=candidates, method=Envelope()
    ).decide(drawn.belief)
    check_mixture(drawn.problem, MaximalObfuscation(), drawn.belief, programme, limit * (1 + 1e-6))
    own = drawn.problem.solve(drawn.belief)
    actions = np.vstack([candidates.actions[candidates.usable], own])
    regrets = drawn.problem.regret(drawn.belief, actions)
    privacies = np.array([consistent_beliefs(drawn.problem, action).distance(drawn.belief) for action in actions])
    privacies[np.isinf(privacies)] = -np.inf
    expected = enumeration.upper_concave_envelope(regrets, privacies, limit)
    assert programme.expected_privacy == pytest.approx(expected, abs=1e-6)
    # The envelope also mixes the polished decision of the CDM: on the same points it is the programme's value.
    single = CounterAdversarialDecisionMaker(drawn.problem, budget=budget, candidates=candidates).decide(drawn.belief)
    with_polished = enumeration.upper_concave_envelope(
        np.append(regrets, single.regret), np.append(privacies, single.privacy), limit
    )
    assert envelope.expected_privacy >= with_polished - 1e-6
    assert envelope.expected_privacy >= programme.expected_privacy - 1e-7


@pytest.mark.parametrize(("measure", "positive"), paired(MEASURES, [True, False]), ids=repr)
def test_all_five_measures_go_through_all_decision_makers(measure, positive):
    market = markets.random_market(np.random.default_rng(11), 3, 5, positive_value=positive)
    problem, belief = MarkowitzProblem(*market), np.array([0.5, 0.3, 0.2])
    limit = 0.1 * abs(float(problem.optimal_cost(belief)))
    local = LocalSearch(n_starts=3, rng=np.random.default_rng(0))
    for method in (GlobalSearch(), local):
        decision = CounterAdversarialDecisionMaker(problem, measure, 0.1, method=method).decide(belief)
        check_decision(problem, measure, belief, decision, limit)
    for method in (Envelope(), LinearProgramme()):
        candidates = action_grid(problem, 5) if measure.searches_actions else decoy_grid(problem, 12)
        mixed = ProbabilisticDecisionMaker(problem, measure, 0.1, candidates=candidates, method=method).decide(belief)
        assert mixed.expected_regret <= limit * (1 + 1e-9)
        assert mixed.expected_privacy <= mixed.privacy_bound


# --- indicators: the goal is met, and met cheaply -------------------------------------------------------------------------


def test_non_existence_pays_no_more_than_it_must():
    """On the belief market ρ = d²/4, so the cheapest way to be a distance of .2 away costs .01."""
    problem = belief_problem(3, min_slack=1e-4)
    belief = [0.4, 0.35, 0.25]
    decision = CounterAdversarialDecisionMaker(problem, NonExistence(0.2), Budget.regret(0.05)).decide(belief)
    assert decision.privacy == 0
    assert decision.regret == pytest.approx(0.01, rel=1e-3)
    refused = CounterAdversarialDecisionMaker(problem, NonExistence(0.2), Budget.regret(0.0099)).decide(belief)
    assert refused.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
    assert refused.privacy == -np.inf
    assert refused.regret == 0
    mixed = ProbabilisticDecisionMaker(problem, NonExistence(0.2), Budget.regret(0.05)).decide(belief)
    assert mixed.expected_privacy == 0
    assert mixed.expected_regret == pytest.approx(0.01, rel=0.05)


def test_infeasibility_leaves_a_gap_within_the_budget():
    market = markets.random_market(np.random.default_rng(4), 2, 4)
    problem = MarkowitzProblem(*market)
    belief = np.array([0.4, 0.6])
    limit = 0.1 * abs(float(problem.optimal_cost(belief)))
    decision = CounterAdversarialDecisionMaker(problem, Infeasibility(margin=1e-5), 0.1).decide(belief)
    assert decision.privacy == 0
    assert decision.belief_set.is_empty
    assert np.isnan(decision.decoy).all()
    assert 1e-5 <= plausibility_gap(problem, decision.action) <= decision.regret + 1e-12
    assert decision.regret <= limit
    assert "no belief explains" in decision.summary()


def test_non_uniqueness_wants_another_belief():
    problem = line_problem(
        [1.0, 0.0, -1.0], min_slack=1e-4
    )  # three beliefs' dimension, two assets: segments everywhere
    belief = [0.4, 0.35, 0.25]
    decision = CounterAdversarialDecisionMaker(problem, NonUniqueness(), 0.1).decide(belief)
    assert decision.privacy == 0
    assert decision.regret == 0  # the optimal decision itself leaves a segment
    assert decision.status in (DecisionStatus.OPTIMAL, DecisionStatus.BEST_CANDIDATE)


# --- closed forms -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("regret", [1e-6, 1e-4, 1e-3, 0.01])
def test_maximal_obfuscation_in_closed_form(regret):
    """ρ = d²/4 in every direction: the best distance is 2√r."""
    problem = belief_problem(3, min_slack=1e-4)
    decision = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(regret)).decide([0.4, 0.35, 0.25])
    assert decision.privacy == pytest.approx(2 * np.sqrt(regret), rel=1e-6)
    mixed = ProbabilisticDecisionMaker(problem, budget=Budget.regret(regret)).decide([0.4, 0.35, 0.25])
    assert mixed.expected_privacy == pytest.approx(2 * np.sqrt(regret), rel=1e-6)


def test_desired_obfuscation_in_closed_form():
    problem = belief_problem(3, min_slack=1e-4)
    belief, target = np.array([0.4, 0.35, 0.25]), np.array([0.2, 0.2, 0.6])
    apart = np.linalg.norm(belief - target)
    decision = CounterAdversarialDecisionMaker(problem, DesiredObfuscation(target), Budget.regret(0.01)).decide(belief)
    assert decision.privacy == pytest.approx(-(apart - 0.2), abs=1e-6)
    np.testing.assert_allclose(decision.decoy, belief + 0.2 * (target - belief) / apart, atol=1e-4)
    reached = CounterAdversarialDecisionMaker(problem, DesiredObfuscation(target), Budget.regret(0.1)).decide(belief)
    assert reached.privacy == pytest.approx(0, abs=1e-6)


def test_a_large_budget_reaches_the_farthest_corner():
    problem = belief_problem(3, min_slack=1e-4)
    belief = [0.4, 0.35, 0.25]
    decision = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(10.0)).decide(belief)
    assert decision.privacy == pytest.approx(np.linalg.norm([0.4, 0.35, -0.75]), abs=1e-9)
    assert decision.privacy_bound == pytest.approx(decision.privacy, abs=1e-9)


def test_no_budget_no_privacy():
    problem = belief_problem(3, min_slack=1e-4)
    for measure in (MaximalObfuscation(), NonExistence()):
        decision = CounterAdversarialDecisionMaker(problem, measure, 0.0).decide([0.4, 0.35, 0.25])
        assert decision.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
        assert decision.regret == 0
        np.testing.assert_allclose(decision.action, problem.solve([0.4, 0.35, 0.25]), atol=1e-14)
        mixed = ProbabilisticDecisionMaker(problem, measure, 0.0).decide([0.4, 0.35, 0.25])
        assert mixed.expected_regret == pytest.approx(0, abs=1e-15)


# --- empty sets ---------------------------------------------------------------------------------------------------------


def unexplained_and_explained():
    problem = line_problem([1.0, 0.0], min_slack=1e-4)  # u_1 in [½, ¾] is explained
    return problem, np.array([[1.0, 0.0], [0.0, 1.0], [0.75, 0.25], [0.6, 0.4]])


def test_empty_sets_are_excluded_by_default():
    problem, actions = unexplained_and_explained()
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        decided = maker(problem, budget=Budget.regret(10.0), candidates=actions).decide([0.2, 0.8])
        value = getattr(decided, "expected_privacy", getattr(decided, "privacy", None))
        assert value == pytest.approx(0.8 * np.sqrt(2), abs=1e-9)  # (1, 0) explains u_1 = ¾
        assert decided.status is not DecisionStatus.UNBOUNDED


def test_empty_sets_by_the_papers_letter_have_no_best_value():
    problem, actions = unexplained_and_explained()
    belief = [0.2, 0.8]
    single = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(10.0), candidates=actions, on_empty="infinite"
    ).decide(belief)
    assert single.status is DecisionStatus.UNBOUNDED
    assert single.privacy == np.inf
    assert single.belief_set.is_empty
    # The smallest budget that is not zero mixes a little of an unexplained decision in.
    for method in (Envelope(), LinearProgramme()):
        mixed = ProbabilisticDecisionMaker(
            problem, budget=Budget.regret(1e-3), candidates=actions, on_empty="infinite", method=method
        ).decide(belief)
        assert mixed.status is DecisionStatus.UNBOUNDED
        assert mixed.expected_privacy == np.inf
        assert mixed.expected_regret <= 1e-3 * (1 + 1e-12)
        assert mixed.expected_regret > 0
        assert mixed.privacy_bound == np.inf
    # Too dear for a single decision: the policy then changes nothing.
    affordable = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(1e-3), candidates=actions, on_empty="infinite"
    ).decide(belief)
    assert affordable.status is not DecisionStatus.UNBOUNDED
    assert affordable.regret <= 1e-3
    nothing = ProbabilisticDecisionMaker(
        problem, budget=Budget.regret(0.0), candidates=actions, on_empty="infinite"
    ).decide(belief)
    assert nothing.status is not DecisionStatus.UNBOUNDED
    assert nothing.expected_regret == pytest.approx(0, abs=1e-15)


def test_the_policy_does_not_touch_measures_a_and_c():
    problem, actions = unexplained_and_explained()
    for measure in (Infeasibility(), NonExistence()):
        for on_empty in ("exclude", "infinite"):
            decision = CounterAdversarialDecisionMaker(
                problem, measure, Budget.regret(10.0), candidates=actions, on_empty=on_empty
            ).decide([0.2, 0.8])
            assert decision.privacy == 0
            assert decision.status is not DecisionStatus.UNBOUNDED


# --- targets and sequences ------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    problem = MarkowitzProblem(*markets.random_market(np.random.default_rng(21), 3, 4))
    beliefs = np.random.default_rng(22).dirichlet(np.ones(3), 4)
    return problem, beliefs, decoy_grid(problem, 15)


@pytest.mark.parametrize(
    "measure",
    some(
        [
            MaximalObfuscation(),
            DesiredObfuscation([0.2, 0.3, 0.5]),
            DesiredObfuscation(np.random.default_rng(1).dirichlet(np.ones(3), 4)),
            DesiredObfuscation(lambda belief: belief[::-1]),
            NonExistence(),
        ],
        2,
    ),
    ids=some(["maximal", "one target", "target per step", "reverse", "non-existence"], 2),
)
def test_many_decisions_are_the_single_ones(small, measure):
    problem, beliefs, candidates = small
    chooser = CounterAdversarialDecisionMaker(problem, measure, candidates=candidates)
    many = chooser.decide_many(beliefs)
    assert len(many) == 4
    assert many.action.shape == (4, 4)
    lottery = ProbabilisticDecisionMaker(problem, measure, candidates=candidates)
    mixed = lottery.decide_many(beliefs)
    assert mixed.probabilities.shape == mixed.regrets.shape == mixed.actions.shape[:2]
    np.testing.assert_allclose(mixed.probabilities.sum(axis=1), 1, atol=1e-12)
    for step, belief in enumerate(beliefs):
        at_step = measure.at_step(step)
        alone = CounterAdversarialDecisionMaker(problem, at_step, candidates=candidates).decide(belief)
        for name in ("action", "cost", "optimal_cost", "regret", "privacy", "privacy_bound", "decoy"):
            # Solved side by side, a number may differ by its last digits, and a halved way by its last halving.
            near = {"rtol": 0, "atol": 1e-8, "err_msg": name}
            np.testing.assert_allclose(getattr(many, name)[step], getattr(alone, name), **near)
            np.testing.assert_array_equal(getattr(many[step], name), getattr(many, name)[step], err_msg=name)
        assert many.status[step] is alone.status
        drawn = ProbabilisticDecisionMaker(problem, at_step, candidates=candidates).decide(belief)
        atoms = len(drawn.probabilities)
        # One belief is searched more thoroughly: the same lottery up to the polish's accuracy.
        np.testing.assert_allclose(mixed.probabilities[step, :atoms], drawn.probabilities, atol=1e-6)
        np.testing.assert_array_equal(mixed.probabilities[step, atoms:], 0)
        np.testing.assert_allclose(mixed.actions[step, :atoms], drawn.actions, atol=1e-6)
        np.testing.assert_allclose(mixed[step].actions, mixed.actions[step, :atoms], atol=1e-15)
        np.testing.assert_allclose(mixed[step].privacies, drawn.privacies, atol=1e-6)
        for name in ("expected_cost", "expected_privacy", "optimal_cost", "privacy_bound"):
            assert getattr(mixed, name)[step] == pytest.approx(getattr(drawn, name), abs=1e-6)


def test_the_originals_many_are_its_single_ones(small):
    problem, beliefs, _ = small
    many = OriginalDecisionMaker(problem).decide_many(beliefs)
    for step, belief in enumerate(beliefs):
        alone = OriginalDecisionMaker(problem).decide(belief)
        np.testing.assert_allclose(many.action[step], alone.action, atol=1e-13)
        assert many.privacy[step] == alone.privacy == 0
        assert many.regret[step] <= 1e-15


def test_progress_is_reported_step_by_step(small):
    problem, beliefs, candidates = small
    seen = []
    ProbabilisticDecisionMaker(problem, candidates=candidates).decide_many(
        beliefs, progress=lambda done, of: seen.append((done, of))
    )
    assert seen[-1] == (4, 4)
    assert seen == sorted(seen)


def test_a_desired_belief_may_already_be_what_is_seen():
    problem = belief_problem(3, min_slack=1e-4)
    belief = np.array([0.4, 0.35, 0.25])
    decision = CounterAdversarialDecisionMaker(problem, DesiredObfuscation(belief)).decide(belief)
    assert decision.privacy == pytest.approx(0, abs=1e-9)
    assert decision.regret <= 1e-12


# --- sampling -------------------------------------------------------------------------------------------------------------


def test_a_lottery_is_drawn_by_its_probabilities(small):
    problem, beliefs, candidates = small
    mixed = ProbabilisticDecisionMaker(problem, budget=0.1, candidates=candidates).decide(beliefs[0])
    assert len(mixed.probabilities) == 2
    rng = np.random.default_rng(0)
    draws = [mixed.sample(rng=rng) for _ in range(1500)]
    for index in range(2):
        share = np.mean([np.array_equal(draw.action, mixed.actions[index]) for draw in draws])
        assert share == pytest.approx(mixed.probabilities[index], abs=0.05)
    assert np.mean([draw.regret for draw in draws]) == pytest.approx(mixed.expected_regret, rel=0.2)
    draw = draws[0]
    assert draw.cost == pytest.approx(float(problem.expected_cost(beliefs[0], draw.action)), abs=1e-12)
    assert draw.privacy == pytest.approx(MaximalObfuscation()(beliefs[0], draw.belief_set), abs=1e-9)
    assert draw.privacy <= draw.privacy_bound
    first, second = (mixed.sample(rng=np.random.default_rng(3)).action for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert mixed.sample().action.shape == (4,)
    steps = ProbabilisticDecisionMaker(problem, candidates=candidates).decide_many(beliefs)
    assert len(steps.sample(rng=np.random.default_rng(0))) == 4


# --- the paper's local search ---------------------------------------------------------------------------------------------


def test_more_starts_never_hurt_and_never_beat_the_global_search(small):
    beliefs = small[1]
    problem = MarkowitzProblem(*markets.random_market(np.random.default_rng(21), 3, 3))
    best = CounterAdversarialDecisionMaker(problem).decide(beliefs[1])
    found: list[float] = []
    starts = (1, 4, 12) if audited() else (1, 2, 4)
    for n_starts in starts:
        method = LocalSearch(n_starts=n_starts, rng=np.random.default_rng(5))
        decision = CounterAdversarialDecisionMaker(problem, method=method).decide(beliefs[1])
        check_decision(problem, MaximalObfuscation(), beliefs[1], decision, 0.1 * abs(decision.optimal_cost))
        assert decision.status is DecisionStatus.LOCAL_OPTIMUM
        found.append(decision.privacy)
    assert found[0] <= found[1] + 1e-12 <= found[2] + 2e-12
    assert max(found) <= best.privacy + 1e-6
    again = CounterAdversarialDecisionMaker(problem, method=LocalSearch(starts[1], rng=np.random.default_rng(5)))
    assert again.decide(beliefs[1]).privacy == found[1]


# --- degenerate problems ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("problem", "belief"),
    [
        (MarkowitzProblem([[0.1, 0.2]], [np.eye(2)], 1.0), [1.0]),  # one state
        (MarkowitzProblem([[0.1], [0.2]], np.ones((2, 1, 1)), 1.0), [0.3, 0.7]),  # one asset
        (MarkowitzProblem([[0.1]], np.ones((1, 1, 1)), 1.0), [1.0]),  # both
        (MarkowitzProblem(np.zeros((2, 2)), np.zeros((2, 2, 2)), 1.0), [0.5, 0.5]),  # no cost at all
        (MarkowitzProblem(np.tile([0.1, 0.2, 0.0], (3, 1)), [np.eye(3)] * 3, 1.0), [0.2, 0.3, 0.5]),  # equal states
        (MarkowitzProblem(np.eye(3), [np.eye(3)] * 3, 1.0), [1.0, 0.0, 0.0]),  # a corner belief
        (MarkowitzProblem(np.eye(3), [np.eye(3)] * 3, 1.0), [0.5, 0.5, 0.0]),  # a state excluded
        (
            MarkowitzProblem(np.eye(3)[:, [0, 1, 2, 0]], [np.eye(4)[[0, 1, 2, 0]][:, [0, 1, 2, 0]]] * 3, 1.0),
            [0.3, 0.3, 0.4],
        ),
    ],
    ids=["X=1", "U=1", "X=U=1", "no cost", "equal states", "corner", "face", "duplicated asset"],
)
def test_degenerate_problems_go_through(problem, belief):
    belief = np.array(belief)
    limit = 0.1 * abs(float(problem.optimal_cost(belief)))
    original = OriginalDecisionMaker(problem).decide(belief)
    assert original.privacy == 0
    candidates = decoy_grid(problem, 20)
    for measure in (MaximalObfuscation(), NonExistence(), NonUniqueness(), Infeasibility()):
        decision = CounterAdversarialDecisionMaker(problem, measure, candidates=candidates).decide(belief)
        check_decision(problem, measure, belief, decision, limit)
        mixed = ProbabilisticDecisionMaker(problem, measure, candidates=candidates).decide(belief)
        assert mixed.expected_regret <= limit + 1e-12
        if not np.isinf(decision.privacy):
            assert mixed.expected_privacy >= decision.privacy - 1e-12


def test_where_every_belief_acts_alike_there_is_nothing_to_hide():
    problem = MarkowitzProblem(np.tile([5.0, 0.0], (3, 1)), [np.eye(2)] * 3, 1.0)
    decision = CounterAdversarialDecisionMaker(problem).decide([0.2, 0.3, 0.5])
    assert decision.privacy == 0
    assert decision.belief_set.dimension == 2
    assert decision.status is DecisionStatus.NO_AFFORDABLE_PRIVACY


def test_budgets_are_shares_of_the_size_of_the_cost():
    assert Budget.relative(0.1).limit(-3.0) == pytest.approx(0.3)
    assert Budget.relative(0.1).limit(3.0) == pytest.approx(0.3)
    assert Budget.regret(0.1).limit(-3.0) == 0.1
    assert Budget.relative(0.1).limit(0.0) == 0


# --- against a dense search ------------------------------------------------------------------------------------------------


@settings(max_examples=instances(8), deadline=None)
@given(
    drawn_problems(states=(2, 4), assets=(2, 8), kinds=[{}], spread=1.0, min_slack=1e-4),
    st.sampled_from([0.003, 0.03, 0.3]),
)
def test_no_decoy_of_a_dense_grid_is_better(drawn, share):
    """Hundreds of decoys, each pulled to where the budget ends on its ray: none beats the search."""
    problem, belief = drawn.problem, drawn.belief
    optimal_cost = float(problem.optimal_cost(belief))
    limit = share * abs(optimal_cost)
    ends = np.vstack([drawn.rng.dirichlet(np.full(belief.size, 0.5), 60), np.eye(belief.size)])
    low, high = np.zeros(len(ends)), np.ones(len(ends))
    for _ in range(40):
        middle = 0.5 * (low + high)
        decoys = belief + middle[:, None] * (ends - belief)
        fits = problem.state_costs(problem.solve(decoys)) @ belief - optimal_cost <= limit
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    rays = belief + np.linspace(0.4, 1.0, 3)[:, None, None] * (low[:, None] * (ends - belief))
    actions = problem.solve(rays.reshape(-1, belief.size))
    actions = actions[problem.constraints.is_admissible(actions)]
    actions = actions[problem.state_costs(actions) @ belief - optimal_cost <= limit]
    sets = consistent_sets(problem, actions)
    target = drawn.rng.dirichlet(np.ones(belief.size))
    for measure, sign, point in ((MaximalObfuscation(), 1, belief), (DesiredObfuscation(target), -1, target)):
        best = max(
            (sign * sets.distances(point)).max(initial=-np.inf), measure(belief, sets[0]) if len(actions) else 0.0
        )
        decision = CounterAdversarialDecisionMaker(problem, measure, Budget.regret(limit)).decide(belief)
        assert decision.privacy >= best - 1e-4 * max(1.0, abs(best)), (measure, best)
