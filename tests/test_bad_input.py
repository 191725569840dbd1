"""One clear error for each thing that is wrong: its type, and the offending number in its message."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from inscrutable import (
    AlphaDecisionMaker,
    AlphaProblem,
    Budget,
    CategoricalEmission,
    CounterAdversarialDecisionMaker,
    DesiredObfuscation,
    DetectabilityCap,
    Disclosure,
    FiniteProblem,
    HiddenMarkovModel,
    InputError,
    InscrutableError,
    LinearProblem,
    LocalSearch,
    MarkowitzProblem,
    ModelError,
    OriginalDecisionMaker,
    Polyhedron,
    PriceCalibration,
    Prior,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    SequentialDecisionMaker,
    SolverError,
    TradingProblem,
    alpha_backtest,
    box,
    consistent_beliefs,
    decoy_grid,
    detectability,
    group_caps,
    grouped,
    infer_weights,
    learning_curve,
    mechanism,
    near_optimal_beliefs,
    plausibility_gap,
    privacy_frontier,
    run_backtest,
    simplex,
    steady_filter,
    uniform_prior,
)
from inscrutable.mechanisms.chains import BeliefChain, resting_chain

INDEFINITE = np.array([[1.0, 2.0], [2.0, 1.0]])  # eigenvalues 3 and −1


@pytest.fixture(scope="module")
def problem():
    return MarkowitzProblem([[0.1, 0.0, 0.2], [0.0, 0.2, 0.1]], [np.eye(3), 2 * np.eye(3)], 1.0)


@pytest.fixture(scope="module")
def candidates(problem):
    return decoy_grid(problem, 4)


BAD_BELIEFS = [
    ([0.5, 0.6], r"sums to 1\.1, expected 1"),
    ([0.5, 0.5 + 1e-6], r"sums to 1\.000001"),
    (np.float32([0.5, 0.50001]), r"sums to 1\.00001"),
    ([1.2, -0.2], r"-0\.2 at index \[1\]"),
    ([0.5, np.nan], r"nan at index \[1\]"),
    ([np.inf, 0.5], r"inf at index \[0\]"),
    ([0.2, 0.3, 0.5], "3 entries, expected one per state: 2"),
    ([1.0], "1 entries, expected one per state: 2"),
    (0.5, r"shape \(\)"),
    (["a", "b"], "must be numbers"),
    (np.array([0.8 + 7j, 0.2 - 7j]), "must be real numbers, got complex ones"),
    (np.ma.array([0.8, 0.2], mask=[False, True]), r"nan at index \[1\]"),
    (None, "dimensional"),
    ([], "0 entries, expected one per state: 2"),
]


def test_states_that_a_belief_lacks_are_named(problem):
    named = FiniteProblem(pd.DataFrame([[0.0, 1.0], [1.0, 0.0]], index=["calm", "wild"]))
    with pytest.raises(InputError, match=r"1 entries, expected one per state: 2 \(calm, wild\)"):
        OriginalDecisionMaker(named).decide([1.0])


@pytest.mark.parametrize(("belief", "message"), BAD_BELIEFS, ids=lambda value: repr(value)[:24])
def test_what_is_not_a_belief_is_refused_everywhere(problem, candidates, belief, message):
    action = problem.solve([0.5, 0.5])
    for question in (
        lambda: problem.solve(belief),
        lambda: problem.optimal_cost(belief),
        lambda: problem.expected_cost(belief, action),
        lambda: problem.regret(belief, action),
        lambda: consistent_beliefs(problem, action).distance(belief),
        lambda: consistent_beliefs(problem, action).contains(belief),
        lambda: near_optimal_beliefs(problem, action, 0.1).distance(belief),
        lambda: near_optimal_beliefs(problem, action, 0.1).contains(belief),
        lambda: OriginalDecisionMaker(problem).decide(belief),
        lambda: CounterAdversarialDecisionMaker(problem, candidates=candidates).decide(belief),
        lambda: ProbabilisticDecisionMaker(problem, candidates=candidates).decide(belief),
        lambda: privacy_frontier(problem, belief, candidates=candidates),
        lambda: DesiredObfuscation(lambda held: belief)([0.5, 0.5], consistent_beliefs(problem, action)),
    ):
        with pytest.raises(InputError, match=message):
            question()


def test_beliefs_in_single_precision_are_those_that_they_round(problem, fresh_rng):
    exact = fresh_rng.dirichlet(np.ones(2), size=50)
    np.testing.assert_allclose(problem.solve(exact.astype(np.float32)), problem.solve(exact), atol=1e-5)


def test_one_bad_belief_among_many_is_named_by_its_row(problem, candidates):
    many = np.array([[0.5, 0.5], [0.5, 0.6], [0.5, 0.5]])
    for chooser in (
        OriginalDecisionMaker(problem),
        CounterAdversarialDecisionMaker(problem, candidates=candidates),
        ProbabilisticDecisionMaker(problem, candidates=candidates),
    ):
        with pytest.raises(InputError, match=r"row 1 sums to 1\.1"):
            chooser.decide_many(many)
        with pytest.raises(InputError, match="no rows"):
            chooser.decide_many(np.zeros((0, 2)))
        with pytest.raises(InputError, match="dimensional"):
            chooser.decide_many(np.zeros((2, 2, 2)))
        with pytest.raises(InputError, match="one belief"):
            chooser.decide(many[:1])


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.5, 0.5], "2 coordinates, expected 3"),
        ([0.5, 0.5, 0.5], r"sum\(u\) = 1 is off by 0\.5"),
        ([1.2, -0.2, 0.0], r"u\[1\] >= 0 is violated by 0\.2"),
        ([0.5, np.nan, 0.5], r"nan at index \[1\]"),
        ([[[0.5, 0.5, 0.0]]], "dimensional"),
        ("abc", "must be numbers"),
        (None, "action"),
    ],
    ids=lambda value: repr(value)[:24],
)
def test_what_is_not_a_decision_is_refused_everywhere(problem, action, message):
    for question in (
        lambda: problem.expected_cost([0.5, 0.5], action),
        lambda: problem.regret([0.5, 0.5], action),
        lambda: problem.check_actions(action),
        lambda: consistent_beliefs(problem, action),
        lambda: near_optimal_beliefs(problem, action, 0.1),
        lambda: plausibility_gap(problem, action),
    ):
        with pytest.raises(InputError, match=message):
            question()


def test_state_costs_and_gradients_refuse_a_wrong_length(problem):
    for question in (problem.state_costs, problem.cost_gradients):
        with pytest.raises(InputError, match=r"2 coordinates|expected"):
            question([0.5, 0.5])


def test_many_decisions_where_one_is_meant(problem):
    many = np.eye(3)
    for question in (consistent_beliefs, plausibility_gap):
        with pytest.raises(InputError, match="one decision"):
            question(problem, many)
    with pytest.raises(InputError, match="one decision"):
        near_optimal_beliefs(problem, many, 0.1)
    with pytest.raises(InputError, match="row 1"):
        problem.check_actions([[1, 0, 0], [0.5, 0, 0]])
    with pytest.raises(InputError):
        problem.expected_cost(np.full((2, 2), 0.5), many)  # two beliefs with three decisions do not pair


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([[0.1, 0.2]], [INDEFINITE], 1.0), ModelError, r"covariances\[0\] is indefinite: smallest eigenvalue -1"),
        (([[0.1, 0.2]], [-np.eye(2)], 1.0), ModelError, "smallest eigenvalue -1"),
        (([[0.1, 0.2]], [[[1.0, 0.5], [0.0, 1.0]]], 1.0), InputError, r"not symmetric.*\[0, 1\]"),
        (([[0.1, 0.2]], [np.eye(3)], 1.0), InputError, r"\(1, 3, 3\), expected \(1, 2, 2\)"),
        (([[0.1, 0.2]], np.eye(2), 1.0), InputError, "3-dimensional"),
        (([0.1, 0.2], [np.eye(2)], 1.0), InputError, "2-dimensional"),
        (([[0.1, np.nan]], [np.eye(2)], 1.0), InputError, r"means has nan at index \[0, 1\]"),
        (([[0.1, 0.2]], [[[1.0, 0], [0, np.inf]]], 1.0), InputError, r"inf at index \[0, 1, 1\]"),
        (([[0.1, 0.2]], [np.eye(2)], 0.0), InputError, "risk_aversion must be above 0, got 0"),
        (([[0.1, 0.2]], [np.eye(2)], -1.0), InputError, "risk_aversion must be above 0, got -1"),
        (([[0.1, 0.2]], [np.eye(2)], np.nan), InputError, "risk_aversion"),
        (([[0.1, 0.2]], [np.eye(2)], "high"), InputError, "risk_aversion must be a number"),
        (([[0.1, 0.2]], [np.eye(2)], 1.0, simplex(3)), InputError, "3 coordinates, the costs 2"),
        (([[0.1, 0.2]], [np.eye(2)], 1.0, "simplex"), InputError, "Polyhedron"),
        ((np.zeros((0, 2)), np.zeros((0, 2, 2)), 1.0), InputError, r"state|shape"),
        ((np.zeros((2, 0)), np.zeros((2, 0, 0)), 1.0), InputError, r"asset|shape"),
        (([[0.1, 0.2]], [np.eye(2)], 1.0, simplex(2) & box([0.6, 0.6], [1, 1])), ModelError, "no decision satisfies"),
    ],
)
def test_malformed_markets_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        MarkowitzProblem(*arguments)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (([INDEFINITE], [[0.0, 0.0]]), ModelError, "smallest eigenvalue -1"),
        (([np.eye(2)], [[0.0, 0.0, 0.0]]), InputError, r"\(1, 3\), expected \(1, 2\)"),
        (([np.eye(2)], [[0.0, 0.0]], [1.0, 2.0]), InputError, "2 entries, expected one per state: 1"),
        (([np.eye(2)], [[0.0, 0.0]], [np.nan]), InputError, "constants has nan"),
        (([np.ones((2, 3))], [[0.0, 0.0]]), InputError, r"expected \(X, U, U\)"),
    ],
)
def test_malformed_quadratic_problems_are_refused(arguments, error, message):
    with pytest.raises(error, match=message):
        QuadraticProblem(*arguments, constraints=simplex(2))


@pytest.mark.parametrize("n_beliefs", [1, 3, 40])
def test_a_cost_that_falls_without_end_is_a_model_error(n_beliefs):
    beliefs = np.full((n_beliefs, 2), 0.5)
    # Falls along u_2 → −∞, which the set leaves open.
    linear = QuadraticProblem(np.zeros((2, 2, 2)), np.ones((2, 2)), constraints=Polyhedron([[-1.0, 0.0]], [0.0]))
    # Curved in u_1 alone, falls along u_2.
    curved = QuadraticProblem([np.diag([1.0, 0.0])] * 2, np.ones((2, 2)), constraints=box([0.0, -np.inf], [1.0, 5.0]))
    # Bounded in state 1, unbounded in state 2: only some beliefs have a decision.
    equality = QuadraticProblem(np.zeros((2, 2, 2)), [[1, 1], [1, 2]], constraints=Polyhedron(A_eq=[[1, 1]], b_eq=[1]))
    for problem in (linear, curved, equality):
        with pytest.raises(ModelError, match=r"no minimum|without end|unbounded"):
            problem.solve(beliefs)


def test_a_flat_direction_without_end_is_either_solved_or_a_model_error():
    """The minimum exists but is not unique along an open direction: a decision, or a clear refusal, never nonsense."""
    problem = QuadraticProblem([np.diag([1.0, 0.0])], [[-1.0, 0.0]], constraints=box([0.0, -np.inf], [2.0, np.inf]))
    try:
        action = problem.solve([1.0])
    except ModelError:
        return
    assert np.isfinite(action).all()
    assert float(problem.regret([1.0], action)) <= 1e-12
    assert action[0] == pytest.approx(1.0)


@pytest.mark.parametrize("maker", [CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker])
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"measure": "maximal"}, "measure must be a privacy measure"),
        ({"budget": True}, "budget must be a number, got True"),
        ({"budget": -0.1}, "budget must be at least 0, got -0.1"),
        ({"budget": np.nan}, "budget"),
        ({"budget": "a lot"}, "budget 'a lot': expected a share"),
        ({"on_empty": "ignore"}, "on_empty must be"),
        ({"method": "fast"}, "method must be"),
        ({"candidates": 5}, "candidate"),
    ],
)
def test_malformed_arguments_are_refused(problem, maker, arguments, message):
    with pytest.raises(InputError, match=message):
        maker(problem, **arguments).decide([0.5, 0.5])


@pytest.mark.parametrize("maker", [OriginalDecisionMaker, CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker])
def test_what_is_not_a_problem_is_refused(maker):
    with pytest.raises(InputError, match="problem"):
        maker("portfolio").decide([0.5, 0.5])


def test_randomness_comes_from_a_generator(problem, candidates):
    mixed = ProbabilisticDecisionMaker(problem, candidates=candidates).decide([0.5, 0.5])
    for wrong in (0, "seed", np.random, np.random.RandomState(0)):
        with pytest.raises(InputError, match=r"numpy\.random\.Generator"):
            mixed.sample(rng=wrong)
        with pytest.raises(InputError, match=r"numpy\.random\.Generator"):
            LocalSearch(rng=wrong)
    for wrong in (0, 1.5, True, None):
        with pytest.raises(InputError, match="n_starts"):
            LocalSearch(n_starts=wrong)


def test_regrets_and_tolerances_have_a_sign(problem):
    action = problem.solve([0.5, 0.5])
    for wrong in (-1e-9, np.nan, np.inf, "big"):
        with pytest.raises(InputError, match="regret"):
            near_optimal_beliefs(problem, action, wrong)
    for wrong in (0.0, -1e-9, np.nan):
        with pytest.raises(InputError, match="tolerance"):
            consistent_beliefs(problem, action, tolerance=wrong)
    for wrong in (-1.0, np.inf, np.nan, None):
        with pytest.raises(InputError, match="budget"):
            Budget.regret(wrong)
        with pytest.raises(InputError, match="budget"):
            Budget.relative(wrong)


def test_input_is_copied_not_kept_or_changed():
    means, covariances = np.array([[0.1, 0.2], [0.2, 0.1]]), np.stack([np.eye(2)] * 2)
    problem = MarkowitzProblem(means, covariances, 1.0)
    before = problem.solve([0.5, 0.5])
    means[:], covariances[:] = 99.0, 99.0
    np.testing.assert_array_equal(problem.solve([0.5, 0.5]), before)
    belief = np.array([0.4, 0.6])
    action = problem.solve(belief)
    consistent_beliefs(problem, action).distance(belief)
    CounterAdversarialDecisionMaker(problem, candidates=decoy_grid(problem, 5)).decide(belief)
    np.testing.assert_array_equal(belief, [0.4, 0.6])


def test_errors_are_sorted_by_what_the_reader_can_do():
    assert (InputError.exit_code, ModelError.exit_code, SolverError.exit_code) == (3, 4, 1)
    for kind in (InputError, ModelError, SolverError):
        assert issubclass(kind, InscrutableError)
    assert issubclass(InputError, ValueError)


CHOICES = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
TWO = MarkowitzProblem([[0.3, 0.0], [0.0, 0.3]], [np.eye(2)] * 2, 1.0)
EVEN = Prior(np.eye(2), [0.5, 0.5])
CHAIN = resting_chain(EVEN, 0.5)
CHOSEN = mechanism(OriginalDecisionMaker(CHOICES), np.eye(2))


def ruled(price, **more):
    rng = np.random.default_rng(0)
    return SequentialDecisionMaker(CHOICES, Budget.regret(0.25), chain=CHAIN, information_price=price, rng=rng, **more)


def played_for(before, **more):
    return ruled(None, calibration=PriceCalibration.at(1.0, np.inf), **more).begin().mechanism_for(EVEN, before)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        (lambda: detectability(CHOSEN, EVEN, TWO), "decisions are choices, those of .* have 2 coordinates"),
        (
            lambda: DetectabilityCap(0.1).reached(CHOSEN, EVEN, TWO),
            "decisions are choices, those of .* have 2 coordinates",
        ),
        (lambda: infer_weights([0.1, 0.2], [[0.1, 0.0], [0.2, 0.1]], total=np.nan), "total must be finite, got nan"),
        (lambda: infer_weights([0.1, 0.2], [[0.1, 0.0], [0.2, 0.1]], total="a"), "total must be a number, got 'a'"),
        (lambda: infer_weights([0.1, 0.2], [[0.1, 0.0], [0.2, 0.1]], total=None), "total must be a number, got None"),
        (lambda: resting_chain("x", 0.5), "prior must be a Prior"),
        (lambda: BeliefChain(EVEN, np.eye(2), public=3), "public must be tables of shape"),
        (lambda: BeliefChain(EVEN, np.eye(2), public=[["a"]]), "public must be tables of shape"),
        (lambda: CHAIN.lagged("x", 1), "expected a Mechanism"),
        (lambda: CHAIN.histories(-1, 2, rng=np.random.default_rng(0)), "n_steps must be a whole number of at least 0"),
        (lambda: CHAIN.histories(1, 0, rng=np.random.default_rng(0)), "n_draws must be a whole number"),
        (lambda: CHAIN.histories(1, 2, rng=None), "rng"),
        (lambda: played_for("x"), "action must be numbers"),
        (lambda: played_for("x", disclosure="grouped([a, b])"), "action must be numbers"),
        (lambda: PriceCalibration.at(1.0, "x"), "information_price must be at least 0, got 'x'"),
        (lambda: PriceCalibration.at(1.0, np.nan), "information_price must be at least 0, got nan"),
        (lambda: ruled("x"), "information_price must be a number of at least 0, or None, got 'x'"),
    ],
)
def test_what_rules_and_observers_cannot_use_is_refused(asked, message):
    with pytest.raises(InputError, match=message):
        asked()


def test_numbers_of_other_kinds_are_numbers():
    assert grouped([np.int64(0), np.int64(0), np.int64(1)]) == grouped([0, 0, 1])
    assert Disclosure.of(str(grouped([np.str_("a"), "b"]))) == grouped(["a", "b"])
    assert ruled(np.int64(1)).information_price == 1
    assert PriceCalibration.at(1.0, np.float32(0.5)).prices(0).information == 0.5


WORLD = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission([[0.8, 0.2], [0.3, 0.7]]))
MONTHS = pd.DataFrame(np.zeros((5, 2)))


def alphas_hidden(*tables):
    maker = AlphaDecisionMaker(AlphaProblem(np.eye(2), 1.0), 0.5, prior_covariance=np.eye(2))
    return alpha_backtest(maker, *tables, rng=np.random.default_rng(0))


def curve_for(pairs):
    prior = uniform_prior(2, 4)
    played = mechanism(OriginalDecisionMaker(FiniteProblem(np.eye(2))), prior.beliefs)
    return learning_curve(played, prior, pairs, rng=np.random.default_rng(0))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Disclosure("every(3)"), r"got 'every\(3\)': Disclosure\.of reads"),
        (lambda: Disclosure(["every(3)"]), r"Disclosure\.of reads"),
        (
            lambda: TradingProblem(LinearProblem(np.eye(2), simplex(2)), [0.5, 0.5], [0.1, 0.1]),
            "must be a QuadraticProblem",
        ),
        (lambda: curve_for(100), r"pairs must be a list of .*, got 100"),
        (lambda: steady_filter(WORLD), "must be a LinearGaussianWorld, got HiddenMarkovModel"),
        (lambda: group_caps(["a", "b"], {"x": 1}, 0.5), "group 'x' must be a list of assets, got 1"),
        (lambda: alphas_hidden(MONTHS.to_numpy()), "alphas must be a DataFrame .*, got ndarray"),
        (lambda: alphas_hidden(MONTHS, MONTHS.to_numpy()), "returns must be a DataFrame .*, got ndarray"),
        (
            lambda: run_backtest(MONTHS, {"regimes": 2}),
            r"settings must be BacktestSettings\(\.\.\.\), got \{'regimes': 2\}",
        ),
    ],
)
def test_an_argument_of_another_kind_is_named(call, message):
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda named: DesiredObfuscation(named),
        lambda named: Prior(pd.DataFrame(np.eye(2), columns=named.index), [0.5, 0.5]),
    ],
)
def test_labels_without_a_known_order_are_to_be_left_out(call):
    """The advice can be followed: no labelled table gives a prior or an aim the states' labels."""
    named = pd.Series([0.5, 0.5], index=["calm", "storm"])
    with pytest.raises(
        InputError, match=r"order is not known here: put them in order and pass the numbers alone \(\.to_numpy\(\)\)"
    ):
        call(named)
