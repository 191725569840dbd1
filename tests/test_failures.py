"""Every way in which a search can end, and every sentence in which a solver or a model is refused, forced once."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    Budget,
    CoinDecisionMaker,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    FiniteProblem,
    GlobalSearch,
    LinearProblem,
    LocalSearch,
    MarkowitzProblem,
    MaximalObfuscation,
    ModelError,
    OriginalDecisionMaker,
    Polyhedron,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    SolverError,
    box,
    long_short,
    near_optimal_beliefs,
    plausibility_gap,
    simplex,
)
from inscrutable import linear_programmes as programmes
from inscrutable.adversaries import near_optimal, plausibility
from inscrutable.geometry import cones, polytopes
from inscrutable.problems import newton, quadratic_programme, vertices

BELIEF = np.array([0.2, 0.3, 0.5])
PAIR = np.array([0.5, 0.5])


def market(size=5):
    rng = np.random.default_rng(4)
    factors = rng.normal(size=(3, size, size + 2))
    return MarkowitzProblem(0.1 * rng.normal(size=(3, size)), 0.05 * factors @ factors.transpose(0, 2, 1), 1.0)


def hidden(problem, belief=BELIEF, regret=0.002, method=None, **options):
    maker = CounterAdversarialDecisionMaker(problem, budget=Budget.regret(regret), method=method, **options)
    return maker.decide(belief).status


def choices():
    return FiniteProblem([[0.0, 4.0, 6.0], [8.0, 3.0, 2.0], [9.0, 6.0, 1.0]])


def unbounded():
    rng = np.random.default_rng(0)
    actions = rng.dirichlet(np.ones(4), 30)
    problem = market(4)
    maker = ProbabilisticDecisionMaker(problem, candidates=actions, budget=Budget.regret(0.01), on_empty="infinite")
    return maker.decide(BELIEF).status


def proved_lottery(problem):
    return ProbabilisticDecisionMaker(problem, budget=Budget.regret(0.01), certify=0.2).decide(BELIEF)


ENDS = {
    DecisionStatus.OPTIMAL: lambda: OriginalDecisionMaker(market()).decide(BELIEF).status,
    DecisionStatus.POLISHED: lambda: hidden(market()),
    DecisionStatus.PROVED: lambda: hidden(choices(), regret=4.0, method=GlobalSearch(certify=0.01)),
    DecisionStatus.GAP_REACHED: lambda: hidden(market(), method=GlobalSearch(certify=0.2, max_oracle_calls=4000)),
    DecisionStatus.BOUNDED: lambda: hidden(market(), method=GlobalSearch(certify=0.0001, max_oracle_calls=10)),
    DecisionStatus.BEST_CANDIDATE: lambda: hidden(choices(), regret=4.0),
    DecisionStatus.LOCAL_OPTIMUM: lambda: hidden(
        market(3), regret=0.05, method=LocalSearch(n_starts=4, rng=np.random.default_rng(0))
    ),
    DecisionStatus.NO_AFFORDABLE_PRIVACY: lambda: hidden(choices(), regret=0.0),
    DecisionStatus.NO_PLAUSIBLE_START: lambda: hidden(
        market(5), regret=1e-9, method=LocalSearch(n_starts=1, rng=np.random.default_rng(0))
    ),
    DecisionStatus.UNBOUNDED: unbounded,
    DecisionStatus.DRAWN: lambda: proved_lottery(market()).sample(rng=np.random.default_rng(0)).status,
    DecisionStatus.RULE_OF_THUMB: lambda: CoinDecisionMaker(market(), 0.5).decide(BELIEF).status,
}


@pytest.mark.parametrize("status", DecisionStatus)
def test_every_end_of_a_search_is_reached(status):
    assert ENDS[status]() is status


def with_no_minimum():
    return QuadraticProblem(np.zeros((2, 2, 2)), [[0, 1], [0, 2]], constraints=Polyhedron([[1, 0], [-1, 0]], [1, 0]))


def endless_vertices():
    table = vertices.VertexTable(np.array([[-1.0, 0.0]]), Polyhedron([[-1.0, 0.0], [0, -1.0], [0, 1]], [0, 0, 1]))
    table.solve(np.ones((1, 1)))


MODELS = {
    r"an empty range: swap the two": lambda: long_short(3, gross=1.5, net=(0.5, 0.2)),
    r"give a start inside their domain": lambda: ConvexProblem.from_functions(
        lambda u: np.array([np.inf, u[0]]), lambda u: np.zeros((2, 2)), simplex(2)
    ),
    r"the cost has no minimum over the feasible set: it is unbounded below along u\[1\]": lambda: (
        with_no_minimum().solve(PAIR)
    ),
    r"the cost has no minimum over the feasible set: \S": endless_vertices,
    r"the cost of state 0 has no minimum": lambda: LinearProblem([[-1.0, 0.0]], box([0, 0], [np.inf, 1])),
    r"covariances\[0\] is indefinite: smallest eigenvalue -1": lambda: MarkowitzProblem(
        np.zeros((1, 2)), [np.diag([1.0, -1.0])], 1.0
    ),
}


@pytest.mark.parametrize("message", MODELS)
def test_a_model_is_refused_by_name(message):
    with pytest.raises(ModelError, match=message):
        MODELS[message]()


def test_a_cost_without_end_in_cvxpy_is_named():
    cp = pytest.importorskip("cvxpy")
    u = cp.Variable(2)
    problem = ConvexProblem(u, [cp.exp(u[0]) - u[1], cp.exp(u[0]) - u[1]], Polyhedron([[-1.0, 0.0]], [1.0]))
    with pytest.raises(ModelError, match=r"the cost under belief .* has no minimum over the feasible set: add bounds"):
        problem.solve(PAIR)


def test_what_clarabel_leaves_open_is_named(monkeypatch):
    cp = pytest.importorskip("cvxpy")
    u = cp.Variable(2)
    problem = ConvexProblem(u, [cp.exp(u[0]), cp.exp(u[1])], simplex(2))

    def fails(self, **options):
        raise cp.error.SolverError("no progress")

    monkeypatch.setattr(cp.Problem, "solve", fails)
    with pytest.raises(SolverError, match=r"Clarabel failed for belief .*: no progress"):
        problem.solve(PAIR)
    monkeypatch.setattr(cp.Problem, "solve", lambda self, **options: u.save_value(None))
    with pytest.raises(SolverError, match="Clarabel ended with status None for belief"):
        problem.solve(PAIR)


def test_newtons_method_says_where_it_did_not_settle(monkeypatch):
    monkeypatch.setattr(newton, "_MOST_STEPS", 1)
    rates = np.array([[3.0, -1.0], [-2.0, 1.0]])
    problem = ConvexProblem.from_functions(
        lambda u: np.exp(rates * u).sum(axis=1), lambda u: rates * np.exp(rates * u), box([-9, -9], [9, 9])
    )
    with pytest.raises(SolverError, match=r"did not converge for belief \[0\.5 0\.5\]: its last step promised"):
        problem.solve(PAIR)


def test_a_quadratic_programme_that_is_not_solved_says_by_how_much(monkeypatch):
    monkeypatch.setattr(quadratic_programme, "_MOST_REPAIRS", -1)
    layout = quadratic_programme.layout_of(Polyhedron(np.vstack([-np.eye(2), [[1.0, 2.0]]]), [0, 0, 1]))
    working = quadratic_programme._Working(np.zeros(2, dtype=np.int8), np.zeros(1, dtype=bool))
    monkeypatch.setattr(quadratic_programme, "range", lambda most: [0], raising=False)
    with pytest.raises(SolverError, match=r"kept a KKT residual of \d"):
        quadratic_programme._repair(np.eye(2), np.array([-9.0, 1.0]), layout, working, np.zeros(2))


def test_cutting_planes_that_do_not_close_are_named(monkeypatch):
    problem = market(6)
    action = np.full(6, 1 / 6)
    monkeypatch.setattr(plausibility, "MOST_PLANES", 1)
    with pytest.raises(SolverError, match="the plausibility gap did not converge: between"):
        plausibility_gap(problem, action)
    monkeypatch.undo()
    near = near_optimal_beliefs(problem, problem.solve(BELIEF), 1e-4)
    monkeypatch.setattr(near_optimal, "MOST_PLANES", 0)
    with pytest.raises(
        SolverError, match=r"cutting planes for the near-optimal beliefs at regret 0\.0001 did not converge"
    ):
        near.nearest([1.0, 0.0, 0.0])


def test_linear_programmes_and_projections_that_fail_are_named(monkeypatch):
    with pytest.raises(SolverError, match="HiGHS found no optimum"):
        programmes.minimum(np.array([-1.0]))
    with pytest.raises(SolverError, match="projection on a belief set failed with DAQP exit flag"):
        polytopes.project_on_rows(np.array([[1.0], [-1.0]]), np.array([-1.0, -1.0]), np.zeros(1))
    failed = programmes.LinearAnswer(4, np.zeros(1), np.nan, np.zeros(0), "numerical trouble")
    monkeypatch.setattr(cones, "minimise", lambda *parts: failed)
    with pytest.raises(SolverError, match="the lines in a cone of multipliers were not found: numerical trouble"):
        cones._lineality(np.eye(3))


def test_a_goal_that_is_out_of_reach_at_any_price_is_said():
    assert hidden(FiniteProblem([[0.0], [1.0]]), PAIR, 10.0) is DecisionStatus.NO_AFFORDABLE_PRIVACY
    assert MaximalObfuscation().upper_bound(PAIR) > 0
