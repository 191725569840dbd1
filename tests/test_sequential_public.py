"""The sequential rule where everybody reads something before every decision."""

from __future__ import annotations

import os
from itertools import product
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from inscrutable import (
    Budget,
    CategoricalEmission,
    FiniteProblem,
    GaussianEmission,
    HiddenMarkovModel,
    InputError,
    Mechanism,
    NamingError,
    PriceCalibration,
    Prior,
    PublicPart,
    SequentialAdversary,
    SequentialDecisionMaker,
    delayed,
    every,
    filter_beliefs,
    path_leakage,
    uniform_prior,
)
from inscrutable.mechanisms.chains import BeliefChain, filtered_chain
from sizes import instances, paired, some
from small_runs import draft_simulations

SEED = int(os.environ.get("FRESH_SEED", "0"))
GUESS = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
PRICES = PriceCalibration.at(np.log(3.0), float("inf"))


def chain_of(reading: np.ndarray, flip: float = 0.1) -> BeliefChain:
    """Certainty of one of two states; a symbol is read that depends on the new state, (2,Z)."""
    moves = np.array([[1 - flip, flip], [flip, 1 - flip]])
    return BeliefChain(Prior(np.eye(2), [0.5, 0.5]), moves, [moves * column for column in reading.T])


READING = np.array([[0.7, 0.2, 0.1], [0.3, 0.2, 0.5]])


def maker_of(chain: BeliefChain, **options: object) -> SequentialDecisionMaker:
    rng = np.random.default_rng([SEED, 2])
    return SequentialDecisionMaker(GUESS, Budget.regret(0.25), chain=chain, rng=rng, **options)


def test_the_observers_law_is_bayes_rule_with_both() -> None:
    rng = np.random.default_rng([SEED, 1])
    chain = chain_of(READING)
    maker = maker_of(chain, calibration=PRICES)
    sequence, law = maker.begin(), np.array([0.5, 0.5])
    places, read = (each[:, 0] for each in chain.public_paths(12, 1, rng=rng))
    actions = []
    for t, (place, z) in enumerate(zip(places, read, strict=True)):
        with pytest.raises(InputError, match="observe"):
            sequence.decide(np.eye(2)[place])
        sequence.observe(int(z))
        law = law @ chain.transition.toarray() * READING[:, z]
        law /= law.sum()
        assert np.abs(sequence.observer.weights - law).max() < 1e-12
        rows = maker.mechanism_for(Prior(np.eye(2), law), actions[-1] if actions else None).probabilities.toarray()
        lottery = sequence.decide(np.eye(2)[place])
        action = int(lottery.actions[rng.choice(len(lottery.probabilities), p=lottery.probabilities)])
        sequence.publish(action)
        law = law * rows[:, action]
        law /= law.sum()
        assert np.abs(sequence.observer.weights - law).max() < 1e-9
        actions.append(action)
        assert t + 1 == sequence.n_published
    found = SequentialAdversary(chain, maker).filter(actions, public=read)
    assert np.abs(found.weights[-1] - sequence.observer.weights).max() < 1e-9
    # Who does not know of the symbols holds something else.
    blind = SequentialAdversary(BeliefChain(chain.prior, chain.transition), maker).filter(actions)
    assert np.abs(blind.weights - found.weights).max() > 1e-3


def test_symbols_that_say_nothing_change_nothing() -> None:
    plain = maker_of(BeliefChain(Prior(np.eye(2), [0.5, 0.5]), chain_of(READING).transition), calibration=PRICES)
    silent = maker_of(chain_of(np.full((2, 2), 0.5)), calibration=PRICES)
    beliefs, rng = np.eye(2)[[0, 0, 1, 1, 0]], np.random.default_rng
    one = plain.decide_path(beliefs, rng=rng(5))
    other = silent.decide_path(beliefs, public=[0, 1, 1, 0, 1], rng=rng(5))
    for name in ("actions", "regrets", "losses", "bits", "observer_means"):
        assert np.abs(getattr(one, name) - getattr(other, name)).max() < 1e-12


def assert_a_path_has_its_figures(maker: SequentialDecisionMaker, chain: BeliefChain, rng: np.random.Generator) -> None:
    """Of 600 steps: the regret of the calibration, and a loss below the ceiling."""
    prices = maker.calibration
    places, read = (each[:, 0] for each in chain.public_paths(600, 1, rng=rng))
    path = maker.decide_path(np.eye(2)[places], public=read, rng=rng)
    assert path.expected_regrets.mean() == pytest.approx(prices.regret, abs=6 * prices.regret_se + 0.03)
    assert path.losses.mean() <= maker.ceiling + 0.05


def test_the_calibration_meets_the_budget() -> None:
    rng = np.random.default_rng([SEED, 4])
    chain = chain_of(np.array([[0.6, 0.4], [0.4, 0.6]]))
    maker = maker_of(chain, information_price=float("inf"))
    with draft_simulations():
        prices = maker.calibration
    assert prices.regret == pytest.approx(0.25, abs=0.01)
    assert_a_path_has_its_figures(maker, chain, rng)


def test_a_world_with_public_symbols_makes_such_a_chain_and_paths_tell_less_beyond_them() -> None:
    rng = np.random.default_rng([SEED, 6])
    law, sensor = [[0.9, 0.1], [0.2, 0.8]], GaussianEmission([[0.0], [1.5]], [[[1.0]], [[1.0]]])
    public = CategoricalEmission([[0.8, 0.2], [0.3, 0.7]])
    world = HiddenMarkovModel(law, sensor, public=public)
    chain = filtered_chain(world, 8, rng=rng, n_steps=40_000)
    assert chain.n_public == 2
    share = np.array([chain.prior.weights @ each.sum(axis=1) for each in chain.public])
    assert np.abs(share - world.initial @ public.probabilities).max() < 0.02
    maker = maker_of(chain, calibration=PRICES)
    told = path_leakage(chain, maker, 4, rng=rng, n_draws=200)
    assert told.n_draws == 0  # exact: of 20 sampled paths the error may be larger with decisions than without
    assert (told.bayes_error <= told.prior_error + 1e-9).all()
    assert told.prior_error[-1] < chain.prior.error
    # A real number is cut; its symbols have the shares of its quantiles.
    real = HiddenMarkovModel(law, sensor, public=GaussianEmission([[0.0], [1.0]], [[[1.0]], [[2.0]]]))
    cut = filtered_chain(real, 8, rng=rng, n_steps=40_000, cuts=[-0.5, 0.5, 1.5])
    drawn = real.sample(40_000, rng=rng).public[:, 0]
    share = np.array([cut.prior.weights @ each.sum(axis=1) for each in cut.public])
    assert np.abs(share - np.bincount(np.searchsorted([-0.5, 0.5, 1.5], drawn)) / len(drawn)).max() < 0.02


def moving(rng: np.random.Generator, n_public: int = 2) -> BeliefChain:
    """Six beliefs that move as they like, with symbols that depend on the new one."""
    beliefs = uniform_prior(3, 2).beliefs
    moves = 0.6 * np.eye(len(beliefs)) + 0.4 * rng.dirichlet(np.ones(len(beliefs)), len(beliefs))
    reading = rng.dirichlet(np.ones(n_public), len(beliefs))
    law = np.linalg.matrix_power(moves, 400)[0]
    return BeliefChain(Prior(beliefs, law), moves, [moves * column for column in reading.T])


def rule_on(chain: BeliefChain, disclosure: object, loss: object, prices: PriceCalibration) -> SequentialDecisionMaker:
    options = {"disclosure": disclosure, "loss": loss, "calibration": prices}
    rng = np.random.default_rng([SEED, 9])
    return SequentialDecisionMaker(FiniteProblem(1.0 - np.eye(3)), Budget.regret(0.2), chain=chain, rng=rng, **options)


@pytest.mark.parametrize(
    ("disclosure", "steps"), [(delayed(1), [1]), (delayed(2), [2]), (every(2) | delayed(1), [1, 2])]
)
def test_a_late_step_is_the_best_against_one_who_reads_meanwhile(disclosure: object, steps: list[int]) -> None:
    rng = np.random.default_rng([SEED, 8])
    chain, price, told = moving(rng), 0.5, 0.05
    maker = rule_on(chain, disclosure, NamingError(), PriceCalibration.at(price, told))
    regrets = maker.table.regrets
    law = rng.dirichlet(np.ones(len(chain.prior)))
    beliefs, tables = chain.prior.beliefs, [each.toarray() for each in chain.public]
    ahead = []  # what each sequence of symbols makes of the belief, times its probability
    for step in steps:
        for said in product(range(2), repeat=step):
            moved = beliefs
            for z in reversed(said):
                moved = tables[z] @ moved
            ahead.append(moved)

    def value(joint: object, minimum: object, nats: object, total: object) -> object:
        named = sum(minimum(moved.T @ joint[:, m]) for moved in ahead for m in range(3))
        return 1.0 - named / len(steps) - price * total(joint, regrets) - told * nats

    held = np.asarray(maker.mechanism_for(Prior(beliefs, law)).probabilities.toarray())
    joint = law[:, None] * held
    ratios = np.divide(held, joint.sum(axis=0), out=np.ones_like(held), where=joint > 0)
    nats = float((joint * np.log(ratios)).sum())
    mine = value(joint, np.max, nats, lambda one, other: float((one * other).sum()))
    rows = cp.Variable(held.shape, nonneg=True)
    shared = cp.multiply(law[:, None], rows)
    played = cp.sum(shared, axis=0)
    told_nats = cp.sum(cp.rel_entr(shared, cp.multiply(law[:, None], cp.vstack([played] * len(law)))))
    best = cp.Problem(
        cp.Maximize(value(shared, cp.max, told_nats, lambda one, other: cp.sum(cp.multiply(one, other)))),
        [cp.sum(rows, axis=1) == 1],
    ).solve(solver=cp.CLARABEL)
    assert mine == pytest.approx(best, abs=2e-5)
    assert maker.table.stakes.loss_of(law) == pytest.approx(
        1.0 - sum(float(np.max(law @ moved)) for moved in ahead) / len(steps), abs=1e-12
    )


@pytest.mark.parametrize(
    ("disclosure", "loss"), paired([delayed(1), every(2) | delayed(1)], [None, NamingError()]), ids=str
)
def test_what_a_late_observer_holds_is_what_the_adversary_finds(disclosure: object, loss: object) -> None:
    rng = np.random.default_rng([SEED, 10])
    chain = moving(rng)
    maker = rule_on(chain, disclosure, loss, PriceCalibration.at(1.0, 0.1))
    places, read = (each[:, 0] for each in chain.public_paths(9, 1, rng=rng))
    path = maker.decide_path(chain.prior.beliefs[places], public=read, rng=rng)
    shown = np.full(9, np.nan)
    for s in range(9):
        if disclosure.schedule.shows(s) and s + 1 < 9:
            shown[s + 1] = path.actions[s]
    held = SequentialAdversary(chain, maker, disclosure=disclosure).filter(shown, public=read)
    assert np.abs(held.mean - path.observer_means).max() < 1e-9
    assert path.observer_means[0] == pytest.approx(chain.prior.weights @ chain.public[read[0]] @ chain.prior.beliefs / (
        chain.prior.weights @ chain.public[read[0]].sum(axis=1)
    ))  # fmt: skip
    # Over all paths: a rule that is seen late tells no more than at once, and less than all is hidden.
    found = path_leakage(chain, maker, 4, rng=rng, n_draws=200, disclosure=disclosure, loss=loss)
    assert (found.bayes_error <= found.prior_error + 1e-9).all()
    assert found.bayes_error[0] == pytest.approx(found.prior_error[0])
    assert found.added[0] == 0.0 < found.added[1]


def test_a_late_rule_is_calibrated_with_what_is_read() -> None:
    rng = np.random.default_rng([SEED, 11])
    chain = chain_of(np.array([[0.6, 0.4], [0.4, 0.6]]))
    options = {"information_price": float("inf"), "disclosure": every(2) | delayed(1)}
    maker = SequentialDecisionMaker(GUESS, Budget.regret(0.1), chain=chain, rng=rng, **options)
    with draft_simulations():
        prices = maker.calibration
    assert prices.regret == pytest.approx(0.1, abs=0.005)
    assert_a_path_has_its_figures(maker, chain, rng)


@pytest.mark.parametrize(
    ("disclosure", "budget"), [(None, 0.7), (delayed(1), 0.7), (delayed(1), 0.1), (every(2) | delayed(1), 0.1)]
)
def test_the_calibrated_loss_is_that_of_an_observer_who_reads(disclosure: object, budget: float) -> None:
    """Against paths, also where the budget affords silence; without the symbols the loss is .05 to .2 more."""
    rng = np.random.default_rng([SEED, 14])
    chain = chain_of(np.array([[0.75, 0.25], [0.25, 0.75]]))
    options = {"information_price": float("inf"), "disclosure": disclosure}
    maker = SequentialDecisionMaker(GUESS, Budget.regret(budget), chain=chain, rng=rng, **options)
    prices = maker.calibration
    losses, regrets = [], []
    for _ in range(8):
        places, read = (each[:, 0] for each in chain.public_paths(200, 1, rng=rng))
        path = maker.decide_path(np.eye(2)[places], public=read, rng=rng)
        losses.append(path.losses[20:].mean())
        regrets.append(path.expected_regrets[20:].mean())
    for stated, error, paths in ((prices.loss, prices.loss_se, losses), (prices.regret, prices.regret_se, regrets)):
        assert stated == pytest.approx(np.mean(paths), abs=4.0 * np.hypot(error, np.std(paths) / 8**0.5))


@pytest.mark.parametrize("kind", some(["sensor", "part"], 2))
def test_real_numbers_are_read_as_cells_with_the_error_that_is_stated(kind: str) -> None:
    rng = np.random.default_rng([SEED, 12])
    sensor = GaussianEmission([[0.0, 0.0], [1.0, 2.0]], [np.eye(2), np.eye(2)])
    public = PublicPart([[0.5, 0.5]]) if kind == "part" else GaussianEmission([[0.0], [1.0]], np.full((2, 1, 1), 2.0))
    world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], sensor, public=public)
    chain = filtered_chain(world, 40, rng=rng, n_steps=20_000)
    assert chain.n_public == len(chain.cells) == 24
    assert sum(chain.public).toarray() == pytest.approx(chain.transition.toarray(), abs=1e-14)
    # One who sees no decision: the numbers by particles, the cells by the chain, on one path.
    path = world.sample(300, rng=rng)
    held = filter_beliefs(world, path.observations, public=path.public).beliefs
    played = Mechanism(
        chain.prior.beliefs, [0, 1], np.full((len(chain.prior), 2), 0.5), np.zeros((len(chain.prior), 2))
    )
    numbers = SequentialAdversary(world, played, n_particles=100, rng=rng).unseen(300, public=path.public).mean
    cells = SequentialAdversary(chain, played).unseen(300, public=chain.cells.symbols(path.public)).mean
    apart = ((held - cells) ** 2).sum(axis=1) - ((held - numbers) ** 2).sum(axis=1)
    error = np.std([each.mean() for each in np.array_split(apart, 20)], ddof=1) / np.sqrt(20)
    stated = chain.cells.symbols_error**2 - chain.cells.numbers_error**2
    spread = 2.0 * chain.cells.numbers_error * chain.cells.error_se
    assert abs(apart.mean() - stated) < 4.0 * (error + spread)
    assert stated < 0.05 * chain.cells.numbers_error**2 + 4.0 * spread
    # Few cells lose more.
    few = [filtered_chain(world, 40, rng=rng, n_steps=20_000, cuts=2).cells for _ in range(instances(4, least=2))]
    lost = np.mean([each.symbols_error - each.numbers_error for each in few])
    assert lost > np.mean([each.error_se for each in few])  # twice the standard error of the four; some .02, se .002
    # What each decision tells beside them: cells against numbers, by particles.
    told = np.clip(chain.prior.beliefs @ [[0.8, 0.2], [0.2, 0.8]], 0.0, 1.0)
    noisy = Mechanism(chain.prior.beliefs, [0, 1], told, np.zeros_like(told))
    found = path_leakage(chain, noisy, 4, rng=rng, n_draws=100)
    assert "discretised to cells" in found.summary()
    assert found.cells_error == pytest.approx(chain.cells.symbols_error - chain.cells.numbers_error)
    errors, count = [], instances(400, least=80)
    for _ in range(count):  # rare large errors
        path = world.sample(4, rng=rng)
        held = filter_beliefs(world, path.observations, public=path.public).beliefs
        actions = (rng.random(4) < held @ [0.2, 0.8]).astype(int)
        seen = SequentialAdversary(world, noisy, n_particles=50, rng=rng).filter(actions, public=path.public)
        errors.append(((held[-1] - seen.mean[-1]) ** 2).sum())
    squared, spread = float(np.mean(errors)), float(np.std(errors) / np.sqrt(count))
    both = 4.0 * (spread + 2.0 * found.bayes_error[-1] * found.error_se[-1]) + 0.03 * squared
    assert abs(found.bayes_error[-1] ** 2 - squared) < both


def test_the_rule_reads_numbers_and_says_what_it_loses_by_cells() -> None:
    rng = np.random.default_rng([SEED, 13])
    sensor = GaussianEmission([[0.0], [1.5]], np.ones((2, 1, 1)))
    world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], sensor, public=PublicPart([[1.0]]))
    chain = filtered_chain(world, 20, rng=rng, n_steps=20_000)
    maker = maker_of(chain, calibration=PRICES)
    path = world.sample(6, rng=rng)
    held = chain.prior.beliefs[cKDTree(chain.prior.beliefs).query(filter_beliefs(world, path.observations).beliefs)[1]]
    one = maker.decide_path(held, public=path.public, rng=np.random.default_rng(1))
    other = maker.decide_path(held, public=chain.cells.symbols(path.public), rng=np.random.default_rng(1))
    assert np.array_equal(one.observer_means, other.observer_means)
    sequence = maker.begin()
    sequence.observe(path.public[0])
    assert sequence.observer.weights == pytest.approx(
        (chain.prior.weights @ chain.public[chain.cells.symbols(path.public)[0]])
        / (chain.prior.weights @ chain.public[chain.cells.symbols(path.public)[0]]).sum()
    )
    assert "24 cells: error without decisions" in maker.summary()
    # All is public: little is left but what cells and grid leave.
    assert chain.cells.numbers_error == pytest.approx(0.0, abs=1e-9)
    assert chain.cells.symbols_error < 0.1


def test_it_goes_to_disk_and_back(tmp_path: Path) -> None:
    chain = chain_of(READING)
    maker = maker_of(chain, calibration=PRICES)
    sequence = maker.begin()
    sequence.observe(2)
    sequence.publish(1)
    sequence.save(tmp_path / "sequence.npz")
    sequence.close()
    again = maker.begin().load(tmp_path / "sequence.npz")
    assert np.array_equal(again.observer.weights, sequence.observer.weights)
    again.observe(1)
    sequence.observe(1)
    assert np.array_equal(again.observer.weights, sequence.observer.weights)
    again.close()
    other = maker_of(chain_of(READING[:, ::-1]), calibration=PRICES)
    with pytest.raises(InputError, match="a chain that is another"):
        other.begin().load(tmp_path / "sequence.npz")


def test_what_does_not_fit_is_refused() -> None:
    chain, moves = chain_of(READING), np.full((2, 2), 0.5)
    prior, maker = Prior(np.eye(2), [0.5, 0.5]), maker_of(chain, calibration=PRICES)
    plain = maker_of(BeliefChain(prior, moves), calibration=PRICES)
    certain = maker_of(
        BeliefChain(prior, np.eye(2), [np.diag([1.0, 0.0]), np.diag([0.0, 1.0])]), calibration=PRICES
    ).begin()
    certain.observe(0)
    sensor, symbols = GaussianEmission([[0.0], [1.0]], np.ones((2, 1, 1))), CategoricalEmission(moves)
    real, nothing = HiddenMarkovModel(moves, sensor, public=sensor), HiddenMarkovModel(moves, symbols)
    both = GaussianEmission(np.eye(2), [np.eye(2), np.eye(2)])
    rng, pair = np.random.default_rng(0), HiddenMarkovModel(moves, sensor, public=both)
    refused = [
        ("whole number from 0 to 2", lambda: maker.begin().observe()),
        ("whole number from 0 to 2", lambda: maker.begin().observe(3)),
        ("has no public information", lambda: plain.begin().observe(1)),
        ("has no public information", lambda: plain.decide_path(np.eye(2), public=[0, 1], rng=rng)),
        ("expected one per belief", lambda: maker.decide_path(np.eye(2), public=[0], rng=rng)),
        ("whole number from", lambda: maker.decide_path(np.eye(2), rng=rng)),
        ("probability 0", lambda: certain.observe(1)),
        ("no MemoryMechanism", lambda: maker.as_mechanism()),
        ("cuts are for one number", lambda: filtered_chain(pair, 4, rng=rng, n_steps=100, cuts=[0.0])),
        ("at least 2", lambda: filtered_chain(real, 4, rng=rng, cuts=1)),
        ("one number a step", lambda: filtered_chain(real, 4, rng=rng, n_steps=100, cuts=[0.0]).cells.symbols([[0.0, 1.0]])),
        ("has missing rows", lambda: SequentialAdversary(chain, maker).filter([1, 1], public=[1, np.nan])),
        ("rising", lambda: filtered_chain(real, 4, rng=rng, cuts=[1.0, 0.0])),
        ("in which real numbers", lambda: filtered_chain(nothing, 4, rng=rng, cuts=[0.0])),
        ("sum to the transition", lambda: BeliefChain(prior, moves, [moves, moves])),
        ("no probability", lambda: BeliefChain(prior, moves, [2.0 * moves, -moves])),
        ("tables of shape", lambda: BeliefChain(prior, moves, [])),
    ]  # fmt: skip
    for said, ask in refused:
        with pytest.raises(InputError, match=said):
            ask()
