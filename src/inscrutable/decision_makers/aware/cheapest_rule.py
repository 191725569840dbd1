"""The mechanism of least regret under some guarantees, the price of each, and the guarantees that contradict each other."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.budgets import Budget
from inscrutable.decision_makers.aware.columns import Columns, columns_of, lotteries, places_of
from inscrutable.decision_makers.aware.guaranteed_programme import PlayedGame, Solved, cheapest_table, nearest_columns
from inscrutable.decision_makers.aware.guarantees import Guarantee
from inscrutable.decision_makers.candidate_sources import as_candidates, decoy_grid
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.results import DecisionStatus, MixedDecision, MixedDecisions
from inscrutable.errors import InputError, ModelError, SolverError
from inscrutable.geometry.grids import largest_resolution
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.priors import checked_prior, without_copies
from inscrutable.mechanisms.same_actions import first_same
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.saved import Summarised

_DECOYS = 60
"""Decoys among the candidates where none are given: programmes grow with beliefs times candidates. With 20 decoys, 11 of 16
rules for 6 to 20 beliefs cost up to 11 % more, in .4 times the time; with 150, 12 cost up to 1 % less, in 5 times the time."""


class LeastRegretStatus(Enum):
    """Whether the least regret was found; the text says what to do about it.

    Example:
        >>> LeastRegretStatus.OPTIMAL.value
        'optimal: regret and bound agree within the gap; other candidates may be cheaper'
    """

    OPTIMAL = "optimal: regret and bound agree within the gap; other candidates may be cheaper"
    BOUNDED = (
        "bounded: the guarantees hold, but the regret may be reduced as far as to its bound; ask for fewer candidates"
    )
    CONTRADICTION = "contradiction: no rule on these candidates gives them all; one of those in conflict must give way"


@dataclass(frozen=True, eq=False, repr=False)
class LeastRegret(Summarised):
    """The rule of least expected regret under some guarantees; it decides for the beliefs of positive prior weight.

    Args:
        problem: The decision problem.
        guarantees: The guarantees asked for, in the given order.
        mechanism: K on the prior's beliefs with weight and the decisions that are played; None where no rule exists.
        regret: Σ_b w_b Σ_m K(u_m|π_b) ρ(π_b,u_m), in the cost's unit; infinite where no rule exists.
        bound: No rule on these candidates that satisfies the guarantees has a smaller expected regret. Where none exists
            because of a budget: the least regret of a rule that satisfies the others.
        silence_regret: r₀ of the prior, at which the best constant decision is played.
        levels: The level of each guarantee that the rule reaches, recomputed from K: in the guarantee's unit, for a
            `Budget` the regret. NaN where no rule exists, as are the prices.
        prices: Marginal regret that relaxing each guarantee by one unit would save, in the cost's unit per unit of the
            guarantee; 0 for one that does not bind. At a kink of the least regret it lies between both one-sided prices.
            Where a floor is the largest possible, the price may be 0 although a lower floor saves regret.
        conflict: Indices of an irreducible infeasible subset: no rule satisfies these guarantees together, but without any
            one of them some rule satisfies the others; empty where a rule exists.
        status: Whether regret and bound agree within the gap.

    Source: linear programming duality; see `least_regret`.

    Example:
        >>> from inscrutable import Budget, FiniteProblem, NamingErrorFloor, Prior, least_regret
        >>> guess, prior = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), Prior(np.eye(2), [0.5, 0.5])
        >>> print(least_regret(guess, prior, [Budget.regret(0.1), NamingErrorFloor(0.25)]).summary())
        contradiction: no rule on these candidates gives them all; one of those in conflict must give way
          in conflict: expected regret of at most 0.1
          in conflict: naming error after every decision at least 0.25
          without the budget the others cost a regret of at least 0.25
    """

    problem: DecisionProblem
    guarantees: tuple[Guarantee | Budget, ...]
    mechanism: Mechanism | None
    regret: float
    bound: float
    silence_regret: float
    levels: tuple[float, ...]
    prices: tuple[float, ...]
    conflict: tuple[int, ...]
    status: LeastRegretStatus
    columns: Columns | None = None

    @property
    def gap(self) -> float:
        """Regret minus bound, in the cost's unit; infinite where no rule exists."""
        return self.regret - self.bound

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        if self.mechanism is None:
            lines = [f"  in conflict: {_spoken(self.guarantees[place])}" for place in self.conflict]
            if np.isfinite(self.bound):
                lines.append(f"  without the budget the others cost a regret of at least {self.bound:.4g}")
            return "\n".join([self.status.value, *lines])
        share = f", {self.regret / self.silence_regret:.1%} of the silence regret" if self.silence_regret > 0 else ""
        lines = [f"least regret {self.regret:.4g}{share}; none below {self.bound:.4g} on these candidates"]
        for asked, level, price in zip(self.guarantees, self.levels, self.prices, strict=True):
            lines.append(f"  {_spoken(asked)}: {level:.4g} given, {price:.4g} a unit")
        return "\n".join([*lines, self.status.value])

    def decide(self, belief: ArrayLike, *, nearest: bool = False) -> MixedDecision:
        """Return the lottery for one belief (X,); see `decide_many`."""
        held = validation.one_belief(belief, self.problem.n_states, names=self.problem.state_names)
        return self.decide_many(held[None], nearest=nearest)[0]

    def decide_many(self, beliefs: ArrayLike, *, nearest: bool = False) -> MixedDecisions:
        """Return the lotteries for beliefs (T,X).

        Args:
            beliefs: Beliefs that the prior gives weight: the guarantees do not cover others.
            nearest: Whether another belief plays the lottery of the nearest one of the prior. The guarantees then hold for
                that one, if the prior is its law, as `filtered_prior` is of beliefs rounded to a grid.

        Raises:
            InputError: A belief is none of the prior's with weight, and `nearest` is False.
            ModelError: No rule gives the guarantees.
        """
        if self.mechanism is None or self.columns is None:
            raise ModelError(self.summary())
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        known = self.mechanism.beliefs
        place = places_of(known, held)
        missing = np.flatnonzero(place < 0)
        if missing.size:
            apart = ((held[missing, None, :] - known[None]) ** 2).sum(axis=2)
            if not nearest:
                raise InputError(
                    f"belief {held[missing[0]]} is none of the {len(known)} beliefs that the prior gives weight, so nothing is "
                    f"guaranteed there; the nearest is {known[apart[0].argmin()]}: nearest=True plays what it plays"
                )
            place[missing] = apart.argmin(axis=1)
        status = DecisionStatus.GAP_REACHED if self.status is LeastRegretStatus.OPTIMAL else DecisionStatus.BOUNDED
        rows = np.asarray(self.mechanism.probabilities)[place]
        return lotteries(self.columns, held, np.asarray(self.problem.optimal_cost(held)), rows, status)


def least_regret(
    problem: DecisionProblem,
    prior: Prior,
    guarantees: Sequence[Guarantee | Budget],
    *,
    candidates: Candidates | ArrayLike | None = None,
    gap: float = tolerances.LEAST_REGRET_GAP,
) -> LeastRegret:
    """Return the rule of least expected regret that satisfies given guarantees against the aware observer.

    Formula: min_K Σ_b w_b Σ_m K(u_m|π_b) ρ(π_b,u_m) over tables K(u|π) that satisfy every guarantee. Example: for n equally
    likely secrets and a cost of 1 for a wrong guess, under ε nats of pointwise maximal leakage: 1 − min(1, e^ε/n).

    Args:
        problem: The decision problem.
        prior: The law of the beliefs, known to the observer.
        guarantees: `PointwiseLeakageCap`, `MaximalLeakageCap`, `DetectabilityCap`, `NamingErrorFloor`, `SquaredErrorFloor` and
            `MeanSquaredErrorFloor`, in any number, and a `Budget` for the expected regret; a share is one of E|c*|. All of
            them hold at once.
        candidates: Decisions to choose from; None is some 60 decoys. The optimal decisions of the prior's beliefs and of its
            mean are added.
        gap: Largest gap between regret and bound, as a share of the silence regret; used for floors on square errors, which
            are not linear.

    Returns:
        A `LeastRegret`: a rule with `decide`, its regret, bound and prices; or which guarantees contradict each other.

    Raises:
        InputError: An argument is malformed.
        SolverError: A budget lies between the regret that was found and its bound.

    Cost: a linear programme in beliefs times candidates, solved again for every round of cuts and, where guarantees contradict
    each other, for each of them: 1 s for 90 times 90 with a pointwise cap, half a minute for 66 times 67 with a floor on square
    errors. Beyond 15,000 pairs by column generation: 491 times 547 takes 30 s with a pointwise cap and 15 s with a
    floor on the naming error. Source: mechanisms of least distortion as linear programmes, as in Saeidian et al.
    (2023); cutting planes: Kelley (J. SIAM 8, 1960).

    Example:
        >>> from inscrutable import FiniteProblem, PointwiseLeakageCap, Prior
        >>> secrets = Prior(np.eye(3), np.full(3, 1 / 3))
        >>> found = least_regret(FiniteProblem(1.0 - np.eye(3)), secrets, [PointwiseLeakageCap(nats=1.0)])
        >>> round(found.regret, 3), round(1 - np.e / 3, 3)
        (0.094, 0.094)
    """
    checked_problem(problem)
    held = without_copies(checked_prior(prior, problem))
    search = RegretSearch(problem, held, candidates, validation.positive(gap, "gap"))
    return search.found(checked_guarantees(guarantees))


class RegretSearch:
    """The game of a problem and a prior on some candidates, solved for some of the guarantees or all."""

    def __init__(
        self,
        problem: DecisionProblem,
        prior: Prior,
        candidates: Candidates | ArrayLike | None,
        gap: float,
        *,
        plausible_only: bool = False,
    ) -> None:
        self.problem = problem
        some = prior.weights > 0
        beliefs, weights = prior.beliefs[some], prior.weights[some]
        given = _few_decoys(problem) if candidates is None else as_candidates(problem, candidates)
        self.columns = columns_of(problem, given, plausible_only).joined(np.vstack([beliefs, prior.mean]))
        self.optimal_costs = np.asarray(problem.optimal_cost(beliefs))
        self.regrets = self.columns.clear_regrets(beliefs, self.optimal_costs)
        first = first_same(np.vstack([self.columns.points, problem.solve_points(beliefs)]))[len(self.columns) :]
        honest = np.bincount(first, weights=weights, minlength=len(self.columns)).astype(np.float64)
        self.game = PlayedGame(beliefs, weights, honest, nearest_columns(self.regrets))
        self.silence = float((weights @ self.regrets).min())
        self.goal = gap * self.silence + tolerances.NO_REGRET * float(self.regrets.max())

    def solved(self, guarantees: Iterable[Guarantee | Budget]) -> Solved:
        """Return the cheapest table that gives the guarantees."""
        rules = tuple(each for each in guarantees if isinstance(each, Guarantee))
        return cheapest_table(self.game, self.regrets, rules, self.goal)

    def limit(self, budget: Budget) -> float:
        """The largest expected regret."""
        return float(self.game.weights @ budget.limits(self.optimal_costs))

    def found(self, guarantees: tuple[Guarantee | Budget, ...]) -> LeastRegret:
        """Return the cheapest rule, or the guarantees that contradict each other."""
        for place, each in enumerate(guarantees):
            if isinstance(each, Guarantee) and each.limit - each.most(self.game) > tolerances.GUARANTEE_ROUNDING:
                return self._contradiction(guarantees, (place,), np.inf)
        solved = self.solved(guarantees)
        budgets = [(self.limit(each), place) for place, each in enumerate(guarantees) if isinstance(each, Budget)]
        limit, place = min(budgets, default=(np.inf, -1))
        if not self._exceeds(solved.regret, limit):
            return self._rule(guarantees, solved)
        if not self._exceeds(solved.bound, limit):
            raise undecided(limit, solved.regret, solved.bound, "ask for a smaller gap, or for fewer candidates")
        return self._contradiction(guarantees, self._irreducible(guarantees, solved, limit, place), solved.bound)

    def _exceeds(self, regret: float, limit: float) -> bool:
        return regret > limit * (1.0 + tolerances.REGRET_MET) + tolerances.NO_REGRET * float(self.regrets.max())

    def _irreducible(
        self, guarantees: tuple[Guarantee | Budget, ...], solved: Solved, limit: float, budget: int
    ) -> tuple[int, ...]:
        """An irreducible set of guarantees that together exceed the budget; those without a price are dropped first."""
        rules = [place for place, each in enumerate(guarantees) if isinstance(each, Guarantee)]
        prices = dict(zip(rules, solved.prices, strict=True))
        kept = sorted(rules, key=lambda place: prices[place])
        for place in tuple(kept):
            fewer = [other for other in kept if other != place]
            if self._exceeds(self.solved(guarantees[other] for other in fewer).bound, limit):
                kept = fewer
        return tuple(sorted([budget, *kept]))

    def _contradiction(
        self, guarantees: tuple[Guarantee | Budget, ...], conflict: tuple[int, ...], bound: float
    ) -> LeastRegret:
        nothing = (float("nan"),) * len(guarantees)
        return LeastRegret(
            self.problem,
            guarantees,
            None,
            float("inf"),
            bound,
            self.silence,
            nothing,
            nothing,
            conflict,
            LeastRegretStatus.CONTRADICTION,
        )

    def _rule(self, guarantees: tuple[Guarantee | Budget, ...], solved: Solved) -> LeastRegret:
        used = np.flatnonzero(self.game.played(solved.table) > 0)
        columns = self.columns.pick(used)
        actions = self.problem.as_actions(columns.points)
        prices = iter(solved.prices)
        near = solved.regret - solved.bound <= self.goal
        return LeastRegret(
            self.problem,
            guarantees,
            Mechanism(self.game.beliefs, actions, solved.table[:, used], self.regrets[:, used]),
            solved.regret,
            solved.bound,
            self.silence,
            tuple(
                each.level(self.game, solved.table) if isinstance(each, Guarantee) else solved.regret
                for each in guarantees
            ),
            tuple(next(prices) if isinstance(each, Guarantee) else 0.0 for each in guarantees),
            (),
            LeastRegretStatus.OPTIMAL if near else LeastRegretStatus.BOUNDED,
            columns,
        )


def undecided(limit: float, regret: float, bound: float, advice: str) -> SolverError:
    """Return the error of a budget of which it is not known whether a rule keeps it."""
    return SolverError(
        f"a budget of {limit:.6g} lies between the regret found, {regret:.6g}, and its bound, {bound:.6g}: {advice}"
    )


def _few_decoys(problem: DecisionProblem) -> Candidates:
    return decoy_grid(problem, largest_resolution(problem.n_states, _DECOYS))


def checked_guarantees(guarantees: Sequence[Guarantee | Budget]) -> tuple[Guarantee | Budget, ...]:
    """Return guarantees and budgets, or raise `InputError`."""
    expected = "guarantees must be a list such as [PointwiseLeakageCap(nats=0.5), Budget.regret(0.1)]"
    if isinstance(guarantees, (Guarantee, Budget, str)) or not isinstance(guarantees, Iterable):
        raise InputError(f"{expected}, got {guarantees!r}")
    held = tuple(guarantees)
    for place, each in enumerate(held):
        if not isinstance(each, (Guarantee, Budget)):
            raise InputError(f"{expected}; got {each!r} at place {place}")
    return held


def _spoken(asked: Guarantee | Budget) -> str:
    if isinstance(asked, Guarantee):
        return str(asked)
    return f"expected regret of at most {asked.amount:.4g}{' of E|c*|' if asked.is_relative else ''}"
