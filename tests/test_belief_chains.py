"""Beliefs that move, and rules that decide by what came before: against enumerated paths and closed forms."""

from __future__ import annotations

from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy import sparse
from scipy.sparse.linalg import spsolve

from inscrutable import (
    Budget,
    CategoricalEmission,
    DelayedDecisionMaker,
    FiniteProblem,
    HiddenMarkovModel,
    InputError,
    MarkowitzProblem,
    Mechanism,
    ModelError,
    OriginalDecisionMaker,
    PartialDecisionMaker,
    Prior,
    SequentialDecisionMaker,
    filter_beliefs,
    filtered_prior,
    leakage,
    mechanism,
    predicted_prior,
    uniform_prior,
)
from inscrutable.experiments import memory_rules
from inscrutable.experiments.comparison import COMPARED, ComparisonSettings, compare, makers_of
from inscrutable.experiments.comparison_markets import market_of
from inscrutable.experiments.memory_rules import delayed, partly
from inscrutable.experiments.random_markets import random_market
from inscrutable.experiments.setting import Setting
from inscrutable.mechanisms.chains import BeliefChain, filtered_chain, predicted_chain, resting_chain
from inscrutable.reports.comparison import short_table
from oracles.chain_paths import every_path
from sizes import audited, some
from strategies import uneven_chain

WORLD = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]))


def market() -> MarkowitzProblem:
    return random_market(rng=np.random.default_rng(3)).problem


# ---- the chain ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("d", [0, 1, 3 if audited() else 2])
def test_a_lagged_mechanism_is_the_delayed_rule_on_every_path(d: int) -> None:
    chain, problem = uneven_chain(4), market()
    beliefs = chain.prior.beliefs
    optimal = mechanism(OriginalDecisionMaker(problem), beliefs)
    lagged = chain.lagged(optimal, d)
    joint = np.zeros((len(beliefs), len(optimal.actions)))
    regret = 0.0
    for path, chance in every_path(chain, d + 1):
        action = DelayedDecisionMaker(problem, d).decide_many(beliefs[path]).action[-1]
        place = int(np.abs(optimal.actions - action).max(axis=1).argmin())
        joint[path[-1], place] += chance
        regret += chance * float(problem.regret(beliefs[path[-1]], action))
    np.testing.assert_allclose(chain.prior.weights[:, None] * lagged.sparse.toarray(), joint, atol=1e-9)
    assert float(chain.prior.weights @ lagged.expected_regrets) == pytest.approx(regret, abs=1e-9)


def test_sampled_pasts_have_the_law_of_the_chain_backwards() -> None:
    chain, n_draws = uneven_chain(3, 1), 20_000
    found = chain.histories(2, n_draws, rng=np.random.default_rng(0))
    assert found.shape == (3, 3, n_draws)
    assert (found[-1] == np.arange(3)[:, None]).all()
    wanted = np.zeros((3, 3, 3))
    for path, chance in every_path(chain, 3):
        wanted[tuple(path)] = chance / chain.prior.weights[path[-1]]
    for b in range(3):
        for first, second in product(range(3), repeat=2):
            share = float(((found[0, b] == first) & (found[1, b] == second)).mean())
            chance = wanted[first, second, b]
            assert abs(share - chance) <= 5 * np.sqrt(chance * (1 - chance) / n_draws) + 1e-12


def test_a_points_own_past_when_nothing_moves_or_nothing_weighs() -> None:
    prior = Prior(np.eye(3), [0.5, 0.5, 0.0])
    for stay in (0.0, 0.4, 1.0):
        chain = resting_chain(prior, stay)
        assert chain.reversed.toarray()[2].tolist() == [0.0, 0.0, 1.0]
        assert (chain.histories(5, 4, rng=np.random.default_rng(0))[:, :2] < 2).all()
    still = resting_chain(prior, 1.0).histories(5, 4, rng=np.random.default_rng(0))
    assert (still == np.arange(3)[:, None]).all()


def test_the_chain_of_a_world_counts_its_path() -> None:
    chain = filtered_chain(WORLD, 6, rng=np.random.default_rng(5), n_steps=2000)
    prior = filtered_prior(WORLD, 6, rng=np.random.default_rng(5), n_steps=2000)
    np.testing.assert_array_equal(chain.prior.beliefs, prior.beliefs)
    np.testing.assert_array_equal(chain.prior.weights, prior.weights)
    observations = WORLD.sample(2000, rng=np.random.default_rng(5)).observations
    held = filter_beliefs(WORLD, observations).beliefs[200:]
    near = [int(((prior.beliefs - belief) ** 2).sum(axis=1).argmin()) for belief in held]
    counts = np.zeros((len(prior), len(prior)))
    for before, after in zip(near, [*near[1:], near[0]], strict=True):
        counts[before, after] += 1
    shares = chain.transition.toarray()
    assert np.array_equal(shares > 0, counts > 0)
    # Steps have weights near one, which balance the time in each state.
    np.testing.assert_allclose(shares, counts / counts.sum(axis=1, keepdims=True), atol=0.02)
    np.testing.assert_allclose(prior.weights, counts.sum(axis=1) / 1800, atol=0.02)
    assert prior.weights @ shares == pytest.approx(prior.weights, abs=1e-12)


@pytest.mark.parametrize("stays", some([(0.9995, 0.999), (0.998, 0.998), (0.9, 0.8)], 3))
def test_the_law_is_right_where_states_last_long(fresh_rng: np.random.Generator, stays: tuple[float, float]) -> None:
    """Against the filter's own chain on 4,001 points, of which each step goes to the two nearest, by linear equations."""
    (a, b), sensor = stays, np.array([[0.7, 0.3], [0.4, 0.6]])
    transition = np.array([[a, 1.0 - a], [1.0 - b, b]])
    n = 4001
    points = np.linspace(0.0, 1.0, n)
    here = np.column_stack([points, 1.0 - points])
    moves = sparse.csr_array((n, n))
    for symbol in range(2):
        joint = here @ transition * sensor[:, symbol]
        chance = joint.sum(axis=1)
        place = joint[:, 0] / chance * (n - 1)
        low = np.minimum(place.astype(int), n - 2)
        for column, share in ((low, 1.0 - (place - low)), (low + 1, place - low)):
            moves = moves + sparse.csr_array((chance * share, (np.arange(n), column)), shape=(n, n))
    system = sparse.lil_array(sparse.identity(n) - moves.T)
    system[0, :] = 1.0
    law = spsolve(sparse.csc_array(system), np.eye(n)[0])
    world = HiddenMarkovModel(transition, CategoricalEmission(sensor))
    chain = filtered_chain(world, 200, rng=fresh_rng)
    assert chain.prior.mean[0] == pytest.approx((1.0 - b) / (2.0 - a - b), abs=1e-3)
    assert chain.prior.mean[0] == pytest.approx(law @ points, abs=1e-3)
    spread = np.sqrt(2.0 * (law @ points**2 - (law @ points) ** 2))
    assert chain.prior.error == pytest.approx(spread, rel=0.02)
    assert chain.prior.weights @ chain.transition == pytest.approx(chain.prior.weights, abs=1e-12)


@pytest.mark.parametrize("transition", [[[1.0, 0.0], [0.1, 0.9]], [[0.0, 1.0], [1.0, 0.0]]])
def test_states_that_a_path_leaves_for_good_or_at_once_have_a_chain(transition: Any) -> None:
    world = HiddenMarkovModel(transition, CategoricalEmission([[0.7, 0.3], [0.4, 0.6]]), [0.3, 0.7])
    chain = filtered_chain(world, 20, rng=np.random.default_rng(0), n_steps=2000)
    assert chain.prior.weights @ chain.transition == pytest.approx(chain.prior.weights, abs=1e-12)


@pytest.mark.parametrize(
    ("transition", "error", "told"),
    [
        (np.eye(2), ModelError, "depends on where the chain begins"),
        (
            [[1 - 1e-9, 1e-9], [1e-9, 1 - 1e-9]],
            InputError,
            "never visits the state 'regime [12]', whose long-run share is 50%",
        ),
    ],
)
def test_a_path_that_never_visits_a_common_state_is_no_long_run_law(
    transition: Any, error: type[Exception], told: str
) -> None:
    world = HiddenMarkovModel(transition, CategoricalEmission([[0.7, 0.3], [0.4, 0.6]]), [0.3, 0.7])
    for law in (filtered_chain, filtered_prior):
        with pytest.raises(error, match=told):
            law(world, 20, rng=np.random.default_rng(0), n_steps=2000)


def test_the_predicted_chain_is_one_step_ahead() -> None:
    chain = predicted_chain(WORLD, 5, rng=np.random.default_rng(1))
    prior = predicted_prior(WORLD, 5, rng=np.random.default_rng(1))
    np.testing.assert_array_equal(chain.prior.beliefs, prior.beliefs)
    np.testing.assert_array_equal(chain.prior.weights, prior.weights)
    # The best guess at tomorrow's prediction is today's, one step on: E[P'T(π,y)] = P'π for the exact filter.
    moved = chain.transition @ chain.prior.beliefs
    assert np.sqrt(chain.prior.weights @ ((moved - chain.prior.beliefs @ WORLD.transition) ** 2).sum(axis=1)) < 0.05


def test_predicted_beliefs_that_are_one_are_listed_once() -> None:
    """Equal rows forget the state, so that there is one prediction; with two of three equal there are those of two shares."""
    report = [[0.8, 0.1, 0.1], [0.1, 0.8, 0.1], [0.1, 0.1, 0.8]]
    forgetful = HiddenMarkovModel([[0.6, 0.4]] * 2, CategoricalEmission([[0.8, 0.2], [0.2, 0.8]]))
    prior = predicted_prior(forgetful, 10, rng=np.random.default_rng(0), n_steps=2000)
    np.testing.assert_allclose(prior.beliefs, [[0.6, 0.4]], atol=1e-12)
    assert prior.entropy == 0.0
    public = CategoricalEmission([[0.7, 0.3], [0.4, 0.6], [0.5, 0.5]])
    rows = [[0.7, 0.2, 0.1], [0.7, 0.2, 0.1], [0.1, 0.3, 0.6]]
    for told in (None, public):
        world = HiddenMarkovModel(rows, CategoricalEmission(report), public=told)
        before = filtered_chain(world, 6, rng=np.random.default_rng(0), n_steps=5000)
        chain = predicted_chain(world, 6, rng=np.random.default_rng(0), n_steps=5000)
        apart = np.abs(chain.prior.beliefs[:, None] - chain.prior.beliefs[None]).max(axis=2)
        assert len(chain.prior) <= 7  # shares of the third state
        assert apart[~np.eye(len(apart), dtype=bool)].min() > 1e-6
        # The flow from one belief to the next is that of all filtered beliefs with the same predictions.
        place = np.abs(before.prior.beliefs[:, 2:] @ [[0.5]] + 0.1 - chain.prior.beliefs[:, 2]).argmin(axis=1)
        tables = [(before.transition, chain.transition)]
        tables += [] if told is None else list(zip(before.public, chain.public, strict=True))
        for filtered, predicted in tables:
            flow = np.zeros((len(apart), len(apart)))
            np.add.at(flow, (place[:, None], place), before.prior.weights[:, None] * filtered.toarray())
            np.testing.assert_allclose(chain.prior.weights[:, None] * predicted.toarray(), flow, atol=1e-12)


@pytest.mark.parametrize(
    ("transition", "message"),
    [
        (np.eye(3), "shape"),
        ([[0.9, 0.2], [0.1, 0.9]], "row 0 sums"),
        ([[0.9, 0.1], [0.3, 0.7]], "does not keep the prior"),
        (sparse.csr_array([[1.5, -0.5], [0.0, 1.0]]), "probabilities"),
        (sparse.csr_array([[np.nan, 0.5], [0.5, 0.5]]), "probabilities"),
    ],
)
def test_malformed_chains_are_refused(transition: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        BeliefChain(Prior(np.eye(2), [0.5, 0.5]), transition)


def test_a_chain_forgets_where_a_high_power_is_positive(fresh_rng: np.random.Generator) -> None:
    """Means of permutations: of one, and often of two, there is a cycle or a class that the belief never leaves."""
    said = []
    for count in (1, 2, 2, 2, 3) * 6:
        moves = np.mean([np.eye(5)[fresh_rng.permutation(5)] for _ in range(count)], axis=0)
        outside = np.pad(moves, (0, 1))
        outside[5, [0, 5]] = 0.5  # a belief without weight does not count
        far = np.linalg.matrix_power(moves, 40)
        beliefs = fresh_rng.dirichlet(np.ones(2), 6)
        chain = BeliefChain(Prior(beliefs, [0.2] * 5 + [0.0]), outside)
        assert chain.forgets == (far > 0.0).all()
        stored = sparse.csr_array((outside.ravel(), np.tile(np.arange(6), 6), np.arange(0, 37, 6)))  # zeros too
        assert BeliefChain(chain.prior, stored).forgets == chain.forgets
        assert stored.nnz == 36
        said.append(chain.forgets)
    assert not all(said)


@pytest.mark.parametrize("moves", [np.roll(np.eye(3), 1, axis=1), np.full((3, 3), 1 / 3)])
def test_a_rule_cautions_where_simulated_paths_stay_apart(moves: np.ndarray) -> None:
    beliefs, problem = [[0.9, 0.1], [0.2, 0.8], [0.4, 0.6]], FiniteProblem([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4]])
    chain, rng = BeliefChain(Prior(beliefs, np.full(3, 1 / 3)), moves), np.random.default_rng(1)
    maker = SequentialDecisionMaker(problem, Budget.regret(0.06), chain=chain, information_price=np.inf, rng=rng)
    assert ("errors above" in maker.summary()) == (not chain.forgets)


def test_malformed_arguments_are_refused() -> None:
    chain = resting_chain(uniform_prior(2, 2), 0.5)
    with pytest.raises(InputError, match="prior must be a Prior"):
        BeliefChain(np.eye(2), np.eye(2))  # type: ignore[arg-type]
    with pytest.raises(InputError, match="at most 1"):
        resting_chain(chain.prior, 1.5)
    other = Mechanism(np.eye(2), [0, 1], np.eye(2), np.zeros((2, 2)))
    with pytest.raises(InputError, match="on the beliefs of the chain"):
        chain.lagged(other, 1)
    assert "50.0%" not in chain.summary()
    assert "stays" in repr(chain)


# ---- the rules in a comparison ---------------------------------------------------------------------------


def setting_of(chain: BeliefChain) -> Setting:
    from inscrutable import decoy_grid

    problem = market()
    return Setting(problem, chain.prior, decoy_grid(problem, 3), chain)


def test_a_delay_on_a_resting_belief_has_a_closed_form() -> None:
    prior, stay = uniform_prior(3, 6), 0.7
    setting = setting_of(resting_chain(prior, stay))
    optimal = mechanism(OriginalDecisionMaker(setting.problem), prior.beliefs)
    if len(optimal.actions) < len(prior):
        pytest.skip("the closed form needs a decision of its own for every belief")
    # Independent beliefs: E ρ(b', u*(b)) over all pairs.
    apart = float(np.mean([[setting.problem.regret(b, u) for b in prior.beliefs] for u in optimal.actions]))
    for d in (1, 2, 4):
        regret = (1 - stay**d) * apart
        play = delayed(setting, regret * 1.0001)
        assert play is not None
        assert play.memory is not None
        assert play.strength == d
        assert float(prior.weights @ play.mechanism.expected_regrets) == pytest.approx(regret, rel=1e-9)
        for n in (1, 2, d, d + 1, 100):
            late = max(d + 1 - n, 0)
            left = leakage(play.memory(n), prior).bayes_error
            assert left == pytest.approx(prior.error * np.sqrt(1 - stay ** (2 * late)), abs=1e-9)


def test_the_target_of_partial_trades_is_decoded(monkeypatch: pytest.MonkeyPatch) -> None:
    chain, n_draws = uneven_chain(4), 3000 if audited() else 1000
    monkeypatch.setattr(memory_rules, "PAST", 3)
    monkeypatch.setattr(memory_rules, "_LEAST_DRAWS", n_draws * len(chain.prior))
    setting = setting_of(chain)
    beliefs, problem = chain.prior.beliefs, setting.problem
    play = partly(setting, 1e-5)
    assert play is not None
    assert play.memory is not None
    fraction = play.memory.fraction
    regret = squared = 0.0
    for path, chance in every_path(chain, 4):
        action = PartialDecisionMaker(problem, fraction).decide_many(beliefs[path]).action[-1]
        found = float(problem.regret(beliefs[path[-1]], action))
        regret += chance * found
        squared += chance * found**2
    error = np.sqrt((squared - regret**2) / n_draws)
    spent = float(chain.prior.weights @ play.mechanism.expected_regrets)
    assert abs(spent - regret) <= 5 * error
    assert spent == pytest.approx(1e-5, rel=0.005)
    honest = leakage(mechanism(OriginalDecisionMaker(problem), beliefs), chain.prior)
    for n in (1, 10):
        told = leakage(play.memory(n), chain.prior)
        assert told.bayes_error == pytest.approx(honest.bayes_error, abs=1e-12)
        assert told.mutual_information == pytest.approx(honest.mutual_information, abs=1e-12)


def test_a_comparison_with_a_chain_holds_rules_with_a_memory() -> None:
    stay, prior = 0.8, uniform_prior(3, 4)
    chain, problem = resting_chain(prior, stay), market()
    makers = makers_of(("ODM", "delay", "partial trades"))
    settings = ComparisonSettings(budgets=(0.5,), repeats=(1, 2, 10), draws=20)
    found = compare(problem, chain, settings, makers=makers, rng=np.random.default_rng(0))
    (honest,) = found.of("ODM")
    for row in found.of("partial trades"):
        assert row.expected_regret == pytest.approx(row.budget, rel=0.1)
        np.testing.assert_allclose(row.repeated_errors, honest.bayes_error, atol=1e-12)
        assert row.naive_error > 0.1 * prior.error
    for row in found.of("delay"):
        assert row.expected_regret <= row.budget
        assert row.repeated_errors[0] == row.bayes_error
        assert row.repeated_errors[-1] == pytest.approx(honest.bayes_error, abs=1e-12)
        assert row.naive_error >= row.bayes_error - 1e-12
        assert row.strength >= 0
    assert any(name.startswith("delay (") for name in short_table(found).index)


def test_without_a_chain_they_are_no_part_of_it() -> None:
    setting = setting_of(resting_chain(uniform_prior(3, 3), 0.5))
    alone = Setting(setting.problem, setting.prior, setting.candidates)
    assert delayed(alone, 0.1) is None
    assert partly(alone, 0.1) is None
    assert {"delay", "partial trades"} < set(COMPARED)


def test_choices_are_delayed_but_not_partly_made() -> None:
    problem, chain = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), resting_chain(uniform_prior(2, 3), 0.9)
    settings, makers = ComparisonSettings(budgets=(1.0,), repeats=(1,)), makers_of(("ODM", "delay", "partial trades"))
    found = compare(problem, chain, settings, makers=makers, rng=np.random.default_rng(0))
    assert "delay" in found.makers
    assert "partial trades" in found.left_out


def test_nothing_to_spend_and_nothing_to_hide() -> None:
    setting = setting_of(resting_chain(uniform_prior(3, 3), 0.5))
    for make in makers_of(("delay", "partial trades")).values():
        play = make(setting, 0.0)
        assert play is not None
        assert float(play.mechanism.expected_regrets.max()) == pytest.approx(0.0, abs=1e-12)
    one = setting_of(resting_chain(Prior([[0.2, 0.3, 0.5]], [1.0]), 0.5))
    for make in makers_of(("delay", "partial trades")).values():
        play = make(one, 0.01)
        assert play is not None
        assert float(play.mechanism.expected_regrets.max()) == pytest.approx(0.0, abs=1e-12)


def test_markets_say_how_the_belief_moves() -> None:
    found = market_of("paper", 4, 0)
    assert found.prior is found.chain.prior
    np.testing.assert_allclose(found.chain.transition.diagonal(), 0.8 + 0.2 / len(found.prior))
