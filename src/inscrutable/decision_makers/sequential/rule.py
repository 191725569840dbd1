"""The sequential rule: each step depends on the observer's law of the belief."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.axes import check_same_order
from inscrutable.budgets import Budget, as_budget
from inscrutable.decision_makers.arguments import Described
from inscrutable.decision_makers.aware.columns import Columns, columns_of
from inscrutable.decision_makers.candidate_sources import as_candidates, decoy_grid
from inscrutable.decision_makers.candidates import Candidates
from inscrutable.decision_makers.sequential.calibration import calibrated
from inscrutable.decision_makers.sequential.ceiling import ceiling_of
from inscrutable.decision_makers.sequential.finite import FiniteRule, finite_rule
from inscrutable.decision_makers.sequential.laws import ChainLaw
from inscrutable.decision_makers.sequential.path import PathDecisions
from inscrutable.decision_makers.sequential.prices import PriceCalibration, loss_text
from inscrutable.decision_makers.sequential.seen import Knowledge
from inscrutable.decision_makers.sequential.sequence import DecisionSequence
from inscrutable.decision_makers.sequential.step import StepTable, step_table
from inscrutable.errors import InputError
from inscrutable.geometry.grids import largest_resolution
from inscrutable.kernels.calls import one_blas_thread
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.mechanisms.chains import BeliefChain, filtered_chain
from inscrutable.mechanisms.disclosures import Disclosure
from inscrutable.mechanisms.priors import checked_prior
from inscrutable.privacy import Loss
from inscrutable.privacy.losses import loss_of_rule
from inscrutable.problems import DecisionProblem, checked_problem
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel

_CANDIDATES = 500
"""Decoys where no candidates are given: twice as many change the error by less than its standard error and double the time of
every step (three states, twelve assets)."""


class SequentialDecisionMaker(Described):
    """The sequential decision maker (SDM), which hides a moving belief from the aware observer of all its decisions.

    Formula: at every step K_t = argmax_K E[L(p_u)] − s E[ρ(π,u)] − λ I(π;u). The expectations are under p_t, the observer's law
    of the belief given all earlier decisions; p_u is this law after decision u, and L(p_u) the observer's loss then:
    E[‖π − E[π|u]‖² | u], or another `loss`. Bayes' rule with K_t(u_t|·) and one step of the chain give p_{t+1}. Where a
    constant decision is optimal it is played and reveals nothing. The prices s and λ are fixed; the long-run mean regret is
    the budget. With `information_price` infinite, K_t = argmax_K −s E[ρ(π,u)] − I(π;u).

    K_t depends on p_t alone, so an observer can compute it. If the belief moves by the chain, a later decision does not
    reveal again what an earlier one revealed: on a belief that never changes only the first decision reveals anything. A
    belief that is not among the chain's plays as the nearest of them, within its own cap. The rule is greedy in p_t;
    `ceiling` is an upper bound of the loss under every rule on the candidates.

    Args:
        problem: The decision problem.
        budget: The long-run mean regret: `Budget.regret(r)`, or a share of E|c*| under the chain's prior.
        chain: The Markov chain of the belief, a `BeliefChain`; its prior is the observer's law before the first decision. Where
            it has public symbols, p_t is also given those, and every step begins with `observe`.
        world: Instead of a chain, the hidden Markov model whose observations the agent filters: the chain is then
            `filtered_chain` of it on a grid of at most 500 beliefs. Public real numbers are discretised to cells, with the
            error that `summary` states.
        candidates: Decisions to choose from; those that no belief explains are left out. None is about 500 decoys and the
            cheapest constant decision. Where they cannot meet the budget or the cap, the optimal decisions of the chain's
            beliefs are added.
        loss: The observer's loss: the square error of its estimate of the belief, `SquaredError()` or None; or that of a
            rival, `NamingError()` or `RivalProblem(problem)`. For a rival with infinitely many answers each step is solved by
            Newton's method in the beliefs that it acts on, or, where its best answer jumps, with a few answers to which its
            best ones are added until none saves a millionth of the prior loss.
        information_price: λ, in loss per nat; infinite where information alone counts; None: the best of several. A price
            below a thousandth of the prior loss is raised to that.
        worst_regret: A cap on the regret of every single decision, as a share of |c*(π)| or a `Budget`; None is no cap.
        disclosure: How decisions become public, a `Disclosure`; None: exactly and at once. Decisions with the same disclosed
            value are one to the observer; each belief plays the cheapest of the candidates among them. Undisclosed decisions
            are optimal ones. The observer's loss counts from the disclosure of a decision to the next one. Public symbols in
            between are used by a rival with few answers; in the objective the square error, and a rival with many answers,
            ignore them, which can only overestimate the loss. `decide_path` and the
            loss of the calibration count them.
        turnover: Largest sum of purchases and sales Σ_j |u_tj − u_{t−1,j}|: after a decision only the candidates within it
            have a positive probability, which the observer knows too. Regrets stay those against the problem without this
            limit. The first decision is free. None is no limit.
        calibration: Prices found before for the same problem, chain and budget; None: they are found at first use.
        rng: The source of the simulated calibration, and of the draw between two prices.

    Raises:
        InputError: An argument is malformed, the chain has another number of states, or the world other state labels;
            `turnover` beside finite choices, a cap or a disclosure.
        InputError: At first use: the rival's best answer is the same under every belief.
        SolverError: At first use: no price was found at which the budget is met, or a step was not solved to its gap.

    Cost: some milliseconds a step for 500 beliefs and 500 candidates. The calibration simulates some thousand steps: half a
    minute to a minute, or ten seconds where information alone counts. With a rival of infinitely many answers, such as one with
    a portfolio, and a finite `information_price`, a step takes some 50 to 200 ms for 136 beliefs and 497 decisions, more at
    smaller prices, and the calibration takes thousands of steps. Save `calibration`, and pass it the next time.

    Source: Tanaka, Esfahani, Mitter, LQG control with minimum directed information (2018), and Kamenica and Gentzkow, Bayesian
    persuasion (2011), for one step.

    Example:
        >>> from inscrutable import FiniteProblem, Prior
        >>> from inscrutable.mechanisms.chains import resting_chain
        >>> chain = resting_chain(Prior(np.eye(2), [0.5, 0.5]), 0.8)
        >>> maker = SequentialDecisionMaker(
        ...     FiniteProblem([[0.0, 1.0], [1.0, 0.0]]),
        ...     Budget.regret(0.25),
        ...     chain=chain,
        ...     calibration=PriceCalibration.at(np.log(3.0), float("inf")),
        ...     rng=np.random.default_rng(0),
        ... )
        >>> print(maker.mechanism_for(chain.prior).probabilities.toarray().round(4))
        [[0.75 0.25]
         [0.25 0.75]]
    """

    _shown = ("budget",)

    def __init__(
        self,
        problem: DecisionProblem,
        budget: Budget | float,
        *,
        chain: BeliefChain | None = None,
        world: Any = None,
        candidates: Candidates | ArrayLike | None = None,
        loss: Loss | None = None,
        information_price: float | None = None,
        worst_regret: Budget | float | None = None,
        disclosure: Disclosure | str | None = None,
        turnover: float | None = None,
        calibration: PriceCalibration | None = None,
        rng: np.random.Generator,
    ) -> None:
        self.problem = checked_problem(problem)
        self.budget = as_budget(budget)
        self._rng = validation.generator(rng)
        self.chain = _checked_chain(chain, _chain_of(world, self.problem, self._rng), self.problem)
        self.loss = loss_of_rule(loss, self.problem.n_states, self.problem)
        self.disclosure = _checked_disclosure(disclosure)
        if information_price is not None and not (
            isinstance(information_price, (int, float, np.integer, np.floating)) and information_price >= 0
        ):
            raise InputError(f"information_price must be a number of at least 0, or None, got {information_price!r}")
        self.information_price = information_price
        self.worst_regret = None if worst_regret is None else as_budget(worst_regret)
        self.turnover = np.inf if turnover is None else validation.non_negative(turnover, "turnover")
        if turnover is not None and (
            self.problem.is_discrete or worst_regret is not None or self.disclosure != Disclosure()
        ):
            raise InputError(
                "turnover limits how far weights move that are published exactly and at once, and may leave none under a "
                "cap: leave out worst_regret and disclosure, and finite choices"
            )
        if calibration is not None and not isinstance(calibration, PriceCalibration):
            raise InputError(f"calibration must be a PriceCalibration, got {calibration!r}")
        self._calibration = calibration
        self._given = candidates

    @property
    def beliefs(self) -> Array:
        """The grid of beliefs, the support of all laws, shape (B,X)."""
        return self.chain.prior.beliefs

    @cached_property
    def table(self) -> StepTable:
        """Beliefs, decisions and their regrets, made at first use."""
        prior = self.chain.prior
        columns = _columns(self.problem, self._given, prior)
        asked = self.worst_regret, self.disclosure, self.loss, self.turnover
        table = step_table(self.chain, columns, *asked)
        regrets = table.regrets if table.allowed is None else np.where(table.allowed, table.regrets, np.inf)
        least, limit = regrets.min(axis=1), self._limit_in(table)
        if not (np.isfinite(least).all() and float(prior.weights @ least) <= limit * table.period):
            table = step_table(self.chain, columns.joined(prior.beliefs), *asked)
        return table

    @property
    def limit(self) -> float:
        """The budget as a mean regret, in the cost's unit."""
        return self._limit_in(self.table)

    def _limit_in(self, table: StepTable) -> float:
        """The mean of the beliefs' limits; one that is the same for all beliefs is kept to the last digit."""
        limits = self.budget.limits(table.optimal_costs)
        least = limits.min()
        return float(least + self.chain.prior.weights @ (limits - least))

    @property
    def calibration(self) -> PriceCalibration:
        """The prices, found at first use and kept."""
        if self._calibration is None:
            with one_blas_thread():  # the simulated paths have a thread each
                found = calibrated(self.table, self.law, self.limit, self.information_price, self._rng)
            self._calibration = replace(found, lost=str(self.loss))
        return self._calibration

    def at_each_price(self) -> list[SequentialDecisionMaker]:
        """Return the rule at each price of the calibration: the one drawn before the first step is public."""
        prices, found = self.calibration, [copy(self) for _ in self.calibration.shares]
        for rule, price in zip(found, prices.regret_prices, strict=True):
            rule._calibration = PriceCalibration.at(price, prices.information_price)
        return found

    @cached_property
    def ceiling(self) -> float:
        """An upper bound of the observer's long-run mean loss under every causal rule on these decisions, beliefs and budget.

        It counts the rule's disclosure: a decision that is never disclosed costs nothing, and its budget goes to the others.
        """
        return ceiling_of(self.table, self.limit * self.table.period)

    @cached_property
    def law(self) -> ChainLaw:
        """The dynamics of the observer's law."""
        return ChainLaw(self.chain)

    def mechanism_for(self, law: Prior, before: Any = None) -> Mechanism:
        """Return K on the chain's beliefs and all decisions, where the observer holds `law` before the decision.

        `before` is the decision of the step before, which wins ties and from which turnover counts; None where there is none.

        Raises:
            InputError: The law is on other beliefs, or one of two prices is to be drawn first: ask the sequence that did, or a
                rule of `at_each_price`.
        """
        if len(self.calibration.shares) > 1:
            raise InputError("one of two prices is drawn before the first step: call begin().mechanism_for(law)")
        return self._any_sequence.mechanism_for(law, before)

    @cached_property
    def _any_sequence(self) -> DecisionSequence:
        return self.begin()

    def as_mechanism(self, most: int = 100) -> FiniteRule:
        """Return the rule as a mechanism with a finite memory, if the observer can reach at most `most` laws.

        Laws that differ by no more than `tolerances.SAME_MEMORY` anywhere count as one; decisions of a probability below
        `tolerances.RARELY_PLAYED` do not change the memory.

        Args:
            most: The largest number of memories, at least 1.

        Raises:
            InputError: `most` is not a whole number of at least 1, some decisions are never shown, or the chain has public
                symbols, which no memory reads.

        Cost: a step for every memory.

        Source: finite-state controllers (Hansen, 1998).

        Example:
            >>> from inscrutable import FiniteProblem, Prior
            >>> from inscrutable.mechanisms.chains import resting_chain
            >>> prices = PriceCalibration.at(np.log(3.0), float("inf"))
            >>> chain = resting_chain(Prior(np.eye(2), [0.5, 0.5]), 0.8)
            >>> problem, rng = FiniteProblem([[0.0, 1.0], [1.0, 0.0]]), np.random.default_rng(0)
            >>> SequentialDecisionMaker(problem, Budget.regret(0.25), chain=chain, calibration=prices, rng=rng).as_mechanism()
            laws found: 3; finite: every law that the observer can reach is a memory
        """
        if self.table.period > 1:
            raise InputError(
                f"a mechanism with a memory is the same at every step, and {self.disclosure} shows only some decisions"
            )
        if self.law.n_public is not None:
            raise InputError(
                "the observer's law also depends on public information, which no MemoryMechanism has: use the rule itself"
            )
        return finite_rule(self.table, self.law, self.calibration, validation.count(most, "most"))

    def begin(self) -> DecisionSequence:
        """Return a new sequence of decisions; of two prices each sequence draws its own."""
        return DecisionSequence(self, self._rng)

    def decide_path(
        self, beliefs: ArrayLike, *, public: ArrayLike | None = None, rng: np.random.Generator
    ) -> PathDecisions:
        """Return drawn decisions along a path of beliefs (T,X), in the order of time, and the observer's estimates.

        Args:
            beliefs: π_t, shape (T,X); those that are not among the chain's beliefs play as the nearest of these, and
                `n_off_grid` counts them.
            public: The public symbols before each decision, shape (T,), or real numbers, one row a step, where the chain's
                symbols are cells of such; None where nothing is public.
            rng: The source of the draws.

        Raises:
            InputError: An argument is malformed.
        """
        held = validation.many_beliefs(beliefs, self.problem.n_states, names=self.problem.state_names)
        source = validation.generator(rng)
        sequence = DecisionSequence(self, source)
        read = None if public is None else self.law.symbols(public, len(held))
        if read is None:
            sequence.observe()
        knowledge = Knowledge(self.law, self.disclosure.schedule.lag, self.loss)
        regrets, losses, bits, expected, own = np.empty((5, len(held)))
        means, points = np.empty((len(held), held.shape[1])), []
        for t, belief in enumerate(held):
            if read is not None:
                sequence.observe(int(read[t]))
            lottery = sequence.decide(belief)
            atom = int(source.choice(len(lottery.probabilities), p=lottery.probabilities))
            now = sequence.expected
            bits[t], expected[t], own[t] = now.bits, now.regret, now.own_regret
            regrets[t] = lottery.regrets[atom]
            sequence.publish(lottery.actions[atom], as_nearest=True)
            points.append(lottery.actions[atom])
            means[t], losses[t] = knowledge.after(sequence.observer.weights, None if read is None else int(read[t]))
        return PathDecisions(
            np.array(points),
            regrets,
            means,
            losses,
            bits,
            self.calibration.status,
            expected,
            own,
            sequence.n_off_grid,
            str(self.loss),
        )

    def summary(self) -> str:
        """Return a few lines for a person to read; finds the prices first if needed."""
        most = loss_text(self.ceiling, str(self.loss))
        lasting = "" if self.chain.forgets or not self.calibration.regret_se > 0.0 else f"\n{_LASTING}"
        read = "" if self.chain.cells is None else f"\npublic numbers        {self.chain.cells}"
        return (
            f"{self.calibration.summary()}{lasting}\n"
            f"ceiling               {most}, on a grid of {len(self.beliefs)} beliefs, on these {len(self.table.columns)} "
            "candidates\n"
            "off the grid          other beliefs play as the nearest of these; what they cost, the `own_regrets` of a path, is "
            f"not counted above{read}"
        )


_LASTING = (
    "caution               the belief goes in a cycle, or stays within a part of the grid: the errors above count what differs "
    "within simulated paths, not between them, and may be too small"
)


def _columns(problem: DecisionProblem, given: Any, prior: Prior) -> Columns:
    if given is not None or problem.is_discrete:
        found = columns_of(problem, as_candidates(problem, given), True)
        return found if len(found) else found.joined(prior.beliefs)
    resolution = largest_resolution(problem.n_states, _CANDIDATES)
    return columns_of(problem, decoy_grid(problem, resolution), True).joined(prior.mean[None])


def _chain_of(world: Any, problem: DecisionProblem, rng: np.random.Generator) -> BeliefChain | None:
    if world is None:
        return None
    if not isinstance(world, HiddenMarkovModel):
        raise InputError(f"world must be a HiddenMarkovModel, got {world!r}")
    check_same_order("state", ("world", world.names), ("the problem", problem.state_names))
    return filtered_chain(world, largest_resolution(world.n_states, _CANDIDATES), rng=rng)


def _checked_chain(chain: Any, made: Any, problem: DecisionProblem) -> BeliefChain:
    if (chain is None) == (made is None):
        raise InputError("how the belief moves must be given once: pass either chain= or world=")
    chain = made if chain is None else chain
    if not isinstance(chain, BeliefChain):
        raise InputError(f"chain must be a BeliefChain such as filtered_chain makes of a world, got {chain!r}")
    checked_prior(chain.prior, problem)
    return chain


def _checked_disclosure(given: Any) -> Disclosure:
    found = Disclosure.of(given)
    if found.needs_returns:
        raise InputError(f"the rule cannot use {found}: what is disclosed must be a function of the decision alone")
    return found
