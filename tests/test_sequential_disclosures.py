"""The sequential rule under a disclosure: decisions that look alike, that come late, or that nobody sees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cvxpy as cp
import numpy as np
import pytest

from inscrutable import (
    Budget,
    FiniteProblem,
    MarkowitzProblem,
    PriceCalibration,
    Prior,
    SequentialAdversary,
    SequentialDecisionMaker,
    decoy_grid,
    delayed,
    every,
    grouped,
    path_leakage,
    portfolio_return,
    rounded,
    uniform_prior,
)
from inscrutable.decision_makers.sequential.state import SequenceState
from inscrutable.errors import InputError
from inscrutable.mechanisms.chains import BeliefChain, resting_chain
from inscrutable.mechanisms.disclosures import Disclosure
from small_runs import draft_simulations

ALONE = float("inf")


def maker_of(
    rng: np.random.Generator, disclosure: Disclosure | None, told: float = ALONE, **options: object
) -> SequentialDecisionMaker:
    roots = rng.normal(0.0, 0.5, (3, 3, 3))
    problem = MarkowitzProblem(rng.normal(0.0, 1.0, (3, 3)), roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(3), 1.0)
    chain = _chain(rng)
    candidates = decoy_grid(problem, 8)
    regrets = chain.prior.beliefs @ candidates.state_costs.T
    regrets -= np.asarray(problem.optimal_cost(chain.prior.beliefs))[:, None]
    silence = float((chain.prior.weights @ regrets).min())
    if silence < 1e-6:  # one decision suits every belief: nothing to hide
        return maker_of(rng, disclosure, told, **options)
    unit = 1.0 if np.isinf(told) else chain.prior.error**2
    prices = PriceCalibration.at(2.0 * unit / silence, told if np.isinf(told) else told * unit)
    options = {"calibration": prices, "candidates": candidates} | options
    return SequentialDecisionMaker(
        problem,
        Budget.regret(silence / 2),
        chain=chain,
        disclosure=disclosure,
        rng=rng,
        **options,
    )


def _chain(rng: np.random.Generator) -> BeliefChain:
    """Ten beliefs that move as they like, with their long-run law."""
    beliefs = uniform_prior(3, 3).beliefs
    transition = 0.7 * np.eye(len(beliefs)) + 0.3 * rng.dirichlet(np.ones(len(beliefs)), len(beliefs))
    return BeliefChain(Prior(beliefs, np.linalg.matrix_power(transition, 400)[0]), transition)


def optimum(maker: SequentialDecisionMaker, law: np.ndarray, steps: range, prices: tuple[float, float]) -> float:
    """The best of one step by a cone programme, where its decision is the latest known in so many steps ahead."""
    beliefs, problem, candidates = maker.beliefs, maker.problem, maker.table.columns.points
    regrets = problem.state_costs(candidates) @ beliefs.T - np.asarray(problem.optimal_cost(beliefs))
    table = cp.Variable((len(beliefs), len(candidates)), nonneg=True)
    joint = cp.multiply(law[:, None], table)
    played = cp.sum(joint, axis=0)
    loss, moved = 0.0, np.eye(len(beliefs))
    for step in range(steps.stop):
        if step in steps:
            ahead, squares = moved @ beliefs, moved @ (beliefs**2).sum(axis=1)
            loss += law @ squares / len(steps)
            loss -= sum(cp.quad_over_lin(ahead.T @ joint[:, m], played[m]) for m in range(len(candidates))) / len(steps)
        moved = moved @ maker.chain.transition.toarray()
    told = cp.sum(cp.rel_entr(joint, cp.multiply(law[:, None], cp.vstack([played] * len(beliefs)))))
    cost = cp.sum(cp.multiply(joint, regrets.T))
    size = maker.table.prior_loss  # the solver's tolerances are absolute
    aim = cp.Maximize((loss - prices[0] * cost - prices[1] * told) / size)
    return size * float(cp.Problem(aim, [cp.sum(table, axis=1) == 1]).solve(solver=cp.CLARABEL))


@pytest.mark.parametrize(("disclosure", "steps"), [(delayed(2), range(2, 3)), (every(3) | delayed(1), range(1, 4))])
def test_a_step_is_the_best_for_when_it_is_seen(
    fresh_rng: np.random.Generator, disclosure: Disclosure, steps: range
) -> None:
    maker = maker_of(fresh_rng, disclosure, 0.3, candidates=fresh_rng.dirichlet(np.ones(3), 6))
    law = fresh_rng.dirichlet(np.ones(len(maker.beliefs)))
    table = maker.mechanism_for(Prior(maker.beliefs, law))
    price, told = maker.calibration.prices(0)
    held = np.asarray(table.probabilities.toarray())
    joint = law[:, None] * held
    played = joint.sum(axis=0)
    some = joint > 0
    nats = float((joint * np.log(np.divide(held, played, out=np.ones_like(held), where=some)))[some].sum())
    loss, moved = 0.0, np.eye(len(law))
    for step in range(steps.stop):
        if step in steps:
            means = (joint.T @ moved @ maker.beliefs) / np.where(played > 0, played, 1.0)[:, None]
            loss += (law @ moved @ (maker.beliefs**2).sum(axis=1) - played @ (means**2).sum(axis=1)) / len(steps)
        moved = moved @ maker.chain.transition.toarray()
    value = loss - price * float((joint * table.regrets).sum()) - told * nats
    best = optimum(maker, law, steps, (price, told))
    assert value == pytest.approx(best, abs=2e-6 * maker.table.prior_loss + 1e-7)
    immediate = maker_of(np.random.default_rng(0), None).table
    assert immediate.stakes.spare.max() == 0.0 < maker.table.stakes.spare.max()


def test_what_hides_nothing_changes_nothing(fresh_seed: int) -> None:
    plain, shown = (maker_of(np.random.default_rng(fresh_seed), each, 0.3) for each in (None, delayed(0) | every(1)))
    law = Prior(plain.beliefs, np.random.default_rng(fresh_seed).dirichlet(np.ones(len(plain.beliefs))))
    assert (plain.mechanism_for(law).probabilities != shown.mechanism_for(law).probabilities).nnz == 0
    path = plain.beliefs[[0, 3, 3, 9, 1]]
    one, other = (each.decide_path(path, rng=np.random.default_rng(1)) for each in (plain, shown))
    for name in ("regrets", "losses", "bits", "observer_means"):
        assert (getattr(one, name) == getattr(other, name)).all(), name
    assert plain.ceiling == shown.ceiling


@pytest.mark.parametrize(
    "disclosure", [every(3, 1), every(2) | delayed(3), rounded(1), grouped(["a", "a", "b"]) | every(2)]
)
def test_the_observer_holds_what_the_decisions_shown_tell(
    fresh_rng: np.random.Generator, disclosure: Disclosure
) -> None:
    maker = maker_of(fresh_rng, disclosure)
    chain, schedule = maker.chain, disclosure.schedule
    transition = chain.transition.toarray()
    places = chain.paths(14, 1, rng=fresh_rng)[:, 0]
    drawn = maker.decide_path(maker.beliefs[places], rng=np.random.default_rng(1))
    sequence, law, laws = maker.begin(), np.array(chain.prior.weights), []
    own = np.asarray(maker.problem.solve_points(maker.beliefs))
    for t, action in enumerate(drawn.actions):
        assert sequence.is_shown == schedule.shows(t)
        lottery = sequence.decide(maker.beliefs[places[t]])
        if schedule.shows(t):
            table = sequence.mechanism_for(Prior(maker.beliefs, law), None)
            seen = np.abs(disclosure.shown(table.actions) - disclosure.shown(action[None])).max(axis=1) < 1e-9
            shares = table.probabilities.toarray()[:, seen].sum(axis=1)
            law = law * shares / (law @ shares)
        else:
            assert np.abs(lottery.actions[0] - own[places[t]]).max() < 1e-9
            assert lottery.expected_regret == pytest.approx(0.0, abs=1e-12)
            known = sequence.mechanism
            played = known.probabilities.toarray()[places[t]].argmax()
            assert np.abs(known.actions[played] - own[places[t]]).max() < 1e-9
            assert known.expected_regrets.max() == pytest.approx(0.0, abs=1e-12)
        sequence.publish(action)
        assert np.abs(sequence.observer.weights - law).max() < 1e-6
        laws.append(law)
        late = np.array(chain.prior.weights) if t < schedule.lag else laws[t - schedule.lag]
        present = late @ np.linalg.matrix_power(transition, schedule.lag)
        assert np.abs(present @ maker.beliefs - drawn.observer_means[t]).max() < 1e-6
        squares = present @ ((maker.beliefs - present @ maker.beliefs) ** 2).sum(axis=1)
        assert drawn.losses[t] == pytest.approx(squares, abs=1e-6)
        law = law @ transition
    assert drawn.status is maker.calibration.status


@pytest.mark.parametrize("disclosure", [None, every(3, 1), every(2) | delayed(3), rounded(1), rounded(1) | delayed(1)])
def test_an_adversary_who_knows_the_rule_holds_the_same(
    fresh_rng: np.random.Generator, disclosure: Disclosure | None
) -> None:
    maker, shown = maker_of(fresh_rng, disclosure), Disclosure.of(disclosure)
    places = maker.chain.paths(12, 1, rng=fresh_rng)[:, 0]
    drawn = maker.decide_path(maker.beliefs[places], rng=np.random.default_rng(1))
    adversary = SequentialAdversary(maker.chain, maker, disclosure=disclosure)
    found = adversary.filter(shown(drawn.actions))
    assert np.abs(found.mean - drawn.observer_means).max() < 1e-6
    with pytest.raises(InputError, match="was made for"):
        SequentialAdversary(maker.chain, maker, disclosure=shown | every(5))


def test_the_calibrated_loss_is_what_paths_lose(fresh_rng: np.random.Generator) -> None:
    disclosure = every(2) | delayed(1)
    maker = maker_of(fresh_rng, disclosure, calibration=None, information_price=ALONE)
    found = path_leakage(maker.chain, maker, 40, rng=fresh_rng, n_draws=20, disclosure=disclosure)
    late = (found.bayes_error[10:] ** 2).mean()
    assert late == pytest.approx(maker.calibration.loss, abs=0.15 * maker.table.prior_loss)
    assert (found.added[::2] == 0.0).all()


def test_of_decisions_that_look_alike_the_cheapest_is_played(fresh_rng: np.random.Generator) -> None:
    maker = maker_of(fresh_rng, rounded(1))
    table = maker.mechanism_for(maker.chain.prior)
    shown = np.round(table.actions, 1)
    held = table.probabilities.toarray()
    for belief, decision in zip(*np.nonzero(held), strict=True):
        alike = np.abs(shown - shown[decision]).max(axis=1) < 1e-9
        assert table.regrets[belief, decision] == table.regrets[belief, alike].min()
    assert (np.array([len(np.unique(shown[row > 0], axis=0)) for row in held]) == (held > 0).sum(axis=1)).all()


def test_a_saved_schedule_goes_on_where_it_stood(fresh_rng: np.random.Generator, tmp_path: Path) -> None:
    maker = maker_of(fresh_rng, every(3))
    sequence, path = maker.begin(), tmp_path / "state.npz"
    for t in range(5):
        lottery = sequence.decide(maker.beliefs[t])
        sequence.publish(lottery.actions[0])
    sequence.save(path)
    sequence.close()
    other = maker.begin().load(path)
    for t in range(5, 9):
        assert other.is_shown == sequence.is_shown == (t % 3 == 0)
        one, two = (each.decide(maker.beliefs[t]) for each in (sequence, other))
        assert (one.actions == two.actions).all()
        assert (one.probabilities == two.probabilities).all()
        for each in (sequence, other):
            each.publish(one.actions[0])
    other.close()
    plain = SequentialDecisionMaker(
        maker.problem,
        maker.budget,
        chain=maker.chain,
        candidates=maker.table.columns.points,
        calibration=maker.calibration,
        rng=fresh_rng,
    )
    with pytest.raises(InputError, match=r"every\(3\)"):
        plain.begin().load(path)


def test_the_budget_is_spent_where_decisions_are_seen(fresh_rng: np.random.Generator) -> None:
    disclosure = every(2) | delayed(1)
    with draft_simulations():
        maker = maker_of(fresh_rng, disclosure, calibration=None, information_price=ALONE)
        found = maker.calibration
    assert found.regret <= maker.limit * 1.02
    path = maker.chain.paths(600, 1, rng=fresh_rng)[:, 0]
    drawn = maker.decide_path(maker.beliefs[path], rng=fresh_rng)
    assert (drawn.expected_regrets[1::2] == 0.0).all()
    assert (drawn.bits[1::2] == 0.0).all()
    assert drawn.expected_regrets.mean() == pytest.approx(found.regret, abs=0.25 * maker.limit)
    assert found.loss <= maker.ceiling + 3.0 * found.loss_se + 1e-12
    plain = maker_of(np.random.default_rng(0), None)
    assert (
        maker.ceiling
        >= SequentialDecisionMaker(
            maker.problem, maker.budget, chain=maker.chain, candidates=maker.table.columns.points, rng=fresh_rng
        ).ceiling
        - 1e-9
    )
    assert plain.table.period == 1


def test_what_cannot_be_gone_by_is_refused(fresh_rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="portfolio_return"):
        maker_of(fresh_rng, portfolio_return())
    with pytest.raises(InputError, match="shows only some"):
        maker_of(fresh_rng, every(2)).as_mechanism()


def test_a_late_decision_of_two_states_is_the_closed_form() -> None:
    """Seen d steps late, a decision that tells the state of a symmetric chain leaves the error (1 − (1 − 2p)^d)/2."""
    flip, late = 0.1, 3
    chain = resting_chain(Prior(np.eye(2), [0.5, 0.5]), 1.0 - 2.0 * flip)
    maker = SequentialDecisionMaker(
        FiniteProblem([[0.0, 1.0], [1.0, 0.0]]),
        Budget.regret(0.0),
        chain=chain,
        disclosure=delayed(late),
        calibration=PriceCalibration.at(1e6, ALONE),
        rng=np.random.default_rng(0),
    )
    states = chain.paths(40, 1, rng=np.random.default_rng(1))[:, 0]
    drawn = maker.decide_path(np.eye(2)[states], rng=np.random.default_rng(2))
    wrong = 0.5 * (1.0 - (1.0 - 2.0 * flip) ** late)
    named = drawn.observer_means[late:].argmax(axis=1)
    assert (named == states[:-late]).all()
    assert np.abs(drawn.observer_means[late:].min(axis=1) - wrong).max() < 1e-9
    assert (drawn.observer_means[:late] == 0.5).all()


@pytest.mark.parametrize("disclosure", [every(3, 1), every(2) | delayed(3), rounded(1)])
def test_a_saved_sequence_has_a_latest_decision_and_keeps_a_disclosed_value(
    fresh_rng: np.random.Generator, tmp_path: Path, disclosure: Disclosure
) -> None:
    """The decision published last is kept also where nobody sees it; what the observer saw last is a disclosed value."""
    path, maker = tmp_path / "state", maker_of(fresh_rng, disclosure)
    sequence = maker.begin()
    for step in range(4):
        sequence.save(path)
        held = SequenceState.load(path)
        assert (held.latest is None, held.n_published) == (step == 0, step)
        sequence.publish(sequence.decide(maker.beliefs[1]).sample(rng=fresh_rng).action)
    n_values = maker.table.n_values
    replace(held, kept=n_values - 1).save(path)
    maker.begin().load(path)
    replace(held, kept=n_values).save(path)
    with pytest.raises(InputError, match=f"is damaged: it kept value {n_values} of {n_values}"):
        maker.begin().load(path)
