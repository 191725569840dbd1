"""The committed mechanism that maximises the Bayes estimation error of the aware observer: persuasion, a Stackelberg game."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget
from inscrutable.decision_makers.aware.base import AwareDecisionMaker, PriorTable, checked_options
from inscrutable.decision_makers.aware.columns import (
    Columns,
    allowed_places,
    lotteries,
    places_of,
    rounding_of,
    without_small,
)
from inscrutable.decision_makers.aware.guaranteed_aims import LeastWorth
from inscrutable.decision_makers.aware.guaranteed_makers import guarantees_of, promised, promised_rows
from inscrutable.decision_makers.aware.guaranteed_programme import PlayedGame
from inscrutable.decision_makers.aware.guarantees import Guarantee
from inscrutable.decision_makers.aware.stackelberg_answers import AnswerGame, largest_loss
from inscrutable.decision_makers.aware.stackelberg_game import Game
from inscrutable.decision_makers.aware.stackelberg_solver import largest_error
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.envelope import best_mixtures
from inscrutable.decision_makers.results import DecisionStatus, MixedDecisions, Progress
from inscrutable.kernels.calls import one_blas_thread
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.privacy.losses import DecisionLoss, Loss, loss_of_rule
from inscrutable.problems import DecisionProblem
from inscrutable.validation import Array

_SMALL = 20_000
"""Pairs of belief and decision up to which the gap is a millionth unless another is asked for."""


class StackelbergDecisionMaker(AwareDecisionMaker["_Solution"]):
    """The committed mechanism that maximises the aware observer's mean square error about the belief, at an expected regret.

    Formula: max_K min_μ Σ_b p_b Σ_m K(u_m|π_b) ‖π_b − μ_m‖² with Σ_m K(u_m|π_b) ρ(π_b,u_m) ≤ r_b for every belief; the
    best μ_m is the posterior mean after u_m. A belief outside the prior's support plays a best reply to the fixed estimates:
    the lottery over the played decisions of the largest error within its own budget, mixed with its own optimal decision
    where none of them is affordable.

    Args:
        problem: The decision problem.
        budget: r_b: a share of |c*(π_b)|, or a `Budget`; it holds in expectation given the belief, as for the PDM.
        prior: The law of the beliefs, known to the observer.
        candidates: Decisions to choose from; None is about 5,000 decoys. Where they cannot meet a belief's budget, its
            optimal decision is added.
        worst_regret: A cap on the regret of every single decision, as a share of |c*(π)| or a `Budget`; None is no cap.
        plausible_only: Whether candidates that no belief explains are left out.
        gap: Largest gap between `value` and `bound`, as a share of the bound; None is 1e-6 up to 20,000 pairs of belief
            and candidate, and 0.01 above or with guarantees. With a loss both are counted from the loss at the known belief.
        loss: The observer's loss, instead of the square error ‖π − μ‖²: `NamingError()`, `RivalProblem(problem)`.
        guarantees: Guarantees of the rule, as for `least_regret`; None is none. With guarantees the rule is found by linear
            programmes with cuts, on about 60 decoys where no candidates are given, and decides for beliefs of positive prior
            weight alone.

    Raises:
        InputError: An argument is malformed.
        ModelError: At first use: no rule gives the guarantees within the budgets; which of them are in conflict.
        SolverError: At first use: a budget lies between the least regret found under the guarantees and its bound.

    Cost: five to nine seconds for 500 beliefs and 2,000 candidates at 1 %, most where budgets are small; a tenth of one
    for 15,000 pairs at 1e-6.
    Source: the saddle point of a Stackelberg game whose follower estimates; compare Crawford and Sobel, Strategic
    Information Transmission (Econometrica 50, 1982).

    Example:
        >>> from inscrutable import Budget, FiniteProblem, Prior
        >>> hidden = StackelbergDecisionMaker(
        ...     FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Budget.regret(0.25), prior=Prior(np.eye(2), [0.5, 0.5])
        ... )
        >>> round(hidden.value, 4), round(hidden.bound, 4)
        (0.375, 0.375)
    """

    def __init__(
        self,
        problem: DecisionProblem,
        budget: Budget | float,
        *,
        prior: Prior,
        candidates: Candidates | ArrayLike | None = None,
        worst_regret: Budget | float | None = None,
        plausible_only: bool = True,
        gap: float | None = None,
        loss: Loss | None = None,
        guarantees: Sequence[Guarantee] | None = None,
    ) -> None:
        options = checked_options(worst_regret, plausible_only, 1.0 if gap is None else gap)
        super().__init__(problem, budget, prior, candidates, options, guarantees_of(guarantees, worst_regret))
        self.asked = gap
        self.loss = loss_of_rule(loss, self.problem.n_states, self.problem)

    def _solve(self, progress: Progress | None) -> _Solution:
        return _promised(self) if self.guarantees else _solved(self, progress)

    @property
    def value(self) -> float:
        """The observer's mean loss: of the square error in squared units of belief (Euclidean)."""
        return self._found.value

    @property
    def bound(self) -> float:
        """No mechanism on these candidates within these budgets leaves a larger mean loss."""
        return max(self._found.bound, self.value)

    @property
    def gap(self) -> float:
        """(bound − value) / bound, both counted from the loss at the known belief; zero where the bound is."""
        # Where the belief is worth nothing to the rival all of them are equal to rounding.
        same = 0.0 if isinstance(self.loss, DecisionLoss) else tolerances.SAME_BELIEF**2
        none = max(tolerances.NO_ERROR * max(self._found.prior_error, abs(self._found.least)), same)
        short = self.bound - self.value
        return 0.0 if short <= none else short / (self.bound - self._found.least)

    @property
    def status(self) -> DecisionStatus:
        """Whether value and bound agree within the gap."""
        return DecisionStatus.GAP_REACHED if self.gap <= self._found.goal else DecisionStatus.BOUNDED

    @property
    def levels(self) -> tuple[float, ...]:
        """The level of each guarantee, recomputed from K, in the guarantee's unit."""
        return self._found.levels

    @property
    def estimates(self) -> Array:
        """The observer's estimate after each of the mechanism's decisions: the posterior mean, shape (M,X)."""
        return self._found.estimates

    def summary(self) -> str:
        """Return two lines for a person to read."""
        return (
            f"loss of the aware observer  {self.value:.6g} of at most {self.bound:.6g} ({self.loss.unit})\n"
            f"{len(self.estimates)} decisions for {len(self.prior)} beliefs; {self.status.value}"
        )

    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> MixedDecisions:
        """Return the lotteries for beliefs (T,X)."""
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        self.solve(progress=progress)
        costs = np.asarray(self.problem.optimal_cost(held))
        columns = self._found.columns
        if self.guarantees:
            shares = promised_rows(self.mechanism.beliefs, self.mechanism.probabilities, held)
            return lotteries(columns, held, costs, shares, self.status)
        rows = np.zeros((len(held), len(columns)))
        place = places_of(self.prior.beliefs, held)
        known = place >= 0
        rows[known] = self._found.mechanism.probabilities[place[known]]
        if not known.all():
            columns, answers = self._answered(held[~known], costs[~known])
            rows = np.hstack([rows, np.zeros((len(held), answers.shape[1] - rows.shape[1]))])
            rows[~known] = answers
        return lotteries(columns, held, costs, rows, self.status)

    def _answered(self, beliefs: Array, costs: Array) -> tuple[Columns, Array]:
        """Columns and rows of best replies to the fixed estimates, each within its budget and the cap."""
        columns = self._found.columns
        limits = self.budget.limits(costs)
        regrets = columns.clear_regrets(beliefs, costs)
        allowed = allowed_places(regrets, self.options.worst_regret, costs)
        least = regrets if allowed is None else np.where(allowed, regrets, np.inf)
        poor = np.flatnonzero(least.min(axis=1) > limits + rounding_of(costs))
        n_played = len(columns)
        gains = self._gains(beliefs)
        if poor.size:  # an optimal decision outside the mechanism is taken at face value: its error is 0
            columns = columns.joined(beliefs[poor])
            regrets = columns.clear_regrets(beliefs, costs)
            own = np.zeros((len(beliefs), len(columns) - n_played), dtype=bool)
            own[poor] = True
            gains = np.hstack([gains, np.zeros(own.shape)])
            allowed = np.ones(regrets.shape, dtype=bool)
            allowed[:, n_played:] = own
            within = allowed_places(regrets, self.options.worst_regret, costs)
            allowed = allowed if within is None else allowed & within
        table = PriorTable(columns, costs, regrets, allowed)
        return columns, _answers(table, gains, limits)

    def _gains(self, beliefs: Array) -> Array:
        """The excess loss of the fixed answers over the loss at the known belief, shape (T,M)."""
        answers = self._found.answers
        if answers is None:
            return np.asarray(((beliefs[:, None, :] - self.estimates[None]) ** 2).sum(axis=2))
        assert isinstance(self.loss, DecisionLoss)
        best = np.atleast_1d(self.loss.precise(beliefs.shape[1]).optimal_cost(beliefs))
        return np.asarray(beliefs @ answers.T - best[:, None])


@dataclass(frozen=True, eq=False)
class _Solution:
    columns: Columns  # those that are played
    mechanism: Mechanism
    estimates: Array
    value: float
    bound: float
    prior_error: float  # beyond `least`
    goal: float
    least: float = 0.0  # the loss at the known belief
    answers: Array | None = None  # state costs of the rival's mixed answers, where it has a decision of its own

    levels: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        validation.read_only(self, "estimates")


def _promised(maker: StackelbergDecisionMaker) -> _Solution:
    """The solution under guarantees: the reduction of the observer's loss is minimised."""
    share = tolerances.ERROR_GAP if maker.asked is None else maker.asked

    def aim(game: PlayedGame, columns: Columns, regrets: Array) -> LeastWorth:
        return LeastWorth(maker.loss, game)

    found = promised(maker, lambda weights: np.eye(len(weights)), aim, lambda wanted: 0.5 * share * wanted.spread)
    game, table, solved = found.game, found.solved.table, found.solved
    used = np.flatnonzero(game.played(table) > 0)
    columns, most = found.columns.pick(used), LeastWorth(maker.loss, game).spread
    least = float(game.weights @ maker.loss.least(game.beliefs))
    known = (least + most - solved.regret, least + most - solved.bound, most, share, least)
    mechanism = Mechanism(
        game.beliefs, maker.problem.as_actions(columns.points), table[:, used], found.regrets[:, used]
    )
    return _Solution(columns, mechanism, game.means(table)[used], *known, levels=found.levels)


def _solved(maker: StackelbergDecisionMaker, progress: Progress | None) -> _Solution:
    prior = maker.prior
    table = maker._table(maker.columns)
    limits = maker.budget.limits(table.optimal_costs)
    poor = ~(table.least <= limits + rounding_of(table.optimal_costs))
    if poor.any():
        table = maker._table(maker.columns.joined(prior.beliefs[poor]))
    held = prior.weights > tolerances.NO_WEIGHT  # beliefs of weight 0 play best replies, and count in the bound
    goal = maker.asked
    if goal is None:
        small = np.count_nonzero(held) * len(table.columns) <= _SMALL
        goal = tolerances.SMALL_ERROR_GAP if small else tolerances.ERROR_GAP
    budgeted = _budgeted(table, limits)
    with one_blas_thread():  # threads wait for each other on a busy machine
        if isinstance(maker.loss, DecisionLoss):
            return _answered(maker.loss, prior, table, budgeted, (held, goal, progress))
        return _estimated(prior, table, budgeted, (held, goal, progress))


_Asked = tuple[np.ndarray, float, Progress | None]
"""Beliefs of weight, the gap, and the progress function."""


def _estimated(prior: Prior, table: PriorTable, budgeted: tuple[np.ndarray, Array], asked: _Asked) -> _Solution:
    """The solution for the square error."""
    (allowed, costs), (held, goal, progress) = budgeted, asked
    # Orthonormal coordinates in which beliefs differ: one fewer than there are states.
    basis = np.linalg.svd(np.ones((1, prior.beliefs.shape[1])))[2][1:]
    points = (prior.beliefs - prior.mean) @ basis.T
    game = Game(points[held], prior.weights[held], costs[held], allowed[held])
    found = largest_error(game, 0.8 * goal, progress)
    replies = Game(points, prior.weights, costs, allowed).bound(found.estimates)
    shares = replies.rows(costs.shape[1])
    bound = found.bound + float(prior.weights[~held] @ replies.values[~held])
    shares[held] = without_small(found.rows, table.regrets[held], tolerances.SELDOM * tolerances.SELDOM * goal)
    return _solution(prior, table, shares, prior.mean + found.estimates @ basis, (bound, game.spread, goal))


def _answered(
    loss: DecisionLoss, prior: Prior, table: PriorTable, budgeted: tuple[np.ndarray, Array], asked: _Asked
) -> _Solution:
    """The solution for a rival with a decision of its own."""
    held, goal, progress = asked
    whole = AnswerGame.of(loss, prior.beliefs, prior.weights, budgeted)
    game = whole.some(held)
    found = largest_loss(game, 0.8 * goal, progress)
    replies = whole.bound(found.answers)
    shares = replies.rows(whole.costs.shape[1])
    bound = found.bound + float(prior.weights[~held] @ replies.values[~held])
    shares[held] = without_small(found.rows, table.regrets[held], tolerances.SELDOM * tolerances.SELDOM * goal)
    least = float(prior.weights @ loss.least(prior.beliefs))
    means = np.tile(prior.mean, (whole.costs.shape[1], 1))
    made = _solution(prior, table, shares, means, (least + bound, game.spread, goal))
    used = np.flatnonzero((shares > 0).any(axis=0))
    return replace(made, value=least + whole.error(shares), least=least, answers=found.answers[used])


def _solution(
    prior: Prior, table: PriorTable, shares: Array, estimates: Array, known: tuple[float, float, float]
) -> _Solution:
    """The played decisions, the posterior means after them, and the loss that they leave."""
    used = np.flatnonzero((shares > 0).any(axis=0))
    rows = shares[:, used]
    sums = (rows * prior.weights[:, None]).T @ prior.beliefs
    played = sums.sum(axis=1)
    means = np.where((played > 0)[:, None], sums / np.where(played > 0, played, 1.0)[:, None], estimates[used])
    value = 0.0
    for column, mean in enumerate(means):
        value += float((prior.weights * rows[:, column]) @ ((prior.beliefs - mean) ** 2).sum(axis=1))
    columns = table.columns.pick(used)
    actions = columns.problem.as_actions(columns.points)
    return _Solution(columns, Mechanism(prior.beliefs, actions, rows, table.regrets[:, used]), means, value, *known)


def _budgeted(table: PriorTable, limits: Array) -> tuple[np.ndarray, Array]:
    least, rounding = table.least, rounding_of(table.optimal_costs)
    allowed = np.ones(table.regrets.shape, dtype=bool) if table.allowed is None else table.allowed
    spare = limits - least
    tight = spare <= rounding
    allowed = allowed & ~(tight[:, None] & (table.regrets > (least + rounding)[:, None]))
    excess = np.maximum(table.regrets - least[:, None], 0.0) / np.where(tight, 1.0, spare)[:, None]
    return allowed, np.where(tight[:, None], 0.0, excess)


def _answers(table: PriorTable, gains: Array, limits: Array) -> Array:
    allowed, costs = _budgeted(table, limits)
    return best_mixtures(costs, gains, np.ones(len(limits)), allowed).rows(gains.shape[1])
