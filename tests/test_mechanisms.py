"""What a decision maker plays, as data, and priors over beliefs: against the decision makers, problems and enumeration."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import sparse

from inscrutable import (
    CategoricalEmission,
    CoinDecisionMaker,
    CounterAdversarialDecisionMaker,
    DirichletDecisionMaker,
    FiniteProblem,
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    LinearProblem,
    MarkowitzProblem,
    MeanSquaredErrorFloor,
    Mechanism,
    OriginalDecisionMaker,
    Polyhedron,
    Prior,
    ProbabilisticDecisionMaker,
    RoundingDecisionMaker,
    box,
    calibrate,
    decoy_grid,
    detectability,
    filter_beliefs,
    filtered_prior,
    leakage,
    mechanism,
    predicted_prior,
    simplex_grid,
    stationary_prior,
    uniform_prior,
)
from inscrutable.mechanisms import played as played_module
from inscrutable.mechanisms.priors import rounded_to_grid
from inscrutable.mechanisms.same_actions import first_same
from oracles import markets
from sizes import paired
from strategies import SEEDS, belief_problem

MAKERS = {
    "original": OriginalDecisionMaker,
    "counter-adversarial": lambda problem: CounterAdversarialDecisionMaker(problem, budget=0.2),
    "probabilistic": lambda problem: ProbabilisticDecisionMaker(problem, budget=0.2),
}


def problems():
    """A portfolio, choices, and a linear problem with vertices in common to many beliefs."""
    rng = np.random.default_rng(5)
    return {
        "markowitz": MarkowitzProblem(*markets.random_market(rng, 3, 4)),
        "finite": FiniteProblem(rng.random((3, 4))),
        "linear": LinearProblem(rng.normal(size=(3, 2)), box(np.zeros(2), np.ones(2))),
    }


def test_a_rule_is_listed_as_it_decides(fresh_rng):
    problem = MarkowitzProblem(*markets.random_market(fresh_rng, 3, 4))
    beliefs = fresh_rng.dirichlet(np.ones(3), 7)
    for chooser in (OriginalDecisionMaker(problem), RoundingDecisionMaker(problem, 0.2)):
        points, numbers, shares = chooser.table(beliefs)
        assert np.array_equal(points[numbers[:, 0]], chooser.decide_many(beliefs).action)
        assert (shares == 1).all()


@pytest.mark.parametrize("kind", ["finite", "linear"])
def test_noise_of_weights_needs_weights(kind):
    with pytest.raises(InputError, match="portfolio weights on the simplex"):
        DirichletDecisionMaker(problems()[kind], 10.0, rng=np.random.default_rng(0))


@pytest.mark.parametrize("spent", [np.inf, 0.3])
def test_off_the_simplex_the_cheapest_neighbour_that_is_feasible_is_played(spent):
    """Against all multiples of the step in the box: few are neighbours of the optimum."""
    rng, step = np.random.default_rng(20261126), 0.25
    ends = np.full(3, 1.0)
    region = box(-ends, ends) if np.isinf(spent) else box(-ends, ends) & Polyhedron([np.ones(3)], [spent])
    market = rng.normal(size=(3, 3)), [np.diag(each) for each in rng.uniform(1.0, 3.0, (3, 3))]
    problem = MarkowitzProblem(*market, 1.0, region)
    grid = np.array(list(product(np.arange(-1.0, 1.1, step), repeat=3)))
    grid = grid[grid.sum(axis=1) <= spent + 1e-9]
    beliefs = rng.dirichlet(np.ones(3), 12)
    for belief, found in zip(beliefs, RoundingDecisionMaker(problem, step).decide_many(beliefs).action, strict=True):
        apart = grid - problem.solve(belief)
        near = grid[((apart > -step) & (apart < step)).all(axis=1)]
        costs = [float(belief @ [a @ c @ a - m @ a for m, c in zip(*market, strict=True)]) for a in near]
        assert found == pytest.approx(near[int(np.argmin(costs))], abs=1e-9)


@pytest.mark.parametrize(("maker", "kind"), paired(list(MAKERS), ["finite", "markowitz", "linear"]))
def test_a_mechanism_is_what_is_decided(kind, maker):
    problem, beliefs = problems()[kind], simplex_grid(3, 4)
    chooser = MAKERS[maker](problem)
    found = mechanism(chooser, beliefs)
    assert np.array_equal(found.beliefs, beliefs)
    assert found.probabilities.sum(axis=1) == pytest.approx(1, abs=1e-12)
    assert (found.probabilities >= 0).all()
    assert (found.probabilities.max(axis=0) > 0).all()
    points = problem.as_points(found.actions)
    apart = np.abs(points[:, None] - points[None]).max(axis=2) + np.eye(len(points))
    assert apart.min() > 1e-11
    for m, action in enumerate(found.actions):
        assert found.regrets[:, m] == pytest.approx(problem.regret(beliefs, action), abs=1e-12)
    decided = chooser.decide_many(beliefs)
    for b in range(len(beliefs)):
        one = decided[b]
        atoms = one.actions if hasattr(one, "actions") else np.asarray(one.action)[None]
        shares = one.probabilities if hasattr(one, "actions") else np.ones(1)
        expected = np.zeros(len(points))
        for point, share in zip(problem.as_points(atoms), shares, strict=True):
            expected[np.abs(points - point).max(axis=1).argmin()] += share
        assert found.probabilities[b] == pytest.approx(expected, abs=1e-12)
        regret = one.expected_regret if hasattr(one, "actions") else one.regret
        assert found.expected_regrets[b] == pytest.approx(regret, abs=1e-9)


def test_the_original_one_plays_at_no_regret():
    problem = problems()["linear"]
    found = mechanism(OriginalDecisionMaker(problem), simplex_grid(3, 12))
    assert len(found.actions) <= 4  # corners of a square
    assert found.expected_regrets == pytest.approx(0, abs=1e-12)
    assert set(np.unique(found.probabilities)) == {0, 1}


def test_candidates_come_first_and_keep_their_order():
    problem = belief_problem(3)
    listed = decoy_grid(problem, 2)
    beliefs = simplex_grid(3, 3)
    found = mechanism(OriginalDecisionMaker(problem), beliefs, listed)
    assert np.array_equal(found.actions[: len(listed.actions)], listed.actions)
    assert len(found.actions) == 6 + 10 - 3  # vertices are on both grids
    assert found.played(np.full(10, 0.1))[6:] == pytest.approx(0.1, abs=1e-12)
    unplayed = found.probabilities.max(axis=0) == 0
    assert unplayed.sum() == 3
    assert found.regrets[:, unplayed].min() > 0


def test_candidates_may_be_plain_decisions():
    problem = belief_problem(2)
    found = mechanism(OriginalDecisionMaker(problem), [[0.9, 0.1], [0.5, 0.5]], [[0.25, 0.75], [0.5, 0.5]])
    assert found.actions[:2].tolist() == [[0.25, 0.75], [0.5, 0.5]]
    assert found.played([0.5, 0.5]) == pytest.approx([0.0, 0.5, 0.5])
    for wrong in ([1.0], [1.5, -0.5], [np.nan, 1.0], np.full((2, 1), 0.5)):
        with pytest.raises(InputError, match="weights"):
            found.played(wrong)


def test_equal_decisions_are_one():
    twice = SimpleNamespace(actions=np.array([[1.0, 0.0], [0.5, 0.5], [1.0, 1e-14]]))
    problem = belief_problem(2)
    found = mechanism(OriginalDecisionMaker(problem), [[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]], twice)
    assert found.actions[:2].tolist() == [[1.0, 0.0], [0.5, 0.5]]
    assert found.probabilities.shape == (3, 4)
    assert np.array_equal(found.probabilities[0], found.probabilities[1])


@settings(max_examples=60)
@given(SEEDS, st.integers(1, 3))
def test_rounding_does_not_part_what_is_the_same(seed, n_actions):
    rng = np.random.default_rng(seed)
    centres = rng.integers(-3, 4, size=(6, n_actions)) + 0.5e-11  # where rounding to 1e-11 decides
    which = rng.integers(6, size=40)
    noisy = centres[which] + rng.uniform(-1e-15, 1e-15, size=(40, n_actions))
    same = (centres[which][:, None] == centres[which][None]).all(axis=2)
    assert np.array_equal(first_same(noisy), same.argmax(axis=1))


def test_large_tables_are_sparse(monkeypatch):
    problem, beliefs = belief_problem(3), simplex_grid(3, 6)
    chooser = ProbabilisticDecisionMaker(problem, budget=0.2)
    plain = mechanism(chooser, beliefs)
    monkeypatch.setattr(played_module, "_MOST_DENSE", 10)
    thin = mechanism(chooser, beliefs)
    assert sparse.issparse(thin.probabilities)
    assert not sparse.issparse(plain.probabilities)
    assert np.array_equal(thin.probabilities.toarray(), plain.probabilities)
    assert thin.expected_regrets == pytest.approx(plain.expected_regrets, abs=1e-14)
    weights = np.random.default_rng(0).dirichlet(np.ones(len(beliefs)))
    assert thin.played(weights) == pytest.approx(plain.played(weights), abs=1e-14)
    assert thin.summary() == plain.summary() == repr(plain)


@pytest.mark.parametrize("maker", MAKERS)
def test_small_worlds(maker):
    one_asset = MarkowitzProblem([[0.1], [0.2]], [[[1.0]], [[2.0]]], 1.0)
    found = mechanism(MAKERS[maker](one_asset), [[0.3, 0.7], [1.0, 0.0]])
    assert found.actions.tolist() == [[1.0]]
    assert found.probabilities.tolist() == [[1.0], [1.0]]
    assert found.regrets.tolist() == [[0.0], [0.0]]
    one_belief = mechanism(MAKERS[maker](belief_problem(2)), [0.5, 0.5])
    assert one_belief.beliefs.shape == (1, 2)
    one_state = mechanism(MAKERS[maker](belief_problem(1)), [[1.0]])
    assert one_state.regrets.tolist() == [[0.0]]


def test_copied_assets_do_not_disturb():
    means, covariance = np.array([[0.2, 0.2], [0.1, 0.1]]), np.ones((2, 2))
    found = mechanism(
        OriginalDecisionMaker(MarkowitzProblem(means, [covariance, 2 * covariance], 1.0)), simplex_grid(2, 4)
    )
    assert found.regrets.max() == pytest.approx(0, abs=1e-12)
    assert found.probabilities.sum(axis=1) == pytest.approx(1)


def test_input_is_checked():
    problem = belief_problem(2)
    with pytest.raises(InputError, match="`problem` and `decide_many` is needed"):
        mechanism(problem, [[0.5, 0.5]])
    with pytest.raises(InputError, match="outside the feasible set"):
        mechanism(OriginalDecisionMaker(problem), [[0.5, 0.5]], [[1.0, 0.5]])
    with pytest.raises(InputError, match=r"sums to 1\.1, expected 1"):
        mechanism(OriginalDecisionMaker(problem), [[0.5, 0.6]])
    with pytest.raises(InputError, match="at least one belief"):
        mechanism(OriginalDecisionMaker(problem), np.zeros((0, 2)))
    with pytest.raises(InputError, match="the prior has 3 states, the problem 2"):
        mechanism(OriginalDecisionMaker(problem), uniform_prior(3, 2))


def test_a_prior_gives_its_beliefs():
    maker, prior = OriginalDecisionMaker(belief_problem(2)), uniform_prior(2, 4)
    found, same = mechanism(maker, prior), mechanism(maker, prior.beliefs)
    assert np.array_equal(found.beliefs, same.beliefs)
    assert np.array_equal(found.probabilities, same.probabilities)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"probabilities": np.ones((2, 2))}, "row 0 sums to 2, expected 1"),
        ({"probabilities": [[1.5, -0.5], [0.5, 0.5]]}, r"-0.5 at index \[0, 1\]"),
        ({"probabilities": np.ones((2, 1))}, r"need probabilities of shape \(2, 2\), got \(2, 1\)"),
        ({"probabilities": sparse.csr_array(np.diag([1.0, 0.5]))}, "row 1 sums to 0.5, expected 1"),
        ({"probabilities": sparse.csr_array([[1.5, -0.5], [0.5, 0.5]])}, "at least 0"),
        ({"regrets": np.zeros((1, 2))}, r"need regrets of shape \(2, 2\), got \(1, 2\)"),
        ({"regrets": [[0.0, 0.0], [0.0, -1.0]]}, r"at least 0, got -1 at index \[1, 1\]"),
        ({"regrets": [[0.0, 0.0], [0.0, np.nan]]}, "every entry must be finite"),
        ({"actions": [[0.0], [np.inf]]}, "every entry must be finite"),
        ({"actions": [0.25, 0.75]}, "mechanism actions must be 2-dimensional"),
        ({"beliefs": [[0.5, 0.4], [1.0, 0.0]]}, "mechanism beliefs row 0 sums to 0.9"),
        ({"beliefs": np.zeros((0, 2)), "probabilities": np.zeros((0, 2)), "regrets": np.zeros((0, 2))}, "0 and 2"),
    ],
)
def test_a_mechanism_checks_itself(change, message):
    held = {
        "beliefs": [[1.0, 0.0], [0.0, 1.0]],
        "actions": [[0.0], [1.0]],
        "probabilities": np.eye(2),
        "regrets": np.zeros((2, 2)),
    }
    Mechanism(**held)
    with pytest.raises(InputError, match=message):
        Mechanism(**{**held, **change})


def test_regrets_below_zero_by_rounding_are_zero():
    found = Mechanism(np.eye(2), [[0.0], [1.0]], np.eye(2), [[0.3, 0.0], [0.2, -2e-16]])
    np.testing.assert_array_equal(found.regrets, [[0.3, 0.0], [0.2, 0.0]])


def test_a_sparse_table_is_cleaned():
    table = sparse.csr_array(([1.0 + 5e-9, 1e-9, 1.0], ([0, 1, 1], [0, 0, 1])), shape=(2, 2))
    found = Mechanism([[1.0, 0.0], [0.0, 1.0]], [[0.0], [1.0]], table, np.zeros((2, 2)))
    assert found.probabilities.sum(axis=1) == pytest.approx(1, abs=1e-15)
    assert table.data[0] == 1.0 + 5e-9  # what was passed in stays as it was


def test_mechanisms_and_priors_can_be_saved_and_read(tmp_path):
    choices = mechanism(OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]])), simplex_grid(2, 3))
    held = mechanism(ProbabilisticDecisionMaker(belief_problem(3), budget=0.1), simplex_grid(3, 3))
    thin = Mechanism(held.beliefs, held.actions, sparse.csr_array(held.probabilities), held.regrets)
    for found in (choices, held, thin):
        found.save(tmp_path / "found.npz")
        again = Mechanism.load(tmp_path / "found.npz")
        assert again.actions.dtype == found.actions.dtype
        for name in ("beliefs", "actions", "regrets"):
            assert np.array_equal(getattr(again, name), getattr(found, name)), name
        assert sparse.issparse(again.probabilities) == sparse.issparse(found.probabilities)
        assert np.array_equal(again.sparse.toarray(), found.sparse.toarray())
    prior = Prior(simplex_grid(3, 3), np.random.default_rng(0).dirichlet(np.ones(10)))
    prior.save(tmp_path / "prior.npz")
    assert np.array_equal(Prior.load(tmp_path / "prior.npz").weights, prior.weights)
    with pytest.raises(InputError, match="holds a Prior, expected a Mechanism"):
        Mechanism.load(tmp_path / "prior.npz")


# --- priors ---------------------------------------------------------------------------------------------------------------


def test_a_prior_by_hand():
    prior = Prior([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]], [0.25, 0.25, 0.5])
    assert len(prior) == 3
    assert prior.mean == pytest.approx([0.5, 0.5])
    assert prior.entropy == 1.5
    assert prior.error == pytest.approx(0.5)  # half the time at distance √½
    assert "3 beliefs, entropy 1.5000 bits" in prior.summary() == repr(prior)
    assert Prior([[1.0, 0.0], [0.0, 1.0]], [1.0, 0.0]).entropy == 0


@pytest.mark.parametrize(
    ("beliefs", "weights", "message"),
    [
        ([[1.0, 0.0]], [0.5, 0.5], "got 1 beliefs and 2 weights"),
        ([[1.0, 0.0], [0.5, 0.4]], [0.5, 0.5], "prior beliefs row 1 sums to 0.9"),
        ([[1.0, 0.0], [0.5, 0.5]], [0.5, 0.4], "prior weights sums to 0.9"),
        ([[1.0, 0.0], [0.5, 0.5]], [1.5, -0.5], "prior weights has -0.5"),
        ([[1.0, 0.0], [0.5, 0.5]], [[0.5, 0.5]], "prior weights must be 1-dimensional"),
        ([1.0, 0.0], [1.0], "prior beliefs must be 2-dimensional"),
    ],
)
def test_a_prior_checks_itself(beliefs, weights, message):
    with pytest.raises(InputError, match=message):
        Prior(beliefs, weights)


def test_the_uniform_prior():
    prior = uniform_prior(3, 30)
    assert len(prior) == 496
    assert prior.entropy == pytest.approx(np.log2(496))
    assert prior.mean == pytest.approx([1 / 3] * 3)
    assert len(uniform_prior(1, 5)) == 1
    with pytest.raises(InputError, match="at least 1"):
        uniform_prior(3, 0)


def enumerated_law(world, table, resolution, n_steps):
    """The law of the belief after n steps: every sequence of observations, Bayes' rule in plain numbers, two states."""
    law: dict[float, float] = {}
    for seen in product(range(len(table[0])), repeat=n_steps):
        belief, chance = list(world.initial), 1.0
        for step, y in enumerate(seen):
            if step:
                belief = [sum(belief[i] * world.transition[i][j] for i in range(2)) for j in range(2)]
            joint = [belief[j] * table[j][y] for j in range(2)]
            chance *= sum(joint)
            belief = [each / sum(joint) for each in joint]
        place = round(belief[0] * resolution) / resolution
        law[place] = law.get(place, 0.0) + chance
    return law


def test_the_stationary_prior_is_the_enumerated_one():
    table = [[0.75, 0.25], [0.4, 0.6]]
    world = HiddenMarkovModel([[0.8, 0.2], [0.4, 0.6]], CategoricalEmission(table))
    expected = enumerated_law(world, table, 8, 12)
    prior = filtered_prior(world, 8, rng=np.random.default_rng(0), n_steps=60_000)
    found = dict(zip(prior.beliefs[:, 0].tolist(), prior.weights.tolist(), strict=True))
    places = sorted({*expected, *found})
    assert sum(expected.values()) == pytest.approx(1)
    for place in places:
        assert found.get(place, 0.0) == pytest.approx(expected.get(place, 0.0), abs=0.01), place  # 3 sd with memory
    # A belief is right on average: its mean is the stationary law, up to the bins.
    assert prior.mean == pytest.approx([2 / 3, 1 / 3], abs=0.5 / 8)


def test_the_stationary_prior_of_worlds_that_say_all_or_nothing():
    telling = HiddenMarkovModel([[0.5, 0.5], [0.25, 0.75]], CategoricalEmission(np.eye(2)))
    prior = filtered_prior(telling, 10, rng=np.random.default_rng(0), n_steps=20_000)
    assert prior.beliefs.tolist() == [[0.0, 1.0], [1.0, 0.0]]
    assert prior.weights == pytest.approx([2 / 3, 1 / 3], abs=0.02)
    silent = HiddenMarkovModel([[0.5, 0.5], [0.25, 0.75]], CategoricalEmission(np.full((2, 2), 0.5)))
    prior = filtered_prior(silent, 3, rng=np.random.default_rng(0), n_steps=100)
    assert prior.beliefs == pytest.approx(np.array([[1 / 3, 2 / 3]]))
    assert prior.weights.tolist() == [1.0]


def test_the_stationary_prior_is_repeatable_and_checks_its_input():
    world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission([[1.0], [-1.0]], [[[1.0]], [[2.0]]]))
    one, other = (filtered_prior(world, 20, rng=np.random.default_rng(7), n_steps=500) for _ in range(2))
    assert np.array_equal(one.beliefs, other.beliefs)
    assert np.array_equal(one.weights, other.weights)
    for resolution, n_steps, message in (
        (0, 10, "resolution"),
        (2.5, 10, "resolution"),
        (10, 0, "n_steps"),
        (10, 1, "n_steps = 1 never visits"),
    ):
        with pytest.raises(InputError, match=message):
            filtered_prior(world, resolution, rng=np.random.default_rng(0), n_steps=n_steps)
    with pytest.raises(InputError, match="rng must be"):
        filtered_prior(world, 10, rng=0)
    with pytest.raises(InputError, match="world must be a HiddenMarkovModel"):
        filtered_prior(world.transition, 10, rng=np.random.default_rng(0))
    with pytest.raises(InputError, match="n_states must be"):
        uniform_prior(0, 10)


@settings(max_examples=60)
@given(SEEDS, st.integers(1, 5), st.integers(1, 9))
def test_rounding_to_the_grid_finds_the_nearest_point(seed, n_states, resolution):
    rng = np.random.default_rng(seed)
    beliefs = np.vstack([rng.dirichlet(np.ones(n_states), 5), np.eye(n_states), simplex_grid(n_states, resolution)[:4]])
    found = rounded_to_grid(beliefs, resolution) / resolution
    grid = simplex_grid(n_states, resolution)
    assert found.sum(axis=1) == pytest.approx(1)
    assert (found >= 0).all()
    nearest = np.linalg.norm(beliefs[:, None] - grid[None], axis=2).min(axis=1)
    assert np.linalg.norm(beliefs - found, axis=1) == pytest.approx(nearest, abs=1e-12)


def test_regrets_that_are_all_rounding_are_taken_as_zero():
    beliefs = np.array([[0.5, 0.5], [0.2, 0.8]])
    for lost in (-5e-17, -9e-16):
        kept = Mechanism(beliefs, np.array([1]), np.ones((2, 1)), [[0.0], [lost]])
        np.testing.assert_array_equal(kept.regrets, 0.0)
    with pytest.raises(InputError, match="regrets must be at least 0, got -1e-06"):
        Mechanism(beliefs, np.array([1]), np.ones((2, 1)), [[0.0], [-1e-6]])


def test_each_prior_is_the_law_of_its_own_belief(fresh_rng):
    world = HiddenMarkovModel(
        [[0.7, 0.2, 0.1], [0.2, 0.6, 0.2], [0.1, 0.3, 0.6]],
        CategoricalEmission([[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]]),
    )
    path = filter_beliefs(world, world.sample(80_000, rng=fresh_rng).observations)
    makers = ((filtered_prior, path.beliefs), (predicted_prior, path.predicted))
    for make, beliefs in makers:
        prior = make(world, 60, rng=fresh_rng, n_steps=80_000)
        spread = np.sqrt(((beliefs - beliefs.mean(axis=0)) ** 2).sum(axis=1).mean())
        assert prior.error == pytest.approx(spread, abs=0.02), make.__name__
        assert prior.mean == pytest.approx(beliefs.mean(axis=0), abs=0.02)
    assert predicted_prior(world, 60, rng=fresh_rng).error < 0.75 * filtered_prior(world, 60, rng=fresh_rng).error
    assert stationary_prior is filtered_prior


@pytest.mark.parametrize(
    ("decided", "said"),
    [
        ({"action": [[0.7, 0.5], [0.5, 0.5]]}, "outside the feasible set: sum"),
        ({"action": [[np.nan, 0.5], [0.5, 0.5]]}, "action has nan"),
        ({"action": [[0.5, 0.5]]}, "for 2 beliefs"),
        (
            {"actions": [[[1.0, 0.0], [0.0, 1.0]]] * 2, "probabilities": [[np.nan, 1.0], [1.0, 0.0]]},
            "probabilities has nan",
        ),
        ({"actions": [[[1.0, 0.0], [0.0, 1.0]]] * 2, "probabilities": [[1.0, -0.3], [1.0, 0.0]]}, "must be >= 0"),
        ({"actions": [[[1.0, 0.0], [0.0, 1.0]]] * 2, "probabilities": [1.0, 0.0]}, "2-dimensional"),
        ({"actions": [[1.0, 0.0], [0.0, 1.0]], "probabilities": [[0.5, 0.5]] * 2}, "3-dimensional"),
    ],
)
def test_decisions_of_a_users_own_are_checked(decided, said):
    problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2)] * 2, 1.0)
    own = SimpleNamespace(**{name: np.array(value) for name, value in decided.items()})
    maker = SimpleNamespace(problem=problem, decide_many=lambda beliefs: own)
    with pytest.raises(InputError, match=said):
        mechanism(maker, [[0.5, 0.5], [0.9, 0.1]])


def test_a_prior_over_states_in_another_order_is_refused():
    problem = MarkowitzProblem(pd.DataFrame([[0.2, 0.0], [0.0, 0.1]], index=["calm", "stress"]), [np.eye(2)] * 2, 1.0)
    names = ["stress", "calm"]
    world = HiddenMarkovModel([[0.7, 0.3], [0.1, 0.9]], CategoricalEmission([[0.7, 0.3], [0.2, 0.8]]), names=names)
    prior = filtered_prior(world, 6, rng=np.random.default_rng(0), n_steps=2000)
    played = mechanism(CoinDecisionMaker(problem, 0.3), prior.beliefs)
    for refused in (
        lambda: calibrate(lambda q: CoinDecisionMaker(problem, q), 1e-4, prior, 0.0, 1.0),
        lambda: detectability(played, prior, problem),
        lambda: leakage(played, prior, problem),
        lambda: MeanSquaredErrorFloor(0.1).reached(played, prior, problem),
    ):
        with pytest.raises(InputError, match="order"):
            refused()
