"""Costs written in CVXPY or as functions: equal to the problems they restate, and explained where they have kinks."""

from __future__ import annotations

import numpy as np
import pytest

from inscrutable import (
    Budget,
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    InputError,
    KellyProblem,
    LinearProblem,
    ModelError,
    Polyhedron,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    box,
    check_decision_problem,
    consistent_beliefs,
    decoy_grid,
    simplex,
    simplex_grid,
)
from sizes import audited, instances, paired, some

cp = pytest.importorskip("cvxpy")

BELIEFS = np.vstack([simplex_grid(3, 3), np.random.default_rng(0).dirichlet(np.ones(3), 10)])


def quadratic_pair(rng):
    """A quadratic problem, and the same written in CVXPY."""
    factors = rng.normal(size=(3, 4, 6))
    hessians, linear, constants = factors @ factors.transpose(0, 2, 1), rng.normal(size=(3, 4)), rng.normal(size=3)
    u = cp.Variable(4)
    costs = [
        0.5 * cp.quad_form(u, cp.psd_wrap(h)) + g @ u + r for h, g, r in zip(hessians, linear, constants, strict=True)
    ]
    rows = [cp.sum(u) == 1, u >= 0, u[0] + u[1] <= 0.6]
    region = simplex(4) & Polyhedron([[1, 1, 0, 0]], [0.6])
    return QuadraticProblem(hessians, linear, constants, constraints=region), ConvexProblem(u, costs, rows)


@pytest.mark.parametrize("seed", range(5))
def test_a_restated_quadratic_problem_is_that_problem(seed):
    plain, written = quadratic_pair(np.random.default_rng(seed))
    np.testing.assert_allclose(written.solve(BELIEFS), plain.solve(BELIEFS), atol=1e-11)
    actions = plain.solve(BELIEFS)
    np.testing.assert_allclose(written.state_costs(actions), plain.state_costs(actions), atol=1e-12)
    np.testing.assert_allclose(written.cost_gradients(actions), plain.cost_gradients(actions), atol=1e-12)
    for belief, action in zip(BELIEFS[-4:], actions[-4:], strict=True):
        np.testing.assert_allclose(
            consistent_beliefs(written, action).bounds(), consistent_beliefs(plain, action).bounds(), atol=1e-8
        )
        assert consistent_beliefs(written, action).contains(belief)


def test_a_restated_quadratic_problem_is_hidden_alike():
    plain, written = quadratic_pair(np.random.default_rng(1))
    belief = np.array([0.5, 0.3, 0.2])
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        reached = [
            maker(problem, budget=Budget.regret(0.01), candidates=decoy_grid(problem, 40)).decide(belief)
            for problem in (plain, written)
        ]
        values = [each.privacy if hasattr(each, "privacy") else each.expected_privacy for each in reached]
        assert values[1] == pytest.approx(values[0], abs=1e-4)


def test_a_restated_linear_problem_is_that_problem():
    costs = np.random.default_rng(2).normal(size=(3, 4))
    u = cp.Variable(4, nonneg=True)
    written = ConvexProblem(u, [c @ u for c in costs], [cp.sum(u) == 1])
    np.testing.assert_allclose(written.solve(BELIEFS), LinearProblem(costs, simplex(4)).solve(BELIEFS), atol=1e-12)


def test_a_restated_growth_problem_is_that_problem():
    rng = np.random.default_rng(4)
    returns, shares = rng.lognormal(0, 0.4, (3, 5, 3)), rng.dirichlet(np.ones(5), 3)
    plain = KellyProblem(returns, shares)
    u = cp.Variable(3)
    written = ConvexProblem(u, [-p @ cp.log(r @ u) for r, p in zip(returns, shares, strict=True)], simplex(3))
    functions = ConvexProblem.from_functions(plain.state_costs, plain.cost_gradients, simplex(3))
    for problem in (written, functions):
        np.testing.assert_allclose(problem.solve(BELIEFS), plain.solve(BELIEFS), atol=1e-9)
    check_decision_problem(functions)
    candidates = plain.solve(simplex_grid(3, 6))
    reached = [
        CounterAdversarialDecisionMaker(problem, budget=Budget.regret(0.01), candidates=candidates).decide(
            [0.2, 0.3, 0.5]
        )
        for problem in (plain, functions)
    ]
    assert reached[1].privacy == pytest.approx(reached[0].privacy, abs=1e-6)
    action = plain.solve([0.2, 0.3, 0.5])
    np.testing.assert_allclose(written.cost_gradients(action), plain.cost_gradients(action), atol=1e-9)
    assert consistent_beliefs(written, action).contains([0.2, 0.3, 0.5])


def test_costs_with_kinks_are_explained_by_cutting_planes():
    """One coordinate, c(i,u) = |u − a_i|: u = a_1 is optimal exactly where the first state is at least as likely."""
    u = cp.Variable(1)
    problem = ConvexProblem(u, [cp.abs(u[0] - 1), cp.abs(u[0] + 1)], box([-2], [2]), differentiable=False)
    np.testing.assert_allclose(problem.solve([[0.8, 0.2], [0.1, 0.9]]), [[1], [-1]], atol=1e-6)
    found = consistent_beliefs(problem, [1.0])
    np.testing.assert_allclose(found.bounds(), [[0.5, 1], [0, 0.5]], atol=1e-5)
    middle = consistent_beliefs(problem, [0.3])
    np.testing.assert_allclose(middle.bounds(), [[0.5, 0.5], [0.5, 0.5]], atol=1e-5)
    decided = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(2.0), candidates=[[1.0], [0.3], [-1.0]]
    ).decide([0.8, 0.2])
    assert decided.privacy == pytest.approx(0.3 * np.sqrt(2), abs=1e-4)


def test_kinks_keep_their_promises():
    u = cp.Variable(2)
    costs = [cp.norm1(u - [1, 0]) + cp.sum_squares(u), cp.max(u) + cp.sum_squares(u - 1)]
    problem = ConvexProblem(u, costs, box([-2, -2], [2, 2]), differentiable=False)
    check_decision_problem(problem, tolerance=1e-6)  # as exact as an interior-point solver


def expressions(u):
    """Convex expressions of many atoms in a variable of three coordinates."""
    a = np.array([[1.0, -2.0, 0.5], [0.3, 0.4, 1.5]])
    return [
        cp.sum(cp.exp(a @ u)) + cp.square(u[0]),
        -np.array([0.4, 0.6]) @ cp.log(np.abs(a) @ u),
        cp.log_sum_exp(a @ u - 1) + 3,
        cp.sum(cp.logistic(u)) - cp.geo_mean(u),
        cp.quad_form(u, np.diag([1.0, 2, 3])) + cp.sum(cp.huber(u - 0.2, 0.1)),
        cp.norm(a @ u + 1) + cp.max(u) + cp.norm1(u - 0.05),
        cp.sum(cp.inv_pos(u + 1)) - 2 * cp.sum(cp.entr(u)),
        cp.sum(cp.multiply([1.0, 2, 3], cp.power(u, 1.5))) + 0.5 * (u[1] - u[2]),
        cp.maximum(u[0], 2 * u[1], 0.01) + cp.sum(cp.exp(cp.reshape(u[:2], (2, 1), order="F"))),
        cp.kl_div(u[0], 0.3) + cp.quad_over_lin(u, 2.0),
    ]


@pytest.mark.parametrize("number", range(10))
def test_values_and_gradients_are_those_that_cvxpy_gives(number):
    """CVXPY's own, at points inside and, where a domain ends, outside."""
    from inscrutable.problems.modelled import Modelled

    u = cp.Variable(3)
    cost = expressions(u)[number]
    model = Modelled(u, [cost], simplex(3))
    assert model._trees is not None
    points = np.vstack([np.random.default_rng(number).uniform(0.1, 1, (4, 3)), [[-0.5, 0.2, -0.3]]])
    with np.errstate(all="ignore"):
        values, slopes = model.values(points), model.gradients(points)
        for point, value, slope in zip(points, values, slopes, strict=True):
            u.save_value(point)
            try:
                found = cost.grad[u]
            except TypeError:  # outside a domain, CVXPY adds None to a matrix
                found = None
            np.testing.assert_allclose(value[0], np.float64(cost.value), rtol=1e-13)
            wanted = np.full(3, np.nan) if found is None else np.ravel(found.toarray())
            np.testing.assert_allclose(slope[0], wanted, rtol=1e-12, atol=1e-14)


def test_an_atom_that_behaves_otherwise_is_left_to_cvxpy(monkeypatch):
    from inscrutable.problems.modelled import Modelled

    def refused(self, values):
        return [np.zeros((3, 1))]

    u = cp.Variable(3)
    cost = cp.log_sum_exp(u)
    plain = Modelled(u, [cost], simplex(3))._slow_gradients(np.eye(3))
    odd = Modelled(u, [cost], simplex(3))
    slow = odd._slow_gradients
    monkeypatch.setattr(type(cost), "_grad", refused)
    monkeypatch.setattr(odd, "_slow_gradients", lambda points: plain if len(points) == 3 else slow(points) + 1.0)
    assert odd._trees is None
    np.testing.assert_array_equal(odd.gradients(np.eye(3)), plain)


def test_what_cannot_be_read_is_named():
    u, v = cp.Variable(2), cp.Variable(2)
    with pytest.raises(InputError, match="state 1 must be an expression that is convex"):
        ConvexProblem(u, [cp.sum(u), cp.log(u[0])], simplex(2))
    with pytest.raises(InputError, match="in the problem's variable alone"):
        ConvexProblem(u, [cp.sum(v)], simplex(2))
    with pytest.raises(InputError, match="must be affine or piecewise linear"):
        ConvexProblem(u, [cp.sum(u)], [cp.norm(u) <= 1])
    with pytest.raises(ModelError, match="no decision satisfies all constraints"):
        ConvexProblem(u, [cp.sum_squares(u)], [u >= 1, cp.sum(u) == 1])
    with pytest.raises(InputError, match="expected \\(X,\\) and \\(X, U\\)"):
        ConvexProblem.from_functions(lambda u: np.zeros(2), lambda u: np.zeros((2, 3)), simplex(2))
    with pytest.raises(InputError, match="shape \\(U,\\)"):
        ConvexProblem(cp.Variable((2, 2)), [cp.sum(u)], simplex(2))


def test_many_beliefs_are_solved_as_each_alone():
    """Together by Newton's method; ties, kinks and a wrong promise of smoothness are left to the interior point."""
    rng = np.random.default_rng(5)
    u = cp.Variable(3)
    rates = rng.normal(0.0, 1.0, (2, 4, 3))
    smooth = [cp.sum(cp.exp(each @ u)) for each in rates]
    tied = [cp.exp(u[0]), cp.exp(-u[0])]
    kinked = [cp.norm1(u - 0.3) + cp.sum_squares(u), cp.norm1(u - 0.4) + cp.sum_squares(u - 1)]
    beliefs = np.vstack([np.eye(2), rng.dirichlet(np.ones(2), 8)])
    for costs, accuracy in ((smooth, 1e-9), (tied, 1e-6), (kinked, 1e-6)):
        problem = ConvexProblem(u, costs, simplex(3))
        many, alone = problem.solve(beliefs), np.array([problem.solve(belief) for belief in beliefs])
        assert problem.constraints.violation(many).max() <= 1e-9
        values = [(beliefs * problem.state_costs(each)).sum(axis=1) for each in (many, alone)]
        np.testing.assert_allclose(values[0], values[1], atol=accuracy)
        if costs is smooth:
            np.testing.assert_allclose(many, alone, atol=1e-8)


def of_exponentials(rng, kind, size=4):
    """Costs of three states in CVXPY: strictly convex, or flat along many directions."""
    u, rates = cp.Variable(size), rng.normal(size=(3, 2 if kind.startswith("flat") else 6, size))
    atom = cp.log_sum_exp if kind.endswith("sums") else lambda inner: cp.sum(cp.exp(inner))
    return u, [atom(each @ u) + (0 if kind.startswith("flat") else 0.1 * cp.sum_squares(u)) for each in rates]


@pytest.mark.parametrize("kind", some(["exponentials", "log-sums", "flat log-sums", "flat exponentials"], 4))
def test_exponentials_are_solved_as_by_an_interior_point(kind, fresh_rng):
    u, costs = of_exponentials(fresh_rng, kind)
    problem = ConvexProblem(u, costs, simplex(4))
    beliefs = np.vstack([np.eye(3), fresh_rng.dirichlet(np.ones(3), 3)])[-instances(6, least=3) :]
    actions = problem.solve(beliefs)
    for belief, action in zip(beliefs, actions, strict=True):
        programme = cp.Problem(
            cp.Minimize(sum(p * c for p, c in zip(belief, costs, strict=True))), [u >= 0, cp.sum(u) == 1]
        )
        programme.solve(solver=cp.CLARABEL)
        assert belief @ problem.state_costs(action) <= programme.value + 1e-7
        np.testing.assert_allclose(problem.solve(belief), action, atol=1e-7)
        assert consistent_beliefs(problem, action).contains(belief)
    candidates = decoy_grid(problem, 8 if audited() else 4)
    assert len(candidates) == (45 if audited() else 15)
    found = CounterAdversarialDecisionMaker(problem, budget=0.1, candidates=candidates).decide([0.5, 0.3, 0.2])
    assert found.regret <= 0.1 * abs(found.optimal_cost) + 1e-12


@pytest.mark.parametrize(
    ("power", "least"), some([(1.5, 2.7 / 3.3), (2.5, 2.7 / 3.3), (3, 2.7 / 3.3), (4, 2.7 / 3.3)], 4)
)
def test_a_power_has_its_slope_at_zero(power, least):
    """At (1,0,0) the powers of the others have slope 0: π explains it where g(π)_0 is the least, by hand."""
    u = cp.Variable(3)
    first = np.array([[-0.4, 0.5, 0.2], [3.0, 0.2, 0.3]])
    curved = first - [[power, 0, 0], [power, 0, 0]]
    problem = ConvexProblem(u, [cp.sum(cp.power(u, power)) + each @ u for each in curved], simplex(3))
    np.testing.assert_allclose(problem.cost_gradients([1.0, 0.0, 0.0]), first, atol=1e-12)
    bounds = consistent_beliefs(problem, [1.0, 0.0, 0.0]).bounds()
    np.testing.assert_allclose(bounds, [[least, 1.0], [0.0, 1.0 - least]], atol=1e-9)
    inside = np.array([[0.2, 0.3, 0.5]])
    np.testing.assert_allclose(problem.cost_gradients(inside)[0], curved + power * inside ** (power - 1.0), atol=1e-12)
    check_decision_problem(problem)


@pytest.mark.parametrize("power", [1.5, 3.0])
def test_lower_partial_moments_are_costs(power):
    """Of outcomes above the threshold the shortfall is 0, where CVXPY has no slope of a power."""
    u, point = cp.Variable(2), np.array([0.6, 0.4])
    returns = np.array([[[0.1, 0.02], [-0.3, 0.01], [0.05, 0.0]], [[-0.2, 0.01], [0.2, 0.03], [0.3, 0.0]]])
    costs = [cp.sum(cp.power(cp.pos(0.02 - each @ u), power)) - each.mean(axis=0) @ u for each in returns]
    problem = ConvexProblem(u, costs, simplex(2))
    short = np.maximum(0.02 - returns @ point, 0.0)
    wanted = -power * np.einsum("xn,xnu->xu", short ** (power - 1.0), returns) - returns.mean(axis=1)
    np.testing.assert_allclose(problem.cost_gradients(point), wanted, atol=1e-12)
    optimum = problem.solve([0.5, 0.5])
    cp.Problem(cp.Minimize(sum(costs)), [cp.sum(u) == 1, u >= 0]).solve(solver=cp.CLARABEL)
    np.testing.assert_allclose(optimum, u.value, atol=1e-4)
    assert consistent_beliefs(problem, optimum).contains([0.5, 0.5])


@pytest.mark.parametrize(
    ("atom", "name"),
    [
        (lambda u: -cp.sum(cp.power(u, 0.5)), r"Power\w*\(.*0\.5\)"),
        (lambda u: cp.sum(cp.inv_pos(u)), r"Power\w*\(.*-1\.0\)"),
        (lambda u: -cp.sum(cp.log(u)), r"log\(\w+\)"),
    ],
)
def test_a_cost_without_a_slope_is_named_with_its_atom(atom, name):
    u = cp.Variable(2)
    costs = [cp.sum_squares(u), 2 * u[0] + atom(u)]
    problem = ConvexProblem(u, costs, simplex(2))
    with pytest.raises(ModelError, match=rf"state 1 has no finite slope at .*{name} has none there; .*lower bound"):
        consistent_beliefs(problem, [1.0, 0.0])
    safe = ConvexProblem(u, costs, simplex(2) & box([1e-6, 1e-6], [1.0, 1.0]))
    assert np.isfinite(safe.cost_gradients([1.0 - 1e-6, 1e-6])).all()
    belief = np.array([0.4, 0.6])
    assert consistent_beliefs(safe, safe.solve(belief)).contains(belief)
    written = ConvexProblem.from_functions(
        lambda v: np.array([v @ v, -np.sqrt(v).sum()]),
        lambda v: np.array([2 * v, -0.5 / np.sqrt(v)]),
        simplex(2),
    )
    with pytest.raises(ModelError, match=r"state 1 has no finite slope at .*gradients has none there"):
        consistent_beliefs(written, [1.0, 0.0])


@pytest.mark.parametrize(
    "attributes",
    [{"nonneg": True}, {"pos": True}, {"nonpos": True}, {"neg": True}, {"bounds": [-0.5, np.array([1.0, np.inf])]}],
)
@pytest.mark.parametrize("region", [box([-1, -1], [1.5, 1.5]), []])
def test_attributes_of_the_variable_bound_decisions(attributes, region):
    u = cp.Variable(2, **attributes)
    problem = ConvexProblem(u, [cp.sum_squares(u - 2), cp.sum_squares(u + 3)], region)
    for belief, aim in (([1.0, 0.0], 2.0), ([0.0, 1.0], -3.0)):
        ends = [] if isinstance(region, list) else [u >= -1, u <= 1.5]
        cp.Problem(cp.Minimize(cp.sum_squares(u - aim)), ends).solve(solver=cp.CLARABEL)
        np.testing.assert_allclose(problem.solve(belief), u.value, atol=1e-5)


@pytest.mark.parametrize("attribute", ["integer", "boolean", "complex", "imag"])
def test_decisions_with_gaps_are_refused(attribute):
    u = cp.Variable(2, **{attribute: True})
    with pytest.raises(InputError, match=f"attribute {attribute}"):
        ConvexProblem(u, [cp.sum(cp.real(u))], simplex(2))


def test_a_variable_with_fixed_zeros_is_refused():
    """Its attribute was ignored: entries fixed at zero were decided like the others."""
    u = cp.Variable(3, sparsity=[np.array([0, 1])])
    with pytest.raises(InputError, match=r"attribute sparsity: .*limits in `constraints`"):
        ConvexProblem(u, [cp.sum_squares(u - 1), cp.sum_squares(u - 2)], [u <= 3])


def test_kinks_are_seen_without_being_told():
    u = cp.Variable(2)
    kinked = [
        cp.norm1(u - 1),
        cp.exp(cp.abs(u[0])),
        cp.square(cp.pos(u[1])) + cp.norm(u - 0.5),
        -cp.min(u),
        cp.max(u),
        cp.sum_largest(u, 1),
        cp.norm(u, "inf"),
        cp.norm(cp.exp(u)),
    ]
    smooth = [cp.exp(u[0]), cp.norm(u), cp.norm1(cp.exp(u)), cp.log_sum_exp(u), cp.huber(u[0]), -cp.log(u[0] + 2)]
    for cost in kinked:
        assert not ConvexProblem(u, [cp.sum(cp.exp(u)), cost], simplex(2)).differentiable
        assert ConvexProblem(u, [cost], simplex(2), differentiable=True).differentiable
    for cost in smooth:
        assert ConvexProblem(u, [cost, cp.sum(u)], simplex(2)).differentiable
    assert not ConvexProblem(u, [cp.norm(u)], box([-1, -1], [1, 1])).differentiable


def test_least_absolute_deviations_need_no_word_about_their_kinks():
    """c(i,u) = |u_1 − a_i| + |u_2 − a_i|: both coordinates sit at the weighted median."""
    u = cp.Variable(2)
    problem = ConvexProblem(u, [cp.norm1(u - 1), cp.norm1(u + 1)], box([-2, -2], [2, 2]))
    solved = problem.solve([[0.8, 0.2], [0.1, 0.9], [0.55, 0.45]])
    np.testing.assert_allclose(solved, [[1, 1], [-1, -1], [1, 1]], atol=1e-6)
    np.testing.assert_allclose(consistent_beliefs(problem, [1.0, 1.0]).bounds(), [[0.5, 1], [0, 0.5]], atol=1e-5)


def test_pieces_of_hubers_function_are_not_taken_for_one_quadratic():
    """CVXPY counts it as quadratic, and each piece is: fitted at the origin, the costs were those of a line."""
    u = cp.Variable(1)
    costs = [cp.sum(cp.huber(u - 3, 0.1)), cp.sum(cp.huber(u + 3, 0.1))]
    problem = ConvexProblem(u, costs, [u >= -5, u <= 5])
    assert problem.quadratic_form() is None
    np.testing.assert_allclose(problem.state_costs([2.0]), [0.19, 0.99], atol=1e-12)
    assert problem.solve([1.0, 0.0])[0] == pytest.approx(3.0, abs=1e-6)


@pytest.mark.parametrize("scale", [1e-5, 1.0, 1e3])
def test_an_optimal_decision_is_explained_whatever_the_scale_of_costs_with_kinks(scale):
    for seed in range(instances(6)):
        rng, u = np.random.default_rng(seed), cp.Variable(3)
        costs = [scale * cp.max(rng.normal(size=(4, 3)) @ u + rng.normal(size=4)) for _ in range(3)]
        belief = rng.dirichlet(np.ones(3))
        problem = ConvexProblem(u, costs, [cp.sum(u) == 1, u >= 0])
        assert consistent_beliefs(problem, problem.solve(belief)).distance(belief) < 1e-4


@pytest.mark.parametrize(("unit", "level"), [(1e-6, 0.0), (1e3, 0.0), (1.0, 10.0), (1.0, -1e4), (1e-3, 1.0)])
def test_the_unit_and_level_of_costs_with_kinks_change_no_belief_that_explains_a_decision(unit, level):
    """Up to the accuracy of the solver, which the bounds of the beliefs show in their fourth digit."""
    u, aims = cp.Variable(2), [[0.3, 0.6], [0.5, 0.2], [0.8, 0.7]]
    found = []
    for factor, shift in ((1.0, 0.0), (unit, level)):
        costs = [factor * (cp.norm(u - aim) + cp.sum_squares(u)) + shift for aim in aims]
        problem = ConvexProblem(u, costs, box([-1, -1], [1, 1]))
        found.append(consistent_beliefs(problem, problem.solve([0.3, 0.4, 0.3])).bounds())
    np.testing.assert_allclose(*found, atol=1e-3)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_every_belief_explains_the_decision_of_all_states_at_no_cost(size, fresh_rng):
    """All costs have their minimum, zero, at one decision, which may be the solver's first point; no other is explained."""
    for aim in (np.full(3, 1.0 / 3.0), fresh_rng.dirichlet(np.ones(3))):
        u, first, second, third = cp.Variable(3), *(size * fresh_rng.uniform(0.2, 3.0, 3))
        off = u - aim
        costs = [first * cp.norm1(off), second * cp.max(cp.abs(off)), third * cp.norm(off)]
        problem = ConvexProblem(u, costs, simplex(3))
        assert all(consistent_beliefs(problem, aim).contains(belief) for belief in some(BELIEFS, 3))
        other = consistent_beliefs(problem, 0.9 * aim + [0.1, 0.0, 0.0])
        assert not any(other.contains(belief) for belief in some(BELIEFS, 3))


def test_costs_whose_size_differs_between_places_are_solved_as_well():
    """Nearly flat or very steep where the size is looked at, and of size one at the best decision."""
    u = cp.Variable(1)
    flat = [cp.sum(cp.exp(-100 * u)), cp.sum(cp.exp(-100 * u)) + 1e-3 * cp.sum(cp.abs(u - 0.02))]
    np.testing.assert_allclose(ConvexProblem(u, flat, [u >= 0, u <= 0.05]).solve([0.5, 0.5]), [0.05], atol=1e-6)
    steep = [cp.sum(cp.power(u - 40, 4)) + cp.sum(cp.abs(u - 41)), cp.sum(cp.power(u - 40, 4))]
    np.testing.assert_allclose(
        ConvexProblem(u, steep, [u >= -100, u <= 100]).solve([1.0, 0.0])[0], 40.0 + 0.25 ** (1 / 3), atol=1e-3
    )


def test_a_conditional_value_at_risk_is_solved_as_written_out() -> None:
    """The solver's compilation failed once the variable held a value."""
    u, rows = cp.Variable(2), np.array([[1.0, -0.5], [-2.0, 1.0], [0.3, 0.8], [-1.0, -1.0], [0.6, -1.2]])
    losses = rows @ u
    costs = [cp.cvar(losses, 0.7) + cp.sum_squares(u), cp.sum_squares(u - np.array([1.0, 0.0]))]
    problem = ConvexProblem(u, costs, [u >= 0, cp.sum(u) == 1])
    for belief in ([0.5, 0.5], [0.8, 0.2]):
        found = problem.solve(belief)
        trials = np.linspace(0.0, 1.0, 20_001)
        points = np.column_stack([trials, 1.0 - trials])
        largest = np.sort(points @ rows.T, axis=1)[:, ::-1]
        shortfall = (largest[:, 0] + 0.5 * largest[:, 1]) / 1.5  # the worst .3 of five: one and a half
        values = belief[0] * (shortfall + (points**2).sum(axis=1))
        values += belief[1] * ((points - [1.0, 0.0]) ** 2).sum(axis=1)
        np.testing.assert_allclose(found, points[values.argmin()], atol=1e-3)
        assert belief @ problem.state_costs(found) == pytest.approx(values.min(), abs=1e-6)


@pytest.mark.parametrize(
    ("kind", "variable"),
    paired(["kinks", "exponential", "logarithm", "tail"], [{}, {"nonneg": True}, {"bounds": [0.0, 9.0]}]),
    ids=str,
)
def test_one_cone_programme_for_all_beliefs_solves_as_cvxpy_does(kind, variable, fresh_rng):
    """Its data are linear in the belief: costs are those of a problem that CVXPY compiles for one belief alone."""
    u, wanted = cp.Variable(2, **variable), fresh_rng.uniform(3.0, 8.0, (3, 2))
    costs = {
        "kinks": lambda d: cp.sum(cp.pos(u - d)) + 3.0 * cp.sum(cp.pos(d - u)) + 0.05 * cp.sum_squares(u),
        "exponential": lambda d: cp.sum(cp.exp(0.2 * (d - u))) + 0.1 * cp.sum(u),
        "logarithm": lambda d: -cp.sum(cp.log(u + d)) + 0.2 * cp.sum(u),
        "tail": lambda d: cp.cvar(cp.hstack([d[0] - u[0], d[1] - u[1], u[0] - d[1]]), 0.5) + 0.02 * cp.sum_squares(u),
    }[kind]
    rows = [u >= 0, cp.sum(u) <= 14]
    problem = ConvexProblem(u, [costs(d) for d in wanted], rows)
    assert problem._model._cones is not None
    for belief in [*np.eye(3), *fresh_rng.dirichlet(np.ones(3), instances(5, least=1))]:
        found = problem.optimal_cost(belief)
        u.save_value(None)  # by which CVXPY compiles a sum of the largest
        alone = cp.Problem(cp.Minimize(sum(p * costs(d) for p, d in zip(belief, wanted, strict=True))), rows)
        assert found == pytest.approx(alone.solve(solver=cp.CLARABEL), abs=2e-6)


def test_without_the_parts_of_cvxpy_that_are_its_own_costs_are_solved_by_it_alone(monkeypatch, fresh_rng):
    def renamed(*_):
        raise AttributeError("var_id_to_col")

    wanted, beliefs = fresh_rng.uniform(3.0, 8.0, (3, 2)), fresh_rng.dirichlet(np.ones(3), 4)
    u = cp.Variable(2)
    costs = [cp.sum(cp.pos(u - d)) + 3.0 * cp.sum(cp.pos(d - u)) for d in wanted]
    first, second = (ConvexProblem(u, costs, [u >= 0, cp.sum(u) <= 14]) for _ in range(2))
    found = first.optimal_cost(beliefs)
    monkeypatch.setattr("inscrutable.problems.modelled.cone_programme", renamed)
    assert second.optimal_cost(beliefs) == pytest.approx(found, abs=2e-6)
    assert second._model._cones is None


def test_costs_that_are_flat_along_the_budget_line_keep_the_solvers_optimum():
    """Newton's step there is the rounding of a slope divided by the damping: it went to a corner, .5 above the optimum."""
    u = cp.Variable(2)
    costs = [cp.sum(cp.huber(u - [-0.5, 0.5], 0.25)), cp.sum_squares(u - 0.5)]
    problem = ConvexProblem(u, costs, [cp.sum(u) == 1, u >= 0])
    line = np.linspace(0.0, 1.0, 10_001)
    costs_there = problem.state_costs(np.column_stack([line, 1.0 - line]))
    for share in np.linspace(0.0, 1.0, 11):
        belief = np.array([share, 1.0 - share])
        assert problem.optimal_cost(belief) == pytest.approx((costs_there @ belief).min(), abs=1e-7)
    assert problem.regret([1.0, 0.0], [1.0, 0.0]) == pytest.approx(0.5, abs=1e-7)


def test_a_cost_of_which_cvxpy_knows_no_slope_is_named():
    u = cp.Variable(3)
    with pytest.raises(ModelError, match=r"knows no slope of the cost of state 1, norm_inf\(.*max\(abs\(x\)\)"):
        ConvexProblem(u, [cp.sum_squares(u - 0.3), cp.norm_inf(u - 0.1)], [cp.sum(u) == 1, u >= 0]).solve([0.5, 0.5])


@pytest.mark.parametrize("size", [1e-5, 1.0, 1e9])
def test_a_cost_without_a_minimum_has_no_decision(size):
    """Clarabel calls both solved: the first beside the exponentials of the other state, the second at 1e14."""
    u = cp.Variable(2)
    falling = [size * cp.sum(cp.exp(u)), size * (cp.exp(u[0]) - u[1])], [u >= -100]
    logarithms = [size * cp.sum_squares(u), -size * cp.sum(cp.log(u))], [u >= 0]
    for costs, rows in (falling, logarithms):
        problem = ConvexProblem(u, costs, rows)
        assert np.isfinite(problem.solve([0.5, 0.5])).all()
        with pytest.raises(ModelError, match=r"belief \[0\. 1\.\]"):
            problem.solve([0.0, 1.0])


def test_one_constraint_needs_no_list():
    u = cp.Variable(2)
    costs = [cp.sum_squares(u - [1, 0]), cp.sum_squares(u - [0, 1])]
    np.testing.assert_allclose(ConvexProblem(u, costs, cp.sum(u) == 1).solve([0.3, 0.7]), [0.3, 0.7], atol=1e-9)
    with pytest.raises(InputError, match="constraints has 1, expected constraints of CVXPY"):
        ConvexProblem(u, costs, 1)


def test_a_decision_at_the_end_of_a_cost_s_domain_is_one():
    """Beyond the domain CVXPY's values of `inv_pos` are negative, and the other state's cost falls on."""
    u = cp.Variable(1)
    costs = [cp.sum(cp.exp(u)) + 1e-3 * cp.sum(u), cp.sum(cp.inv_pos(u + 2.0)) + 1e-3 * cp.sum_squares(u)]
    assert ConvexProblem(u, costs, [u <= 9]).solve([1.0, 0.0])[0] == pytest.approx(-2.0, abs=1e-3)


def test_functions_are_called_at_no_decision_where_there_is_none():
    problem = ConvexProblem.from_functions(
        lambda u: np.array([u @ u, u[0]]), lambda u: np.array([2 * u, [1.0, 0.0]]), simplex(2)
    )
    none = np.empty((0, 2))
    assert problem.state_costs(none).shape == (0, 2)
    assert problem.cost_gradients(none).shape == (0, 2, 2)
    assert problem.solve(none).shape == (0, 2)


def finite_beyond_its_domain(u, kind):
    """Costs with finite values where CVXPY calls them infinite; the least ones are inside the domain or at its end."""
    return {
        "cube": cp.power(u[0], 3) + 0.1 * u[0],
        "reciprocal": cp.inv_pos(u[0]) + u[0],
        "square of the reciprocal": cp.power(u[0], -2) + u[0],
        "quotient": cp.quad_over_lin(1, u[0]) + u[0],
        "power 3/2": cp.power(u[0], 1.5) + 0.2 * u[0],
    }[kind]


@pytest.mark.parametrize("kind", ["cube", "reciprocal", "square of the reciprocal", "quotient", "power 3/2"])
def test_decisions_are_within_the_domain_of_the_costs(kind):
    u = cp.Variable(1)
    cost = finite_beyond_its_domain(u, kind)
    problem = ConvexProblem(u, [cost, cost - 0.7 * u[0]], [u >= -1, u <= 2])
    assert not problem.is_admissible(np.array([-0.5]))
    with pytest.raises(InputError, match="outside the feasible set"):
        problem.regret([1.0, 0.0], [-0.5])
    for belief in ([0.5, 0.5], [1.0, 0.0], [0.0, 1.0]):
        expected = cp.Problem(cp.Minimize(cost - 0.7 * belief[1] * u[0]), [u >= -1, u <= 2])
        expected.solve(solver=cp.CLARABEL)
        assert problem.optimal_cost(belief) == pytest.approx(expected.value, abs=1e-7)
        assert consistent_beliefs(problem, problem.solve(belief)).contains(belief)


def test_ends_of_a_domain_that_the_constraints_imply_are_no_rows():
    u = cp.Variable(2)
    costs = [cp.inv_pos(u[0] + 1.0) + cp.power(cp.sum(u), 1.5), cp.sum_squares(u) + cp.inv_pos(3.0 - u[0] - u[1])]
    assert len(ConvexProblem(u, costs, [cp.sum(u) == 1, u >= 0]).constraints.b_ub) == 2
    assert len(ConvexProblem(u, costs, [u >= 0]).constraints.b_ub) == 3


def test_costs_that_are_no_list_of_expressions_are_named():
    u = cp.Variable(2)
    for given in (cp.sum(u), u, cp.hstack([cp.sum(u), u[0]]), {"calm": cp.sum(u)}, 1.0):
        with pytest.raises(InputError, match="costs must be a list with one expression of CVXPY per state, got "):
            ConvexProblem(u, given, simplex(2))
    for given in (cp.Minimize(cp.sum(u)), cp.Maximize(cp.sum(u)), 1.0, "u"):
        with pytest.raises(InputError, match="the cost of state 1 must be an expression of CVXPY, got "):
            ConvexProblem(u, [cp.sum(u), given], simplex(2))


@pytest.mark.parametrize(
    ("atom", "of"),
    [
        (cp.huber, lambda u: cp.huber(u, 0.3)),
        (cp.kl_div, lambda u: cp.kl_div(u + 1.0, 0.3)),
        (cp.maximum, lambda u: cp.maximum(cp.square(u), u, 0.1)),
    ],
)
def test_atoms_that_act_entry_by_entry_are_computed_for_all_decisions_at_once(atom, of, monkeypatch):
    u, calls, numeric = cp.Variable(3), [], atom.numeric
    problem = ConvexProblem(u, [cp.sum(of(u)), cp.sum(u)], simplex(3))
    points = np.random.default_rng(0).dirichlet(np.ones(3), 50)
    problem.state_costs(points)
    monkeypatch.setattr(atom, "numeric", lambda self, values: calls.append(1) or numeric(self, values))
    found = problem.state_costs(points)
    assert len(calls) == 1
    for point, costs in zip(points, found, strict=True):
        u.save_value(point)
        np.testing.assert_allclose(costs, [cp.sum(of(u)).value, 1.0], rtol=1e-13)


def test_pieces_of_hubers_function_have_their_slopes_at_once(monkeypatch):
    u, calls, slope = cp.Variable(3), [], cp.huber._grad
    problem = ConvexProblem(u, [cp.sum(cp.huber(u - 0.2, 0.3)), cp.sum(u)], simplex(3))
    points = np.random.default_rng(0).dirichlet(np.ones(3), 50)
    problem.cost_gradients(points)
    monkeypatch.setattr(cp.huber, "_grad", lambda self, values: calls.append(1) or slope(self, values))
    np.testing.assert_allclose(problem.cost_gradients(points)[:, 0], 2.0 * np.clip(points - 0.2, -0.3, 0.3), atol=1e-15)
    assert not calls
