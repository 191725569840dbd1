"""The cheapest rule under guarantees: closed forms, a cone programme as written, definitions in plain Python."""

from __future__ import annotations

import os
import time
from typing import Any

import cvxpy as cp
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.typing import NDArray

from inscrutable import (
    Budget,
    DetectabilityCap,
    FiniteProblem,
    Guarantee,
    InputError,
    LeastRegret,
    LeastRegretStatus,
    MarkowitzProblem,
    MaximalLeakageCap,
    MeanSquaredErrorFloor,
    Mechanism,
    ModelError,
    NamingErrorFloor,
    OriginalDecisionMaker,
    PointwiseLeakageCap,
    Prior,
    SquaredErrorFloor,
    StackelbergDecisionMaker,
    decoy_grid,
    detectability,
    leakage,
    least_regret,
    mechanism,
    uniform_prior,
)
from inscrutable.decision_makers.aware.guaranteed_programme import lower_bound
from inscrutable.experiments.comparison_markets import market_of
from inscrutable.linear_programmes import Rows
from oracles import leakages
from sizes import instances
from strategies import SEEDS

Array = NDArray[np.float64]

FRESH = int(os.environ.get("FRESH_SEED", "20260101"))
MET = 1e-9
SOLVED = 2e-7  # what the cone programme of the oracle is solved to, as a share of the largest regret


def finite(rng: np.random.Generator, n_states: int, n_choices: int, n_beliefs: int) -> tuple[FiniteProblem, Prior]:
    """Random costs, beliefs and weights."""
    problem = FiniteProblem(rng.normal(size=(n_states, n_choices)))
    return problem, Prior(rng.dirichlet(np.ones(n_states), size=n_beliefs), rng.dirichlet(np.full(n_beliefs, 2.0)))


def market(rng: np.random.Generator, n_states: int = 3) -> MarkowitzProblem:
    return MarkowitzProblem(0.05 * rng.normal(size=(n_states, 3)), [0.1 * np.eye(3)] * n_states, 1.0)


def asked(rng: np.random.Generator, prior: Prior) -> list[Guarantee]:
    """One of each kind, of random strictness; floors as shares of what the prior leaves."""
    drawn: list[Guarantee] = [
        PointwiseLeakageCap(rng.uniform(0.05, 0.8)),
        MaximalLeakageCap(rng.uniform(0.05, 0.6)),
        DetectabilityCap(rng.uniform(0.0, 0.4)),
        NamingErrorFloor(rng.uniform(0.3, 0.99) * (1.0 - prior.mean.max())),
        SquaredErrorFloor(rng.uniform(0.2, 0.9) * prior.error**2),
        MeanSquaredErrorFloor(rng.uniform(0.2, 0.99) * prior.error**2),
    ]
    return [drawn[i] for i in sorted(rng.choice(6, size=int(rng.integers(1, 4)), replace=False))]


def by_cones(problem: Any, prior: Prior, guarantees: list[Guarantee], actions: Any) -> float:
    """The least regret over some distinct decisions, as it is written."""
    costs = prior.beliefs @ np.asarray(problem.state_costs(actions)).T
    regrets = costs - np.asarray(problem.optimal_cost(prior.beliefs))[:, None]
    honest = np.zeros(len(actions))
    np.add.at(honest, regrets.argmin(axis=1), prior.weights)
    weights, table = prior.weights, cp.Variable(regrets.shape, nonneg=True)
    played = weights @ table
    rows = [cp.sum(table, axis=1) == 1]
    squares = weights * (prior.beliefs**2).sum(axis=1) @ table
    for each in guarantees:
        # ‖Σ p K π‖²/q as a cone, with 1e-12 that keeps q above zero
        taken = []
        for m in range(len(actions)):
            sums = (prior.beliefs * weights[:, None]).T @ table[:, m]
            if isinstance(each, PointwiseLeakageCap):
                rows.append(table[:, m] <= np.exp(each.nats) * played[m])
            if isinstance(each, NamingErrorFloor):
                rows.append(sums <= (1.0 - each.least) * played[m])
            taken.append(cp.quad_over_lin(sums, played[m] + 1e-12))
            if isinstance(each, SquaredErrorFloor):
                rows.append(taken[m] <= squares[m] - each.least * played[m] + 1e-12)
        if isinstance(each, MeanSquaredErrorFloor):
            rows.append(sum(taken) <= cp.sum(squares) - each.least)
        if isinstance(each, MaximalLeakageCap):
            rows.append(cp.sum(cp.max(table, axis=0)) <= np.exp(each.nats))
        if isinstance(each, DetectabilityCap):
            rows.append(0.5 * cp.norm1(played - honest) <= each.total_variation)
    unit = regrets.max()
    programme = cp.Problem(cp.Minimize(weights @ cp.sum(cp.multiply(table, regrets / unit), axis=1)), rows)
    programme.solve(solver=cp.CLARABEL)
    assert programme.status == "optimal"
    return float(programme.value) * unit


def levels_of(found: LeastRegret, prior: Prior) -> list[float]:
    """What a rule gives, by definition."""
    assert found.mechanism is not None
    some = prior.weights > 0
    weights, beliefs = prior.weights[some].tolist(), prior.beliefs[some].tolist()
    table = found.mechanism.probabilities.tolist()
    honest = mechanism(OriginalDecisionMaker(found.problem), prior.beliefs[some], found.mechanism.actions)
    wide = np.zeros((len(weights), len(honest.actions)))
    wide[:, : len(table[0])] = table
    naming, square = leakages.errors_after(weights, table, beliefs)
    by_kind = {
        PointwiseLeakageCap: np.log(2.0) * leakages.pointwise_leakage(weights, table),
        MaximalLeakageCap: np.log(2.0) * leakages.maximal_leakage(weights, table),
        DetectabilityCap: leakages.variation((np.array(weights) @ wide).tolist(), honest.played(weights).tolist()),
        NamingErrorFloor: naming,
        SquaredErrorFloor: square,
        MeanSquaredErrorFloor: leakages.bayes_error(weights, table, beliefs) ** 2,
    }
    return [by_kind[type(each)] for each in found.guarantees if isinstance(each, Guarantee)]  # type: ignore[index]


def check_holds(found: LeastRegret, prior: Prior) -> None:
    """All guarantees hold when recomputed, and what is stated is so."""
    assert found.mechanism is not None
    asked = [each for each in found.guarantees if isinstance(each, Guarantee)]
    for each, level in zip(asked, levels_of(found, prior), strict=True):
        over = each.limit - level if each.is_floor else level - each.limit
        assert over <= MET, (each, level)
        assert each.is_met(level)
        assert each.reached(found.mechanism, prior, found.problem) == pytest.approx(level, abs=1e-9)
    regret = prior.weights[prior.weights > 0] @ found.mechanism.expected_regrets
    assert found.regret == pytest.approx(regret, abs=1e-12)
    assert found.bound <= found.regret <= found.silence_regret * 100 + 10


@pytest.mark.parametrize("nats", [0.0, 0.3, 0.5, 1.0])
@pytest.mark.parametrize("n", [2, 3, 5])
def test_secrets_alike_cost_what_the_closed_form_says(n: int, nats: float) -> None:
    secrets = Prior(np.eye(n), np.full(n, 1.0 / n))
    found = least_regret(FiniteProblem(1.0 - np.eye(n)), secrets, [PointwiseLeakageCap(nats)])
    assert found.regret == pytest.approx(1.0 - min(1.0, np.exp(nats) / n), abs=1e-12)
    assert found.status is LeastRegretStatus.OPTIMAL
    assert found.gap <= 1e-12
    if 0 < nats < np.log(n):
        assert found.prices[0] == pytest.approx(np.exp(nats) / n, abs=1e-9)
    if n == 3 and nats == 1.0:
        assert round(found.regret, 3) == 0.094
        assert round(2.0 / (2.0 + np.e), 3) == 0.424  # what randomized response at the same number leaves


@settings(max_examples=instances(12), deadline=None)
@given(SEEDS)
def test_a_cone_programme_agrees_on_choices(seed: int) -> None:
    rng = np.random.default_rng([seed, FRESH])
    n_choices = int(rng.integers(2, 5))
    problem, prior = finite(rng, int(rng.integers(2, 4)), n_choices, int(rng.integers(2, 7)))
    guarantees = asked(rng, prior)
    found = least_regret(problem, prior, guarantees, candidates=np.arange(n_choices))
    exact = by_cones(problem, prior, guarantees, np.arange(n_choices))
    unit = SOLVED * float(np.ptp(problem.state_costs(np.arange(n_choices))))
    assert found.bound - unit <= exact <= found.regret + unit
    assert found.gap <= 1e-4 * found.silence_regret + 1e-9
    check_holds(found, prior)


@pytest.mark.parametrize("seed", range(3))
def test_a_cone_programme_agrees_on_portfolios(seed: int) -> None:
    rng = np.random.default_rng([seed, FRESH])
    problem = market(rng)
    beliefs = uniform_prior(3, 3).beliefs
    prior = Prior(beliefs, rng.dirichlet(np.ones(len(beliefs))))
    candidates = decoy_grid(problem, 3)
    guarantees = [*asked(rng, prior)[:1], SquaredErrorFloor(0.6 * prior.error**2)]
    found = least_regret(problem, prior, guarantees, candidates=candidates)
    actions = np.vstack([candidates.actions[candidates.distinct], problem.solve(prior.mean)])
    exact = by_cones(problem, prior, guarantees, actions)
    assert found.bound * (1 - 1e-6) <= exact <= found.regret * (1 + 1e-6)
    assert found.status is LeastRegretStatus.OPTIMAL
    check_holds(found, prior)


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_any_prices_bound_the_least_regret_from_below(seed: int) -> None:
    rng = np.random.default_rng([seed, FRESH])
    n_beliefs, n_columns, n_extra = (int(k) for k in rng.integers(1, 5, size=3))
    size, n_rows = n_beliefs * n_columns, int(rng.integers(1, 6))
    objective, prices = rng.normal(size=size), rng.exponential(size=n_rows)
    matrix = rng.normal(size=(n_rows, size + n_extra))
    table = rng.dirichlet(np.ones(n_columns), size=n_beliefs)
    others = rng.uniform(size=n_extra)
    kept = Rows(matrix, matrix @ np.append(table.ravel(), others) + rng.exponential(size=n_rows) * rng.integers(2))
    assert lower_bound((n_beliefs, n_columns), objective, kept, prices) <= objective @ table.ravel() + 1e-9


@settings(max_examples=instances(6), deadline=None)
@given(SEEDS)
def test_prices_are_slopes(seed: int) -> None:
    """A price lies between the slopes of the least regret on both sides, up to how it bends within a step."""
    rng = np.random.default_rng([seed, FRESH])
    problem, prior = finite(rng, 3, 4, 6)
    room = 1.0 - float(prior.mean.max())
    step = 1e-4

    def regret(cap: float, floor: float) -> LeastRegret:
        return least_regret(problem, prior, [DetectabilityCap(cap), NamingErrorFloor(floor)])

    cap, floor = 0.1, 0.8 * room
    found = regret(cap, floor)
    for place, (less, more) in enumerate(
        [(regret(cap + step, floor), regret(cap - step, floor)), (regret(cap, floor - step), regret(cap, floor + step))]
    ):
        low, high = (found.regret - less.regret) / step, (more.regret - found.regret) / step
        bend = 1e-3 * (1.0 + abs(high))
        assert min(low, high) - bend <= found.prices[place] <= max(low, high) + bend


def test_prices_of_leakage_and_of_square_errors_are_slopes() -> None:
    """Two states, cost 1 for the wrong one, errors D: ln(2 − 2D) nats either way, and a mean square error of 2 D (1 − D)."""
    problem, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Prior(np.eye(2), [0.5, 0.5])
    error = 0.2
    for asked, slope in (
        (PointwiseLeakageCap(np.log(2 - 2 * error)), 1 - error),
        (MaximalLeakageCap(np.log(2 - 2 * error)), 1 - error),
        (NamingErrorFloor(error), 1.0),
        (SquaredErrorFloor(2 * error * (1 - error)), 1 / (2 - 4 * error)),
        (MeanSquaredErrorFloor(2 * error * (1 - error)), 1 / (2 - 4 * error)),
    ):
        found = least_regret(problem, prior, [asked], gap=1e-8)
        assert found.regret == pytest.approx(error, abs=1e-7)
        assert found.prices[0] == pytest.approx(slope, rel=1e-4)


@pytest.mark.parametrize("limit", [0.05, 0.2])
def test_the_floor_on_average_is_the_inverse_of_the_largest_error(limit: float) -> None:
    """Where all beliefs may spend the same and none has reason to spend less, the best error costs what it was given."""
    problem, prior = FiniteProblem(1.0 - np.eye(3)), Prior(np.eye(3), np.full(3, 1 / 3))
    best = StackelbergDecisionMaker(problem, Budget.regret(limit), prior=prior)
    found = least_regret(problem, prior, [MeanSquaredErrorFloor(best.value)], gap=1e-6)
    assert found.regret == pytest.approx(limit, abs=1e-5)


@settings(max_examples=instances(30), deadline=None)
@given(SEEDS)
def test_facts_that_hold_for_every_mechanism(seed: int) -> None:
    """A pointwise cap implies the others: maximal leakage, information, and guesses right e^ε times as often at most."""
    rng = np.random.default_rng([seed, FRESH])
    problem, prior = finite(rng, 3, 4, 5)
    table = rng.dirichlet(np.full(4, 0.3), size=5)
    played = Mechanism(prior.beliefs, np.arange(4), table, rng.uniform(size=(5, 4)))
    found = leakage(played, prior)
    assert found.pointwise_leakage == pytest.approx(
        leakages.pointwise_leakage(prior.weights.tolist(), table.tolist()), abs=1e-9
    )
    assert found.mutual_information <= found.maximal_leakage + MET
    assert found.min_entropy_leakage <= found.maximal_leakage + MET
    assert found.maximal_leakage <= found.pointwise_leakage + MET
    naming = NamingErrorFloor(0.0).reached(played, prior, problem)
    assert 1.0 - naming <= 2.0**found.pointwise_leakage * prior.mean.max() + MET
    assert DetectabilityCap(0.0).reached(played, prior, problem) == pytest.approx(
        detectability(played, prior, problem).total_variation, abs=MET
    )
    assert MeanSquaredErrorFloor(0.0).reached(played, prior, problem) == pytest.approx(found.bayes_error**2, abs=MET)
    assert SquaredErrorFloor(0.0).reached(played, prior, problem) <= found.bayes_error**2 + MET


@settings(max_examples=instances(6), deadline=None)
@given(SEEDS)
def test_contradictions_are_irreducible(seed: int) -> None:
    rng = np.random.default_rng([seed, FRESH])
    problem, prior = finite(rng, 3, 4, 6)
    others: list[Guarantee] = [
        PointwiseLeakageCap(0.1),
        DetectabilityCap(0.05),
        NamingErrorFloor(0.9 * (1.0 - float(prior.mean.max()))),
        MaximalLeakageCap(0.3),
    ]
    whole = least_regret(problem, prior, others)
    if whole.regret <= 1e-6:
        return
    everything = [*others[:2], Budget.regret(0.9 * whole.regret), *others[2:]]
    found = least_regret(problem, prior, everything)
    assert found.mechanism is None
    assert found.regret == np.inf
    assert found.bound == pytest.approx(whole.bound)
    assert found.status is LeastRegretStatus.CONTRADICTION
    conflict = [everything[place] for place in found.conflict]
    assert least_regret(problem, prior, conflict).mechanism is None
    for place in range(len(conflict)):
        fewer = [*conflict[:place], *conflict[place + 1 :]]
        assert least_regret(problem, prior, fewer).mechanism is not None
    assert "in conflict: expected regret" in found.summary()
    with pytest.raises(ModelError, match="in conflict"):
        found.decide(prior.beliefs[0])


def test_a_floor_above_what_the_prior_leaves_contradicts_itself() -> None:
    problem, prior = finite(np.random.default_rng(1), 3, 4, 6)
    for floor in (NamingErrorFloor(1.01 - prior.mean.max()), SquaredErrorFloor(1.01 * prior.error**2)):
        found = least_regret(problem, prior, [PointwiseLeakageCap(0.5), floor])
        assert found.conflict == (1,)
        assert found.bound == np.inf


def test_silence_is_what_the_strictest_guarantees_leave() -> None:
    rng = np.random.default_rng(2)
    problem, prior = market(rng), uniform_prior(3, 2)
    silence = leakage(mechanism(OriginalDecisionMaker(problem), prior.beliefs), prior, problem).silence_regret
    for strict in (PointwiseLeakageCap(0.0), MaximalLeakageCap(0.0)):
        found = least_regret(problem, prior, [strict])
        assert found.regret == pytest.approx(silence, rel=1e-9)
        check_holds(found, prior)
    edge = least_regret(problem, prior, [SquaredErrorFloor(prior.error**2)])
    assert edge.regret <= silence * (1 + 1e-9)
    check_holds(edge, prior)
    both = least_regret(problem, prior, [PointwiseLeakageCap(0.0), DetectabilityCap(0.0)])
    assert both.regret >= silence
    check_holds(both, prior)
    free = least_regret(problem, prior, [])
    assert free.regret <= 1e-12
    assert free.prices == ()


def test_beliefs_without_weight_copies_and_single_decisions() -> None:
    """A belief of no weight changes nothing; nor does a choice written twice; one choice alone tells nothing."""
    costs = np.array([[0.0, 1.0, 0.4], [1.0, 0.0, 0.4]])
    beliefs, asked = np.array([[1.0, 0.0], [0.0, 1.0], [0.5, 0.5]]), [PointwiseLeakageCap(0.2), NamingErrorFloor(0.3)]
    plain = least_regret(FiniteProblem(costs), Prior(beliefs[:2], [0.6, 0.4]), asked)
    idle = least_regret(FiniteProblem(costs), Prior(beliefs, [0.6, 0.4, 0.0]), asked)
    assert idle.regret == pytest.approx(plain.regret, abs=1e-12)
    with pytest.raises(InputError, match="nothing is guaranteed there"):
        idle.decide(beliefs[2])
    copied = least_regret(FiniteProblem(costs[:, [0, 1, 2, 1]]), Prior(beliefs[:2], [0.6, 0.4]), asked)
    assert copied.regret == pytest.approx(plain.regret, abs=1e-12)
    one = least_regret(FiniteProblem([[1.0], [2.0]]), Prior(beliefs[:2], [0.6, 0.4]), [PointwiseLeakageCap(0.0)])
    assert one.regret == 0.0
    assert one.silence_regret == 0.0
    known = least_regret(FiniteProblem([[1.0, 2.0]]), Prior([[1.0]], [1.0]), [NamingErrorFloor(0.0)])
    assert known.regret == 0.0
    certain = least_regret(FiniteProblem(costs), Prior([[0.3, 0.7]], [1.0]), [SquaredErrorFloor(0.0)])
    assert certain.regret == 0.0


@pytest.mark.parametrize("weight", [1e-9, 1e-11, 1e-13])
@pytest.mark.parametrize("asked", [[], [MaximalLeakageCap(2.0)], [PointwiseLeakageCap(2.0)], [DetectabilityCap(0.0)]])
def test_a_belief_of_tiny_weight_costs_no_more_than_its_weight(weight: float, asked: list[Guarantee]) -> None:
    prior = Prior(np.eye(3), [0.5, 0.5 - weight, weight])
    found = least_regret(FiniteProblem(1.0 - np.eye(3)), prior, asked)
    assert found.regret <= weight
    check_holds(found, prior)


@pytest.mark.parametrize("nats", [1.0, 35.0, 700.0, 800.0])
@pytest.mark.parametrize("cap", [PointwiseLeakageCap, MaximalLeakageCap])
def test_a_cap_above_what_any_rule_leaks_binds_nothing(cap: Any, nats: float) -> None:
    two, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Prior(np.eye(2), [0.5, 0.5])
    found = least_regret(two, prior, [cap(nats)])
    assert found.regret == 0.0
    assert found.prices == (0.0,)


def test_no_detectability_beside_square_errors_costs_what_its_bound_says() -> None:
    problem = FiniteProblem([[-3.21, 0.46], [1.04, -1.54], [3.49, 4.72], [-0.58, 0.11]])
    beliefs = [[0.123, 0.257, 0.472, 0.148], [0.003, 0.319, 0.175, 0.503], [0.002, 0.54, 0.366, 0.092]]
    prior = Prior(beliefs, [0.026, 0.906, 0.068])
    found = least_regret(problem, prior, [DetectabilityCap(0.0), SquaredErrorFloor(0.73 * prior.error**2)])
    assert found.status is LeastRegretStatus.OPTIMAL
    check_holds(found, prior)


@pytest.mark.parametrize("seed", range(5))
def test_costs_that_cancel_keep_a_budget_of_nothing(seed: int) -> None:
    rng = np.random.default_rng(seed)
    beliefs, common = rng.dirichlet(np.ones(3), size=4), 1e4 * rng.normal(size=3)
    common -= common @ beliefs[0]
    problem = FiniteProblem(1e-3 * rng.normal(size=(3, 4)) + common[:, None])
    found = least_regret(problem, Prior(beliefs, np.full(4, 0.25)), [Budget.regret(0.0)], candidates=np.eye(4))
    assert found.regret == 0.0


def test_it_decides_as_its_mechanism_says() -> None:
    rng = np.random.default_rng(3)
    problem, prior = market(rng), uniform_prior(3, 2)
    found = least_regret(problem, prior, [PointwiseLeakageCap(0.4)])
    assert found.mechanism is not None
    again = mechanism(found, prior.beliefs, found.mechanism.actions)
    assert again.probabilities == pytest.approx(found.mechanism.probabilities, abs=1e-12)
    drawn = found.decide(prior.beliefs[1])
    assert drawn.expected_regret == pytest.approx(found.mechanism.expected_regrets[1], abs=1e-12)
    near = 0.99 * prior.beliefs[1] + 0.01 * prior.mean
    with pytest.raises(InputError, match="nearest=True"):
        found.decide(near)
    assert np.array_equal(found.decide(near, nearest=True).probabilities, drawn.probabilities)
    told = leakage(found.mechanism, prior, problem)
    assert np.log(2.0) * told.pointwise_leakage <= 0.4 + MET
    assert "none below" in found.summary()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: PointwiseLeakageCap(-0.1), "nats must be at least 0"),
        (lambda: MaximalLeakageCap(np.inf), "nats must be finite"),
        (lambda: DetectabilityCap(1.5), "total_variation must be from 0 to 1"),
        (lambda: NamingErrorFloor(2.0), "least must be from 0 to 1"),
        (lambda: SquaredErrorFloor("much"), "least must be a number"),  # type: ignore[arg-type]
    ],
)
def test_what_no_guarantee_is_refused(make: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        make()


def test_arguments_are_checked() -> None:
    problem, prior = finite(np.random.default_rng(1), 3, 4, 6)
    with pytest.raises(InputError, match="must be a list"):
        least_regret(problem, prior, PointwiseLeakageCap(0.1))  # type: ignore[arg-type]
    with pytest.raises(InputError, match=r"got 0\.1 at place 1"):
        least_regret(problem, prior, [PointwiseLeakageCap(0.1), 0.1])  # type: ignore[list-item]
    with pytest.raises(InputError, match="states"):
        least_regret(problem, uniform_prior(2, 3), [])
    with pytest.raises(InputError, match="gap must be above 0"):
        least_regret(problem, prior, [], gap=0.0)


@pytest.mark.parametrize("seed", [FRESH + 700 + each for each in range(instances(12, least=3))])
def test_decisions_that_join_as_they_are_needed_come_to_the_same(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(seed)
    problem, prior = market(rng), uniform_prior(3, 5)
    every = PointwiseLeakageCap, MaximalLeakageCap, NamingErrorFloor
    guarantees = [each for each in asked(rng, prior) if isinstance(each, every)] or [PointwiseLeakageCap(0.4)]
    whole = least_regret(problem, prior, guarantees)
    monkeypatch.setattr("inscrutable.decision_makers.aware.guaranteed_programme._WHOLE", 0)
    monkeypatch.setattr("inscrutable.decision_makers.aware.guaranteed_programme._FIRST", 4)
    parts = least_regret(problem, prior, guarantees)
    assert parts.bound <= whole.regret + MET
    assert whole.bound <= parts.regret + MET
    assert parts.regret - parts.bound <= 1e-4 * whole.silence_regret + MET
    for each in guarantees:
        assert each.is_met(each.reached(parts.mechanism, prior, problem))


@pytest.mark.audit
@pytest.mark.parametrize("kind", ["pointwise", "naming", "maximal"])
def test_the_prior_of_the_embedded_returns_is_done_in_a_minute(kind: str) -> None:
    """491 beliefs, 547 decisions: 30, 15 and 10 s of one core when written."""
    market = market_of("returns", 30, 0)
    floor = NamingErrorFloor(0.7 * (1.0 - market.prior.mean.max()))
    asked = {"pointwise": PointwiseLeakageCap(0.5), "naming": floor, "maximal": MaximalLeakageCap(0.1)}[kind]
    begun = time.process_time()
    found = least_regret(market.problem, market.prior, [asked])
    assert time.process_time() - begun < 60.0
    assert found.status is LeastRegretStatus.OPTIMAL
    assert found.gap <= 1e-4 * found.silence_regret
