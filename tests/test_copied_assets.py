"""Markets in which decisions or states are not told apart: what is stated is what an observer finds from the decision.

With copies of an asset, or two riskless ones, a belief has many optimal decisions on one face; with identical states many
beliefs have one decision.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from inscrutable import (
    Budget,
    Candidates,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    DesiredObfuscation,
    GlobalSearch,
    KellyProblem,
    MarkowitzProblem,
    MaximalObfuscation,
    Polyhedron,
    PrivacyMeasure,
    ProbabilisticDecisionMaker,
    QuadraticProblem,
    box,
    consistent_beliefs,
    decoy_grid,
    group_caps,
    max_weights,
    privacy_frontier,
    simplex,
)
from inscrutable.problems.copied_coordinates import merged_copies
from sizes import instances, some

Array = NDArray[np.float64]
Moments = tuple[Array, Array]  # means (X,U), covariances (X,U,U)

STATED = 1e-6  # distances to a set, by the search and by the adversary
ROUNDING = 1e-13  # of a cost, relative to its largest term
SAVED = 1e-9  # of privacy: the share of a budget that a lottery leaves unspent
BUDGETS = [0.0, 0.02, 0.1, 1.0]


def copied(moments: Moments, asset: int, of: int, state: int | slice = slice(None)) -> Moments:
    means, covariances = (part.copy() for part in moments)
    means[state, asset] = means[state, of]
    covariances[state, asset, :] = covariances[state, of, :]
    covariances[state, :, asset] = covariances[state, :, of]
    return means, covariances


def riskless(moments: Moments, asset: int, mean: float | None, state: int | slice = slice(None)) -> Moments:
    means, covariances = (part.copy() for part in moments)
    covariances[state, asset, :] = 0.0
    covariances[state, :, asset] = 0.0
    if mean is not None:
        means[state, asset] = mean
    return means, covariances


def all_copies(moments: Moments) -> Moments:
    for asset in range(1, moments[0].shape[1]):
        moments = copied(moments, asset, 0)
    return moments


def one_pair(moments: Moments) -> Moments:
    return copied(moments, moments[0].shape[1] - 1, 0)


def two_pairs(moments: Moments) -> Moments:
    last = moments[0].shape[1] - 1
    return copied(copied(moments, last, 0), last - 1, 1) if last > 2 else one_pair(moments)


def pair_in_one_state(moments: Moments) -> Moments:
    return copied(moments, moments[0].shape[1] - 1, 0, 0)


def mixed_of_two(moments: Moments) -> Moments:
    """The last asset is half of each of the first two: a copy of a portfolio."""
    size = moments[0].shape[1]
    held = np.eye(size)
    if size > 2:
        held[-1] = 0.0
        held[-1, :2] = 0.5
    return moments[0] @ held.T, held @ moments[1] @ held.T


def same_states(moments: Moments) -> Moments:
    which = np.arange(len(moments[0]))
    which[-1] = 0
    return moments[0][which], moments[1][which]


def one_riskless(moments: Moments) -> Moments:
    return riskless(moments, 0, 0.02)


def two_riskless(moments: Moments) -> Moments:
    return riskless(one_riskless(moments), moments[0].shape[1] - 1, 0.02)


def riskless_in_one_state(moments: Moments) -> Moments:
    return riskless(moments, 0, None, 0)


def pair_and_same_states(moments: Moments) -> Moments:
    return one_pair(same_states(moments))


KINDS: list[Callable[[Moments], Moments]] = [
    all_copies,
    one_pair,
    two_pairs,
    pair_in_one_state,
    mixed_of_two,
    same_states,
    one_riskless,
    two_riskless,
    riskless_in_one_state,
    pair_and_same_states,
]


def market(
    rng: np.random.Generator, n_states: int, n_assets: int, kind: Callable[[Moments], Moments]
) -> MarkowitzProblem:
    factors = 0.3 * rng.normal(size=(n_states, n_assets, n_assets + 2))
    covariances = factors @ factors.transpose(0, 2, 1) / n_assets + 0.01 * np.eye(n_assets)
    return MarkowitzProblem(*kind((rng.normal(0.05, 0.2, (n_states, n_assets)), covariances)), 2.0)


def drawn_beliefs(rng: np.random.Generator, n_states: int) -> Array:
    """An interior belief, a lopsided one, one with an impossible state, and a corner."""
    impossible = rng.dirichlet(np.ones(n_states))
    impossible[rng.integers(n_states)] = 0.0
    corner = np.eye(n_states)[rng.integers(n_states)]
    lopsided = rng.dirichlet(np.full(n_states, 0.2)) + 1e-9
    return np.array(
        [rng.dirichlet(np.ones(n_states)), lopsided / lopsided.sum(), impossible / impossible.sum(), corner]
    )


class Told:
    """What a decision maker states of its decisions for some beliefs, to be compared with the decisions."""

    def __init__(self, problem: MarkowitzProblem, measure: PrivacyMeasure, budget: float) -> None:
        self.problem, self.measure, self.budget = problem, measure, budget
        self.scale = max(float(np.abs(part).max()) for part in (problem.hessians, problem.linear))

    def check(self, belief: Array, atoms: list[tuple[float, Array, float, float]]) -> float:
        """Check atoms (probability, decision, privacy, regret) of one belief; returns the expected privacy."""
        problem = self.problem
        for _, action, privacy, regret in atoms:
            assert problem.constraints.violation(action) <= 1e-9
            found = consistent_beliefs(problem, action)
            assert privacy == pytest.approx(self.measure(belief, found), abs=STATED)
            assert regret == pytest.approx(float(problem.regret(belief, action)), abs=ROUNDING * self.scale)
        limit = self.budget * abs(float(problem.optimal_cost(belief)))
        assert sum(share * regret for share, _, _, regret in atoms) <= limit + ROUNDING * self.scale
        return sum(share * privacy for share, _, privacy, _ in atoms)

    def check_all(self, beliefs: Array, candidates: Candidates) -> None:
        """Check single and mixed decisions, one by one and together: a lottery is never worse than one decision."""
        chosen = (self.problem, self.measure, self.budget)
        single = CounterAdversarialDecisionMaker(*chosen, candidates=candidates)
        mixed = ProbabilisticDecisionMaker(*chosen, candidates=candidates)
        singles, lotteries = single.decide_many(beliefs), mixed.decide_many(beliefs)
        for t, belief in enumerate(beliefs):
            alone = self.check(belief, [(1.0, d.action, d.privacy, d.regret) for d in [single.decide(belief)]])
            self.check(belief, [(1.0, d.action, d.privacy, d.regret) for d in [singles[t]]])
            one, many = mixed.decide(belief), lotteries[t]
            assert one.expected_privacy >= alone - SAVED
            for lottery in (one, many):
                atoms = zip(lottery.probabilities, lottery.actions, lottery.privacies, lottery.regrets, strict=True)
                expected = self.check(belief, list(atoms))
                assert lottery.expected_privacy == pytest.approx(expected, abs=1e-12)


def cases() -> Iterator[object]:
    for number, kind in enumerate(KINDS):
        for n_states in (2, 3, 4):
            for n_assets in (2, 3, 5):
                budget = BUDGETS[(number + n_states + n_assets) % len(BUDGETS)]
                name = f"{kind.__name__}-{n_states}-{n_assets}-{budget}"
                yield pytest.param(kind, n_states, n_assets, budget, id=name)


@pytest.mark.parametrize(("kind", "n_states", "n_assets", "budget"), some(list(cases()), 10))
def test_what_is_stated_is_found_from_the_decision(
    kind: Callable[[Moments], Moments], n_states: int, n_assets: int, budget: float
) -> None:
    rng = np.random.default_rng([n_states, n_assets, KINDS.index(kind)])
    problem, beliefs = market(rng, n_states, n_assets, kind), drawn_beliefs(rng, n_states)
    candidates = decoy_grid(problem, 6)
    desired = DesiredObfuscation(rng.dirichlet(np.ones(n_states)))
    few = 2 if n_states < 4 else 3  # every so many of the beliefs: more states take longer
    Told(problem, MaximalObfuscation(), budget).check_all(beliefs[::few], candidates)
    Told(problem, desired, budget).check_all(beliefs[1::few], candidates)


@pytest.mark.parametrize("budget", BUDGETS)
def test_assets_that_are_all_copies_hide_everything_and_nothing(budget: float) -> None:
    """Every belief explains every decision: no distance from the truth, none to a target."""
    means = np.repeat([[0.31275401], [0.40993904], [0.10545302]], 2, axis=1)
    variances = np.array([0.02454563, 0.15438926, 0.16572241])
    problem = MarkowitzProblem(means, variances[:, None, None] * np.ones((3, 2, 2)), 2.910885061964363)
    belief, candidates = np.array([0.12244196, 0.5, 0.37755804]), decoy_grid(problem, 15)
    for measure in (MaximalObfuscation(), DesiredObfuscation([0.6, 0.3, 0.1])):
        Told(problem, measure, budget).check_all(belief[None], candidates)
        mixed = ProbabilisticDecisionMaker(problem, measure, budget, candidates=candidates).decide(belief)
        assert mixed.privacies == pytest.approx(0.0, abs=STATED)
        assert consistent_beliefs(problem, mixed.actions[0]).dimension == 2


@pytest.mark.parametrize("n_states", [2, 3, 4])
def test_a_lottery_keeps_the_very_decision_of_the_single_one(n_states: int) -> None:
    """A decoy that has many decisions does not lead back to the one that was chosen: regrets follow the decision."""
    for seed in range(instances(3, least=1)):
        rng = np.random.default_rng([seed, n_states])
        problem, beliefs = market(rng, n_states, 5, two_pairs), drawn_beliefs(rng, n_states)
        Told(problem, MaximalObfuscation(), 0.02).check_all(beliefs[:1], decoy_grid(problem, 4))


@pytest.mark.parametrize("n_states", some([3, 2, 4], 3))
@pytest.mark.parametrize("seed", range(instances(3, least=1)))
def test_copies_away_from_all_bounds_leave_a_decision_as_private_as_a_candidate(n_states: int, seed: int) -> None:
    """Decisions are tied inside the box: a face on which nothing climbs still has its candidates."""
    rng = np.random.default_rng([41, seed])
    roots, linear, twice = rng.normal(size=(n_states, 2, 2)), 0.3 * rng.normal(size=(n_states, 2)), [0, 1, 1]
    hessians = (roots @ roots.swapaxes(1, 2) + 0.05 * np.eye(2))[:, twice][:, :, twice]
    problem = QuadraticProblem(hessians, linear[:, twice], constraints=box([-1] * 3, [1] * 3))
    belief, candidates = rng.dirichlet(np.ones(n_states)), decoy_grid(problem, 12 if n_states < 4 else 8)
    regrets = problem.regret(belief, candidates.actions)
    affordable = (regrets <= np.quantile(regrets, 0.3)) & candidates.usable
    budget = Budget.regret(float(np.quantile(regrets, 0.3)))
    target = np.eye(n_states)[0]
    for measure in (MaximalObfuscation(), DesiredObfuscation(target)):
        best = max(
            measure(belief, consistent_beliefs(problem, action)) for action in candidates.actions[affordable][::3]
        )
        maker = CounterAdversarialDecisionMaker(problem, measure, budget, candidates=candidates)
        decided = maker.decide(belief)
        assert decided.privacy >= best - STATED
        assert decided.privacy == pytest.approx(
            measure(belief, consistent_beliefs(problem, decided.action)), abs=STATED
        )
        assert maker.decide_many([belief]).privacy[0] == pytest.approx(decided.privacy, abs=STATED)
        mixed = ProbabilisticDecisionMaker(problem, measure, budget, candidates=candidates).decide(belief)
        assert mixed.expected_privacy >= decided.privacy - SAVED


def doubled(problem: QuadraticProblem, twice: list[int], constraints: Polyhedron) -> QuadraticProblem:
    """The problem with its coordinates repeated, as often and in the order of `twice`."""
    return QuadraticProblem(problem.hessians[:, twice][:, :, twice], problem.linear[:, twice], constraints=constraints)


@pytest.mark.parametrize("toward", [False, True])
@pytest.mark.parametrize(("n_states", "n_assets"), some([(2, 3), (3, 3), (3, 5), (4, 4)], 2))
def test_a_market_with_copies_hides_as_much_as_the_one_without(n_states: int, n_assets: int, toward: bool) -> None:
    rng = np.random.default_rng([7, n_states, n_assets])
    plain = market(rng, n_states, n_assets, lambda moments: moments)
    beliefs = drawn_beliefs(rng, n_states)[:6]
    measure = DesiredObfuscation(np.eye(n_states)[0]) if toward else MaximalObfuscation()
    more = doubled(plain, [0, *range(n_assets), 0, n_assets - 1], simplex(n_assets + 3))
    for budget in (0.02, 0.3):
        found = []
        for problem in (plain, more):
            maker = CounterAdversarialDecisionMaker(problem, measure, budget, candidates=decoy_grid(problem, 20))
            mixer = ProbabilisticDecisionMaker(problem, measure, budget, candidates=maker.candidates)
            found.append([maker.decide_many(beliefs).privacy, mixer.decide_many(beliefs).expected_privacy])
            assert maker.decide(beliefs[0]).privacy == pytest.approx(found[-1][0][0], abs=STATED)
        np.testing.assert_allclose(found[0], found[1], rtol=0.0, atol=STATED)


def test_a_frontier_with_copies_is_the_one_without() -> None:
    rng = np.random.default_rng(8)
    plain = market(rng, 3, 3, lambda moments: moments)
    regrets, curves = np.linspace(0.0, 0.01, 5), []
    for problem in (plain, doubled(plain, [0, 1, 2, 2], simplex(4))):
        frontier = privacy_frontier(problem, [0.2, 0.3, 0.5], candidates=decoy_grid(problem, 20))
        curves.append([frontier.deterministic(regrets), frontier.randomized(regrets)])
    np.testing.assert_allclose(*curves, atol=STATED)


def test_what_tells_copies_apart_keeps_them_apart() -> None:
    rng = np.random.default_rng(9)
    problem = market(rng, 3, 3, one_pair)
    hessians, linear = problem.hessians, problem.linear

    def kept(constraints: Polyhedron, more: Array = linear) -> list[int] | None:
        merged = merged_copies(np.vstack([*hessians, more]), constraints)
        return None if merged is None else merged.kept.tolist()

    assert kept(simplex(3)) == [0, 1]
    assert kept(simplex(3) & Polyhedron([[1.0, 0.5, 1.0]], [0.8])) == [0, 1]
    assert kept(simplex(3) & group_caps(["a", "b", "c"], {"both": ["a", "c"]}, 0.6)) == [0, 1]
    for limit in (max_weights(3, [0.5, 0.5, 0.5]), Polyhedron([[1.0, 0.5, 0.0]], [0.8])):
        assert kept(simplex(3) & limit) is None
    assert kept(box([-1, -1, -1], [1, 1, 1])) is None
    assert kept(Polyhedron(-np.eye(3), [0.0, 0.0, 0.1])) is None
    assert kept(simplex(3), np.add(linear, [0.0, 0.0, 1e-3])) is None


@pytest.mark.parametrize("seed", range(4))
def test_what_is_solved_without_copies_is_optimal_with_them(seed: int) -> None:
    rng = np.random.default_rng([10, seed])
    plain = market(rng, 3, 3, lambda moments: moments)
    beliefs = drawn_beliefs(rng, 3)
    group = Polyhedron([[1.0, 1.0, 0.0]], [0.6])
    few = QuadraticProblem(plain.hessians, plain.linear, constraints=simplex(3) & group)
    many = doubled(plain, [0, 0, 1, 2, 2], simplex(5) & Polyhedron([[1.0, 1.0, 1.0, 0.0, 0.0]], [0.6]))
    solved = many.solve(beliefs)
    assert (solved[:, [1, 4]] == 0.0).all()
    assert many.constraints.violation(solved).max() <= 1e-9
    np.testing.assert_allclose(many.optimal_cost(beliefs), few.optimal_cost(beliefs), rtol=0.0, atol=1e-12)


@pytest.mark.parametrize(("n_states", "n_assets"), some([(3, 3), (4, 4)], 2))
def test_a_proof_with_copies_is_the_one_without(n_states: int, n_assets: int) -> None:
    rng = np.random.default_rng([7, n_states, n_assets])
    plain = market(rng, n_states, n_assets, lambda moments: moments)
    belief, proved, mixed = drawn_beliefs(rng, n_states)[1], [], []
    for problem in (plain, doubled(plain, [0, *range(n_assets)], simplex(n_assets + 1))):
        few = {"candidates": decoy_grid(problem, 20)}
        method = GlobalSearch(certify=0.01)
        proved.append(CounterAdversarialDecisionMaker(problem, budget=0.05, method=method, **few).decide(belief))
        mixed.append(ProbabilisticDecisionMaker(problem, budget=0.05, certify=0.01, **few).decide(belief))
    assert proved[0].oracle_calls == proved[1].oracle_calls
    assert proved[0].privacy_bound == pytest.approx(proved[1].privacy_bound, abs=STATED)
    assert mixed[0].privacy_bound == pytest.approx(mixed[1].privacy_bound, abs=STATED)
    for found in (*proved, *mixed):
        assert found.status in (DecisionStatus.GAP_REACHED, DecisionStatus.PROVED)


def grown(seed: int, twice: list[int], constraints: Polyhedron | None = None) -> KellyProblem:
    """A growth problem of three assets, repeated as often and in the order of `twice`; impossible outcomes differ in copies."""
    rng = np.random.default_rng([11, seed])
    returns, chances = rng.lognormal(0.0, 0.3, (3, 4, 3)), rng.dirichlet(np.ones(4), 3)
    chances[0] = [0.5, 0.3, 0.2, 0.0]
    copied = returns[:, :, twice]
    copied[0, 3] = rng.uniform(0.5, 1.5, len(twice))
    return KellyProblem(copied, chances, constraints)


@pytest.mark.parametrize("seed", some([4, 5, 6, 11], 2))
def test_growth_with_copies_is_hidden_and_proved_as_without(seed: int) -> None:
    belief, found, costs = drawn_beliefs(np.random.default_rng([12, seed]), 3)[1], [], []
    for twice in ([0, 1, 2], [0, 1, 2, 1, 2]):
        problem = grown(seed, twice)
        method = GlobalSearch(certify=0.01)
        maker = CounterAdversarialDecisionMaker(
            problem, budget=Budget.regret(1e-3), method=method, candidates=decoy_grid(problem, 20)
        )
        found.append(maker.decide(belief))
        costs.append(problem.state_costs(found[-1].action))
        assert found[-1].status in (DecisionStatus.GAP_REACHED, DecisionStatus.PROVED)
    np.testing.assert_allclose(costs[1], costs[0], rtol=0.0, atol=STATED)
    assert found[1].oracle_calls == found[0].oracle_calls
    assert found[1].privacy == pytest.approx(found[0].privacy, abs=STATED)
    assert found[1].privacy_bound == pytest.approx(found[0].privacy_bound, abs=STATED)


def test_growth_holds_only_the_first_of_copies_unless_a_limit_tells_them_apart() -> None:
    beliefs = drawn_beliefs(np.random.default_rng(13), 3)
    plain, copied = grown(0, [0, 1, 2]), grown(0, [0, 0, 1, 2, 2])
    np.testing.assert_array_equal(copied.solve(beliefs)[:, [0, 2, 3]], plain.solve(beliefs))
    assert not copied.solve(beliefs)[:, [1, 4]].any()
    same = KellyProblem(np.full((2, 2, 3), 1.1), np.full((2, 2), 0.5))
    np.testing.assert_array_equal(same.solve([0.3, 0.7]), [1.0, 0.0, 0.0])
    held = grown(0, [0, 0, 1, 2, 2], simplex(5) & max_weights(5, [0.2, 1.0, 1.0, 1.0, 1.0]))
    np.testing.assert_allclose(held.optimal_cost(beliefs), plain.optimal_cost(beliefs), rtol=0.0, atol=1e-9)
    assert held.solve(beliefs)[:, 0].max() <= 0.2
