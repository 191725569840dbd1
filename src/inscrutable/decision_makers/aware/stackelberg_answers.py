"""The mechanism of largest loss for a rival with a decision of its own: linear programmes over the rival's answers.

The rival's costs are linear in the belief, so with answers a of gain g_b(a) = ℓ(π_b,a) − L(δ_b) its loss under rows K is Σ_m
t_m, t_m = min_a Σ_b p_b K_bm g_b(a). If the rival has few choices, all are answers from the start; else the best answers at
posterior means enter (Kelley's cuts). For every decision m the multipliers y_ma of the answers form a mixed answer. A decision
*tempts* a belief where its reduced cost is negative; decisions enter while they tempt some belief. The beliefs' best replies to
any mixed answers bound the loss (`best_mixtures`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy import sparse

from inscrutable import tolerances
from inscrutable.decision_makers.aware.stackelberg_solver import Told, first_columns
from inscrutable.decision_makers.envelope import Mixtures, best_mixtures
from inscrutable.linear_programmes import Rows, minimum
from inscrutable.privacy.losses import DecisionLoss, on_simplex
from inscrutable.problems import DecisionProblem, FiniteProblem
from inscrutable.validation import Array

_MOST_ROUNDS = 60
"""Never reached: 20 games of 20 to 140 beliefs, 36 to 5,048 decisions and gaps from 1e-6 to .02 need at most 25."""
_FIRST, _ADDED = 40, 40
"""Decisions at first, and how many may enter at a time. With 13 at first these 20 take .9 of the time, with 13 at a time .95,
with 120 at a time 1.05, and single ones up to 1.3 times as long."""
_FEW_CHOICES = 12
"""Choices of a rival up to which all are answers to every decision from the start. With none, 42 games with rivals of 3 to 40
choices end at the same values in 1.1 times the time, one in 4.8 times; with 36 in as much time."""


@dataclass(frozen=True, eq=False)
class AnswerGame:
    """Beliefs (B,X), their weights (B,), costs (B,M) of which each row may spend 1, allowed places (B,M), and the rival."""

    beliefs: Array
    weights: Array
    costs: Array
    allowed: np.ndarray
    rival: DecisionProblem

    @classmethod
    def of(cls, loss: DecisionLoss, beliefs: Array, weights: Array, budgeted: tuple[np.ndarray, Array]) -> AnswerGame:
        """Return the game of a loss, from `allowed` and `costs`."""
        return cls(beliefs, weights, budgeted[1], budgeted[0], loss.precise(beliefs.shape[1]))

    def some(self, rows: np.ndarray) -> AnswerGame:
        """Return the same with some of the beliefs."""
        return replace(
            self,
            beliefs=self.beliefs[rows],
            weights=self.weights[rows],
            costs=self.costs[rows],
            allowed=self.allowed[rows],
        )

    def gains(self, answers: Array) -> Array:
        """Return g_b of answers given by their state costs (n,X): shape (B,n)."""
        best = np.atleast_1d(np.asarray(self.rival.optimal_cost(self.beliefs)))
        return np.asarray(np.maximum(self.beliefs @ answers.T - best[:, None], 0.0))

    def answers(self, means: Array) -> Array:
        """Return the rival's best decisions under means (n,X) as points (n,U)."""
        return np.asarray(self.rival.solve_points(on_simplex(means)))

    @property
    def spread(self) -> float:
        """The loss beyond L(δ) where decisions reveal nothing, Σ p excess: an upper bound of every loss."""
        mean = (self.weights @ self.beliefs / self.weights.sum())[None]
        return float(self.weights @ self.gains(self.rival.state_costs(self.answers(mean)))[:, 0])

    def error(self, rows: Array) -> float:
        """Return what the rival loses beyond L(δ) under rows (B,M)."""
        joint = self.weights[:, None] * rows
        shown = np.flatnonzero(joint.sum(axis=0) > 0)
        points = self.answers(joint[:, shown].T @ self.beliefs)
        return float((joint[:, shown] * self.gains(self.rival.state_costs(points))).sum())

    def bound(self, answers: Array) -> Mixtures:
        """Return the rows' best replies to mixed answers (M,X): Σ p values bounds every loss."""
        return best_mixtures(self.costs, self.gains(answers), np.ones(len(self.weights)), self.allowed)


@dataclass(frozen=True, eq=False)
class Answered:
    """Rows K (B,M), state costs of the rival's mixed answers (M,X), its loss beyond L(δ), and the bound of that."""

    rows: Array
    answers: Array
    error: float
    bound: float


def largest_loss(game: AnswerGame, goal: float, progress: Told | None = None) -> Answered:
    """Return the rows of largest loss, with a bound at most `goal` of it above, or as near as it comes."""
    usable = np.flatnonzero(game.allowed.any(axis=0))
    few = replace(game, costs=game.costs[:, usable], allowed=game.allowed[:, usable])
    mean = game.weights @ game.beliefs
    at_mean = game.rival.state_costs(game.answers(mean[None] / mean.sum()))[0]
    found = _constant(few, at_mean)
    if found is None:
        found = _Search(few, goal, at_mean).run(progress)
    rows = np.zeros_like(game.costs)
    rows[:, usable] = found.rows
    answers = np.tile(at_mean, (rows.shape[1], 1))
    answers[usable] = found.answers
    return replace(found, rows=rows, answers=answers)


def _constant(game: AnswerGame, at_mean: Array) -> Answered | None:
    """A constant decision, where every row can afford it, or any rows where the loss is 0."""
    free, spread = np.flatnonzero((game.allowed & (game.costs <= 1.0)).all(axis=0)), game.spread
    worthless = spread <= tolerances.NO_ERROR * max(float(np.abs(at_mean).max()), tolerances.TINY)
    if not free.size and not worthless:
        return None
    rows = np.zeros_like(game.costs)
    if free.size:
        rows[:, free[game.costs[:, free].sum(axis=0).argmin()]] = 1.0
    else:
        rows[np.arange(len(rows)), np.where(game.allowed, game.costs, np.inf).argmin(axis=1)] = 1.0
    return Answered(rows, np.tile(at_mean, (rows.shape[1], 1)), spread, spread)


class _Search:
    """The present decisions and the answers to each, which grow."""

    def __init__(self, game: AnswerGame, goal: float, at_mean: Array) -> None:
        self.game, self.goal, self.spread = game, goal, game.spread
        self.costs = np.where(game.allowed, game.costs, 0.0)
        self.columns = first_columns(game.costs, game.allowed, _FIRST)
        self.there = np.zeros_like(game.allowed)
        self.there[:, self.columns] = game.allowed[:, self.columns]
        self.points = self._first_points()
        self.known = self._gains(self.points)
        self.replies: dict[int, list[int]] = {int(m): list(range(len(self.points))) for m in self.columns}
        self.n_first = len(self.points)
        self.mixed = np.tile(at_mean, (game.costs.shape[1], 1))
        self.best = Answered(np.zeros_like(game.costs), self.mixed.copy(), -np.inf, np.inf)

    def _first_points(self) -> Array:
        """All choices if few; else the best answers to the prior's mean and to each sure state."""
        game = self.game
        if isinstance(game.rival, FiniteProblem) and game.rival.n_choices <= _FEW_CHOICES:
            return np.eye(game.rival.n_choices)
        mean = game.weights @ game.beliefs
        return np.unique(game.answers(first_means(mean / mean.sum())), axis=0)

    def _gains(self, points: Array) -> Array:
        """Gains of answers in units of the spread, shape (B,n)."""
        return self.game.gains(np.asarray(self.game.rival.state_costs(points))) / self.spread

    def run(self, progress: Told | None) -> Answered:
        """Solve, add answers and decisions, until value and bound meet or nothing is left to add."""
        for done in range(1, _MOST_ROUNDS + 1):
            shares, model, weights = self._programme()
            self._mix(weights)
            rows = np.zeros_like(self.game.costs)
            rows[:, self.columns] = shares
            cut = self._cut(shares, model)
            tempted, lacking = self._priced()
            self._keep(rows)
            if progress is not None:
                progress(done, _MOST_ROUNDS)
            short = self.best.bound - self.best.error
            near = short <= self.goal * self.best.bound + tolerances.NO_ERROR * self.spread
            missing = ((lacking < 0) & ~self.there)[:, self.columns]
            if near or not (cut or tempted or missing.any()):
                break
            self._join(tempted, lacking)
        return self.best

    def _programme(self) -> tuple[Array, Array, Array]:
        """Rows (B,n), the model's loss of each decision (n,), and the multipliers of all replies in order."""
        game, columns = self.game, self.columns
        belief, place = np.nonzero(self.there[:, columns])
        n_pairs, n = len(belief), len(columns)
        chance = game.weights[belief]
        numbers = [np.array(self.replies[int(m)]) for m in columns]
        own = np.repeat(np.arange(n), [len(each) for each in numbers])
        answer = np.concatenate(numbers)
        first = np.concatenate([[0], np.cumsum([len(each) for each in numbers])])
        pairs = [np.flatnonzero(place == k) for k in range(n)]
        entry = np.concatenate([np.tile(pairs[k], len(numbers[k])) for k in range(n)])
        row = np.concatenate(
            [np.repeat(np.arange(first[k], first[k + 1]), len(pairs[k])) for k in range(n)] or [np.empty(0, int)]
        )
        value = -chance[entry] * self.known[belief[entry], answer[row]]
        size = n_pairs + n
        least = sparse.csr_array((value, (row, entry)), shape=(len(own), size))
        least = least + sparse.csr_array(
            (np.ones(len(own)), (np.arange(len(own)), n_pairs + own)), shape=(len(own), size)
        )
        paid = self.costs[belief, columns[place]]
        unit = np.maximum(np.bincount(belief, paid), 1.0)[belief]  # rows of dear decisions in a unit of their own
        spent: Any = sparse.csr_array((paid / unit, (belief, np.arange(n_pairs))), shape=(len(game.weights), size))
        sides = 1.0 / np.maximum(np.bincount(belief, paid, minlength=len(game.weights)), 1.0)
        whole: Any = sparse.csr_array((np.ones(n_pairs), (belief, np.arange(n_pairs))), shape=(len(game.weights), size))
        below: Any = Rows(sparse.vstack([least, spent], format="csr"), np.concatenate([np.zeros(len(own)), sides]))
        equal = Rows(whole, np.ones(len(game.weights)))
        objective = np.concatenate([np.zeros(n_pairs), -np.ones(n)])
        found = minimum(objective, below, equal, [(0.0, None)] * n_pairs + [(None, None)] * n)
        shares = np.zeros((len(game.weights), n))
        shares[belief, place] = np.maximum(found.x[:n_pairs], 0.0)
        return self._affordable(shares), found.x[n_pairs:], np.maximum(-found.duals[: len(own)], 0.0)

    def _affordable(self, shares: Array) -> Array:
        """Rows that sum to one and keep their budgets up to rounding: HiGHS's error goes to the cheapest decision."""
        shares = shares / shares.sum(axis=1, keepdims=True)
        costs = self.costs[:, self.columns]
        cheapest = np.where(self.there[:, self.columns], costs, np.inf).argmin(axis=1)
        each = np.arange(len(shares))
        spent, least = (shares * costs).sum(axis=1), costs[each, cheapest]
        over = np.clip((spent - 1.0) / np.maximum(spent - least, tolerances.TINY), 0.0, 1.0)
        shares *= (1.0 - over)[:, None]
        shares[each, cheapest] += over
        return np.asarray(shares)

    def _mix(self, weights: Array) -> None:
        """Normalise the multipliers of each decision's answers to a mixed answer; convex decisions mix to their mean."""
        place = 0
        for m in self.columns:
            numbers = self.replies[int(m)]
            share = weights[place : place + len(numbers)]
            place += len(numbers)
            if share.sum() > 0:
                self.mixed[m] = self._costs_of(numbers, share / share.sum())

    def _costs_of(self, numbers: list[int] | np.ndarray, share: Array) -> Array:
        # Of a convex problem the mean decision costs no more in any state than the mixture.
        mixed: Array = self.game.rival.state_costs((share @ self.points[numbers])[None])[0]
        return mixed

    def _cut(self, shares: Array, model: Array) -> bool:
        """Add the best answer to each posterior mean at which the model overestimates the loss."""
        joint = self.game.weights[:, None] * shares
        played = joint.sum(axis=0)
        shown = np.flatnonzero(played > tolerances.NO_WEIGHT)
        points = self.game.answers(joint[:, shown].T @ self.game.beliefs)
        known = self._gains(points)
        lost = (joint[:, shown] * known).sum(axis=0)
        off = np.flatnonzero(model[shown] - lost > tolerances.NO_ERROR * 10.0)
        for k in off:
            self.replies[int(self.columns[shown[k]])].append(len(self.points))
            self.points = np.vstack([self.points, points[k]])
            self.known = np.hstack([self.known, known[:, [k]]])
        return bool(off.size)

    def _priced(self) -> tuple[dict[int, np.ndarray], Array]:
        """Give absent decisions the mixed answer that tempts least, and return those that still tempt, with its answers.

        The second is the reduced cost of every pair of belief and decision (B,M).
        """
        game, columns = self.game, self.columns
        n_columns = game.costs.shape[1]
        ones = np.ones(len(game.weights))
        known = game.gains(self.mixed[columns]) / self.spread
        inner = best_mixtures(game.costs[:, columns], known, ones, self.there[:, columns])
        paid = (inner.values - inner.prices)[:, None] + inner.prices[:, None] * self.costs
        paid = np.where(game.allowed, paid, np.inf)
        near = 0.1 * self.goal + tolerances.NO_ERROR
        tempted: dict[int, np.ndarray] = {}
        others = np.setdiff1d(np.arange(n_columns), columns)
        if others.size:
            pool = np.unique(np.vstack([self.mixed[columns], self.game.rival.state_costs(self.points)]), axis=0)
            former = game.gains(self.mixed[others]) / self.spread
            worst = (former - paid[:, others]).max(axis=0)
            least, which = least_tempting_answer(game.gains(pool) / self.spread, paid[:, others])
            self.mixed[others[least < worst]] = pool[which[least < worst]]
            worst = np.minimum(worst, least)
            order = np.argsort(-worst)
            for k in order[worst[order] > near]:
                share, worth, _ = matrix_game(self.known, paid[:, others[k]])
                self.mixed[others[k]] = self._costs_of(np.arange(len(self.points)), share)
                if worth > near:
                    tempted[int(others[k])] = np.flatnonzero(share > tolerances.PROBABILITY)
                if len(tempted) == _ADDED:
                    break
        return tempted, paid - near - game.gains(self.mixed) / self.spread

    def _keep(self, rows: Array) -> None:
        """Keep the better rows, and the answers of smaller bound."""
        game, best = self.game, self.best
        error = game.error(rows)
        bound = min(float(game.weights @ game.bound(self.mixed).values), self.spread)
        if error > best.error:
            best = replace(best, rows=rows, error=error)
        if bound < best.bound:
            best = replace(best, answers=self.mixed.copy(), bound=bound)
        self.best = best

    def _join(self, tempted: dict[int, np.ndarray], lacking: Array) -> None:
        """Add decisions with their answers, each for the beliefs that it tempts and those to which it is the cheapest."""
        first = range(self.n_first)
        for m, answers in tempted.items():
            self.replies[m] = sorted({*first, *answers.tolist()})
        self.columns = np.sort(np.concatenate([self.columns, np.array(list(tempted), dtype=np.intp)]))
        allowed, each = self.game.allowed[:, self.columns], np.arange(len(self.costs))
        kept = self.there[:, self.columns] | (lacking[:, self.columns] <= 0)
        kept[each, np.where(allowed, self.costs[:, self.columns], np.inf).argmin(axis=1)] = True
        self.there[:, self.columns] = kept & allowed


def first_means(mean: Array) -> Array:
    """Return means (n,X) for the first answers of a rival: the prior's, each sure state, and halfway between."""
    sure = np.eye(len(mean))
    return np.vstack([mean, sure, 0.5 * (sure + mean)])


def least_tempting_answer(gains: Array, paid: Array) -> tuple[Array, np.ndarray]:
    """Return min_k max_b (gains_bk − paid_bm) of every decision m, and which k: shapes (M,)."""
    worst, which = np.full(paid.shape[1], np.inf), np.zeros(paid.shape[1], dtype=np.intp)
    for k, gain in enumerate(gains.T):
        tempts = (gain[:, None] - paid).max(axis=0)
        better = tempts < worst
        worst[better], which[better] = tempts[better], k
    return worst, which


def matrix_game(gains: Array, paid: Array) -> tuple[Array, float, Array]:
    """Return the mixed answer y of least max_b (gains y − paid)_b, that, and the law of the belief (B,) to which y is best."""
    some = np.isfinite(paid)
    rows = np.hstack([gains[some], -np.ones((int(some.sum()), 1))])
    n = gains.shape[1]
    one = Rows(np.append(np.ones(n), 0.0)[None], np.ones(1))
    objective = np.append(np.zeros(n), 1.0)
    found = minimum(objective, Rows(rows, paid[some]), one, [(0.0, None)] * n + [(None, None)])
    share, law = np.maximum(found.x[:n], 0.0), np.zeros(len(paid))
    law[some] = np.maximum(-found.duals[: int(some.sum())], 0.0)
    return share / share.sum(), found.value, law / law.sum()
