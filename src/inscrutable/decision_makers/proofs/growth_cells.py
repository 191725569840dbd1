"""Regrets on cells of beliefs for growth, costs −Σ_s p_is log(r_is'u): bounds whose error falls with the cell's size squared.

Wealth w_k = r_k'u is interpolated along with the decision, and the curvature of a logarithm's slope 1/w has a closed form:
Σ_j θ_j/w_jk − 1/w̃_k = Σ_{j<l} θ_j θ_l (w_jk − w_lk)²/(w_jk w_lk w̃_k). At y = Σ θ_j y_j, with outcomes' weights W_k(y), the
conditions of optimality are broken by

    R = Σ_{j<l} θ_j θ_l {Σ_k r_k (W_k(y)/w̃_k) (w_jk − w_lk)²/(w_jk w_lk) − Σ_i (y_ji − y_li)(∇c_i(u_j) − ∇c_i(u_l))},

where W_k(y)/w̃_k, a ratio of linear functions, lies between its values at the corners. Monotonicity of the gradients gives
Σ_k W_k (w*_k − w̃_k)²/(w*_k w̃_k) ≤ R·(u* − ũ) + c, with c as for quadratic costs and w*_k at most the largest wealth in C,
or, once u* is known to be near ũ, the largest wealth near ũ. For a row that is active at all corners the term λ·slack(u*) is
added, at least λ·slack²/(largest slack). In a horse race R is zero: u*(π) = π is linear.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from inscrutable import tolerances
from inscrutable.decision_makers.proofs.oracle_points import OraclePoints
from inscrutable.decision_makers.proofs.smooth_cells import (
    Nearness,
    SmoothCells,
    Whitened,
    middle_of,
    pair_share,
    whitened_by,
)
from inscrutable.geometry.simplicial import edges
from inscrutable.linear_programmes import OPTIMAL, Rows, minimise
from inscrutable.problems import KellyProblem
from inscrutable.validation import Array

_ROUNDS = 3
"""Rounds in which the bounds of wealth and of slacks tighten each other. With one, 12 proofs take up to 1.25 times the calls;
with nine, none takes over 4 % less."""


def whitened_growth(problem: KellyProblem) -> Whitened | None:
    """Return the coordinates, by the curvatures at the decision for the belief in the middle; None where some direction
    inside C has no curvature there."""
    returns = problem.scaled_returns
    wealth = returns @ problem.solve(middle_of(problem))
    shares = problem.probabilities / np.maximum(wealth, tolerances.LEAST_WEALTH) ** 2
    return whitened_by(problem, np.einsum("xs,xsu,xsv->xuv", shares, returns, returns))


class _Spread(NamedTuple):
    """Wealth and weights of outcomes on cells (C,·)."""

    wealth: Array  # (C,J,K)
    least: Array  # (C,K) wealth
    most: Array  # (C,K)
    ratios: Array  # (C,J,K) weight over wealth
    lean: np.ndarray  # (C,) whether wealth is near zero in some outcome


class GrowthCells(SmoothCells):
    """Bounds of the regret on cells, from the optimal decisions at their corners."""

    def __init__(self, problem: KellyProblem, points: OraclePoints, form: Whitened) -> None:
        possible = problem.probabilities.ravel() > 0
        returns = problem.scaled_returns.reshape(-1, problem.n_actions)[possible]
        self._returns = returns
        self._states = np.repeat(np.arange(problem.n_states), problem.probabilities.shape[1])[possible]
        self._shares = problem.probabilities.ravel()[possible]
        largest = (problem.largest_wealth / problem.best_returns.ravel())[possible]
        self._largest = np.where(largest > 0.0, largest, np.inf)
        self._rows = returns @ form.basis  # (K,F)
        self._lengths = np.linalg.norm(self._rows, axis=1)
        region = problem.constraints
        self._touch = tolerances.FEASIBILITY * region.row_scale[form.kept] / form.lengths
        self._rooms = np.maximum(_largest_slacks(problem, form.kept) / form.lengths, self._touch)
        super().__init__(problem, points, form)

    @property
    def is_strictly_convex(self) -> bool:
        """False: decisions may be tied in a corner's outcomes, and wealth may be near zero."""
        return False

    def is_blind(self, regrets: Array, near: Nearness) -> np.ndarray:
        """Return which cells (C,) need bounds by optimal costs: where wealth is near zero, where a corner's outcomes do not
        distinguish all decisions, and where the cell is too large for other bounds."""
        return np.asarray(~np.isfinite(near.near) | (regrets.max(axis=(1, 2)) <= 0.0))

    def _traits(self, actions: Array, beliefs: Array) -> Array:
        """Wealth in every outcome, as a share of the best asset's."""
        return np.asarray(actions @ self._returns.T)

    def _spread(self, corners: np.ndarray) -> _Spread:
        wealth = self.known.traits[corners]
        lean = (wealth <= 2.0 * tolerances.LEAST_WEALTH).any(axis=(1, 2))
        wealth = np.where(lean[:, None, None], 1.0, wealth)
        weights = self.points.beliefs[corners][..., self._states] * self._shares
        return _Spread(wealth, wealth.min(axis=1), wealth.max(axis=1), weights / wealth, lean)

    def unrest(self, corners: np.ndarray) -> Array:
        """Return the most by which interpolations break the conditions of optimality on cells (C,J): ‖R‖."""
        return self._unrest(corners, *self._broken(corners, self._spread(corners), edges(corners.shape[1])))

    def _unrest(self, corners: np.ndarray, broken: Array, wild: Array) -> Array:
        plain = np.linalg.norm(broken, axis=2) + np.einsum("cek,k->ce", wild, self._lengths)
        return np.asarray(self.known.residuals[corners].max(axis=1) + pair_share(corners.shape[1]) * plain.max(axis=1))

    def nearness(self, corners: np.ndarray) -> Nearness:
        """Return how near interpolations are on cells (C,J)."""
        known, spread, pairs = self.known, self._spread(corners), edges(corners.shape[1])
        broken, wild = self._broken(corners, spread, pairs)
        # Twice, because rows count as active up to rounding.
        loose, share = 2.0 * self.spare(corners, pairs), pair_share(corners.shape[1])
        residuals = known.residuals[corners].max(axis=1)
        top = np.broadcast_to(self._largest, spread.most.shape)
        sure = ~spread.lean
        held = np.where((known.slacks[corners] <= self._touch).all(axis=1), known.multipliers[corners].min(axis=1), 0.0)
        rooms = np.broadcast_to(self._rooms, held.shape)
        for _ in range(_ROUNDS):
            roots, least = self._roots(spread.ratios.min(axis=1) / np.maximum(top, spread.most), held / rooms)
            sure = sure & (least > tolerances.CURVATURE)
            lengths = np.linalg.norm(np.einsum("kf,cfg->ckg", self._rows, roots), axis=2)
            left = np.linalg.norm(np.einsum("cef,cfg->ceg", broken, roots), axis=2)
            left += np.einsum("cek,ck->ce", wild, lengths)
            total = share * left.max(axis=1) + residuals / np.sqrt(least)
            near = 0.5 * (total + np.sqrt(total**2 + 4.0 * loose))
            moves = lengths * near[:, None]
            top = np.minimum(top, spread.most + moves)
            reach = np.linalg.norm(np.einsum("rf,cfg->crg", self.form.rows, roots), axis=2) * near[:, None]
            rooms = np.where(sure[:, None], np.clip(reach, self._touch, rooms), rooms)
        slopes = np.linalg.norm(np.einsum("cjf,cfg->cjg", known.slopes[corners], roots), axis=2)
        # The gradient at the interpolated decision is the interpolated one plus its error.
        own = self.points.belief[self._states] * self._shares
        slopes += np.einsum("k,ck,ck->c", own, self._slope_gaps(spread), lengths)[:, None]
        found = Nearness(
            near / np.sqrt(least),
            self._unrest(corners, broken, wild) + self._sum_moves(spread, moves),
            self._gradient_moves(spread, moves),
            slopes * near[:, None],
        )
        return found.where(sure)

    def _broken(self, corners: np.ndarray, spread: _Spread, pairs: np.ndarray) -> tuple[Array, Array]:
        """R for every pair (C,E,F), and what outcomes (C,E,K) may add along their returns."""
        known, beliefs = self.known, self.points.beliefs
        first, second = pairs[:, 0], pairs[:, 1]
        change = known.gradients[corners[:, first]] - known.gradients[corners[:, second]]
        apart = beliefs[corners[:, first]] - beliefs[corners[:, second]]
        one, other = spread.wealth[:, first], spread.wealth[:, second]
        spreads = (one - other) ** 2 / (one * other)
        least, most = spread.ratios.min(axis=1), spread.ratios.max(axis=1)
        broken = np.einsum("cek,ck,kf->cef", spreads, 0.5 * (least + most), self._rows)
        broken -= np.einsum("cex,cexf->cef", apart, change)
        return broken, spreads * (0.5 * (most - least))[:, None]

    def _roots(self, weights: Array, held: Array) -> tuple[Array, Array]:
        """A^(−1/2) (C,F,F) of the curvature A that outcomes of weights (C,K) and rows held by (C,r) give, and its least
        eigenvalue (C,)."""
        curvatures = np.einsum("ck,kf,kg->cfg", weights, self._rows, self._rows)
        curvatures += np.einsum("cr,rf,rg->cfg", held, self.form.rows, self.form.rows)
        values, vectors = np.linalg.eigh(curvatures)
        sizes = np.maximum(values, tolerances.CURVATURE)
        return vectors / np.sqrt(sizes)[:, None, :], sizes[:, 0]

    def _slope_gaps(self, spread: _Spread) -> Array:
        """The most (C,K) by which 1/w̃ is below the interpolation of 1/w."""
        return np.asarray((1.0 / np.sqrt(spread.least) - 1.0 / np.sqrt(spread.most)) ** 2)

    def _slope_moves(self, spread: _Spread, moves: Array) -> Array:
        """The most (C,K) by which 1/w* differs from 1/w̃, where wealth differs by no more than `moves`."""
        below = spread.least - moves
        safe = below > tolerances.LEAST_WEALTH
        return np.where(safe, moves / (spread.least * np.where(safe, below, 1.0)), np.inf)

    def _sum_moves(self, spread: _Spread, moves: Array) -> Array:
        """The same for a belief's mean of the gradients, from that at ũ."""
        below = spread.least - moves
        safe = below > tolerances.LEAST_WEALTH
        turned = np.where(safe, moves / np.where(safe, below, 1.0), 0.0) * spread.ratios.max(axis=1)
        return np.asarray(np.where(safe.all(axis=1), turned @ self._lengths, np.inf))

    def _gradient_moves(self, spread: _Spread, moves: Array) -> Array:
        """The same for all states' gradients together, from their interpolation."""
        sizes = (self._slope_moves(spread, moves) + self._slope_gaps(spread)) * (self._shares * self._lengths)
        by_state = np.stack([sizes[:, self._states == i].sum(axis=1) for i in range(self.problem.n_states)], axis=1)
        return np.asarray(np.linalg.norm(by_state, axis=1))

    def regret_bounds(self, corners: np.ndarray, near: Nearness) -> Array:
        """Return columns (C,J,K) of lower bounds of the regret of every optimal decision, linear on each cell (C,J)."""
        known, spread = self.known, self._spread(corners)
        places, slopes, regrets = known.places[corners], known.slopes[corners], known.regrets[corners]
        away = places[:, :, None] - places[:, None]
        at_corners = regrets[:, None, :] + np.einsum("cjkf,ckf->cjk", away, slopes)
        own = self.points.belief[self._states] * self._shares
        # The tangent at the mean decision; and the chord minus the largest gap between the logarithm and its chord.
        means = spread.wealth.mean(axis=1, keepdims=True)
        gained = np.einsum("k,cjk->cj", own, (spread.wealth - means) / means)
        at_mean = (regrets + np.log(spread.wealth) @ own).mean(axis=1) - np.log(means[:, 0]) @ own
        chord = regrets - (_log_gaps(spread.least, spread.most) @ own)[:, None]
        columns = np.concatenate(
            [at_corners, (at_mean[:, None] - gained)[:, :, None], chord[:, :, None]],
            axis=2,
        )
        sure = np.isfinite(near.near)
        lost = np.where(sure[:, None], near.regrets, 0.0) + self.points.allowance
        return np.where(sure[:, None, None], columns - lost[:, :, None], 0.0)


def _largest_slacks(problem: KellyProblem, kept: np.ndarray) -> Array:
    """The largest slack (r,) of rows in C, infinite where it has no limit."""
    region = problem.constraints
    below, equal = Rows(region.A_ub, region.b_ub), Rows(region.A_eq, region.b_eq)
    found = [minimise(region.A_ub[row], below, equal) for row in kept]
    least = np.array([each.value if each.status == OPTIMAL else -np.inf for each in found])
    return np.asarray(region.b_ub[kept] - least)


def _log_gaps(least: Array, most: Array) -> Array:
    """How far a logarithm rises above its chord between two points: largest at (b − a)/(log b − log a)."""
    ratio = np.log(most / least)
    wide = ratio > tolerances.TINY
    touch = np.where(wide, np.expm1(ratio) / np.where(wide, ratio, 1.0), 1.0)  # in units of the least
    return np.asarray(np.maximum(np.log(touch) - 1.0 + 1.0 / touch, 0.0))
