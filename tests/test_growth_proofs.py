"""Proofs for growth problems: single cells against sampled beliefs, answers against scans by SciPy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from inscrutable import (
    Budget,
    CounterAdversarialDecisionMaker,
    DecisionStatus,
    GlobalSearch,
    KellyProblem,
    Polyhedron,
    ProbabilisticDecisionMaker,
    box,
    consistent_beliefs,
    decoy_grid,
    simplex,
)
from inscrutable.adversaries import consistent_sets
from inscrutable.decision_makers.proofs.fibres import Fibres
from inscrutable.decision_makers.proofs.growth_cells import GrowthCells, _log_gaps, whitened_growth
from inscrutable.decision_makers.proofs.oracle_points import OraclePoints
from oracles.horse_race import farthest_stake
from sizes import instances, some
from strategies import cell_around, random_cell

PROVEN = (DecisionStatus.PROVED, DecisionStatus.GAP_REACHED)


def growth(rng, n_states, n_assets, n_outcomes=4, spread=0.3, region=None):
    returns = np.exp(rng.normal(0.02, spread, (n_states, n_outcomes, n_assets)))
    return KellyProblem(returns, rng.dirichlet(np.full(n_outcomes, 2.0), n_states), region)


def any_problem(rng, n_states):
    """More and fewer assets than states and outcomes, ruin, caps and cuts; horse races."""
    n_assets, kind = int(rng.integers(2, 6)), int(rng.integers(5))
    if kind == 0:
        odds = rng.uniform(1.5, 4.0, n_states)
        return KellyProblem((odds[:, None] * np.eye(n_states))[:, None, :], np.ones((n_states, 1)))
    if kind == 1:
        returns = np.exp(rng.normal(0.0, 0.3, (n_states, 3, n_assets))) * (rng.random((n_states, 3, n_assets)) > 0.1)
        returns[..., 0] = 1.01
        return KellyProblem(returns, rng.dirichlet(np.ones(3), n_states))
    if kind == 2:
        cuts = rng.normal(size=(2, n_assets))
        cut = simplex(n_assets) & Polyhedron(A_ub=cuts, b_ub=cuts.mean(axis=1) + 0.1)
        return growth(rng, n_states, n_assets, region=cut)
    if kind == 3:
        capped = simplex(n_assets) & box(np.zeros(n_assets), np.full(n_assets, 0.5 + 0.5 / n_assets))
        return growth(rng, n_states, n_assets, spread=1.0, region=capped)
    return growth(rng, n_states, n_assets, int(rng.integers(1, 5)))


def cells_of(problem, belief):
    points = OraclePoints(problem, belief, np.eye(problem.n_states))
    form = whitened_growth(problem)
    return None if form is None else GrowthCells(problem, points, form)


@pytest.mark.parametrize("seed", range(instances(24, least=4)))
def test_bounds_on_cells_hold_for_sampled_beliefs(seed):
    """Decisions, gradients and regrets between corners; and where no fibre ends all beliefs have a nearer one beside them."""
    rng = np.random.default_rng([20270501, seed])
    n_states = 2 + seed % 3
    problem = any_problem(rng, n_states)
    belief = rng.dirichlet(np.full(n_states, 2.0)) if seed % 5 else np.eye(n_states)[0]
    cells = cells_of(problem, belief)
    if cells is None:
        return
    points, fibres = cells.points, Fibres(cells)
    for _ in range(12):
        index = points.add(random_cell(rng, n_states, smallest=1e-3, evenness=0.7))[None]
        near = cells.nearness(index)
        bounds = cells.regret_bounds(index, near)[0]
        shares = np.vstack([np.eye(n_states), rng.dirichlet(np.full(n_states, 0.6), 30)])
        beliefs = shares @ points.beliefs[index[0]]
        actions = problem.solve(beliefs)
        regrets = problem.regret(belief, actions)
        assert (regrets - (shares @ bounds).max(axis=1)).min() >= -1e-10 * points.scale
        if not np.isfinite(near.near[0]):
            continue
        places = actions @ np.linalg.pinv(cells.form.basis).T
        known = cells.known
        slack = 1e-7
        away = np.linalg.norm(places - shares @ known.places[index[0]], axis=1)
        assert (away <= near.near[0] + slack).all()
        gradients = problem.cost_gradients(actions) @ cells.form.basis
        meant = np.einsum("nj,jxf->nxf", shares, known.gradients[index[0]])
        size = np.abs(gradients).max()
        assert (np.linalg.norm(gradients - meant, axis=(1, 2)) <= near.gradients[0] + slack * size**2).all()
        sums = np.einsum("nx,nxf->nf", beliefs, gradients)
        at_corners = np.einsum("jx,jxf->jf", points.beliefs[index[0]], known.gradients[index[0]])
        assert (np.linalg.norm(sums - shares @ at_corners, axis=1) <= near.sum[0] + slack * size**2).all()
        if fibres.passes(index, near)[0]:
            distances = consistent_sets(problem, actions, beliefs).distances(belief)
            assert (distances < np.linalg.norm(beliefs - belief, axis=1)).all()


@pytest.mark.parametrize("seed", range(instances(8, least=2)))
def test_a_cell_with_the_nearest_belief_of_a_decision_is_never_left_out(seed):
    rng = np.random.default_rng([20270503, seed])
    n_states = 3 + seed % 2
    problem = growth(rng, n_states, int(rng.integers(2, n_states + 2)))
    belief = rng.dirichlet(np.full(n_states, 2.0))
    cells = cells_of(problem, belief)
    fibres = Fibres(cells)
    for _ in range(instances(25, least=6)):
        decoy = rng.dirichlet(np.full(n_states, 0.7))
        nearest = np.maximum(consistent_beliefs(problem, problem.solve(decoy)).nearest(belief), 0.0)
        nearest /= nearest.sum()
        for size in 10 ** rng.uniform(-3.0, -0.3, 4):
            corners = cell_around(rng, nearest, decoy, size)
            index = cells.points.add(corners)[None]
            assert not fibres.passes(index, cells.nearness(index))[0]


def test_in_a_horse_race_decisions_are_linear():
    problem = KellyProblem((np.array([2.0, 3.0, 4.0])[:, None] * np.eye(3))[:, None, :], np.ones((3, 1)))
    cells = cells_of(problem, np.array([0.2, 0.3, 0.5]))
    index = cells.points.add([[0.2, 0.5, 0.3], [0.6, 0.3, 0.1], [0.3, 0.1, 0.6]])[None]
    assert cells.nearness(index).near[0] <= 1e-6


@pytest.mark.parametrize("factor", [1.0, 1.0 + 1e-9, 1.01, 3.0, 1e6])
def test_the_chord_of_a_logarithm(factor):
    shares = np.linspace(0.0, 1.0, 20001)
    wealth = 0.7 * (1 + shares * (factor - 1))
    rise = np.log(wealth) - np.log(0.7) - shares * np.log(factor)
    assert _log_gaps(np.array(0.7), np.array(0.7 * factor)) == pytest.approx(rise.max(), rel=1e-4, abs=1e-12)


class Scan:
    """Growth problems by SciPy alone, on the simplex of decisions."""

    def __init__(self, problem, belief):
        self.returns, self.shares = problem.gross_returns, problem.probabilities
        self.belief = belief
        self.n_assets = self.returns.shape[2]
        self.least = self.cost(self.solve(belief), belief)

    def state_costs(self, stakes):
        return -(self.shares * np.log(self.returns @ stakes)).sum(axis=1)

    def slopes(self, stakes):
        return -np.einsum("xs,xsu->xu", self.shares / (self.returns @ stakes), self.returns)

    def cost(self, stakes, belief):
        return float(belief @ self.state_costs(stakes))

    def solve(self, belief):
        found = minimize(
            self.cost,
            np.full(self.n_assets, 1 / self.n_assets),
            args=(belief,),
            jac=lambda stakes, held: held @ self.slopes(stakes),
            bounds=[(0, 1)] * self.n_assets,
            constraints={"type": "eq", "fun": lambda u: u.sum() - 1, "jac": lambda u: np.ones_like(u)},
            method="SLSQP",
            options={"ftol": 1e-15, "maxiter": 300},
        )
        return np.maximum(found.x, 0.0) / np.maximum(found.x, 0.0).sum()

    def judged(self, decoy):
        """Regret and privacy; rows that are nearly tight count as tight."""
        stakes = self.solve(decoy)
        slopes = self.slopes(stakes)
        held = stakes > 1e-6
        apart = (slopes - slopes[:, [int(stakes.argmax())]]).T
        rules = [{"type": "eq", "fun": lambda y: y.sum() - 1}]
        equal, above = apart[held & (np.arange(self.n_assets) != stakes.argmax())], apart[~held]
        if len(equal):
            # What the solver left is not held against the decoy.
            rules.append({"type": "eq", "fun": lambda y: equal @ (y - decoy)})
        if len(above):
            rules.append({"type": "ineq", "fun": lambda y: above @ y - np.minimum(above @ decoy, 0.0)})
        found = minimize(
            lambda y: ((y - self.belief) ** 2).sum(),
            decoy,
            jac=lambda y: 2 * (y - self.belief),
            bounds=[(0, 1)] * len(decoy),
            constraints=rules,
            method="SLSQP",
            options={"ftol": 1e-14},
        )
        return self.cost(stakes, self.belief) - self.least, float(np.linalg.norm(found.x - self.belief))


def scanned(scan, budget, rng, n_points=120):
    """Regrets and privacies of many decoys, and the best under the budget refined by a simplex search."""
    n_states = scan.belief.size
    decoys = rng.dirichlet(np.ones(n_states), n_points)
    pairs = np.array([scan.judged(decoy) for decoy in decoys])

    def loss(free):
        if min(free.min(), 1 - free.sum()) < 0:
            return 1.0
        regret, privacy = scan.judged(np.append(free, 1 - free.sum()))
        return -privacy if regret <= budget else 1.0

    affordable = np.where(pairs[:, 0] <= budget, pairs[:, 1], -1.0)
    start = decoys[affordable.argmax()][:-1]
    better = minimize(loss, start, method="Nelder-Mead", options={"maxfev": 60, "xatol": 1e-5, "fatol": 1e-6})
    best = max(float(affordable.max()), -float(better.fun), 0.0)
    return np.vstack([pairs, [0.0, 0.0]]), best


def proofs_of(problem, belief, budget, calls=10_000):
    candidates = decoy_grid(problem, 12)
    method = GlobalSearch(certify=0.01, max_oracle_calls=calls)
    single = CounterAdversarialDecisionMaker(
        problem, budget=Budget.regret(budget), candidates=candidates, method=method
    )
    lottery = ProbabilisticDecisionMaker(problem, budget=Budget.regret(budget), candidates=candidates, certify=0.01)
    return single.decide(belief), lottery.decide(belief)


@pytest.mark.parametrize(
    ("n_states", "n_assets", "seed"), some([(2, 4, 0), (3, 3, 0), (3, 3, 1), (3, 5, 2), (3, 2, 0)], 5)
)
def test_bounds_are_above_a_scan_and_near_what_is_reached(n_states, n_assets, seed):
    rng = np.random.default_rng([20270507, n_states, n_assets, seed])
    problem = growth(rng, n_states, n_assets)
    belief = rng.dirichlet(np.full(n_states, 3.0))
    scan = Scan(problem, belief)
    budget = 0.1 * max(scan.cost(scan.solve(corner), belief) - scan.least for corner in np.eye(n_states))
    pairs, best = scanned(scan, budget, rng)
    decision, mixed = proofs_of(problem, belief, budget)
    assert decision.privacy_bound >= best - 1e-6
    hull = linprog(-pairs[:, 1], A_ub=pairs[None, :, 0], b_ub=[budget], A_eq=np.ones((1, len(pairs))), b_eq=[1.0])
    assert mixed.privacy_bound >= max(-hull.fun, best) - 1e-6
    assert decision.status in PROVEN
    assert mixed.status in PROVEN
    assert decision.privacy_bound <= 1.0101 * max(decision.privacy, 0.01)
    assert mixed.privacy_bound <= 1.0101 * max(mixed.expected_privacy, 0.01)


# Three states with equal bounds: test_proofs_of_a_horse_race_close in test_problem_types.py.
@pytest.mark.parametrize("n_states", [2, *(pytest.param(n, marks=pytest.mark.audit) for n in (3, 4))])
def test_a_horse_race_is_a_closed_form(n_states):
    """u* = π and the regret is the divergence: rays from the belief are searched for the farthest stake in it."""
    rng = np.random.default_rng([20270511, n_states])
    belief, budget = rng.dirichlet(np.full(n_states, 3.0)), 0.05
    problem = KellyProblem((np.full(n_states, 3.0)[:, None] * np.eye(n_states))[:, None, :], np.ones((n_states, 1)))
    best = farthest_stake(belief, budget, rng)
    decision, mixed = proofs_of(problem, belief, budget)
    assert decision.status in PROVEN
    assert decision.privacy_bound >= best * (1 - 1e-9)
    assert decision.privacy <= best * (1.01 if n_states > 3 else 1 + 1e-3)
    assert mixed.status in PROVEN
    assert mixed.privacy_bound >= mixed.expected_privacy >= decision.privacy - 1e-6
