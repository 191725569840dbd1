"""The sequential rule under a limit on turnover: what it may play, what it plays best, and what its observer holds."""

from __future__ import annotations

from contextlib import closing

import numpy as np
import pytest

import inscrutable as ins
from inscrutable.mechanisms.chains import resting_chain
from sizes import instances

MOST, SIZE, PRICE = 0.5, 4, 30.0


def ruled(rng, information=np.inf, **more):
    """A rule on seven beliefs that rest with probability 0.6, at given prices unless a budget is to be met."""
    factors = rng.normal(size=(3, SIZE, SIZE)) / SIZE
    covariances = factors @ factors.transpose(0, 2, 1) + 0.02 * np.eye(SIZE)
    problem = ins.MarkowitzProblem(0.3 * rng.normal(size=(3, SIZE)), covariances, 1.0)
    prior = ins.Prior(rng.dirichlet(np.ones(3), 7), rng.dirichlet(np.ones(7)))
    known = {"calibration": ins.PriceCalibration.at(PRICE if np.isinf(information) else 5.0, information)} | more
    chain, candidates = resting_chain(prior, 0.6), ins.decoy_grid(problem, 6)
    return ins.SequentialDecisionMaker(
        problem, known.pop("budget", ins.Budget.regret(0.01)), chain=chain, candidates=candidates, rng=rng, **known
    )


def without_rival(law, regrets):
    """The most of −s E ρ − I, by the fixed points of Blahut and Arimoto."""
    weights = np.exp(-PRICE * regrets)
    shares = np.full(regrets.shape[1], 1.0 / regrets.shape[1])
    for _ in range(100_000):
        shares = shares * ((law / (weights @ shares)) @ weights)
    return float(law @ np.log(weights @ shares))


def value(law, rows, regrets):
    played = law @ rows
    ratios = np.log(np.divide(rows, played, out=np.ones_like(rows), where=rows > 0))
    return float(-PRICE * (law[:, None] * rows * regrets).sum() - (law[:, None] * rows * ratios).sum())


@pytest.mark.parametrize("information", [np.inf, 0.05])
def test_steps_are_best_within_reach_and_the_observer_follows_them(information, fresh_rng):
    """Two steps, all paths enumerated: masked, best for the rest where information alone counts, the filter exact to 1e-12."""
    maker = ruled(fresh_rng, information, turnover=MOST)
    points, prior, moves = maker.table.columns.points, maker.chain.prior, maker.chain.transition.toarray()
    regrets = (maker.problem.state_costs(points) @ prior.beliefs.T).T - maker.problem.optimal_cost(prior.beliefs)[
        :, None
    ]
    first = maker.mechanism_for(prior).probabilities.toarray()
    for one in np.flatnonzero(prior.weights @ first > 1e-9):
        law = (prior.weights * first[:, one]) @ moves / (prior.weights @ first[:, one])
        rows = maker.mechanism_for(ins.Prior(prior.beliefs, law), points[one]).probabilities.toarray()
        near = np.abs(points - points[one]).sum(axis=1) <= MOST + 1e-9
        assert not rows[:, ~near].any()
        if np.isinf(information):
            assert value(law, rows, regrets) == pytest.approx(without_rival(law, regrets[:, near]), abs=1e-6)
        for two in np.flatnonzero(law @ rows > 1e-9):
            sequence = maker.begin()
            sequence.publish(points[one])
            sequence.publish(points[two])
            paths = np.einsum("a,a,ab,b->b", prior.weights, first[:, one], moves, rows[:, two])
            np.testing.assert_allclose(sequence.observer.weights, paths / paths.sum(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("share", [0.2, 0.03])
def test_before_a_rival_with_a_portfolio_steps_are_best_within_reach(share, fresh_rng):
    """No decision farther than the limit is played, and the step is worth what it is where no others are candidates."""
    first, other = ruled(fresh_rng), ruled(fresh_rng).problem
    problem, chain, prior = first.problem, first.chain, first.chain.prior
    unit, silence = (
        float(each.optimal_cost(prior.mean) - prior.weights @ each.optimal_cost(prior.beliefs))
        for each in (other, problem)
    )

    def maker(points, turnover=None):
        prices = ins.PriceCalibration.at(unit / silence, share * unit)
        return ins.SequentialDecisionMaker(
            problem,
            ins.Budget.regret(100.0),  # met by any decision, so that none are added to the candidates
            chain=chain,
            candidates=points,
            loss=ins.RivalProblem(other),
            calibration=prices,
            turnover=turnover,
            rng=fresh_rng,
        )

    def value(law, found):
        rows = found.probabilities.toarray()
        joint, played = law[:, None] * rows, law @ rows
        means = (joint.T @ prior.beliefs)[played > 0] / played[played > 0, None]
        nats = (joint * np.log(np.divide(rows, played, out=np.ones_like(rows), where=joint > 0))).sum()
        lost = played[played > 0] @ other.optimal_cost(means)
        return float(lost - unit / silence * (joint * found.regrets).sum() - share * unit * nats)

    limited = maker(ins.decoy_grid(problem, 6), MOST)
    points = limited.table.columns.points
    for one in fresh_rng.choice(len(points), instances(3, least=1), replace=False):
        near = np.abs(points - points[one]).sum(axis=1) <= MOST + 1e-9
        law = fresh_rng.dirichlet(np.ones(7))
        found = limited.mechanism_for(ins.Prior(prior.beliefs, law), points[one])
        assert not found.probabilities.toarray()[:, ~near].any()
        best = maker(points[near]).mechanism_for(ins.Prior(prior.beliefs, law))
        assert value(law, found) == pytest.approx(value(law, best), abs=2e-5 * unit)


def test_the_budget_is_kept_along_paths(fresh_rng):
    maker = ruled(np.random.default_rng(3), calibration=None, turnover=MOST, information_price=float("inf"))
    beliefs = maker.beliefs
    moves = maker.chain.transition.toarray()
    path = [0]
    for _ in range(200):
        path.append(int(fresh_rng.choice(len(beliefs), p=moves[path[-1]])))
    found = maker.decide_path(beliefs[path], rng=fresh_rng)
    assert np.abs(np.diff(found.actions, axis=0)).sum(axis=1).max() <= MOST + 1e-9
    assert maker.calibration.regret <= 1.02 * maker.limit
    spread = found.own_regrets.std() / np.sqrt(len(path) / 10)
    assert found.own_regrets.mean() <= maker.limit + 4 * spread
    assert found.losses[20:].mean() <= maker.ceiling * 1.05  # a bound on the mean of all rules, in the long run


def test_a_limit_on_turnover_is_kept_in_the_file_and_refused_where_it_means_nothing(tmp_path):
    def rng():
        return np.random.default_rng(3)

    with closing(ruled(rng(), turnover=MOST).begin()) as sequence:
        sequence.publish(sequence.decide(sequence.beliefs[0]).actions[0])
        sequence.save(tmp_path / "state")
        law, mechanism = sequence.observer.weights, sequence.mechanism.probabilities.toarray()
    with closing(ruled(rng(), turnover=MOST).begin().load(tmp_path / "state")) as again:
        np.testing.assert_array_equal(again.observer.weights, law)
        np.testing.assert_array_equal(again.mechanism.probabilities.toarray(), mechanism)
    with pytest.raises(ins.InputError, match="another limit on turnover"):
        ruled(rng(), turnover=0.4).begin().load(tmp_path / "state")
    with pytest.raises(ins.SolverError, match=r"within a turnover of 0\.01 of the last one costs"):
        _ = ruled(rng(), calibration=None, budget=ins.Budget.regret(0.001), turnover=0.01).calibration
    for more in ({"disclosure": "every(2)"}, {"worst_regret": 0.1}):
        with pytest.raises(ins.InputError, match="leave out worst_regret and disclosure"):
            ruled(rng(), turnover=MOST, **more)
    with pytest.raises(ins.InputError, match="turnover must be at least 0"):
        ruled(rng(), turnover=-1.0)
    chain = resting_chain(ins.Prior(np.eye(2), [0.5, 0.5]), 0.8)
    with pytest.raises(ins.InputError, match="finite choices"):
        ins.SequentialDecisionMaker(ins.FiniteProblem(np.eye(2)), 0.1, chain=chain, turnover=0.5, rng=rng())
