"""The most private affordable weights for each belief, and the lottery over weights."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.adversaries import affordable_beliefs, consistent_beliefs
from inscrutable.budgets import Budget, as_budget
from inscrutable.datasets.tables import FULL_PRECISION_DIGITS
from inscrutable.decision_makers import (
    CounterAdversarialDecisionMaker,
    Decisions,
    DecisionStatus,
    GlobalSearch,
    MixedDecisions,
    ProbabilisticDecisionMaker,
)
from inscrutable.decision_makers.arguments import checked_measure
from inscrutable.decision_makers.proofs.certified import check_provable, checked_gap
from inscrutable.decision_makers.results import Progress
from inscrutable.errors import InputError
from inscrutable.experiments.attack import Attack, Reading
from inscrutable.experiments.episodes import part_of
from inscrutable.experiments.holding import Reached, Requirement, best_ranking, estimate_quality, requirement_of
from inscrutable.experiments.investor_model import BASIS_POINTS, InvestorModel, checked_model
from inscrutable.experiments.silence import silence_in
from inscrutable.geometry import BeliefSet
from inscrutable.privacy import DesiredObfuscation, MaximalObfuscation, PrivacyMeasure
from inscrutable.validation import Array

_KEPT = 0.9  # share of the privacy that rounded weights must keep
PARTS = 3  # parts of the work: CDM, PDM, and the set of the budget-aware observer


@dataclass(frozen=True, eq=False)
class Protection:
    """Weights to publish instead of the optimal ones, their regret, and an observer's inference from them.

    Args:
        model: The investor.
        index: Labels of the rows, T of them.
        beliefs: The investor's own beliefs π, shape (T,X).
        optimal: u*(π), the optimal weights, shape (T,U).
        optimal_sets: Π(u*), the beliefs consistent with these.
        budget: The budget per row.
        measure: The privacy measure Ψ.
        deterministic: The most private affordable weights (CDM).
        lotteries: The lotteries of largest expected privacy (PDM).
        drawn: One draw of each lottery.
        aware_bounds: Bounds of the budget-aware observer, who knows the budget (above 100 % of |c*| the regret allowed in that
            row), from the CDM's weights: least and greatest probability of each regime under which they are affordable, shape
            (T,X,2); they contain π.
        planned: The readings of the planned weights, if the beliefs came from weights; else None.
        certified: The relative gap of the requested proof, or None; with a proof `deterministic.privacy_bound` and
            `lotteries.privacy_bound` are valid bounds.
    """

    model: InvestorModel
    index: pd.Index
    beliefs: Array
    optimal: Array
    optimal_sets: tuple[BeliefSet, ...]
    budget: Budget
    measure: PrivacyMeasure
    deterministic: Decisions
    lotteries: MixedDecisions
    drawn: Decisions
    aware_bounds: Array
    planned: Attack | None = None
    certified: float | None = None

    def __len__(self) -> int:
        return len(self.beliefs)

    def summary(self) -> str:
        """Return one sentence: privacy and regret of the weights and of the lottery."""
        scale = np.abs(self.deterministic.optimal_cost)
        spent = BASIS_POINTS * float(np.mean(self.deterministic.regret))
        lottery = BASIS_POINTS * float(np.mean(self.lotteries.expected_cost - self.lotteries.optimal_cost))
        share = f" ({float(self.deterministic.regret.sum() / scale.sum()):.1%} of |c*|)" if (scale > 0).all() else ""
        rows = "" if len(self) == 1 else f"on average over {len(self)} rows "
        if self.measure.is_indicator:
            bought = f" and {self.measure!r} {_how_often(self.deterministic.privacy)}"
            by_lot = f" and it {_how_often(self.lotteries.expected_privacy)}"
        else:
            bought = f" for a privacy of {float(np.mean(self.deterministic.privacy)):z.3f}"
            by_lot = f" for {float(np.mean(self.lotteries.expected_privacy)):z.3f} in expectation"
        return (
            f"{rows}the weights to publish cost a regret of {spent:.3g} bp of wealth{share}{bought}, the lottery "
            f"{max(lottery, 0.0):.3g} bp{by_lot}, against the naive observer{self._proven()}"
        )

    @cached_property
    def verdict(self) -> str:
        """Whether the beliefs are hidden from the naive observer, who takes the weights at face value, and what silence costs.

        For one belief it has the observer's error. An observer without weights estimates the stationary law of the model's
        regimes, and names its likeliest regime. The text is empty where that law is not unique.
        """
        asked = requirement_of(self.model.world, self.beliefs)
        if asked is None:
            return ""
        than = self._silence_text()
        sets = {"ODM": self.optimal_sets, "CDM": self.deterministic.belief_set, "PDM": self.drawn.belief_set}
        estimates = {name: np.array([each.center() for each in found]) for name, found in sets.items()}
        reached = [Reached(name, *estimate_quality(found, self.beliefs)) for name, found in estimates.items()]
        if len(self) == 1:
            told = ("explained by no belief" if np.isnan(each.error) else f"{each.error:.2f}" for each in reached)
            errors = ", ".join(f"{each.name} {error}" for each, error in zip(reached, told, strict=True))
            many = (
                " Many beliefs explain the optimal weights, yours among them." if self.optimal_sets[0].dimension else ""
            )
            return (
                "Error of the naive observer, who takes the weights at face value: "
                f"{errors}; without weights {asked.error_without:.2f}.{many}\n{than}\n"
                "A backtest and a comparison judge whether many decisions are hidden, also from the aware observer, who knows "
                "the rule."
            )
        return (
            f"Hidden from the naive observer, who takes the weights at face value: {asked.judge(reached[1:], reached[0])}.\n"
            f"{self._cautions(asked, reached, estimates)}"
            f"{asked.meaning(without='weights', state='regime', cases='the rows')}\n{than}\n"
            "A backtest and a comparison judge the aware observer, who knows the rule."
        )

    def _cautions(self, asked: Requirement, reached: Sequence[Reached], estimates: Mapping[str, Array]) -> str:
        """What the naive observer's estimates tell of beliefs that count as hidden, a line each; `reached` begins with ODM."""
        said = ""
        for each in reached[1:]:
            if not asked.is_met(each) or asked.is_met(reached[0]):
                continue
            told = asked.caution(each.named, best_ranking(estimates[each.name], self.beliefs), self.model.regimes)
            said += f"{each.name} counts as hiding from the naive observer, but {told}\n" if told else ""
        return said

    def _silence_text(self) -> str:
        """What the best constant portfolio costs in the long run, or why that is not known."""
        unlimited = self.model.unlimited
        try:
            silence = silence_in(self.model.world, self.model.problem if unlimited is None else unlimited)
        except InputError as error:  # regimes that practically never change
            return f"What silence, a constant portfolio, costs in the long run is not known: {error}."
        said = (
            f"Silence, a constant portfolio, reveals nothing and costs {BASIS_POINTS * silence:.3g} bp a row on average"
        )
        # A regret within the limit, near weights that are far from optimal, does not compare with it.
        if unlimited is not None:
            return f"{said}, against the best without the limit on turnover."
        dearer = float(np.mean(self.deterministic.regret)) >= silence > 0.0
        return said + (": not more than these weights." if dearer else ".")

    def rounding_note(self, step: int = 0) -> str:
        """Return with how many decimals a row's weights keep their privacy, as text; empty where one is enough.

        Rounding makes the observer's set larger, and may bring the true belief into it.
        """
        found, belief = self.deterministic[step], self.beliefs[step]
        if not isinstance(self.measure, MaximalObfuscation) or not 0.0 < found.privacy < np.inf:
            return ""
        if self.model.turnover is not None or self.model.unlimited is not None:
            return ""  # rounded weights are not read under a limit on turnover
        before = 0.0
        for digits in range(1, FULL_PRECISION_DIGITS):
            left = consistent_beliefs(self.model.problem, found.action.round(digits), digits=digits).distance(belief)
            if left >= _KEPT * found.privacy:
                break
            before = left
        else:
            digits = FULL_PRECISION_DIGITS
        if digits == 1:
            return ""
        return (
            f"Publish the weights with at least {digits} decimals: with {digits - 1}, the set that this library reads from the "
            f"weights reaches beliefs as near to yours as {before:.2f}."
        )

    def _proven(self) -> str:
        if self.certified is None:
            return ""
        both = self.deterministic, self.lotteries
        single, lottery = (float(np.mean(found.privacy_bound)) for found in both)
        missed = any(status is DecisionStatus.BOUNDED for found in both for status in found.status)
        return (
            f"; it is proven that within the budget no weights give more than {single:z.3f} and no lottery more than "
            f"{lottery:z.3f}{f'; the gap of {self.certified:.3g} that was asked for is not reached' if missed else ''}"
        )


def privacy_text(measure: PrivacyMeasure, privacy: float, digits: int) -> str:
    """Return a privacy as text: a number, or for an indicator whether the goal is met."""
    return f"{privacy:z.{digits}f}" if not measure.is_indicator else "met" if privacy == 0.0 else "missed"


def _how_often(privacies: Array) -> str:
    met = int(np.count_nonzero(privacies == 0.0))
    return ("is met" if met else "is missed") if len(privacies) == 1 else f"is met in {met} of {len(privacies)}"


def protect(
    model: InvestorModel,
    beliefs: ArrayLike | pd.DataFrame | Attack,
    budget: Budget | float | None = None,
    measure: PrivacyMeasure | None = None,
    *,
    certify: float | None = None,
    rng: np.random.Generator | None = None,
    progress: Progress | None = None,
) -> Protection:
    """Return the weights and the lottery to publish instead of the optimal weights for the investor's beliefs.

    Formula: max Ψ(ū) over ū ∈ C with ρ(π,ū) ≤ budget (CDM), max Σ p_l Ψ(ū_l) with Σ p_l ρ(π,ū_l) ≤ budget (PDM).

    Args:
        model: The investor.
        beliefs: π, shape (X,) or (T,X); a frame's columns are the model's regimes, its index labels the rows. An `Attack` on
            planned weights gives the beliefs that it estimates.
        budget: A share of |c*|, or a `Budget`; None is the model's.
        measure: The privacy measure Ψ; None is maximal obfuscation.
        certify: The relative gap of a proof that no affordable weights are more private, such as 0.01, for up to about five
            regimes; None: no proof.
        rng: Source of the draws; None: the operating system's entropy, because an observer who knows the seed knows the draw.
        progress: Called with (steps done, steps in all).

    Returns:
        A `Protection`.

    Raises:
        InputError: The beliefs are not on the simplex, have other regimes than the model, or an argument is malformed;
            `certify` with another measure than maximal or desired obfuscation.

    Cost: about 0.3 s per belief, plus 1 s for the candidates; a proof takes another 0.3 s to some seconds. Source:
    the paper, Approaches 1 and 2.

    Example:
        >>> from inscrutable.problems import MarkowitzProblem
        >>> from inscrutable.worlds import GaussianEmission, HiddenMarkovModel
        >>> means, spreads = [[0.02, 0.0], [-0.03, 0.0]], [0.01 * np.eye(2), 0.09 * np.eye(2)]
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], GaussianEmission(means, spreads))
        >>> model = InvestorModel(world, MarkowitzProblem(means, spreads, 2.0), ("A", "B"), ("calm", "crisis"))
        >>> protection = protect(model, [0.8, 0.2], budget=0.1, rng=np.random.default_rng(0))
        >>> bool(protection.deterministic.regret[0] <= 0.1 * abs(protection.deterministic.optimal_cost[0]))
        True
    """
    problem, limit = checked_model(model).problem, model.budget if budget is None else as_budget(budget)
    goal = checked_measure(measure)
    source = None if rng is None else validation.generator(rng)
    gap, method = checked_gap(certify), GlobalSearch(certify=certify)
    if gap is not None:
        check_provable(goal, "exclude")
    planned = beliefs if isinstance(beliefs, Attack) else None
    held, index = _beliefs_of(model, beliefs)
    _check_target(goal, held)
    done = 0 if planned is None else 1  # progress of the attack on the weights
    watch = [part_of(progress, done + number, done + PARTS) for number in range(PARTS)]
    chooser = CounterAdversarialDecisionMaker(problem, goal, limit, method=method)
    deterministic = chooser.decide_many(held, progress=watch[0])
    mixer = ProbabilisticDecisionMaker(problem, goal, limit, candidates=chooser.candidates, certify=gap)
    lotteries = mixer.decide_many(held, progress=watch[1])
    aware = []
    for step, (action, cost) in enumerate(zip(deterministic.action, deterministic.optimal_cost, strict=True)):
        # A share above 1 leaves no convex set: the regret that it allows under this belief does.
        is_large = limit.is_relative and limit.amount > 1.0
        known = Budget.regret(limit.limit(float(cost))) if is_large else limit
        aware.append(affordable_beliefs(problem, action, known).bounds())
        watch[2](step + 1, len(held))
    optimal = problem.solve(held)
    return Protection(
        model,
        index,
        held,
        optimal,
        tuple(consistent_beliefs(problem, action) for action in optimal),
        limit,
        goal,
        deterministic,
        lotteries,
        lotteries.sample(rng=source),
        np.array(aware),
        planned,
        gap,
    )


def _check_target(measure: PrivacyMeasure, beliefs: Array) -> None:
    """Raise the error of an invalid target before the candidates are solved."""
    if isinstance(measure, DesiredObfuscation):
        for step, belief in enumerate(beliefs):
            measure.at_step(step).reference(belief)


def _beliefs_of(model: InvestorModel, beliefs: ArrayLike | pd.DataFrame | Attack) -> tuple[Array, pd.Index]:
    if isinstance(beliefs, Attack):
        return beliefs.estimates, beliefs.index
    if isinstance(beliefs, pd.DataFrame):
        missing = [regime for regime in model.regimes if regime not in beliefs.columns]
        unknown = [column for column in beliefs.columns if column not in model.regimes]
        if missing or unknown:
            raise InputError(f"beliefs must have one column per regime; missing: {missing}, unknown: {unknown}")
        held = validation.many_beliefs(beliefs[list(model.regimes)].to_numpy(), model.problem.n_states)
        return held, beliefs.index
    held = validation.many_beliefs(beliefs, model.problem.n_states, names=model.regimes)
    return held, pd.RangeIndex(len(held), name="row")


def implausible_rows(protection: Protection) -> list[int]:
    """Return the planned rows that no belief explains, counted from 0; empty where the beliefs were given."""
    if protection.planned is None:
        return []
    return [step for step, row in enumerate(protection.planned.rows) if row.reading is Reading.IMPLAUSIBLE]
