"""The observer that learns the cost: against closed forms, and against the consistent beliefs of each single cost."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    ConvexProblem,
    CostLearningAdversary,
    CostStatus,
    InputError,
    LearnedCost,
    MarkowitzProblem,
    consistent_beliefs,
    simplex,
)
from sizes import instances, some

BOUNDS = (0.05, 50.0)


def market(rng: np.random.Generator, n_states: int, n_assets: int) -> tuple[np.ndarray, np.ndarray]:
    factors = rng.normal(size=(n_states, n_assets, n_assets)) * 0.15
    covariances = factors @ factors.transpose(0, 2, 1) / n_assets + 0.02 * np.eye(n_assets)
    return rng.normal(size=(n_states, n_assets)) * 0.03 + 0.05, covariances


@pytest.mark.parametrize("seed", range(instances(6, least=2)))
def test_risk_aversion_is_recovered_from_decisions_that_hold_more_assets_than_states(seed: int) -> None:
    rng = np.random.default_rng([1, seed])
    n_states = 2 + seed % 2
    means, covariances = market(rng, n_states, 6)
    truth = float(np.exp(rng.uniform(np.log(1.0), np.log(8.0))))
    actions = MarkowitzProblem(means, covariances, truth).solve(rng.dirichlet(np.ones(n_states), 3))
    assert ((actions > 1e-4).sum(axis=1) > n_states).any()
    learned = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS).learn(actions)
    assert learned.is_identified
    assert learned.parameter == pytest.approx(truth, rel=1e-6)
    assert learned.contains(truth)
    assert learned.residual <= 1e-9


@pytest.mark.parametrize(("seed", "bounds"), [(10, (0.1, 50.0)), (39, (0.5, 20.0))])
def test_programmes_that_the_simplex_method_gives_up_on_are_solved_otherwise(
    seed: int, bounds: tuple[float, float]
) -> None:
    rng = np.random.default_rng(seed)
    means, roots = rng.normal(0.05, 0.02, (2, 5)), rng.normal(size=(2, 5, 5)) * 0.05
    covariances = roots @ roots.transpose(0, 2, 1) + 0.02 * np.eye(5)
    truth = float(rng.uniform(1, 8))
    actions = MarkowitzProblem(means, covariances, truth).solve(rng.dirichlet(np.ones(2), 6))
    low, high = CostLearningAdversary.risk_aversion(means, covariances, bounds).learn(actions).interval
    assert low - 1e-9 <= truth <= high + 1e-9


@pytest.mark.parametrize("truth", some([0.0, 1e-3, 0.3], 2))
def test_a_parameter_near_zero_is_identified_as_any_other(truth: float) -> None:
    """A tilt of returns; the width of its interval was compared with its value alone, which may be zero."""
    means, covariances = (
        np.array([[0.3, 0.1, 0.0], [0.0, 0.1, 0.25]]),
        [np.diag([1.0, 2.0, 3.0]), np.diag([3.0, 1.0, 1.0])],
    )
    tilt = np.array([0.1, -0.1, 0.05])

    def family(parameter: float) -> MarkowitzProblem:
        return MarkowitzProblem(means + parameter * tilt, covariances, 0.7)

    actions = family(truth).solve([[0.6, 0.4], [0.3, 0.7]])
    learned = [CostLearningAdversary(family, bounds).learn(actions) for bounds in some(((-1.0, 1.0), (-2.0, 2.0)), 2)]
    for each in learned:
        assert each.status is CostStatus.IDENTIFIED
        assert each.parameter == pytest.approx(truth, abs=1e-7)


def test_one_decision_can_be_enough() -> None:
    rng = np.random.default_rng(3)
    means, covariances = market(rng, 2, 6)
    action = MarkowitzProblem(means, covariances, 3.0).solve([0.4, 0.6])
    assert (action > 1e-4).sum() > 3
    learned = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS).learn(action)
    assert learned.parameter == pytest.approx(3.0, rel=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_two_states_and_two_assets_have_a_closed_form(seed: int) -> None:
    """With d = (1,−1) some belief balances d'(2γΣ_i u − μ_i) exactly where the two states' signs differ."""
    rng = np.random.default_rng([2, seed])
    means, covariances = market(rng, 2, 2)
    action = np.array([0.3, 0.7]) if seed % 2 else np.array([0.8, 0.2])
    d = np.array([1.0, -1.0])
    slopes, levels = 2.0 * covariances @ action @ d, means @ d
    roots = np.sort(levels / slopes)
    inside = slopes[0] * slopes[1] > 0
    whole = [roots] if inside else [[BOUNDS[0], roots[0]], [roots[1], BOUNDS[1]]]
    expected = [(max(a, BOUNDS[0]), min(b, BOUNDS[1])) for a, b in whole]
    expected = [pair for pair in expected if pair[0] < pair[1]]
    learned = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS).learn(action)
    assert len(learned.intervals) == len(expected)
    for found, pair in zip(learned.intervals, expected, strict=True):
        slack = 0.01 * (pair[1] - pair[0])
        assert pair[0] - slack <= found[0] <= pair[0] + 1e-9
        assert pair[1] - 1e-9 <= found[1] <= pair[1] + slack


@pytest.mark.parametrize("seed", range(3))
def test_the_interval_holds_the_costs_whose_consistent_beliefs_are_not_empty(seed: int) -> None:
    rng = np.random.default_rng([4, seed])
    means, covariances = market(rng, 3, 3)
    truth = 2.0
    actions = MarkowitzProblem(means, covariances, truth).solve(rng.dirichlet(np.ones(3), 4))
    learned = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS).learn(actions)
    assert learned.contains(truth)
    assert not learned.is_identified
    width = np.diff(learned.intervals, axis=1).max()
    for value in np.geomspace(*BOUNDS, 60):
        problem = MarkowitzProblem(means, covariances, value)
        explained = not any(consistent_beliefs(problem, action).is_empty for action in actions)
        if np.abs(learned.intervals - value).min() > 0.01 * width:
            assert learned.contains(value) == explained


@pytest.mark.parametrize("seed", range(instances(6, least=1)))
def test_rounded_decisions_leave_an_interval_with_the_truth(seed: int) -> None:
    rng = np.random.default_rng([5, seed])
    n_states, n_assets = [(2, 4), (3, 4), (2, 3)][seed % 3]
    means, covariances = market(rng, n_states, n_assets)
    truth = float(np.exp(rng.uniform(np.log(0.3), np.log(8.0))))
    actions = MarkowitzProblem(means, covariances, truth).solve(rng.dirichlet(np.ones(n_states), 2))
    adversary = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS)
    learned = adversary.learn(np.round(actions, 3), rounding=0.5e-3)
    assert learned.contains(truth)
    assert learned.status != CostStatus.IDENTIFIED
    coarse = adversary.learn(np.round(actions, 2), rounding=0.5e-2)
    assert coarse.contains(truth)
    assert coarse.interval[1] - coarse.interval[0] > 0.5 * (learned.interval[1] - learned.interval[0])


def test_rounded_decisions_taken_for_exact_ones_are_unexplained() -> None:
    rng = np.random.default_rng(6)
    means, covariances = market(rng, 2, 6)
    actions = MarkowitzProblem(means, covariances, 2.0).solve(rng.dirichlet(np.ones(2), 3))
    rounded = np.round(actions, 2)
    rounded[:, 0] += 1.0 - rounded.sum(axis=1)
    learned = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS).learn(rounded)
    assert learned.status == CostStatus.UNEXPLAINED
    assert np.isnan(learned.parameter)
    assert np.isnan(learned.interval).all()
    assert "rounded" in learned.summary()
    beliefs = learned.consistent_beliefs(rounded[0])
    assert beliefs.is_empty
    assert not beliefs.contains([0.5, 0.5])


def test_an_error_of_the_means_is_recovered() -> None:
    rng = np.random.default_rng(7)
    means, covariances = market(rng, 2, 6)
    direction = rng.normal(size=(2, 6)) * 0.01

    def shifted(amount: float) -> MarkowitzProblem:
        return MarkowitzProblem(means + amount * direction, covariances, 3.0)

    actions = shifted(-0.37).solve(rng.dirichlet(np.ones(2), 4))
    learned = CostLearningAdversary(shifted, (-2.0, 2.0)).learn(actions)
    assert learned.parameter == pytest.approx(-0.37, rel=1e-6)


@pytest.mark.parametrize("seed", range(instances(2, least=1)))
def test_the_union_holds_every_costs_consistent_beliefs(seed: int) -> None:
    rng = np.random.default_rng([8, seed])
    means, covariances = market(rng, 3, 3)
    held = rng.dirichlet(np.ones(3), 3)
    actions = MarkowitzProblem(means, covariances, 2.0).solve(held)
    learned = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS).learn(actions)
    union = learned.consistent_beliefs(actions[0])
    assert not union.is_empty
    assert union.contains(held[0])
    limits = union.bounds()
    for low, high in learned.intervals:
        for value in np.linspace(low, high, 5)[1:-1]:
            corners = consistent_beliefs(MarkowitzProblem(means, covariances, value), actions[0]).vertices()
            for corner in corners:
                assert union.contains(corner / corner.sum())
                assert (limits[:, 0] - 1e-8 <= corner).all()
                assert (corner <= limits[:, 1] + 1e-8).all()
    # A belief that no cost explains: its own decision differs from this one under every cost of the interval.
    stray = rng.dirichlet(np.ones(3), 40)
    gaps = np.min(
        [
            np.abs(MarkowitzProblem(means, covariances, v).solve(stray) - actions[0]).max(axis=1)
            for v in np.linspace(*learned.interval, instances(200))
        ],
        axis=0,
    )
    assert (gaps > 0.02).any()
    assert not any(union.contains(belief) for belief in stray[gaps > 0.02])


def test_a_known_cost_gives_its_consistent_beliefs() -> None:
    rng = np.random.default_rng(9)
    means, covariances = market(rng, 2, 6)
    problem = MarkowitzProblem(means, covariances, 2.0)
    actions = problem.solve([[0.3, 0.7], [0.8, 0.2]])
    union = (
        CostLearningAdversary.risk_aversion(means, covariances, BOUNDS).learn(actions).consistent_beliefs(actions[0])
    )
    assert union.bounds() == pytest.approx(consistent_beliefs(problem, actions[0]).bounds(), abs=1e-5)


def test_a_decision_that_no_cost_explains_leaves_an_empty_union() -> None:
    means, covariances = market(np.random.default_rng(3), 2, 4)
    adversary = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS)
    odd = np.random.default_rng(3).dirichlet(np.ones(4), 3)
    learned = adversary.learn(odd)
    assert learned.status is CostStatus.UNEXPLAINED
    beliefs = learned.consistent_beliefs(odd[0])
    assert beliefs.is_empty
    assert not beliefs.contains([0.5, 0.5])
    assert beliefs.bounds().shape == (2, 2)
    assert np.isnan(beliefs.bounds()).all()


def test_what_cannot_be_is_refused(tmp_path: object) -> None:
    rng = np.random.default_rng(10)
    means, covariances = market(rng, 2, 2)
    adversary = CostLearningAdversary.risk_aversion(means, covariances, BOUNDS)
    with pytest.raises(InputError, match="ascending"):
        CostLearningAdversary.risk_aversion(means, covariances, (2.0, 1.0))
    with pytest.raises(InputError, match="outside the feasible set"):
        adversary.learn([[0.5, 0.4]])
    with pytest.raises(InputError, match="more than its rounding"):
        adversary.learn([[0.5, 0.4]], rounding=0.01)
    with pytest.raises(InputError, match="rounding must be at least 0"):
        adversary.learn([[0.5, 0.5]], rounding=-1.0)
    with pytest.raises(InputError, match="decision problem"):
        CostLearningAdversary(lambda _: None, BOUNDS)  # type: ignore[arg-type, return-value]
    with pytest.raises(InputError, match="family must give"):
        CostLearningAdversary(5.0, BOUNDS)  # type: ignore[arg-type]
    kinked = ConvexProblem.from_functions(lambda u: u**2, lambda u: 2.0 * np.diag(u), simplex(2))
    kinked.differentiable = False
    with pytest.raises(InputError, match="without gradients"):
        CostLearningAdversary(lambda _: kinked, BOUNDS).learn([[0.5, 0.5]])
    learned = adversary.learn([[0.5, 0.5]])
    learned.save(tmp_path / "learned.npz")
    again = LearnedCost.load(tmp_path / "learned.npz")
    assert (again.intervals == learned.intervals).all()
    with pytest.raises(InputError, match="learn again"):
        again.consistent_beliefs([0.5, 0.5])


def test_the_low_end_of_a_wide_interval_is_as_well_known_as_the_high_one() -> None:
    """2γ (u_1 − u_2) is the mean of the states' 0.01 and 3: γ lies between 0.05 and 15 where the weights differ by 0.1."""
    adversary = CostLearningAdversary.risk_aversion([[0.01, 0.0], [3.0, 0.0]], [np.eye(2), np.eye(2)], (0.001, 1000.0))
    low, high = adversary.learn([[0.55, 0.45]]).interval
    assert 0.05 * 0.97 <= low <= 0.05 * (1 + 1e-6)
    assert 15.0 * (1 - 1e-6) <= high <= 15.0 * 1.03


def test_a_cost_that_is_identified_explains_the_decision_it_was_learned_from():
    for seed in some(range(60), 20):
        rng = np.random.default_rng(seed)
        means, factors = rng.normal(size=(1, 6)), rng.normal(size=(1, 6, 6))
        covariances, aversion = factors @ factors.swapaxes(1, 2) / 6, 10 ** rng.uniform(-1, 1)
        action = MarkowitzProblem(means, covariances, aversion).solve([1.0])
        found = CostLearningAdversary.risk_aversion(means, covariances, (0.05, 50.0)).learn([action])
        if len(found.intervals):
            assert found.consistent_beliefs(action).contains([1.0])
