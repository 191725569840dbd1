"""A sequence of decisions with a memory: the next lottery, and the observer's present law."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy import sparse

from inscrutable import tolerances, validation
from inscrutable.decision_makers.aware.columns import lotteries, without_small
from inscrutable.decision_makers.results import DecisionStatus, MixedDecision
from inscrutable.decision_makers.sequential.laws import ChainLaw
from inscrutable.decision_makers.sequential.lock import KeptInFile
from inscrutable.decision_makers.sequential.prices import PriceCalibration
from inscrutable.decision_makers.sequential.state import SequenceState, problem_of
from inscrutable.decision_makers.sequential.step import Step, StepRule, StepTable, hidden_step
from inscrutable.errors import InputError
from inscrutable.files import PathLike
from inscrutable.mechanisms import Mechanism, Prior
from inscrutable.saved import Summarised
from inscrutable.validation import Array


class StepFigures(NamedTuple):
    """Regret and leakage of the present step on average.

    regret: Mean regret under the observer's law, without knowledge of the belief, in the cost's unit.
    own_regret: The same under the belief itself; NaN before `decide`.
    bits: I(π;u) under the law.
    loss: The observer's mean loss after the decision, under the law, such as the square error; where decisions are disclosed
        late or not all, on average over the steps in which it is the latest known.
    """

    regret: float
    own_regret: float
    bits: float
    loss: float


class Prepared(Protocol):
    """The interface of a sequence to its decision maker."""

    @property
    def table(self) -> StepTable:
        """Beliefs, decisions and regrets."""

    @property
    def law(self) -> ChainLaw:
        """The dynamics of the observer's law."""

    @property
    def limit(self) -> float:
        """The mean regret allowed."""

    @property
    def calibration(self) -> PriceCalibration:
        """The prices, found when they are first needed."""


class DecisionSequence(Summarised, KeptInFile):
    """Successive decisions, with the observer's law of the belief; `SequentialDecisionMaker.begin` makes it.

    At every step `decide` returns the lottery, any number of times; `publish` records the one decision that was drawn and
    published. Time passes with `observe`, or else with the next `decide` or `publish`. Where the chain has public symbols,
    `observe` takes the one of the step, before each decision. `period` may name the time of the latest decision, and
    `digest` may hold a hash of the data behind it; both are stored with the sequence.

    Cost: the solve of a step, some milliseconds for 500 beliefs and 500 decisions. Source: see `SequentialDecisionMaker`.

    Example:
        >>> from inscrutable import Budget, FiniteProblem, PriceCalibration, SequentialDecisionMaker
        >>> from inscrutable.mechanisms.chains import resting_chain
        >>> chain = resting_chain(Prior(np.eye(2), [0.5, 0.5]), 0.8)
        >>> sequence = SequentialDecisionMaker(
        ...     FiniteProblem([[0.0, 1.0], [1.0, 0.0]]),
        ...     Budget.regret(0.25),
        ...     chain=chain,
        ...     calibration=PriceCalibration.at(np.log(3.0), float("inf")),
        ...     rng=np.random.default_rng(0),
        ... ).begin()
        >>> print(sequence.decide([1.0, 0.0]).probabilities.round(2))
        [0.75 0.25]
        >>> sequence.publish(0)
        >>> print(sequence.observer.weights.round(4))
        [0.75 0.25]
    """

    def __init__(self, maker: Prepared, rng: np.random.Generator) -> None:
        self._maker, self._rng, self._law, self._table = maker, rng, maker.law, maker.table
        self._prices: tuple[PriceCalibration, int, StepRule] | None = None
        self._state = self._law.start()
        self._kept = -1
        self._published = self._looked = False
        self._step: Step | None = None
        self._own, self._is_off_grid = float("nan"), False
        self.n_steps = 0
        self.n_published = self.n_off_grid = self.n_approximate = 0
        self.total_regret = self.total_bits = 0.0
        self._latest: Array | None = None
        self.period: str | None = None
        self.digest: str | None = None

    def _priced(self) -> tuple[PriceCalibration, int, StepRule]:
        """The prices, found and drawn before the first step."""
        if self._prices is None:
            found = self._maker.calibration
            index = 0 if len(found.shares) == 1 else int(self._rng.choice(len(found.shares), p=found.shares))
            self._prices = found, index, StepRule(self._table, found.prices(index))
        return self._prices

    @property
    def calibration(self) -> PriceCalibration:
        """The prices, of which `price_index` was drawn; both are public."""
        return self._priced()[0]

    @property
    def price_index(self) -> int:
        """Index of the calibration's price that is used."""
        return self._priced()[1]

    @property
    def _rule(self) -> StepRule:
        return self._priced()[2]

    @property
    def beliefs(self) -> Array:
        """The grid of beliefs, the support of all laws, shape (B,X)."""
        return self._table.prior.beliefs

    @property
    def observer(self) -> Prior:
        """The law of the present belief given all published decisions that are ever disclosed, already or later."""
        return Prior(self.beliefs, self._state)

    @property
    def begun(self) -> Prior:
        """The observer's law of the belief before the first decision."""
        return self._table.prior

    @property
    def latest(self) -> Any:
        """The decision published last, shape (U,); an int where decisions are finite choices; None before the first."""
        return None if self._latest is None else self._table.columns.problem.as_actions(self._latest)

    @property
    def is_off_grid(self) -> bool:
        """Whether the belief last decided for in this step is not among `beliefs`; it plays as the nearest of them."""
        return self._is_off_grid

    @property
    def is_shown(self) -> bool:
        """Whether the decision of this step will be disclosed; if not, it is the optimal one."""
        passed = self.n_steps + self._published
        if self._law.n_public is not None:  # the public symbol before the first decision begins a step too
            passed = max(passed - 1, 0)
        return self._table.disclosure.schedule.shows(passed)

    @property
    def is_exact(self) -> bool:
        """Whether every published decision was one that the rule could have played."""
        return self.n_approximate == 0

    @property
    def expected(self) -> StepFigures:
        """Regret and leakage of this step on average, before its decision is drawn."""
        step = self._now()
        return StepFigures(step.regret, self._own, step.bits, step.loss)

    @property
    def step(self) -> Step:
        """The mechanism of the present step, on the chain's beliefs and the disclosed values."""
        return self._now()

    @property
    def mechanism(self) -> Mechanism:
        """K of the present step, on the chain's beliefs and all decisions; on the optimal ones where it is never disclosed."""
        step, beliefs = self._now(), self.beliefs
        if not step.is_hidden:
            return self._rule.mechanism(step)
        columns, rows, costs = self._rule.answers(step, beliefs)
        actions = columns.problem.as_actions(columns.points)
        return Mechanism(beliefs, actions, sparse.csr_array(rows), columns.regrets(beliefs, costs))

    def mechanism_for(self, law: Prior, before: Any = None) -> Mechanism:
        """Return K on the chain's beliefs and all decisions, where the observer holds `law` before the decision.

        Args:
            law: The observer's law, on the chain's beliefs.
            before: The decision disclosed last, or its disclosed value, which wins ties; None: there is none.

        Raises:
            InputError: The law is on other beliefs, or `before` is malformed.
        """
        known = self.beliefs
        if not isinstance(law, Prior) or law.beliefs.shape != known.shape:
            raise InputError(f"law must be a Prior over the rule's {len(known)} beliefs, got {law!r}")
        if np.abs(law.beliefs - known).max() > tolerances.SAME_BELIEF:
            raise InputError("law must be on the rule's beliefs, in their order")
        return self._rule.mechanism(self._rule.step(law.weights, self._rule.table.number(before)))

    def decide(self, belief: ArrayLike) -> MixedDecision:
        """Return the lottery of this step for a belief (X,); nothing is recorded."""
        problem = self._table.columns.problem
        held = validation.one_belief(belief, problem.n_states, names=problem.state_names)
        step = self._now()
        columns, rows, costs = self._rule.answers(step, held[None])
        regrets = columns.regrets(held[None], costs)
        shares = without_small(rows, regrets)
        self._own = float((shares * regrets).sum())
        self._is_off_grid = bool(self._table.tree.query(held)[0] > tolerances.SAME_BELIEF)
        return lotteries(columns, held[None], costs, shares, DecisionStatus.BEST_CANDIDATE)[0]

    def could_play(self, action: ArrayLike) -> bool:
        """Return whether some belief that is still possible plays a decision at this step."""
        return self._place(action)[2]

    def publish(self, action: ArrayLike, *, as_nearest: bool = False) -> None:
        """Record the decision of this step, which is then public.

        Args:
            action: u, shape (U,); an int where decisions are finite choices.
            as_nearest: Whether a decision that the rule could not have played counts as the nearest one that it could have; the
                law is approximate from then on.

        Raises:
            InputError: The decision is malformed, or the rule could not have played it; nothing is recorded then.
        """
        point, place, possible = self._place(action)
        if not possible and not as_nearest:
            raise InputError(
                f"the rule could not have played {np.asarray(action)} at this step: draw from decide(), or pass "
                "as_nearest=True, after which the observer's law is approximate"
            )
        step = self._now()
        if not step.is_hidden:
            self._state = self._law.seen(self._state, step.rows[:, place])
            self._kept = int(step.numbers[place])
        self.total_regret += step.regret
        self.total_bits += step.bits
        self._latest = point
        self.n_published += 1
        self.n_approximate += not possible
        self.n_off_grid += self._is_off_grid
        self._published, self._looked = True, False

    def observe(self, public: int | ArrayLike | None = None) -> None:
        """Begin the next step with its public observation.

        Before the first decision it gives the information of the first step; a second call in a step ends it without a
        decision. Where the chain has public symbols, every step begins with this call, before its decision.

        Args:
            public: The symbol, a whole number, or the real numbers (D,) where the chain's symbols are cells of such; None where
                the chain has none.

        Raises:
            InputError: A symbol is missing, not asked for, or of probability 0 under the present law; nothing is recorded then.
        """
        count = self._law.n_public
        if count is None and public is not None:
            raise InputError(f"public must be None: the rule's chain has no public information, got {public!r}")
        if count is not None and self._law.chain.cells is not None and public is not None and np.ndim(public) == 1:
            public = int(self._law.symbols(np.asarray(public)[None], 1)[0])
        if count is not None:
            whole = isinstance(public, (int, np.integer)) and not isinstance(public, bool)
            if not whole or not 0 <= public < count:  # type: ignore[operator]
                raise InputError(
                    f"public must be the public symbol, a whole number from 0 to {count - 1}, got {public!r}"
                )
        if self._published or self._looked or count is not None:
            self._pass(None if public is None else int(public))  # type: ignore[arg-type]
        self._looked = True

    def _pass(self, read: int | None = None) -> None:
        self._state = self._law.moved(self._state, read)
        self.n_steps += 1
        self._published, self._step = False, None
        self._own, self._is_off_grid = float("nan"), False

    def _now(self) -> Step:
        if self._law.n_public is not None and (self._published or not self._looked):
            raise InputError(
                "the public information of this step comes before its decision: call observe(public) first"
            )
        if self._published:
            self._pass()
        if self._step is None:
            state = self._state
            self._step = self._rule.step(state, self._kept) if self.is_shown else hidden_step(self._table, state)
        return self._step

    def _place(self, action: Any) -> tuple[Array, int, bool]:
        """A decision as a point, the number of this step's nearest value, and whether it is exact; a hidden one has none."""
        point = self._table.columns.problem.check_action(action)  # before time passes
        step = self._now()
        played = np.flatnonzero(step.played > 0)
        place, gap = self._table.nearest(point, step.numbers[played])
        return point, int(played[place]), step.is_hidden or gap <= tolerances.SAME_ACTION

    def save(self, path: PathLike) -> None:
        """Write the sequence's memory to `path` atomically, and lock the file for other processes until `close`.

        No belief of the agent's is written, and no generator or seed.

        Raises:
            InputError: The file cannot be written, or another process uses it.
        """
        self._locked(path)
        calibration, index, _ = self._priced()
        SequenceState(
            problem_of(self._table, self._law, self._maker.limit),
            calibration,
            index,
            self._state,
            self._kept,
            self._published,
            self._looked,
            self.n_published,
            self.n_approximate,
            self.n_off_grid,
            self.total_regret,
            self.total_bits,
            self._latest,
            self.n_steps,
            self.period,
            self.digest,
        ).save(path)

    def load(self, path: PathLike) -> Self:
        """Continue the sequence saved at `path`, with its prices, and lock the file for other processes until `close`.

        Raises:
            InputError: The file is missing, damaged, of another version or another problem, or another process uses it; the
                sequence and the file stay as they are.
        """
        found = self._read(path, lambda: self._state_at(path))
        calibration = found.calibration
        prices = calibration.prices(found.price_index)
        self._prices = calibration, found.price_index, StepRule(self._table, prices)
        self._state, self._kept, self._step = np.array(found.state), found.kept, None
        self._published, self._looked = found.has_published, found.has_looked
        self.n_published, self.n_approximate = found.n_published, found.n_approximate
        self.n_off_grid, self.total_regret, self.total_bits = found.n_off_grid, found.regret, found.bits
        self._latest, self.n_steps = found.latest, found.n_steps
        self.period, self.digest = found.period, found.digest
        self._own, self._is_off_grid = float("nan"), False
        return self

    def _state_at(self, path: PathLike) -> SequenceState:
        found = SequenceState.load(path)
        try:
            problem_of(self._table, self._law, self._maker.limit).check(found.problem)
        except InputError as error:
            raise InputError(
                f"{path} cannot be continued: {error}. Go on as it was begun, with the same problem and limits (`protect` "
                "takes the budget from the file where none is given), or begin another sequence in another file: the observer "
                "remembers this one all the same"
            ) from None
        if found.kept >= self._table.n_values:
            raise InputError(f"{path} is damaged: it kept value {found.kept} of {self._table.n_values}")
        return found

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        observer = self.observer
        lines = [
            f"{self.n_published} decisions published",
            f"cost so far     {self.total_regret:.4g} of regret, {self.total_bits:.4f} bits leaked, by the observer's law",
            f"observer holds  {observer.summary()}",
        ]
        if not self.is_exact:
            lines.append(f"approximate     {self.n_approximate} decisions counted as the nearest that could be played")
        if self.n_off_grid:
            lines.append(f"off the grid    {self.n_off_grid} beliefs, which play as the nearest on it")
        return "\n".join([*lines, f"prices          {self.calibration.status.value}"])
