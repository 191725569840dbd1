"""Problems drawn by hypothesis, and small ones whose answers are known by hand."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from hypothesis import strategies as st
from numpy.typing import ArrayLike, NDArray

from inscrutable import (
    CategoricalEmission,
    DecisionProblem,
    HiddenMarkovModel,
    MarkowitzProblem,
    Polyhedron,
    Prior,
    QuadraticProblem,
    simplex,
)
from inscrutable.mechanisms.chains import BeliefChain
from oracles import consistent, markets

Array = NDArray[np.float64]

SEEDS = st.integers(0, 2**32 - 1)
KINDS: list[dict[str, bool]] = [{}, {}, {"duplicate": True}, {"singular": True}, {"positive_value": True}]
DETERMINED = 1e-5  # singular values above this determine a direction of the belief for library and oracle alike
FREE = 1e-11  # singular values below this leave one free for both; between the two, rounding decides


class Drawn(NamedTuple):
    """A market, the problem the library makes of it, a belief, and a source for whatever else a test draws."""

    market: markets.Market
    problem: MarkowitzProblem
    belief: Array
    rng: np.random.Generator


def long_only(n_assets: int, min_slack: float) -> Polyhedron:
    """Return the simplex with a smallest weight of the test's choice."""
    return Polyhedron(-np.eye(n_assets), np.zeros(n_assets), np.ones((1, n_assets)), np.ones(1), min_slack=min_slack)


class OwnShares(DecisionProblem):
    """Shares of K choices with costs (X,K) in a table, as a user may write it: what a problem must have, and no more."""

    def __init__(self, costs: ArrayLike) -> None:
        self.costs = np.asarray(costs, dtype=float)
        self.constraints = simplex(self.costs.shape[1])

    @property
    def n_states(self) -> int:
        return len(self.costs)

    def solve(self, beliefs: ArrayLike) -> Array:
        return np.eye(self.costs.shape[1])[(np.asarray(beliefs) @ self.costs).argmin(axis=-1)]

    def state_costs(self, actions: ArrayLike) -> Array:
        return np.asarray(actions) @ self.costs.T

    def cost_gradients(self, action: ArrayLike) -> Array:
        return np.broadcast_to(self.costs, (*np.shape(action)[:-1], *self.costs.shape))


def uneven_chain(n_beliefs: int = 3, seed: int = 0) -> BeliefChain:
    """Return a chain that is not the same backwards in time, on beliefs of three states."""
    rng = np.random.default_rng(seed)
    transition = rng.dirichlet(np.full(n_beliefs, 0.7), size=n_beliefs)
    weights = np.linalg.matrix_power(transition, 4000)[0]
    return BeliefChain(Prior(rng.dirichlet(np.ones(3), size=n_beliefs), weights / weights.sum()), transition)


def random_world(rng: np.random.Generator, n_states: int = 2, n_symbols: int = 2) -> HiddenMarkovModel:
    """Return a world of symbols with any chain, sensor and start."""
    return HiddenMarkovModel(
        rng.dirichlet(np.ones(n_states), n_states),
        CategoricalEmission(rng.dirichlet(np.ones(n_symbols), n_states)),
        rng.dirichlet(np.ones(n_states)),
    )


@st.composite
def drawn_problems(
    draw: st.DrawFn,
    *,
    states: tuple[int, int] = (2, 6),
    assets: tuple[int, int] = (2, 30),
    min_slack: float = 0.0,
    kinds: list[dict[str, bool]] = KINDS,
    spread: float = 3.0,
) -> Drawn:
    """Draw an ordinary or degenerate market in units from basis points to hundreds, states up to `spread` decades apart.

    The belief is an interior one, or lies on a face or a corner of the simplex.
    """
    rng = np.random.default_rng(draw(SEEDS))
    n_states, n_assets = draw(st.integers(*states)), draw(st.integers(*assets))
    market = markets.random_market(
        rng, n_states, n_assets, scale_spread=draw(st.sampled_from([0.0, 0.0, spread])), **draw(st.sampled_from(kinds))
    )
    means_unit, covariances_unit = draw(st.sampled_from([(0, 0), (0, 0), (-2, -4), (-3, -3), (1, 2), (-4, 0)]))
    market = markets.Market(
        market.means * 10.0**means_unit, market.covariances * 10.0**covariances_unit, market.risk_aversion
    )
    belief = draw_belief(draw, rng, n_states)
    problem = MarkowitzProblem(*market, constraints=long_only(n_assets, min_slack))
    return Drawn(market, problem, belief, rng)


def draw_belief(draw: st.DrawFn, rng: np.random.Generator, n_states: int) -> Array:
    """Draw an interior belief, a lopsided one, one on a face, or a corner."""
    where = draw(st.sampled_from(["interior", "interior", "lopsided", "face", "corner"]))
    if where == "interior":
        return markets.random_belief(rng, n_states)
    if where == "corner":
        return np.asarray(np.eye(n_states)[rng.integers(n_states)])
    belief = rng.dirichlet(np.full(n_states, 0.2 if where == "lopsided" else 1.0)) + 1e-12
    if where == "face" and n_states > 1:
        belief[rng.integers(n_states)] = 0.0
    return np.asarray(belief / belief.sum())


def cost_scale(problem: QuadraticProblem, action: Array) -> float:
    """Return the largest single term of any state's cost at an action: what a rounding error is relative to.

    Terms count at their size: where a covariance is nearly singular, products a thousand times the variance cancel in it.
    """
    held = np.abs(action)
    curved = 0.5 * np.einsum("iuv,u,v->i", np.abs(problem.hessians), held, held)
    return float(max(curved.max(), (np.abs(problem.linear) @ held).max(), np.abs(problem.constants).max()))


def system_of(problem: QuadraticProblem, action: Array) -> consistent.System:
    """Return the oracle's system of an action: gradients written out, rows tight by the set's `min_slack`."""
    region = problem.constraints
    gradients = np.stack([h @ action + g for h, g in zip(problem.hessians, problem.linear, strict=True)], axis=1)
    tight = consistent.tight_rows(region.A_ub, region.b_ub, action, region.min_slack)
    return consistent.kkt_system(gradients, region.A_ub[tight], region.A_eq)


def is_well_posed(system: consistent.System) -> bool:
    """Say whether the set is determined by the data: no direction of belief is decided by rounding alone.

    The stationarity equations are projected off the span of the tight rows and onto directions of belief that keep
    its sum; every singular value must be clearly zero or clearly not.
    """
    n_states = system.gradients.shape[1]
    normals = np.vstack([system.active, system.equalities])
    left, singular, _ = np.linalg.svd(normals.T, full_matrices=True)
    rank = int((singular > consistent.RANK).sum())
    sums_to_zero = np.linalg.svd(np.ones((1, n_states)))[2][1:].T
    values = np.linalg.svd(left[:, rank:].T @ system.gradients @ sums_to_zero, compute_uv=False)
    return bool(np.all((values > DETERMINED) | (values < FREE)))


def line_problem(slopes: list[float], min_slack: float = 0.0) -> MarkowitzProblem:
    """Two assets, identity covariance, γ = 1, means (m_i, 0): u_1 = ½ + π·m/4 and Π(u) = {π·m = 4u_1 − 2} inside."""
    n_states = len(slopes)
    means = np.column_stack([slopes, np.zeros(n_states)])
    return MarkowitzProblem(means, [np.eye(2)] * n_states, 1.0, long_only(2, min_slack))


def belief_problem(n_states: int = 3, min_slack: float = 0.0) -> MarkowitzProblem:
    """As many assets as states, identity covariance, γ = 1, state i pays asset i.

    u*(π) = (1 − 1/(2X))/X + π/2 − … = c + π/2 with c = 1/(2X): a decision tells its belief, Π(u*(y)) = {y}, and
    ρ(π, u*(y)) = ‖π − y‖²/4.
    """
    return MarkowitzProblem(np.eye(n_states), [np.eye(n_states)] * n_states, 1.0, long_only(n_states, min_slack))


def cell_around(rng: np.random.Generator, member: np.ndarray, decoy: np.ndarray, size: float) -> np.ndarray:
    """Corners (X,X) of a cell of a size with a belief at a corner, or as their mean where they stay in the simplex; some
    on the way to a decoy, some where the belief's zeros stay zero."""
    n_states = member.size
    others = rng.dirichlet(np.ones(n_states), n_states)
    others[rng.random(n_states) < 0.5] = decoy
    others[:, member < 1e-12] *= rng.random() < 0.5
    others /= others.sum(axis=1, keepdims=True)
    corners = (1 - size) * member + size * others
    corners[0] = member
    if rng.random() < 0.5 and (member > 0.0).all():
        moved = corners - corners.mean(axis=0) + member
        corners = moved if moved.min() >= 0.0 else corners
    return np.asarray(corners)


def random_cell(rng: np.random.Generator, n_states: int, *, smallest: float, evenness: float) -> np.ndarray:
    """Corners (X,X) of a cell of any size from the smallest on, some on the simplex's border."""
    size = 10 ** rng.uniform(np.log10(smallest), 0)
    middle, apart = rng.dirichlet(np.full(n_states, evenness)), rng.dirichlet(np.full(n_states, evenness), n_states)
    corners = (1 - size) * middle + size * apart
    if rng.random() < 0.3:
        corners[:, rng.integers(n_states)] *= rng.random(n_states) < 0.5
        corners /= corners.sum(axis=1, keepdims=True)
    return np.asarray(corners)
