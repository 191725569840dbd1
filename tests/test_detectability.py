"""Whether hiding shows: against the single gaps, loops over pairs of decisions, and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from inscrutable import (
    Detectability,
    FiniteProblem,
    InputError,
    LinearProblem,
    MarkowitzProblem,
    Mechanism,
    OriginalDecisionMaker,
    Prior,
    ProbabilisticDecisionMaker,
    box,
    consistent_beliefs,
    detectability,
    mechanism,
    plausibility_gap,
    simplex_grid,
    uniform_prior,
)
from inscrutable.adversaries.plausibility import nearest_explanation, nearest_explanations
from inscrutable.privacy.detection import area_under_curve
from oracles import markets
from sizes import instances
from strategies import SEEDS, belief_problem, line_problem


def laws(problem, played, prior):
    """p and q as dictionaries by decision rounded to nine digits."""

    def key(action):
        return tuple(np.round(np.atleast_1d(action), 9).tolist())

    hiding: dict[tuple[float, ...], float] = {}
    honest: dict[tuple[float, ...], float] = {}
    for weight, belief, row in zip(prior.weights, played.beliefs, played.probabilities, strict=True):
        for share, action in zip(row, played.actions, strict=True):
            hiding[key(action)] = hiding.get(key(action), 0.0) + weight * share
        best = key(problem.solve(belief))
        honest[best] = honest.get(best, 0.0) + weight
    return hiding, honest


def by_pairs(hiding, honest):
    """P(λ(u) > λ(v)) + ½ P(λ(u) = λ(v)) pair by pair."""
    decisions = [u for u in {*hiding, *honest} if hiding.get(u, 0) + honest.get(u, 0) > 0]
    area = 0.0
    for u in decisions:
        for v in decisions:
            one = hiding.get(u, 0.0) * honest.get(v, 0.0)
            other = hiding.get(v, 0.0) * honest.get(u, 0.0)
            better = 0.5 if abs(one - other) < 1e-13 else float(one > other)
            area += hiding.get(u, 0.0) * honest.get(v, 0.0) * better
    return area


@settings(max_examples=instances(25))
@given(SEEDS, st.sampled_from(["finite", "markowitz", "linear"]))
def test_every_figure_is_its_definition(seed, kind):
    rng = np.random.default_rng(seed)
    problem = {
        "finite": lambda: FiniteProblem(rng.random((3, 5))),
        "markowitz": lambda: MarkowitzProblem(*markets.random_market(rng, 3, 4)),
        "linear": lambda: LinearProblem(rng.normal(size=(3, 2)), box(np.zeros(2), np.ones(2))),
    }[kind]()
    prior = Prior(simplex_grid(3, 3), rng.dirichlet(np.ones(10)))
    if kind == "finite":
        actions = np.arange(5)
    elif kind == "markowitz":
        actions = np.vstack([problem.solve(prior.beliefs[:4]), rng.dirichlet(np.ones(4), 2)])
    else:
        actions = np.vstack([[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]], rng.random((2, 2))])
    table = rng.dirichlet(np.full(len(actions), 0.5), 10)
    table[:, -1] = 0.0
    table /= table.sum(axis=1, keepdims=True)
    regrets = np.array([problem.regret(prior.beliefs, action) for action in actions]).T
    played = Mechanism(prior.beliefs, actions, table, regrets)
    if len(np.unique(np.round(np.asarray(actions, dtype=float), 9), axis=0)) < len(actions):
        return  # optimal decisions in common
    found = detectability(played, prior, problem)
    shares = prior.weights @ table
    gaps = np.array([plausibility_gap(problem, action) for action in actions])
    empty = np.array([consistent_beliefs(problem, action).is_empty for action in actions])
    assert found.gaps[:-1] == pytest.approx(gaps[:-1], abs=1e-8)
    assert np.isnan(found.gaps[-1])
    assert found.expected_gap == pytest.approx(shares[:-1] @ gaps[:-1], abs=1e-8)
    assert found.largest_gap == pytest.approx(gaps[:-1].max(), abs=1e-8)
    assert found.implausible_share == pytest.approx(shares[empty].sum(), abs=1e-12)
    hiding, honest = laws(problem, played, prior)
    both = {*hiding, *honest}
    assert found.auc == pytest.approx(by_pairs(hiding, honest), abs=1e-9)
    assert found.total_variation == pytest.approx(
        sum(abs(hiding.get(u, 0.0) - honest.get(u, 0.0)) for u in both) / 2, abs=1e-9
    )
    if all(honest.get(u, 0.0) > 0 for u in hiding if hiding[u] > 0):
        expected = sum(p * np.log2(p / honest[u]) for u, p in hiding.items() if p > 0)
        assert found.divergence == pytest.approx(expected, abs=1e-9)
    else:
        assert found.divergence == np.inf
    # A coarser look never tells more.
    assert 0.5 - 1e-9 <= found.read_auc <= found.auc + 1e-9
    assert found.read_total_variation <= found.total_variation + 1e-9
    # A test by likelihood ratio: half of total variation at least, all of it at most, is area.
    assert 0.5 + 0.5 * found.total_variation - 1e-9 <= found.auc
    assert found.auc <= 0.5 + found.total_variation - 0.5 * found.total_variation**2 + 1e-9


@pytest.mark.parametrize("kind", ["finite", "markowitz", "linear"])
def test_who_hides_nothing_shows_nothing(kind):
    rng = np.random.default_rng(2)
    problem = {
        "finite": FiniteProblem(rng.random((3, 5))),
        "markowitz": MarkowitzProblem(*markets.random_market(rng, 3, 4)),
        "linear": LinearProblem(rng.normal(size=(3, 2)), box(np.zeros(2), np.ones(2))),
    }[kind]
    prior = uniform_prior(3, 5)
    found = detectability(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem)
    assert found.auc == pytest.approx(0.5, abs=1e-9)
    assert found.total_variation == pytest.approx(0, abs=1e-12)
    assert found.divergence == pytest.approx(0, abs=1e-12)
    assert (found.expected_gap, found.implausible_share) == (0, 0)
    assert found.read_auc == pytest.approx(0.5, abs=1e-9)
    assert found.read_total_variation == pytest.approx(0, abs=1e-12)
    assert found.likelihood_ratios == pytest.approx(1)


def test_decoys_are_plausible_and_yet_seen():
    problem, prior = belief_problem(3), uniform_prior(3, 4)
    found = detectability(mechanism(ProbabilisticDecisionMaker(problem, budget=0.2), prior.beliefs), prior, problem)
    assert found.implausible_share == 0
    assert found.expected_gap == 0
    assert found.auc > 0.6


def test_an_implausible_decision_by_hand():
    # u_1 = ½ + π·m/4 <= ¾; everything in asset 1 leaves a regret of ⅛ at best.
    problem, prior = line_problem([1.0, 0.0]), uniform_prior(2, 1)
    honest = problem.solve(prior.beliefs)
    played = Mechanism(prior.beliefs, [honest[0], [1.0, 0.0]], [[1.0, 0.0], [0.0, 1.0]], [[0.0, 0.125], [0.2, 0.5]])
    found = detectability(played, prior, problem)
    assert found.gaps == pytest.approx([0, 0.125], abs=1e-8)
    assert found.expected_gap == pytest.approx(0.0625, abs=1e-8)
    assert found.implausible_share == 0.5
    assert found.likelihood_ratios.tolist() == [1, np.inf]
    assert found.total_variation == 0.5
    assert found.auc == pytest.approx(0.5 * 1 + 0.5 * (0.5 * 0.5 + 0.5 * 1))
    assert found.divergence == np.inf
    assert found.read_auc == found.auc
    assert found.read_total_variation == 0.5


def test_decisions_between_the_points_of_a_prior_are_read_as_the_nearest():
    # Each decision tells its belief; playing for a belief a little off is seen at once, but not in what is read.
    problem, prior = belief_problem(3), uniform_prior(3, 4)
    moved = 0.95 * prior.beliefs + 0.05 / 3
    actions = problem.solve(moved)
    regrets = np.array([problem.regret(prior.beliefs, action) for action in actions]).T
    found = detectability(Mechanism(prior.beliefs, actions, np.eye(len(prior)), regrets), prior, problem)
    assert found.auc == pytest.approx(1)
    assert found.total_variation == pytest.approx(1)
    assert found.read_auc == pytest.approx(0.5)
    assert found.read_total_variation == pytest.approx(0)


def test_areas_by_hand():
    assert area_under_curve(np.array([1.0, 0.0]), np.array([0.0, 1.0])) == 1
    assert area_under_curve(np.array([0.5, 0.5, 0.0]), np.array([0.5, 0.5, 0.0])) == 0.5
    assert area_under_curve(np.array([0.75, 0.25]), np.array([0.25, 0.75])) == 0.75


def test_unplayed_decisions_have_no_ratio_unless_they_are_optimal():
    problem, prior = FiniteProblem([[0.0, 1.0, 5.0], [1.0, 0.0, 5.0]]), uniform_prior(2, 1)
    played = Mechanism(prior.beliefs, [0, 1, 2], [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], np.zeros((2, 3)))
    found = detectability(played, prior, problem)
    assert found.likelihood_ratios[:2].tolist() == [2, 0]
    assert np.isnan(found.likelihood_ratios[2])
    assert np.isnan(found.gaps[1:]).all()


def test_input_output(tmp_path):
    problem, prior = belief_problem(2), uniform_prior(2, 3)
    played = mechanism(OriginalDecisionMaker(problem), prior.beliefs)
    found = detectability(played, prior, problem)
    found.save(tmp_path / "found.npz")
    assert Detectability.load(tmp_path / "found.npz").summary() == found.summary() == repr(found)
    assert "AUC 0.5000" in found.summary()
    with pytest.raises(InputError, match="the problem has 3 states, the mechanism 2"):
        detectability(played, prior, belief_problem(3))
    with pytest.raises(InputError, match="action has 2 coordinates, expected 3"):
        detectability(played, prior, MarkowitzProblem(np.zeros((2, 3)), [np.eye(3)] * 2, 1.0))
    with pytest.raises(InputError, match="problem must be a decision problem"):
        detectability(played, prior, "problem")
    with pytest.raises(InputError, match="none of the mechanism's"):
        detectability(played, uniform_prior(2, 2), problem)


def test_equal_decisions_share_their_figures():
    problem, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), uniform_prior(2, 1)
    once = Mechanism(prior.beliefs, [0, 1], [[1.0, 0.0], [0.5, 0.5]], np.zeros((2, 2)))
    twice = Mechanism(prior.beliefs, [0, 0, 1], [[0.75, 0.25, 0.0], [0.0, 0.5, 0.5]], np.zeros((2, 3)))
    one, other = detectability(once, prior, problem), detectability(twice, prior, problem)
    assert (other.auc, other.total_variation) == (one.auc, one.total_variation)
    assert other.likelihood_ratios.tolist() == [1.5, 1.5, 0.5]
    assert other.gaps.tolist() == [0, 0, 0]


def test_decisions_that_nothing_explains_are_excused_by_the_belief_of_least_regret() -> None:
    rng = np.random.default_rng(5)
    problem = MarkowitzProblem(
        rng.normal(size=(3, 4)) * 0.1, [np.diag(rng.uniform(0.1, 0.3, 4)) for _ in range(3)], 1.0
    )
    prior = uniform_prior(3, 3)
    actions = np.vstack([problem.solve(prior.beliefs[:2]), rng.dirichlet(np.ones(4), size=6)])
    table = np.tile(np.append(np.full(7, 1 / 7), 0.0), (len(prior), 1))
    regrets = np.maximum(
        prior.beliefs @ problem.state_costs(actions).T - problem.optimal_cost(prior.beliefs)[:, None], 0
    )
    found = detectability(Mechanism(prior.beliefs, actions, table, regrets), prior, problem)
    fine = simplex_grid(3, 60)
    for action, gap, excuse in zip(actions, found.gaps, found.excuses, strict=True):
        if np.isnan(gap) or gap <= 0:
            assert np.isnan(excuse).all()  # never played, or in no need
            continue
        assert problem.regret(excuse, action) == pytest.approx(gap, abs=1e-9)
        assert gap <= float(np.min(problem.regret(fine, np.tile(action, (len(fine), 1))))) + 1e-9
        alone = nearest_explanation(problem, action)
        assert alone[1] == pytest.approx(gap, abs=1e-9)
    assert np.isfinite(found.excuses[:, 0]).sum() == 5
    empty = nearest_explanations(problem, actions[:0])
    assert (empty[0].shape, empty[1].shape) == ((0, 3), (0,))
