"""The paper's five measures on sets worked by hand, with margins, targets and empty sets."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings

from inscrutable import (
    BeliefSet,
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    Infeasibility,
    InputError,
    KellyProblem,
    LocalSearch,
    MarkowitzProblem,
    MaximalObfuscation,
    NonExistence,
    NonUniqueness,
    PrivacyMeasure,
    consistent_beliefs,
    decoy_grid,
    long_short,
    plausibility_gap,
)
from inscrutable.adversaries import consistent_sets
from sizes import instances, some
from strategies import belief_problem, drawn_problems, line_problem

NO_ROWS = np.zeros((0, 3))
POINT = BeliefSet(np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]]), NO_ROWS)  # (⅓, ⅓, ⅓)
SEGMENT = BeliefSet(np.array([[1.0, -1.0, 0.0]]), NO_ROWS)  # from (0, 0, 1) to (½, ½, 0)
WHOLE = BeliefSet(NO_ROWS, NO_ROWS)
EMPTY = BeliefSet(np.array([[1.0, 1.0, 1.0]]), NO_ROWS, gap=lambda enough: 0.2)

CENTRE, CORNER, ELSEWHERE = [1 / 3, 1 / 3, 1 / 3], [1.0, 0.0, 0.0], [0.5, 0.2, 0.3]
YES, NO = 0.0, -np.inf


@pytest.mark.parametrize(
    ("measure", "found", "belief", "expected"),
    [
        # (a) infeasibility: only an empty set satisfies it
        (Infeasibility(), POINT, CENTRE, NO),
        (Infeasibility(), WHOLE, CENTRE, NO),
        (Infeasibility(), EMPTY, CENTRE, YES),
        (Infeasibility(margin=0.0), EMPTY, CENTRE, YES),
        (Infeasibility(margin=0.2), EMPTY, CENTRE, YES),
        (Infeasibility(margin=0.21), EMPTY, CENTRE, NO),
        (Infeasibility(), BeliefSet(np.ones((1, 3)), NO_ROWS), CENTRE, NO),  # no gap is known
        # (b) non-uniqueness: another belief than the true one, whether or not the true one is there
        (NonUniqueness(), POINT, CENTRE, NO),
        (NonUniqueness(), POINT, CORNER, YES),
        (NonUniqueness(), SEGMENT, CENTRE, YES),
        (NonUniqueness(), WHOLE, CENTRE, YES),
        (NonUniqueness(), EMPTY, CENTRE, NO),
        # (c) non-existence: the true one is not there; an empty set will do
        (NonExistence(), POINT, CENTRE, NO),
        (NonExistence(), POINT, CORNER, YES),
        (NonExistence(), WHOLE, CORNER, NO),
        (NonExistence(), EMPTY, CENTRE, YES),
        (NonExistence(margin=0.8), POINT, CORNER, YES),  # the distance is √(2/3) = .8165
        (NonExistence(margin=0.82), POINT, CORNER, NO),
        (NonExistence(margin=0.0), SEGMENT, ELSEWHERE, YES),
        (NonExistence(margin=0.0), SEGMENT, CENTRE, NO),
        # (d) desired obfuscation: minus the distance from the target, wherever the true belief is
        (DesiredObfuscation(CENTRE), POINT, CORNER, 0.0),
        (DesiredObfuscation(CORNER), POINT, CENTRE, -np.sqrt(2 / 3)),
        (DesiredObfuscation(CORNER), SEGMENT, CENTRE, -np.sqrt(1 / 2)),
        (DesiredObfuscation(CORNER), WHOLE, CENTRE, 0.0),
        (DesiredObfuscation(CORNER), EMPTY, CENTRE, NO),
        # (e) maximal obfuscation: the distance from the true belief
        (MaximalObfuscation(), POINT, CENTRE, 0.0),
        (MaximalObfuscation(), POINT, CORNER, np.sqrt(2 / 3)),
        (MaximalObfuscation(), SEGMENT, CORNER, np.sqrt(1 / 2)),
        (MaximalObfuscation(), SEGMENT, CENTRE, 0.0),
        (MaximalObfuscation(), WHOLE, CORNER, 0.0),
        (MaximalObfuscation(), EMPTY, CENTRE, np.inf),
    ],
)
def test_measures_by_hand(measure, found, belief, expected):
    assert measure(belief, found) == pytest.approx(expected, abs=1e-12)


def test_the_largest_distance_of_the_simplex_is_root_two():
    opposite = BeliefSet(np.array([[0.0, 1.0, 1.0]]), NO_ROWS)
    assert MaximalObfuscation()([0, 0, 1], opposite) == pytest.approx(np.sqrt(2))


def test_default_margins_are_the_documented_ones():
    assert NonExistence().margin == 0.01
    assert Infeasibility().margin == 1e-6


def test_targets_per_step_and_by_rule():
    steps = DesiredObfuscation(np.eye(3))
    assert steps.at_step(1)(CENTRE, POINT) == pytest.approx(-np.sqrt(2 / 3))
    np.testing.assert_array_equal(steps.at_step(2).reference(np.array(CENTRE)).point, [0, 0, 1])
    with pytest.raises(InputError, match="3 steps, step 3"):
        steps.at_step(3)
    with pytest.raises(InputError, match="each of 3 steps"):
        steps(CENTRE, POINT)
    constant = DesiredObfuscation(CORNER)
    assert constant.at_step(7) is constant
    reverse = DesiredObfuscation(lambda belief: belief[::-1])
    assert reverse([1, 0, 0], POINT) == pytest.approx(-np.sqrt(2 / 3))
    np.testing.assert_array_equal(reverse.target_for(np.array([0.7, 0.2, 0.1])), [0.1, 0.2, 0.7])


@pytest.mark.parametrize(
    "make",
    [
        lambda: DesiredObfuscation([0.5, 0.6]),
        lambda: DesiredObfuscation([0.5, np.nan]),
        lambda: DesiredObfuscation(0.5),
        lambda: DesiredObfuscation(np.zeros((0, 3))),
        lambda: DesiredObfuscation([["a", "b"]]),
        lambda: DesiredObfuscation([0.5, 0.5])(CENTRE, POINT),  # two states, not three
        lambda: DesiredObfuscation(lambda belief: belief * 2)(CENTRE, POINT),
        lambda: NonExistence(margin=-0.1),
        lambda: NonExistence(margin=np.nan),
        lambda: Infeasibility(margin=-1e-9),
        lambda: Infeasibility(margin="much"),
        lambda: MaximalObfuscation()([0.5, 0.6, 0.1], POINT),
        lambda: NonExistence()([0.5, 0.6, 0.1], POINT),
        lambda: NonUniqueness()([0.5, 0.6, 0.1], POINT),
        lambda: NonUniqueness()([0.5, 0.5], POINT),
    ],
)
def test_malformed_measures_and_beliefs_are_refused(make):
    with pytest.raises(InputError):
        make()


def test_an_abstract_measure_cannot_be_made():
    with pytest.raises(TypeError):
        PrivacyMeasure()


def all_measures(belief):
    return [
        Infeasibility(margin=0.0),
        Infeasibility(),
        NonUniqueness(),
        NonExistence(margin=0.0),
        NonExistence(),
        NonExistence(margin=0.3),
        DesiredObfuscation(np.eye(belief.size)[0]),
        DesiredObfuscation(lambda held: held[::-1]),
        MaximalObfuscation(),
    ]


@settings(max_examples=instances(30), deadline=None)
@given(drawn_problems(states=(2, 4), assets=(2, 6), spread=1.0, min_slack=1e-4))
def test_many_values_are_the_single_ones_or_bounds_of_them(drawn):
    decoys = np.vstack([drawn.belief, np.eye(drawn.belief.size), drawn.rng.dirichlet(np.ones(drawn.belief.size), 3)])
    actions = np.vstack([drawn.problem.solve(decoys), drawn.rng.dirichlet(np.ones(drawn.problem.n_actions), 2)])
    for members in (None, np.vstack([decoys, decoys[:2]])):
        chosen = actions if members is None else drawn.problem.solve(members)
        sets = consistent_sets(drawn.problem, chosen, members)
        for measure in all_measures(drawn.belief):
            values = measure.values(drawn.belief, sets)
            for index, action in enumerate(chosen):
                single = measure(drawn.belief, consistent_beliefs(drawn.problem, action))
                if values.exact[index]:
                    assert values.privacies[index] == pytest.approx(single, abs=1e-8), measure
                else:
                    assert values.privacies[index] >= single - 1e-9, measure


@settings(max_examples=instances(60), deadline=None)
@given(drawn_problems(states=(2, 5), assets=(2, 8), spread=1.0))
def test_maximal_obfuscation_is_positive_exactly_where_the_belief_is_absent(drawn):
    for action in drawn.problem.solve(np.vstack([drawn.belief, drawn.rng.dirichlet(np.ones(drawn.belief.size), 4)])):
        found = consistent_beliefs(drawn.problem, action)
        distance = MaximalObfuscation()(drawn.belief, found)
        assert 0 <= distance <= np.sqrt(2) + 1e-12
        if distance > 1e-6:
            assert NonExistence(margin=0.0)(drawn.belief, found) == YES
            assert not found.contains(drawn.belief)
        if found.contains(drawn.belief):
            assert distance == 0
            assert NonExistence(margin=0.0)(drawn.belief, found) == NO
        target = drawn.rng.dirichlet(np.ones(drawn.belief.size))
        assert DesiredObfuscation(target)(drawn.belief, found) == -found.distance(target)


def test_infeasibility_judges_the_gap_of_a_real_decision():
    problem = line_problem([1.0, 0.0])
    found = consistent_beliefs(problem, [1.0, 0.0])  # the gap is 1/8
    assert plausibility_gap(problem, [1.0, 0.0]) == pytest.approx(0.125, abs=1e-9)
    assert Infeasibility(margin=0.124)([0.5, 0.5], found) == YES
    assert Infeasibility(margin=0.126)([0.5, 0.5], found) == NO


def test_a_set_of_one_corner_belief_is_unique():
    """The set is cut to the true belief by inequalities alone; nothing else is left to the observer."""
    only = BeliefSet(NO_ROWS, np.array([[0.0, -1.0, -1.0]]))
    assert NonUniqueness()(CORNER, only) == NO
    problem = line_problem([2.0, 0.0, 0.0])  # u_1 = 1/2 + π_1/2: all in asset 1 at the corner belief alone
    action = problem.solve(CORNER)
    np.testing.assert_allclose(action, [1, 0], atol=1e-14)
    assert NonUniqueness()(CORNER, consistent_beliefs(problem, action)) == NO
    values = NonUniqueness().values(np.array(CORNER), consistent_sets(problem, action[None], np.array([CORNER])))
    assert values.privacies[0] == NO or not values.exact[0]


def test_measures_print_their_names():
    assert repr(MaximalObfuscation()) == "MaximalObfuscation()"
    assert "0.3" in repr(NonExistence(margin=0.3))
    assert "0.001" in repr(Infeasibility(margin=0.001))
    assert belief_problem().n_states == 3


class InOtherUnits(MaximalObfuscation):
    """The distance times a factor: a measure of a user's own that follows a distance without being equal to it."""

    def __init__(self, factor):
        self.factor = factor

    def __call__(self, belief, belief_set):
        return self.factor * super().__call__(belief, belief_set)

    def values(self, belief, sets):
        found = super().values(belief, sets)
        return found._replace(privacies=self.factor * found.privacies)

    def upper_bound(self, belief):
        return self.factor * super().upper_bound(belief)


@cache
def growth_hidden():
    """Growth problems, arguments of a decision maker with a belief, and the privacy of its decision."""
    rng, cases = np.random.default_rng(5), []
    for _ in range(instances(6)):
        n_states, n_assets = (int(n) for n in rng.integers([2, 3], [4, 6]))
        returns = np.tile(1.01 + 0.05 * rng.normal(size=(12, n_assets)), (n_states, 1, 1))
        problem = KellyProblem(returns, rng.dirichlet(np.ones(12), n_states))
        belief = rng.dirichlet(np.ones(n_states))
        chosen = {"budget": Budget.regret(float(rng.uniform(1e-4, 1e-3))), "candidates": decoy_grid(problem, 10)}
        found = CounterAdversarialDecisionMaker(problem, MaximalObfuscation(), **chosen).decide(belief)
        cases.append((problem, chosen, belief, found.privacy))
    return cases


@pytest.mark.parametrize("factor", some([10.0, 0.01], 2))
def test_a_measure_in_other_units_has_the_same_decision(factor):
    """Of the same candidates, which keep the searches of each."""
    for problem, chosen, belief, privacy in growth_hidden():
        other = CounterAdversarialDecisionMaker(problem, InOtherUnits(factor), **chosen).decide(belief)
        assert other.privacy == pytest.approx(factor * privacy, rel=1e-9)


@pytest.mark.parametrize("seed", some(range(6), 6))
def test_a_local_search_plays_no_decision_that_hides_by_rounding(seed):
    rng = np.random.default_rng(seed)
    means, factors = rng.normal(size=(2, 3)), rng.normal(size=(2, 3, 3))
    problem = MarkowitzProblem(means, factors @ factors.swapaxes(1, 2) / 3, 1.0, long_short(3, gross=2.0, net=1.0))
    search = LocalSearch(n_starts=3, rng=np.random.default_rng(1))
    belief = rng.dirichlet(np.ones(2))
    found = CounterAdversarialDecisionMaker(problem, NonExistence(0.1), 0.3, method=search).decide(belief)
    assert not found.belief_set.is_empty
    assert found.status is DecisionStatus.NO_PLAUSIBLE_START or found.belief_set.distance(belief) >= 0.1
