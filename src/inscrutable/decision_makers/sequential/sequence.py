"""A sequence of decisions with a memory: what is played next, and what the observer holds by now."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from inscrutable import tolerances, validation
from inscrutable.decision_makers.aware.columns import lotteries, without_small
from inscrutable.decision_makers.results import DecisionStatus, MixedDecision
from inscrutable.decision_makers.sequential.laws import ChainLaw
from inscrutable.decision_makers.sequential.prices import PriceCalibration
from inscrutable.decision_makers.sequential.step import Step, StepRule
from inscrutable.errors import InputError
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.validation import Array


class StepFigures(NamedTuple):
    """What the present step costs and tells on average.

    regret: Mean regret under the observer's law, which knows nothing of the belief, in the cost's unit.
    own_regret: The same under the belief itself; NaN before `decide`.
    bits: I(π;u) under the law.
    loss: The observer's mean square error after the decision, under the law.
    """

    regret: float
    own_regret: float
    bits: float
    loss: float


class DecisionSequence:
    """Decisions one after the other, with what the observer holds of the belief; `SequentialDecisionMaker.begin` makes it.

    At every step `decide` says what to draw from, any number of times; `publish` records the one decision that was drawn and
    seen. Time passes with `observe`, or with the next `decide` or `publish`, where `observe` was left out.
    """

    def __init__(self, rule: StepRule, law: ChainLaw, calibration: PriceCalibration, index: int) -> None:
        self._rule, self._law, self.calibration, self.price_index = rule, law, calibration, index
        self._state = law.start()
        self._kept = -1
        self._published = self._looked = False
        self._step: Step | None = None
        self._own, self._is_off_grid = float("nan"), False
        self.n_published = self.n_off_grid = self.n_approximate = 0
        self._tree = cKDTree(rule.table.prior.beliefs)

    @property
    def beliefs(self) -> Array:
        """The beliefs that laws are on, shape (B,X)."""
        return self._rule.table.prior.beliefs

    @property
    def observer(self) -> Prior:
        """What the observer holds of the present belief, given all that was published."""
        return Prior(self.beliefs, self._law.weights(self._state))

    @property
    def is_exact(self) -> bool:
        """Whether every published decision was one that the rule could have played."""
        return self.n_approximate == 0

    @property
    def expected(self) -> StepFigures:
        """What this step costs and tells on average, before its decision is drawn."""
        step = self._now()
        return StepFigures(step.regret, self._own, step.bits, step.loss)

    def mechanism_for(self, law: Prior) -> Mechanism:
        """Return K on the chain's beliefs and all decisions, where the observer holds `law` before the decision.

        Raises:
            InputError: The law is on other beliefs.
        """
        known = self.beliefs
        if not isinstance(law, Prior) or law.beliefs.shape != known.shape:
            raise InputError(f"law must be a Prior over the rule's {len(known)} beliefs, got {law!r}")
        if np.abs(law.beliefs - known).max() > tolerances.SAME_BELIEF:
            raise InputError("law must be on the rule's beliefs, in their order")
        return self._rule.mechanism(self._rule.step(law.weights))

    def decide(self, belief: ArrayLike) -> MixedDecision:
        """Return the lottery of this step for a belief (X,); nothing is recorded."""
        problem = self._rule.table.columns.problem
        held = validation.one_belief(belief, problem.n_states, names=problem.state_names)
        step = self._now()
        columns, rows, costs = self._rule.answers(step, held[None])
        regrets = columns.regrets(held[None], costs)
        shares = without_small(rows, regrets)
        self._own = float((shares * regrets).sum())
        self._is_off_grid = bool(self._tree.query(held)[0] > tolerances.SAME_BELIEF)
        return lotteries(columns, held[None], costs, shares, DecisionStatus.BEST_CANDIDATE)[0]

    def could_play(self, action: ArrayLike) -> bool:
        """Return whether some belief that is still possible plays a decision at this step."""
        return self._place(action)[1]

    def publish(self, action: ArrayLike, *, as_nearest: bool = False) -> None:
        """Record the decision of this step, which everybody now knows.

        Args:
            action: u, shape (U,); an int where decisions are finite choices.
            as_nearest: Whether a decision that the rule could not have played counts as the nearest that it could; the law is
                approximate from then on.

        Raises:
            InputError: The decision is malformed, or the rule could not have played it; nothing is recorded then.
        """
        place, possible = self._place(action)
        if not possible and not as_nearest:
            raise InputError(
                f"the rule could not have played {np.asarray(action)} at this step: draw from decide(), or pass "
                "as_nearest=True, after which the observer's law is approximate"
            )
        step = self._now()
        self._state = self._law.seen(self._state, step.rows[:, place])
        self._kept = int(step.numbers[place])
        self.n_published += 1
        self.n_approximate += not possible
        self.n_off_grid += self._is_off_grid
        self._published, self._looked = True, False

    def observe(self, public: None = None) -> None:
        """Let one step pass, at whose beginning everybody read `public`: None, nothing.

        Before the first decision it tells that nothing was read; a step that is observed twice passed without a decision.
        """
        if public is not None:
            raise InputError(f"public must be None: the rule knows of no public information, got {public!r}")
        if self._published or self._looked:
            self._pass()
        self._looked = True

    def _pass(self) -> None:
        self._state = self._law.moved(self._state)
        self._published, self._step = False, None
        self._own, self._is_off_grid = float("nan"), False

    def _now(self) -> Step:
        if self._published:
            self._pass()
        if self._step is None:
            self._step = self._rule.step(self._law.weights(self._state), self._kept)
        return self._step

    def _place(self, action: Any) -> tuple[int, bool]:
        """Which of this step's decisions is meant or nearest, and whether it is that one."""
        table = self._rule.table
        point = table.columns.problem.check_action(action)
        step = self._now()
        gaps = np.abs(table.columns.points[step.numbers] - point).max(axis=1)
        gaps = np.where(step.played > 0, gaps, np.inf)
        place = int(gaps.argmin())
        return place, bool(gaps[place] <= tolerances.SAME_ACTION)

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        observer = self.observer
        lines = [
            f"{self.n_published} decisions published",
            f"observer holds  {observer.summary()}",
        ]
        if not self.is_exact:
            lines.append(f"approximate     {self.n_approximate} decisions counted as the nearest that could be played")
        if self.n_off_grid:
            lines.append(f"off the grid    {self.n_off_grid} beliefs, which the observer's law does not have")
        return "\n".join([*lines, f"prices          {self.calibration.status.value}"])
