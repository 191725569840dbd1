"""Problems say by forms what they are: a user's own problem with a form is searched, proved and judged as the library's."""

import numpy as np
import pytest

from inscrutable import (
    ConvexProblem,
    CounterAdversarialDecisionMaker,
    DecisionProblem,
    DecisionStatus,
    DesiredObfuscation,
    FiniteProblem,
    GlobalSearch,
    KellyProblem,
    LinearProblem,
    MarkowitzProblem,
    MaximalObfuscation,
    PiecewiseLinearProblem,
    ProbabilisticDecisionMaker,
    QuadraticForm,
    QuadraticProblem,
    box,
    check_decision_problem,
    consistent_beliefs,
    decoy_grid,
    simplex,
    with_transaction_costs,
)
from sizes import audited, some

_RECOMPUTED = 1e-7  # between the stated privacy of a decision and the distance of its consistent set
GOALS = [MaximalObfuscation(), DesiredObfuscation([0.2, 0.2, 0.6])]


def market(rng, n_states=3, n_assets=5, cap=1.0):
    roots = rng.normal(size=(n_states, n_assets, n_assets)) / np.sqrt(n_assets)
    covariances = 0.01 * np.einsum("xij,xkj->xik", roots, roots) + 0.001 * np.eye(n_assets)
    region = simplex(n_assets) & box(np.zeros(n_assets), np.full(n_assets, cap))
    return MarkowitzProblem(rng.normal(0.01, 0.02, (n_states, n_assets)), covariances, 1.0, region)


class Own(DecisionProblem):
    """A problem that a user wrote around one of the library's; it may say what it is or not."""

    def __init__(self, inner, form=True):
        self.inner, self.form = inner, form
        self.constraints = inner.constraints

    @property
    def n_states(self):
        return self.inner.n_states

    def solve(self, beliefs):
        return self.inner.solve(beliefs)

    def state_costs(self, actions):
        return self.inner.state_costs(actions)

    def cost_gradients(self, action):
        return self.inner.cost_gradients(action)

    def quadratic_form(self):
        return self.inner.quadratic_form() if self.form else None

    def smooth_form(self):
        return self.inner.smooth_form()


def test_the_forms_of_the_librarys_problems():
    gains, chances = np.array([[[1.1, 0.9], [0.9, 1.2]]] * 2), np.full((2, 2), 0.5)
    plain = market(np.random.default_rng(0))
    trading = with_transaction_costs(plain, np.full(5, 0.2), linear=0.002)
    kinked = PiecewiseLinearProblem([[[1.0, 0.0], [0.0, 1.0]], [[2.0, 0.0]]], [[0.0, 0.0], [0.0]], simplex(2))
    flat = QuadraticProblem(np.zeros((2, 2, 2)), np.eye(2), constraints=simplex(2))
    stated = {
        plain: (True, False), trading: (True, False), flat: (True, True), kinked: (False, True),
        LinearProblem(np.eye(2), simplex(2)): (False, True), FiniteProblem(np.eye(2)): (False, True),
        KellyProblem(gains, chances): (False, False),
    }  # fmt: skip
    for problem, (quadratic, linear) in stated.items():
        assert (problem.quadratic_form() is not None, problem.linear_form() is not None) == (quadratic, linear)
        assert problem.smooth_form() is not None
    for problem in (trading, kinked, flat):
        check_decision_problem(problem)


@pytest.mark.parametrize("measure", GOALS, ids=["maximal", "desired"])
@pytest.mark.parametrize("form", [True, False])
def test_a_users_own_quadratic_problem_is_decided_as_the_librarys(fresh_rng, measure, form):
    problem = market(fresh_rng)
    own, belief = Own(problem, form), fresh_rng.dirichlet(np.ones(3))
    both = [decoy_grid(each, 12) for each in (problem, own)]
    for maker in (CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker):
        of_library, of_user = (
            maker(each, measure, candidates=candidates).decide(belief)
            for each, candidates in zip((problem, own), both, strict=True)
        )
        name = "privacy" if hasattr(of_user, "privacy") else "expected_privacy"
        if form:
            assert getattr(of_user, name) == pytest.approx(getattr(of_library, name), abs=1e-12)
        else:  # without the form candidates are polished and mixed, which finds no more
            assert getattr(of_user, name) <= getattr(of_library, name) + 1e-4
        assert of_user.problem is own


def test_a_form_is_proved_as_the_librarys_own(fresh_rng):
    problem, belief = market(fresh_rng, n_assets=4), fresh_rng.dirichlet(np.ones(3))
    certify = 0.01 if audited() else 0.1
    found = [
        CounterAdversarialDecisionMaker(
            each, candidates=decoy_grid(each, 12 if audited() else 6), method=GlobalSearch(certify=certify)
        ).decide(belief)
        for each in (problem, Own(problem))
    ]
    assert found[1].privacy_bound == pytest.approx(found[0].privacy_bound, abs=1e-9)
    assert found[1].oracle_calls == found[0].oracle_calls


def test_quadratic_costs_written_in_cvxpy_are_searched_as_such(fresh_rng):
    cp = pytest.importorskip("cvxpy")
    problem, u = market(fresh_rng, n_assets=4), cp.Variable(4)
    costs = [
        0.5 * cp.quad_form(u, cp.psd_wrap(h)) + g @ u for h, g in zip(problem.hessians, problem.linear, strict=True)
    ]
    written = ConvexProblem(u, costs, problem.constraints)
    belief = fresh_rng.dirichlet(np.ones(3))
    of_library, of_user = (
        CounterAdversarialDecisionMaker(each, candidates=decoy_grid(each, 12)).decide(belief)
        for each in (problem, written)
    )
    assert of_user.privacy == pytest.approx(of_library.privacy, abs=1e-7)


def formers(problem, rng):
    """Former decisions: all held, few held, at caps, a holding below the least one, one outside the caps."""
    size = problem.n_actions
    few = problem.solve(rng.dirichlet(np.ones(problem.n_states)))
    little = 0.5 * few + 0.5 / size
    little[0] = 3e-5
    outside = np.zeros(size)
    outside[1] = 1.0
    return {"all": 0.7 * few + 0.3 / size, "few": few, "little": little / little.sum(), "outside": outside}


def test_without_an_admissible_candidate_the_optimal_decision_is_kept():
    """Trades of half a basis point are below `min_slack`."""
    rng = np.random.default_rng(30)
    plain = market(rng, 2, 5, cap=0.6)
    former, rates = formers(plain, rng)["little"], rng.uniform(0.0, 0.01, 5) * (rng.uniform(size=5) > 0.2)
    problem = with_transaction_costs(plain, former, linear=rates + 0.001)
    belief, maker = rng.dirichlet(np.ones(2)), CounterAdversarialDecisionMaker(problem)
    assert not maker.candidates.usable.any()
    found = maker.decide(belief)
    assert found.status is DecisionStatus.NO_AFFORDABLE_PRIVACY
    np.testing.assert_array_equal(found.action, problem.solve(belief))


@pytest.mark.parametrize(("kind", "n_states"), some([("all", 3), ("few", 4), ("little", 3), ("outside", 2)], 3))
def test_trading_costs_are_searched_no_worse_than_by_candidates(fresh_rng, n_states, kind):
    plain = market(fresh_rng, n_states, 5, cap=0.6)
    former, rates = formers(plain, fresh_rng)[kind], fresh_rng.uniform(0.0, 0.01, 5) * (fresh_rng.uniform(size=5) > 0.2)
    problem = with_transaction_costs(plain, former, linear=rates + 0.001)
    check_decision_problem(problem, rng=fresh_rng)
    slow = Own(problem, form=False)
    for belief in fresh_rng.dirichlet(np.ones(n_states), 1):
        found = CounterAdversarialDecisionMaker(problem, candidates=decoy_grid(problem, 10)).decide(belief)
        tried = CounterAdversarialDecisionMaker(slow, candidates=decoy_grid(slow, 10)).decide(belief)
        lottery = ProbabilisticDecisionMaker(problem, candidates=decoy_grid(problem, 10)).decide(belief)
        assert found.privacy >= tried.privacy - 2e-3
        assert lottery.expected_privacy >= found.privacy - 1e-7
        assert found.regret <= 0.1 * abs(found.optimal_cost) + 1e-12
        assert found.privacy == pytest.approx(
            consistent_beliefs(problem, found.action).distance(belief), abs=_RECOMPUTED
        )
        for action, privacy in zip(lottery.actions, lottery.privacies, strict=True):
            assert privacy == pytest.approx(consistent_beliefs(problem, action).distance(belief), abs=_RECOMPUTED)


def test_a_wrong_form_is_found_out():
    problem = market(np.random.default_rng(1))

    class Wrong(Own):
        def quadratic_form(self):
            form = self.inner.quadratic_form()
            dearer = form.linear + np.array([0.0, 0.0, 0.0, 0.0, 0.01])
            return QuadraticForm(form.hessians, dearer, form.constants, form.constraints)

    with pytest.raises(AssertionError, match="quadratic_form has the costs of the problem"):
        check_decision_problem(Wrong(problem))
