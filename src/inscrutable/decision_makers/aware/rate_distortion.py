"""The decision maker of least leakage to an aware observer, at an expected regret."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers.aware.base import AwareDecisionMaker, PriorTable, checked_options
from inscrutable.decision_makers.aware.columns import Columns, allowed_places, lotteries, rounding_of, without_small
from inscrutable.decision_makers.aware.guaranteed_aims import LeastInformation
from inscrutable.decision_makers.aware.guaranteed_makers import guarantees_of, promised, promised_rows
from inscrutable.decision_makers.aware.guaranteed_programme import PlayedGame
from inscrutable.decision_makers.aware.guarantees import Guarantee
from inscrutable.decision_makers.aware.rate_distortion_solver import BITS, Hidden, RateEffort, least_rate, rows
from inscrutable.decision_makers.aware.rate_distortion_steps import Source
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.results import DecisionStatus, MixedDecisions, Progress
from inscrutable.errors import InputError
from inscrutable.kernels.calls import one_blas_thread
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Summarised
from inscrutable.validation import Array


class RateDistortionDecisionMaker(AwareDecisionMaker["_Solution"]):
    """The decision maker of least mutual information between belief and decision, at an expected regret.

    Formula: min_K I(π;u) with Σ_b p_b Σ_m K(u_m|π_b) ρ(π_b,u_m) ≤ r; the optimum is K(u|π) ∝ q(u) e^{−s ρ(π,u)}, also for
    beliefs outside the prior's support, where only `worst_regret` limits the regret.

    Args:
        problem: The decision problem.
        budget: r: `Budget.regret(r)`, or a share of E|c*| under the prior; it holds in expectation over the prior.
        prior: The law of the beliefs, known to the observer.
        candidates: Decisions to choose from; None is about 5,000 decoys and the optimal decision at the prior's mean, the
            cheapest constant one. Where they cannot meet the budget or the cap, the optimal decisions of the prior's
            beliefs are added.
        worst_regret: A cap on the regret of every single decision, as a share of |c*(π)| or a `Budget`; None is no cap.
        plausible_only: Whether candidates that no belief explains are left out.
        gap: Bits by which `rate` and `rate_bound` may differ.
        guarantees: Guarantees of the rule, as for `least_regret`; None is none. With guarantees the rule is found by linear
            programmes with cuts, on about 60 decoys where no candidates are given, and decides for beliefs of positive prior
            weight alone.

    Raises:
        InputError: An argument is malformed.
        ModelError: At first use: no rule gives the guarantees within the budget; which of them are in conflict.
        SolverError: At first use: the budget lies between the least regret found under the guarantees and its bound.

    Cost: some hundreds of products with a table of B·M regrets. Source: Shannon's rate–distortion function; Blahut,
    Computation of Channel Capacity and Rate-Distortion Functions (IEEE Trans. IT 18, 1972), and its dual bound.

    Example:
        >>> from inscrutable import Budget, FiniteProblem, Prior
        >>> hidden = RateDistortionDecisionMaker(
        ...     FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Budget.regret(0.11), prior=Prior(np.eye(2), [0.5, 0.5])
        ... )
        >>> round(hidden.rate, 3)
        0.5
        >>> print(hidden.mechanism.probabilities.round(2))
        [[0.89 0.11]
         [0.11 0.89]]
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
        gap: float = tolerances.RATE_GAP,
        guarantees: Sequence[Guarantee] | None = None,
    ) -> None:
        options = checked_options(worst_regret, plausible_only, gap)
        asked = guarantees_of(guarantees, worst_regret)
        super().__init__(problem, budget, prior, candidates, options, asked)

    def _solve(self, progress: Progress | None) -> _Solution:
        if self.guarantees:
            return _promised(self)
        return _solved(self, [self.budget], progress)[0]

    @property
    def rate(self) -> float:
        """I(π;u) of the mechanism, in bits."""
        return self._found.rate

    @property
    def rate_bound(self) -> float:
        """No mechanism on these candidates leaks fewer bits at this expected regret."""
        return min(self._found.hidden.bound, self.rate)

    @property
    def gap(self) -> float:
        """Rate minus bound, in bits."""
        return self.rate - self.rate_bound

    @property
    def levels(self) -> tuple[float, ...]:
        """The level of each guarantee, recomputed from K, in the guarantee's unit."""
        return self._found.levels

    @property
    def price(self) -> float:
        """Bits that one more unit of expected regret would save."""
        return self._found.hidden.slope * BITS

    @property
    def status(self) -> DecisionStatus:
        """Whether rate and bound agree within the gap."""
        return DecisionStatus.GAP_REACHED if self.gap <= self.options.gap else DecisionStatus.BOUNDED

    def decide_many(self, beliefs: ArrayLike, *, progress: Progress | None = None) -> MixedDecisions:
        """Return the lotteries for beliefs (T,X)."""
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        self.solve(progress=progress)
        costs = np.asarray(self.problem.optimal_cost(held))
        if self.guarantees:
            known = self.mechanism
            shares = promised_rows(known.beliefs, known.probabilities, held)
            return lotteries(self._found.table.columns, held, costs, shares, self.status)
        columns, hidden = self._found.table.columns, self._found.hidden
        regrets = columns.clear_regrets(held, costs)
        allowed = allowed_places(regrets, self.options.worst_regret, costs)
        lost = np.zeros(len(held), dtype=bool)
        if allowed is not None:
            lost |= ~(allowed & (hidden.law > 0)).any(axis=1)
        if np.isinf(hidden.slope):
            lost |= regrets[:, hidden.law > 0].min(axis=1) > hidden.free + rounding_of(costs)
        shares = _rows(regrets, allowed, hidden)
        if lost.any():  # none of the played decisions is allowed: the optimal decision is played
            columns = columns.joined(held[lost])
            regrets = columns.clear_regrets(held, costs)
            shares = np.hstack([shares, np.zeros((len(held), len(columns) - shares.shape[1]))])
            shares[lost] = 0.0
            shares[lost, regrets[lost].argmin(axis=1)] = 1.0
        return lotteries(columns, held, costs, without_small(shares, regrets), self.status)


@dataclass(frozen=True, eq=False, repr=False)
class RateDistortionCurve(Summarised):
    """Least rates at many budgets, with their bounds.

    Args:
        regrets: Expected regrets r, shape (n,), in the cost's unit, in the order of the budgets.
        rates: Least mutual information found, shape (n,), in bits.
        bounds: No mechanism on the candidates leaks fewer bits, shape (n,).
        prices: Bits that one more unit of expected regret would save, shape (n,).

    Source: Shannon's rate–distortion function; `rate_distortion_curve` makes it.

    Example:
        >>> one = RateDistortionCurve(np.array([0.5]), np.array([1.0]), np.array([0.999]), np.array([2.0]))
        >>> print(one.summary())
              regret       bits   at least
                 0.5     1.0000     0.9990
    """

    regrets: Array
    rates: Array
    bounds: Array
    prices: Array

    def summary(self) -> str:
        """Return a table for a person to read."""
        lines = [
            f"{regret:12.6g}  {rate:9.4f}  {bound:9.4f}"
            for regret, rate, bound in zip(self.regrets, self.rates, self.bounds, strict=True)
        ]
        return "\n".join(["      regret       bits   at least", *lines])


def rate_distortion_curve(
    problem: DecisionProblem,
    prior: Prior,
    budgets: Sequence[Budget | float],
    candidates: Candidates | ArrayLike | None = None,
    progress: Progress | None = None,
) -> RateDistortionCurve:
    """Return the least mutual information at many expected regrets.

    Formula: R(r) = min_K I(π;u) with E ρ ≤ r, for every r; it is convex and decreasing.

    Args:
        problem: The decision problem.
        prior: The law of the beliefs.
        budgets: Expected regrets as `Budget.regret(r)`, or shares of E|c*|.
        candidates: Decisions to choose from; None as for `RateDistortionDecisionMaker`.
        progress: Called with (budgets done, budgets in all).

    Raises:
        InputError: An argument is malformed.

    Cost: as `RateDistortionDecisionMaker` for the first budget, less for the others, each of which starts from the next
    larger one's solution: for 2,000 beliefs and candidates a second or two of one core each. Source: Blahut (1972).

    Example:
        >>> from inscrutable import Budget, FiniteProblem, Prior
        >>> two = FiniteProblem([[0.0, 1.0], [1.0, 0.0]])
        >>> curve = rate_distortion_curve(two, Prior(np.eye(2), [0.5, 0.5]), [Budget.regret(0.11), Budget.regret(0.5)])
        >>> print(curve.rates.round(3))
        [0.5 0. ]
    """
    if isinstance(budgets, (Budget, str)) or not isinstance(budgets, Iterable):
        raise InputError(f"budgets must be a sequence of budgets such as [Budget.regret(0.1)], got {budgets!r}")
    checked = [as_budget(each) for each in budgets]
    if not checked:
        raise InputError("budgets must hold at least one budget")
    whole = RateDistortionDecisionMaker(problem, checked[0], prior=prior, candidates=candidates)
    found = _solved(whole, checked, progress)
    return RateDistortionCurve(
        np.array([each.limit for each in found]),
        np.array([each.rate for each in found]),
        np.array([min(each.hidden.bound, each.rate) for each in found]),
        np.array([each.hidden.slope * BITS for each in found]),
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    table: PriorTable  # of the decisions that are played
    hidden: Hidden
    mechanism: Mechanism
    rate: float
    limit: float
    levels: tuple[float, ...] = ()


def _promised(maker: RateDistortionDecisionMaker) -> _Solution:
    """The solution under guarantees."""

    def aim(game: PlayedGame, columns: Columns, regrets: Array) -> LeastInformation:
        # The posterior laws of the mechanism without guarantees are the first cuts.
        source = Source(game.weights, np.maximum(regrets - regrets.min(axis=1, keepdims=True), 0.0), None)
        limit = float(game.weights @ maker.budget.limits(maker.problem.optimal_cost(game.beliefs)))
        free = least_rate(source, limit, RateEffort(maker.options.gap))
        kernel = source.kernel(free.slope) if np.isfinite(free.slope) else (source.excess <= free.free).astype(float)
        return LeastInformation(game.weights, kernel / np.maximum(kernel @ free.law, tolerances.TINY)[:, None])

    found = promised(maker, lambda weights: weights[None], aim, lambda _: maker.options.gap / BITS)
    used = np.flatnonzero(found.game.played(found.solved.table) > 0)
    shares, regrets, columns = found.solved.table[:, used], found.regrets[:, used], found.columns.pick(used)
    costs = np.asarray(maker.problem.optimal_cost(found.game.beliefs))
    law, regret = found.game.weights @ shares, float(found.game.weights @ (shares * regrets).sum(axis=1))
    hidden = Hidden(law, found.price, found.solved.regret * BITS, found.solved.bound * BITS, regret)
    mechanism = Mechanism(found.game.beliefs, maker.problem.as_actions(columns.points), shares, regrets)
    limit = float(found.game.weights @ maker.budget.limits(costs))
    small = PriorTable(columns, costs, regrets, None)
    return _Solution(small, hidden, mechanism, _rate(shares, found.game.weights), limit, found.levels)


def _solved(maker: RateDistortionDecisionMaker, budgets: list[Budget], progress: Progress | None) -> list[_Solution]:
    """The solutions for budgets, found from the largest to the smallest.

    On one thread of linear algebra: the many short products wait for memory, and on a busy machine threads wait for each other.
    """
    with one_blas_thread():
        return _solved_in_turn(maker, budgets, progress)


def _solved_in_turn(
    maker: RateDistortionDecisionMaker, budgets: list[Budget], progress: Progress | None
) -> list[_Solution]:
    table, weights = maker._table(maker.columns), maker.prior.weights
    limits = [float(weights @ budget.limits(table.optimal_costs)) for budget in budgets]
    slack = float(weights @ rounding_of(table.optimal_costs))
    if not (np.isfinite(table.least).all() and float(weights @ table.least) <= min(limits) + slack):
        table = maker._table(maker.columns.joined(maker.prior.beliefs))
    least = table.least
    source = Source(weights, np.maximum(table.regrets - least[:, None], 0.0), table.allowed)
    found: dict[int, _Solution] = {}
    last: Hidden | None = None
    effort = RateEffort(maker.options.gap, progress=progress if len(budgets) == 1 else None)
    for done, index in enumerate(np.argsort(-np.array(limits), kind="stable")):
        last = least_rate(source, max(limits[index] - float(weights @ least), 0.0), effort, last)
        found[int(index)] = _solution(maker.prior, table, source, last, limits[index])
        if progress is not None and len(budgets) > 1:
            progress(done + 1, len(budgets))
    return [found[i] for i in range(len(budgets))]


def _solution(prior: Prior, table: PriorTable, source: Source, hidden: Hidden, limit: float) -> _Solution:
    shares = rows(source, hidden)
    # A belief of weight 0 does not enter the law, and the cap may forbid it all played decisions.
    lost = np.flatnonzero(shares.sum(axis=1) <= 0)
    shares[lost, table.regrets[lost].argmin(axis=1)] = 1.0
    used = np.flatnonzero((hidden.law > 0) | (shares[lost] > 0).any(axis=0))
    shares = without_small(shares[:, used], table.regrets[:, used])
    columns = table.columns.pick(used)
    mechanism = Mechanism(
        prior.beliefs, table.columns.problem.as_actions(columns.points), shares, table.regrets[:, used]
    )
    allowed = None if table.allowed is None else table.allowed[:, used]
    small = PriorTable(columns, table.optimal_costs, table.regrets[:, used], allowed)
    of_used = replace(hidden, law=hidden.law[used])
    return _Solution(small, of_used, mechanism, _rate(shares, prior.weights), limit)


def _rate(shares: Array, weights: Array) -> float:
    """I(π;u) in bits."""
    played = weights @ shares
    some = shares > 0
    ratios = np.log2(np.divide(shares, played, out=np.ones_like(shares), where=some & (played > 0)))
    return max(float(weights @ (shares * ratios).sum(axis=1)), 0.0)


def _rows(regrets: Array, allowed: np.ndarray | None, hidden: Hidden) -> Array:
    """K ∝ q e^{−s ρ} of any beliefs (T,M)."""
    if not len(regrets):
        return regrets
    within = np.broadcast_to(hidden.law > 0, regrets.shape) if allowed is None else allowed & (hidden.law > 0)
    excess = np.where(within, regrets, np.inf)
    excess = np.where(within, regrets - excess.min(axis=1, keepdims=True), 0.0)
    return rows(Source(np.ones(len(regrets)), excess, within), hidden)
