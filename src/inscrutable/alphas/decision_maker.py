"""The decision maker with a Gaussian private mean, against the aware observer."""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.alphas.error_law import law_between, root_of, sizes_of
from inscrutable.alphas.factored_law import FactoredErrorLaw, least_information_of_factors, specific_ratio
from inscrutable.alphas.first_steps import FirstSteps
from inscrutable.alphas.observed import Moves
from inscrutable.alphas.plans import (
    AlphaStatus,
    Plan,
    gap_of,
    is_met,
    plan_of_factors,
    plan_once,
    plan_over_time,
    silent_plan,
)
from inscrutable.alphas.problem import AlphaProblem, checked_alpha_problem
from inscrutable.alphas.risk import FactorRisk
from inscrutable.alphas.sequence import AlphaDraw, AlphaPath, AlphaSequence
from inscrutable.alphas.trading import TradingPolicy, trading_policy
from inscrutable.alphas.under_limits import SimulatedRegret, drawn_means, simulation, spending
from inscrutable.axes import Axis
from inscrutable.budgets import Budget, as_budget
from inscrutable.errors import InputError, ModelError
from inscrutable.validation import Array
from inscrutable.worlds import LinearGaussianWorld

Objective = Literal["information", "error"]


class AlphaDecisionMaker:
    """The rule that leaks least about a private mean, or leaves the aware observer the largest error, at a mean regret.

    Formula: with E the covariance of m − m̂ after a decision and Θ of the problem, tr(ΘE) is the mean regret. "information"
    leaks the fewest bits, min ½ log det P − ½ log det E; "error" leaves the largest tr(QE); over 0 ⪯ E ⪯ P. Where several rules
    leave the same error, the one of fewest bits is returned for one decision, and over time if Q is a multiple of Θ. Other ties
    over time return some optimal rule; in an example of three signals it leaked 3 % more bits than the fewest. The rule draws
    m̂ = m̂⁻ + (I − EP⁻¹)(m − m̂⁻) + N(0, E − EP⁻¹E) and plays the optimum for m̂, which is then the observer's posterior mean.
    With `prior_covariance`, P = S and every decision concerns an independent mean. With a `world`, P = AEA' + W, updated by
    public observations, and the observer remembers all decisions.

    Args:
        problem: The problem; with a trading cost, decisions trade part of the way to an aim.
        budget: The regret per step, `Budget.regret(r)`; a number is a share of the silence regret tr(ΘS), the cost of deciding
            by public information alone. (With zero mean and no constraints it is also a share of E|c*|.) Over time, less than
            1e-14 of what one step's news are worth is lost in rounding and counts as 0.
        prior_covariance: S, public, shape (k,k), or a `FactorRisk` over the assets, squared units of m.
        world: The public dynamics of the state, whose estimate m by the Kalman filter is private. With its `initial` the agent
            begins to observe at the first decision; without, its filter is steady by then. Instead of `prior_covariance`.
        prior_mean: m̄, shape (k,), the mean of the first m before any public observation; None is that of the world, else zero.
            Where a world has neither `initial` nor a stationary law, its covariance is the one that past public observations
            leave, or without these the rule's own; the first public observation is then not used.
        objective: "information" or "error".
        error_weights: Q, shape (k,k), positive semidefinite; None is the identity.

    Labelled tables and a world whose states are named are aligned with the problem's signals.

    Raises:
        InputError: An argument is malformed, the budget is a share but the silence regret is infinite, or there are both
            inequalities and a trading cost.
        ModelError: S or Q is indefinite, the world has no steady filter, or trading cannot follow the mean.
        SolverError: At first use, if the iteration over time did not converge and the silence regret is infinite.

    Cost:

    - One decision, dense S: O(k³); 3,000 alphas take 9 s on two cores, 12 s on one.
    - One decision, "information", S a `FactorRisk` with the problem's exposures and proportional specific variances:
      O(n (factors)²) time, memory linear in assets.
    - One decision, "error", weights that do not commute with Θ: one or two decompositions in single precision and one or two in
      double; 3,000 alphas take 13 s on two cores, 19 s on one.
    - Over time, "information": some seconds for 100 signals.
    - Over time, "error": O(k⁶) up to 60 signals, 0.3 s for 22, 11 s for 60; then by an iteration, 40 s for 100.
    - Over time, above 120 signals, where the iteration leaves a gap above 1e-4: it ends after 20,000 steps with the best
      rule, its gap, and the status BOUNDED where the gap exceeds 1e-4.

    Source: Cover and Thomas (2006), section 10.3.3, for one decision; Tanaka, Kim, Parrilo, Mitter (IEEE Trans. AC 62, 2017)
    and Tanaka, Esfahani, Mitter (IEEE Trans. AC 63, 2018) over time.

    Example:
        >>> problem = AlphaProblem([[0.04, 0.0], [0.0, 0.01]], risk_aversion=2.5)
        >>> maker = AlphaDecisionMaker(problem, 0.5, prior_covariance=np.diag([4e-4, 1e-4]))
        >>> round(maker.bits, 6), round(maker.regret / maker.silence_regret, 6)
        (1.0, 0.5)
        >>> maker.decide([0.02, 0.01], rng=np.random.default_rng(0)).action.shape
        (2,)
    """

    def __init__(
        self,
        problem: AlphaProblem,
        budget: Budget | float,
        *,
        prior_covariance: ArrayLike | FactorRisk | None = None,
        world: LinearGaussianWorld | None = None,
        prior_mean: ArrayLike | None = None,
        objective: Objective = "information",
        error_weights: ArrayLike | None = None,
    ) -> None:
        self.problem, self.budget = checked_alpha_problem(problem), as_budget(budget)
        if objective not in ("information", "error"):
            raise InputError(f'objective must be "information" or "error", got {objective!r}')
        if (prior_covariance is None) == (world is None):
            raise InputError("what is public of the mean must be given once: pass either prior_covariance= or world=")
        self.objective: Objective = objective
        k = problem.n_signals
        self.world = _checked_world(world, problem)
        self._weights = None if error_weights is None else _covariance(error_weights, "error_weights", problem)
        self._prior: Array | FactorRisk | None = None
        self._ratio: float | None = None
        if prior_covariance is not None:
            self._take_prior(prior_covariance)
        start = _start_of(self.world, k) if prior_mean is None else problem.check_mean(prior_mean, "prior_mean")
        if start.ndim != 1:
            raise InputError(f"prior_mean has shape {start.shape}, expected one entry per signal: ({k},)")
        self.start_mean = start
        self.simulated_regret: SimulatedRegret | None = None
        self.policy: TradingPolicy | None = None
        if problem.trading_cost:
            self.policy = trading_policy(problem, np.zeros((k, k)) if self.world is None else self.world.transition)

    def _take_prior(self, given: Any) -> None:
        if isinstance(given, FactorRisk):
            if given.n_assets != self.problem.n_signals:
                raise InputError(
                    f"prior_covariance is of {given.n_assets} alphas, expected one per signal: {self.problem.n_signals}"
                )
            given = _in_order(given, self.problem)
            self._ratio = specific_ratio(self.problem, given)
            fits = self._ratio is not None and self.objective == "information" and not self.problem.trading_cost
            self._prior, self._ratio = (given, self._ratio) if fits else (given.dense(), None)
        else:
            self._prior = _covariance(given, "prior_covariance", self.problem)

    @cached_property
    def theta(self) -> Array:
        """Θ, shape (k,k)."""
        free = self.problem.theta
        return free if self.policy is None else self.policy.theta(free)

    @cached_property
    def weights(self) -> Array:
        """Q, shape (k,k)."""
        return np.eye(self.problem.n_signals) if self._weights is None else self._weights

    @cached_property
    def moves(self) -> Moves:
        """The dynamics of the mean for the observer; with `prior_covariance` every mean is independent."""
        if self.world is None:
            assert self._prior is not None
            prior = self._prior.dense() if isinstance(self._prior, FactorRisk) else self._prior
            return Moves.private(np.zeros_like(prior), prior, sizes_of(prior))
        return self._first_steps.lasting

    @cached_property
    def _first_steps(self) -> FirstSteps:
        assert self.world is not None
        return FirstSteps(self.world)

    def moves_into(self, step: int) -> Moves | None:
        """The dynamics of the mean into a step of a world; into step 0 from `start_mean`, None where no law is given."""
        return self._first_steps.into(step)

    @cached_property
    def has_long_run(self) -> bool:
        """Whether the means have a stationary law."""
        return self.world is None or self._first_steps.stationary is not None

    @cached_property
    def silence(self) -> Array | None:
        """Covariance of the mean for an observer who sees no decision, shape (k,k); None where it grows without bound."""
        return self.moves.innovation if self.world is None else self.moves.silence()

    @cached_property
    def silence_regret(self) -> float:
        """r₀ = tr(ΘS), the cost per step of deciding by public information alone; infinite where that grows without bound."""
        if self._ratio is not None:
            assert isinstance(self.plan.law, FactoredErrorLaw)
            return self.plan.law.silence
        return float("inf") if self.silence is None else float(np.sum(self.theta * self.silence))

    @property
    def limit(self) -> float:
        """The budget as a regret per step."""
        if not self.budget.is_relative:
            return self.budget.amount
        if not np.isfinite(self.silence_regret):
            raise InputError(
                f"the budget is a share, {self.budget.amount:g}, of what silence costs, and silence costs without end: the "
                f"largest eigenvalue of transition has modulus {self.moves.radius:.10g}, expected less than 1; pass "
                "Budget.regret(amount)"
            )
        return self.budget.amount * self.silence_regret

    @cached_property
    def plan(self) -> Plan:
        """The rule's law and figures, found at first use."""
        is_error = self.objective == "error"
        if self._ratio is not None:
            assert isinstance(self._prior, FactorRisk)
            amount = self.budget.amount
            spent = np.array([0.0, amount] if self.budget.is_relative else [amount, 0.0])
            law = least_information_of_factors(self.problem, self._prior, self._ratio, spent)
            return plan_of_factors(law, self._weights)
        limit = self.limit
        if self.silence is not None and limit >= self.silence_regret:
            return silent_plan(self.silence, self.theta, self.weights, is_error, self.moves.units)
        if self.silence is not None and not self.moves.transition.any():  # every mean is independent of those before
            return plan_once(self.theta, self.silence, limit, self.weights, is_error, self.moves.units)
        return plan_over_time(self.moves, self.theta, limit, self.weights, is_error)

    @property
    def bits(self) -> float:
        """Bits that a decision leaks about the mean, per step in the long run; infinite if it reveals a part exactly."""
        return self.plan.bits

    @property
    def error(self) -> float:
        """tr(QE), the observer's mean square error about the mean after a decision, per step in the long run.

        With inequalities it is a lower bound: weights at a limit hide a part of the estimate.
        """
        return self.plan.error

    @property
    def regret(self) -> float:
        """tr(ΘE), the mean regret per step in the long run; with inequalities an upper bound of it."""
        return self.plan.regret

    @property
    def error_covariance(self) -> Array:
        """E, shape (k,k); about the state of a world it is E + P⁺ of the agent's own filter."""
        return self.plan.law.covariance

    @property
    def ceiling(self) -> float | None:
        """The fewest bits, or the largest error, of any causal rule at this regret; None with inequalities."""
        return None if self.problem.has_inequalities else self.plan.ceiling

    @property
    def gap(self) -> float:
        """The difference between the rule and `ceiling`, as a share of the larger; 0 for closed forms."""
        return gap_of(self.plan, self.objective == "error")

    @property
    def status(self) -> AlphaStatus:
        """Whether the rule is optimal, up to its gap."""
        if self.limit >= self.silence_regret:
            return AlphaStatus.SILENT
        if self.problem.has_inequalities:
            return AlphaStatus.AT_MOST
        return AlphaStatus.OPTIMAL if is_met(self.gap) else AlphaStatus.BOUNDED

    def under_limits(self, *, draws: int = 1000, rng: np.random.Generator) -> AlphaDecisionMaker:
        """Return the rule that spends the budget under inequalities, where it costs less than tr(ΘE), by simulation.

        Formula: means are drawn from the observer's law without decisions, estimates from the rule's. With a world it is the
        law of the long run, whose mean is zero; with a public sensor that mean is drawn as well, as it follows the public
        observations. The mean regret is tr(ΘE) less what the limits save, and E grows until it equals the budget. A share
        refers to the cost of the optimum for that mean under the inequalities. `simulated_regret` of the returned rule has the
        mean and its standard error; `regret` is tr(ΘE), an upper bound.

        Args:
            draws: Number of means drawn, at least 3; every E uses the same draws.
            rng: Source of the draws. Their law is public, so a public seed reveals nothing.

        Raises:
            InputError: The problem has no inequalities, or the world no stationary law.
            SolverError: No E spends the budget.

        Cost: about ten times that of the rule, and about ten times `draws` decisions.

        Example:
            >>> from inscrutable import box
            >>> problem = AlphaProblem([[0.04]], 2.5, box([0.0], [1.0]))
            >>> maker = AlphaDecisionMaker(problem, Budget.regret(2e-4), prior_covariance=[[4e-4]])
            >>> found = maker.under_limits(rng=np.random.default_rng(0))
            >>> round(found.simulated_regret.mean, 5), found.error > maker.error
            (0.0002, True)
        """
        many, source = validation.count(draws, "draws", least=3), validation.generator(rng)
        if not self.problem.has_inequalities:
            raise InputError("the problem has no inequalities: its rule spends the budget as it is")
        centre, means = self._drawn(many, source)
        noise = source.integers(2**63)
        simulated = simulation(self.problem, centre + means)
        silent = simulated(centre, self.silence_regret)
        target = self.budget.amount * (silent.mean if self.budget.is_relative else 1.0)

        def cost(limit: float) -> SimulatedRegret:
            plan = self._spending(limit).plan
            law = plan.law
            if self.silence is not None and self.world is not None:
                law = law_between(root_of(self.silence, self.moves.units), law.covariance)
            return simulated(centre + law.message(means, np.random.default_rng(noise)), plan.regret)

        limit, found = self.silence_regret, silent
        if target < silent.mean:
            limit, found = spending(cost, target, self.silence_regret, silent) if target > 0.0 else (0.0, cost(0.0))
        grown = self._spending(limit)
        grown.simulated_regret = found._replace(silence=silent.mean)
        return grown

    def _drawn(self, draws: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Draw the observer's means without decisions, and how far the private ones lie from them, shapes (draws,k)."""
        if self.world is None:
            assert self._prior is not None
            means = drawn_means(self._prior, draws, rng)
            return np.broadcast_to(self.start_mean, means.shape), means
        silence, stationary = self.silence, self._first_steps.stationary
        if silence is None or stationary is None:
            raise InputError(
                "the means have no stationary law to draw them from: the largest eigenvalue of transition has modulus "
                f"{self.moves.radius:.10g}, expected less than 1"
            )
        means = drawn_means(silence, draws, rng)
        if self.world.public is None:
            return np.zeros_like(means), means
        return drawn_means(stationary - silence, draws, rng), means

    def _spending(self, limit: float) -> AlphaDecisionMaker:
        """Return the same decision maker with another limit on tr(ΘE)."""
        other = copy(self)
        other.__dict__.pop("plan", None)
        if self._ratio is not None:
            other.__dict__["silence_regret"] = self.silence_regret
        other.budget = Budget.regret(limit)
        return other

    def begin(self) -> AlphaSequence:
        """Return a new sequence of decisions, before the first one."""
        return AlphaSequence(self)

    def decide(self, mean: ArrayLike, *, rng: np.random.Generator) -> AlphaDraw:
        """Return a drawn decision for a mean (k,): the first of a new sequence."""
        return self.begin().decide(mean, rng=rng)

    def decide_path(self, means: ArrayLike, *, public: ArrayLike | None = None, rng: np.random.Generator) -> AlphaPath:
        """Return drawn decisions along a path of means (T,k), in the order of time, each published before the next.

        Args:
            means: m_t, shape (T,k).
            public: (T,q), the public observation of each row where the world has a public sensor; each is read before the
                row's decision. Labelled rows are aligned with those of `means`, columns with the world's.
            rng: The source of the draws.

        Raises:
            InputError: Shapes or labels disagree.
        """
        return self.begin().follow(means, public, rng)

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return a few lines for a person to read; computes the rule at first use."""
        plan, silent = self.plan, self.silence_regret
        limited = self.problem.has_inequalities  # then silence costs less than tr(ΘS) as well
        share = f", {plan.regret / silent:.1%} of silence" if 0.0 < silent < np.inf and not limited else ""
        most = "at most " if limited else ""
        what = "bits" if self.objective == "information" else "error"
        ceiling = self.ceiling
        best = (
            ""
            if ceiling is None
            else f"; no rule {'leaks fewer' if what == 'bits' else 'leaves more'} than {ceiling:.6g} {what}"
        )
        simulated = self.simulated_regret
        drawn = (
            ""
            if simulated is None
            else f"; simulated {simulated.mean:.6g} ± {simulated.standard_error:.2g}, {simulated.mean / simulated.silence:.1%} "
            "of silence"
        )
        return (
            f"regret a step    {most}{plan.regret:.6g}{share}{drawn}\n"
            f"leaks            {most}{plan.bits:.6f} bits a step\n"
            f"leaves           {'at least ' if limited else ''}a mean square error of {plan.error:.6g} a step\n"
            f"gap              {self.gap:.1e}{best}\n"
            f"{self.status.value}"
        )


def _checked_world(world: Any, problem: AlphaProblem) -> LinearGaussianWorld | None:
    if world is None:
        return None
    if not isinstance(world, LinearGaussianWorld):
        raise InputError(f"world must be a LinearGaussianWorld, got {world!r}")
    if world.n_states != problem.n_signals:
        raise InputError(
            f"the world has {world.n_states} states, expected one per signal of the problem: {problem.n_signals}"
        )
    world.check_constant("a rule that stays the same")
    if world.names is None or problem.signal_names is None:
        return world
    order = Axis("signal", problem.signal_names).order(world.names, "world")
    return world if order is None else world.in_order(order)


def _start_of(world: LinearGaussianWorld | None, k: int) -> Array:
    """Return the observer's mean before the first decision."""
    if world is None:
        return np.zeros(k)
    try:
        return np.asarray(world.initial.mean)
    except ModelError:  # no initial law is given, and there is no stationary one
        return np.zeros(k)


def _in_order(prior: FactorRisk, problem: AlphaProblem) -> FactorRisk:
    """The prior with its assets in the order of the problem's."""
    if prior.names is None:
        return prior
    order = Axis("signal", problem.signal_names).order(prior.names, "prior_covariance")
    if order is None:
        return prior
    return FactorRisk(prior.exposures[order], prior.factor_covariance, prior.specific[order])


def _covariance(given: Any, name: str, problem: AlphaProblem) -> Array:
    axis = Axis("signal", problem.signal_names)
    matrix = validation.finite_array(given, name, ndim=2, axes=(axis, axis))
    if matrix.shape != (problem.n_signals, problem.n_signals):
        raise InputError(
            f"{name} has shape {matrix.shape}, expected one row and column per signal: {problem.n_signals}"
        )
    try:
        np.linalg.cholesky(matrix)
        is_sure = np.array_equal(matrix, matrix.T)
    except np.linalg.LinAlgError:
        is_sure = False
    if not is_sure:
        validation.check_positive_semidefinite(matrix, name, "a covariance has no negative eigenvalue")
    return np.asarray(0.5 * (matrix + matrix.T))
