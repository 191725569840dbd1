"""The sequential rule in a backtest: its decisions by row, and a bound for every rule of the same regret in the long run."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from inscrutable import tolerances
from inscrutable.adversaries import SequentialAdversary
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.budgets import Budget
from inscrutable.decision_makers import SequentialDecisionMaker
from inscrutable.decision_makers.results import Decision, DecisionStatus, stack
from inscrutable.decision_makers.sequential.ceiling import ceiling_of
from inscrutable.decision_makers.sequential.path import PathDecisions
from inscrutable.experiments.backtest_aware import (
    AwareReading,
    PublicSymbols,
    beliefs_resolution,
    rivals_chain,
    without_public,
)
from inscrutable.experiments.episodes import Record
from inscrutable.experiments.investor_model import InvestorModel
from inscrutable.geometry import BeliefSet
from inscrutable.privacy import PrivacyMeasure
from inscrutable.validation import Array
from inscrutable.worlds import HiddenMarkovModel

SHARE_OF_SILENCE = 0.5
"""Share of the silence regret that the rule spends by default."""

_OTHER_DRAWS = 8
"""Further draws that show how a verdict varies with the draw; a second each for 300 decisions."""

_MOST_BELIEFS = 150
"""Beliefs of the rule's grid. On 500 its prices take four times as long, and the error moves by 0.003 (embedded returns)."""


@dataclass(frozen=True, eq=False)
class SequentialPart:
    """Results of the sequential rule in a backtest.

    Args:
        maker: The rule, on the law of the belief in the fitted world, with its prices.
        path: What it published, and the estimates of a rival who follows it.
        others: The same rival's estimates under other draws, each of shape (T,X).
        silence_regret: Long-run mean regret of the one constant portfolio that suits the fitted world best.
        beside_public: The estimates of an observer who follows it and a public number, which the rule does not know of, shape
            (T,X).
    """

    maker: SequentialDecisionMaker
    path: PathDecisions
    others: tuple[Array, ...]
    silence_regret: float
    beside_public: Array | None = None

    def ceiling(self, regret: float) -> float:
        """Return the root mean square error that no rule of a long-run mean regret exceeds, on this grid and candidates."""
        return float(np.sqrt(max(ceiling_of(self.maker.table, regret), 0.0)))

    def record(self, investor: InvestorModel, beliefs: Array, measure: PrivacyMeasure) -> Record:
        """Return the published portfolios in the form of the other decision makers', for beliefs (T,X).

        Where turnover is limited, the regret is that of the problem near the portfolio before: the cost of the limit is not
        a price of privacy.
        """
        path, played, sets = self.path, list[Decision](), list[BeliefSet]()
        nowhere, spared = np.full(beliefs.shape[1], np.nan), np.zeros(len(beliefs))
        for t, (belief, action) in enumerate(zip(beliefs, path.actions, strict=True)):
            problem = investor.problem_after(path.actions[t - 1] if t else None)
            least = float(problem.optimal_cost(belief))
            spared[t] = least - float(investor.problem.optimal_cost(belief))
            regret = max(float(path.regrets[t] - spared[t]), 0.0)
            sets.append(belief_set_of(problem, action))
            hidden = float(measure.at_step(t)(belief, sets[t]))
            played.append(
                Decision(action, least + regret, least, regret, hidden, np.inf, nowhere, DecisionStatus.DRAWN, problem)
            )
        decisions = stack(played, None)
        vars(decisions)["belief_set"] = tuple(sets)
        return Record(decisions, expected=path.own_regrets - spared)

    def joined(self, aware: AwareReading, name: str) -> AwareReading:
        """Return the aware observers' reading with this rule added under its name, and with the ceilings."""
        regrets = {**aware.regrets, name: self.maker.calibration.regret}
        least = tolerances.NO_COST * self.silence_regret
        return replace(
            aware,
            followed={**aware.followed, name: self.path.observer_means},
            bits={**aware.bits, name: self.path.bits},
            beside_public=aware.beside_public
            if self.beside_public is None
            else {**aware.beside_public, name: self.beside_public},
            regrets=regrets,
            ceilings={each: self.ceiling(regret) for each, regret in regrets.items() if regret > least},
        )


def play_sequentially(
    world: HiddenMarkovModel,
    investor: InvestorModel,
    beliefs: Array,
    budget: Budget | None,
    *,
    rng: np.random.Generator,
    public: PublicSymbols | None = None,
) -> SequentialPart | None:
    """Return what the sequential rule publishes along beliefs (T,X); None where the budget is zero.

    The rule minimises information alone: .10 bits a step and an error of .547 on the embedded returns, and prices in a second.
    With one nat at the price of the prior loss it leaks .13 bits at an error of .563, and prices take 3 to 5 s.

    Args:
        world: The fitted world; the rule uses the law of its predicted belief.
        investor: The portfolio problem, and its limit on turnover.
        beliefs: What the investor holds, in the order of time.
        budget: Long-run mean regret; None is half of what silence costs in the long run.
        rng: The source of the simulations and draws.
        public: The public observations beside the portfolios.

    Raises:
        SolverError: No price was found at which the budget is met.
    """
    reading = rivals_chain(world, beliefs_resolution(world.n_states, _MOST_BELIEFS), public, rng=rng)
    chain, prior = without_public(reading), reading.prior
    problem = investor.problem
    costs = np.asarray(problem.optimal_cost(prior.beliefs))
    silence = max(float(problem.optimal_cost(prior.mean)) - float(prior.weights @ costs), 0.0)
    limit = Budget.regret(SHARE_OF_SILENCE * silence) if budget is None else budget
    if not float(prior.weights @ limit.limits(costs)) > 0:
        return None
    maker = SequentialDecisionMaker(
        problem, limit, chain=chain, information_price=float("inf"), turnover=investor.turnover, rng=rng
    )
    path, *others = (maker.decide_path(beliefs, rng=rng) for _ in range(1 + _OTHER_DRAWS))
    beside = None
    if public is not None and len(maker.calibration.shares) == 1:
        rival = SequentialAdversary(reading, maker, agent_world=chain)
        beside = rival.filter(path.actions, public=public.read, nearest=True).mean
    return SequentialPart(maker, path, tuple(each.observer_means for each in others), silence, beside)
