"""Sequential decisions about a private mean, and the Kalman filter of the aware observer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.alphas.error_law import ErrorLaw, after_sensor, root_of
from inscrutable.alphas.observed import Moves
from inscrutable.alphas.plans import AlphaStatus, Plan
from inscrutable.alphas.problem import AlphaProblem
from inscrutable.alphas.sequence_state import AlphaState, arrays_of, labels_of
from inscrutable.alphas.trading import TradingPolicy
from inscrutable.axes import Axis
from inscrutable.decision_makers.sequential.lock import KeptInFile
from inscrutable.errors import InputError
from inscrutable.files import PathLike
from inscrutable.saved import Saved
from inscrutable.validation import Array
from inscrutable.worlds import LinearGaussianWorld


@dataclass(frozen=True, eq=False)
class AlphaDraw(Saved):
    """A drawn decision about a private mean.

    Args:
        action: u, shape (n,), the weights to hold.
        estimate: m̂, shape (k,), the aware observer's mean after the decision.
        regret: Its regret for the mean; with trading costs the long-run cost (m̂ − m)'Θ(m̂ − m).
        status: Whether the rule is optimal, up to its gap.

    Example:
        >>> one = AlphaDraw(np.array([0.1]), np.array([0.02]), 0.0, AlphaStatus.OPTIMAL)
        >>> print(one)
        decision for an estimate of norm 0.02, regret 0
    """

    action: Array
    estimate: Array
    regret: float
    status: AlphaStatus

    def __str__(self) -> str:
        return f"decision for an estimate of norm {np.linalg.norm(self.estimate):.4g}, regret {self.regret:.4g}"


@dataclass(frozen=True, eq=False)
class AlphaPath(Saved):
    """Decisions along a path of private means.

    Args:
        actions: u_t, shape (T,n).
        estimates: m̂_t, the observer's mean after each decision, shape (T,k); with inequalities the mean of an observer who
            sees m̂_t itself, of which weights at a limit reveal only a part.
        predictions: m̂_t⁻, the observer's mean before each decision, shape (T,k).
        regrets: Regret of each decision, shape (T,).
        bits: Leakage of each decision under the observer's law, shape (T,); the first values differ from the long run.

    Example:
        >>> zero = np.zeros((2, 1))
        >>> print(AlphaPath(zero, zero, zero, np.zeros(2), np.zeros(2)))
        2 decisions: mean regret 0, 0.000000 bits each
    """

    actions: Array
    estimates: Array
    predictions: Array
    regrets: Array
    bits: Array

    def __str__(self) -> str:
        return f"{len(self.regrets)} decisions: mean regret {self.regrets.mean():.6g}, {self.bits.mean():.6f} bits each"


class PreparedAlphas(Protocol):
    """The interface that a sequence needs of its decision maker."""

    problem: AlphaProblem
    world: LinearGaussianWorld | None
    start_mean: Array
    policy: TradingPolicy | None

    @property
    def plan(self) -> Plan:
        """The rule's law and figures."""

    @property
    def status(self) -> AlphaStatus:
        """Whether the rule is optimal, up to its gap."""

    @property
    def moves(self) -> Moves:
        """The dynamics of the mean in the long run."""

    def moves_into(self, step: int) -> Moves | None:
        """The dynamics of the mean into a step; into step 0 from `start_mean`, None where no law is given."""

    @property
    def theta(self) -> Array:
        """Θ."""


class AlphaSequence(KeptInFile):
    """A sequence of decisions about a private mean; `AlphaDecisionMaker.begin` makes it.

    At every step `decide` draws a decision, any number of times; `publish` records the published one. `observe`, or the next
    `decide`, ends the step. In a world with a public sensor every step begins with `observe` and its public observation; at the
    first step it may be left out, and that step's figures are then of an observer who has not read it. The law of a decision
    given the mean is the same at every step. The observer's covariance starts at that of the first mean and converges to the
    rule's own. With a trading cost the first trade starts from the decision of least risk, which is zero without a budget.

    Example:
        >>> from inscrutable.alphas.decision_maker import AlphaDecisionMaker
        >>> problem = AlphaProblem([[0.04]], risk_aversion=2.5)
        >>> sequence = AlphaDecisionMaker(problem, 0.25, prior_covariance=[[4e-4]]).begin()
        >>> drawn = sequence.decide([0.02], rng=np.random.default_rng(0))
        >>> sequence.publish(drawn)
        >>> round(sequence.total_bits, 6), bool(sequence.mean == drawn.estimate)
        (1.0, True)
    """

    def __init__(self, maker: PreparedAlphas) -> None:
        self._maker, self._plan, self._problem = maker, maker.plan, maker.problem
        self.mean = np.array(maker.start_mean)
        self._is_fresh = maker.world is None
        self._law: Any = self._plan.law
        self._sensor: tuple[Array, Array] | None = None
        if not self._is_fresh:
            assert isinstance(self._law, ErrorLaw)
            self._sensor = self._law.sensor()
            first = maker.moves_into(0)
            self._law = self._plan.law if first is None else self._law_of(first.innovation)
        self._published = self._has_read = False
        self._labels = labels_of(self._problem)
        self.latest: Array | None = None
        self.periods: tuple[str, ...] = ()  # of the published decisions, as far as the caller adds them
        self.n_published = self.n_steps = 0
        self.total_regret = self.total_bits = 0.0

    @property
    def covariance(self) -> Array:
        """The observer's error covariance now, (k,k): before the step's decision, or after it was published."""
        return self._law.covariance if self._published else self._before

    @property
    def _before(self) -> Array:
        return self._maker.moves.innovation if self._is_fresh else self._law.before

    @property
    def expected_regret(self) -> float:
        """tr(ΘE_t), the mean regret of this step's decision; with inequalities an upper bound of it."""
        return self._expected(self._law)[0]

    @property
    def expected_bits(self) -> float:
        """Bits that this step's decision leaks on average."""
        return self._expected(self._law)[1]

    def upcoming(self) -> tuple[float, float]:
        """Return the mean regret and the bits of the next decision to publish."""
        return self._expected(self._next_law() if self._published else self._law)

    def _expected(self, law: Any) -> tuple[float, float]:
        if law is self._plan.law:
            return self._plan.regret, self._plan.bits
        return law.weighed(self._maker.theta), law.bits

    @property
    def _public_rows(self) -> Array:
        return np.zeros((0, 0)) if self._is_fresh else self._maker.moves.public_sensor

    @property
    def _columns(self) -> Axis:
        """The public columns by the world's labels."""
        return Axis("public column", None if self._maker.world is None else self._maker.world.public_names)

    @property
    def _is_settled(self) -> bool:
        return self._law is self._plan.law

    def decide(self, mean: ArrayLike, *, rng: np.random.Generator) -> AlphaDraw:
        """Return a drawn decision of this step for a private mean (k,); nothing is recorded.

        Raises:
            InputError: The mean is malformed, or a public observation is missing.
        """
        held = self._problem.check_mean(mean)
        if held.ndim != 1:
            raise InputError(
                f"mean must be of one step, shape ({self._problem.n_signals},), got {held.shape}; see decide_path"
            )
        self._now()
        estimate = self.mean + self._law.message(held - self.mean, validation.generator(rng))
        policy = self._maker.policy
        if policy is None:
            action = self._problem.optimum(estimate)
            regret = float(self._problem.regret(held, action))
        else:
            before = self._problem.least_risk if self.latest is None else self.latest
            centre = self._maker.start_mean if self._is_fresh else np.zeros(self._problem.n_signals)
            action = before + policy.rate * (policy.aim(self._problem, estimate, centre) - before)
            regret = float((estimate - held) @ self._maker.theta @ (estimate - held))
        return AlphaDraw(action, estimate, regret, self._maker.status)

    def publish(self, decision: AlphaDraw) -> None:
        """Record the decision of this step, drawn by `decide`, which is then public.

        Raises:
            InputError: `decision` is not a decision of this problem.
        """
        if not isinstance(decision, AlphaDraw):
            raise InputError(f"publish takes what decide drew, an AlphaDraw, got {decision!r}")
        estimate = self._problem.check_mean(decision.estimate, "estimate")
        self._now()
        self.total_regret += self.expected_regret
        self.total_bits += self.expected_bits
        self.mean, self.latest = np.array(estimate), self._problem.check_weights(decision.action)
        self.n_published += 1
        self._published = True

    def observe(self, public: ArrayLike | None = None) -> None:
        """Begin the next step with its public observation `public`, (q,), labels aligned: None without a public sensor.

        With a public sensor the first call gives the observation of the first step, if no decision is published. Otherwise, a
        step without a decision ends without one.

        Raises:
            InputError: The public observation is missing, not expected or of another length.
        """
        count = len(self._public_rows)
        if (public is None) != (count == 0):
            wants = "None: nothing is public" if count == 0 else f"the public observation, shape ({count},)"
            raise InputError(f"public must be {wants}, got {public!r}")
        read = (
            np.zeros(0) if public is None else validation.finite_array(public, "public", ndim=1, axes=(self._columns,))
        )
        if len(read) != count:
            raise InputError(f"public has {len(read)} entries, expected {count}")
        if count and not (self._has_read or self._published or self.n_steps):
            self._read_first(read)
        else:
            self._pass(read)

    def _read_first(self, read: Array) -> None:
        self._has_read, first = True, self._maker.moves_into(0)
        if first is not None:
            known = np.zeros_like(first.innovation)
            self.mean = self.mean + first.gain(known) @ (read - first.public_sensor @ self.mean)
            self._law = self._law_of(first.predicted(known)[0])

    def _pass(self, read: Array) -> None:
        law, error = self._next_law(), self._error()
        self.n_steps += 1
        self._published, self._law = False, law
        if self._is_fresh:
            self.mean = np.array(self._maker.start_mean)
            return
        moves = self._moves_into(self.n_steps)
        self.mean = moves.transition @ self.mean + moves.gain(error) @ (read - moves.public_sensor @ self.mean)

    def _moves_into(self, step: int) -> Moves:
        found = self._maker.moves_into(step)
        assert found is not None  # known after step 0
        return found

    def _error(self) -> Array:
        """The observer's error covariance at the end of the step, (k,k)."""
        return np.asarray(self._law.covariance if self._published else self._law.before)

    def _law_of(self, before: Array) -> ErrorLaw:
        """The law of a step with the covariance P before its decision."""
        assert self._sensor is not None
        return after_sensor(root_of(before, self._maker.moves.units), *self._sensor)

    def _next_law(self) -> Any:
        """Return the law of the next step: its public observation changes the mean, not the covariances."""
        if self._is_fresh:
            return self._law
        moves = self._moves_into(self.n_steps + 1)
        is_steady = moves is self._maker.moves
        if is_steady and self._published and self._is_settled:
            return self._law
        before, _ = moves.predicted(self._error())
        lasting = self._plan.law.before  # type: ignore[union-attr]
        size = np.sqrt(np.diag(lasting))
        size[size == 0.0] = size.max()
        near = np.abs(before - lasting) <= tolerances.SETTLED * np.outer(size, size)
        return self._plan.law if is_steady and near.all() else self._law_of(before)

    def _now(self) -> None:
        if self._published:
            if len(self._public_rows):
                raise InputError("the public observation comes before the next decision: call observe(public) first")
            self._pass(np.zeros(0))

    def follow(self, means: Any, public: ArrayLike | None, rng: np.random.Generator) -> AlphaPath:
        """Decide and publish along a path; see `AlphaDecisionMaker.decide_path`."""
        held = np.atleast_2d(self._problem.check_mean(means, "means"))
        steps = Axis("row", learns=True)
        if hasattr(means, "columns"):  # a table, whose rows are steps
            steps.order(tuple(means.index), "means")
        axes = (steps, self._columns)
        read = None if public is None else validation.finite_array(public, "public", ndim=2, axes=axes)
        if read is not None and len(read) != len(held):
            raise InputError(f"public has {len(read)} rows, expected one per mean: {len(held)}")
        drawn, before, bits = [], [], []
        for t, mean in enumerate(held):
            if t or read is not None:
                self.observe(None if read is None else read[t])
            before.append(self.mean)
            bits.append(self.expected_bits)
            drawn.append(self.decide(mean, rng=rng))
            self.publish(drawn[-1])
        return AlphaPath(
            np.array([each.action for each in drawn]),
            np.array([each.estimate for each in drawn]),
            np.array(before),
            np.array([each.regret for each in drawn]),
            np.array(bits),
        )

    def save(self, path: PathLike) -> None:
        """Write the public state to `path` atomically, and lock the file until `close`.

        The file contains no private mean, generator or seed; it contains the rule's law, which stays fixed.

        Raises:
            InputError: The file cannot be written, or another process uses it.
        """
        self._locked(path)
        AlphaState(
            self._signature(), self.mean, self._kept(), self._published, self.n_published, self.n_steps,
            self.total_regret, self.total_bits, self.latest, self.periods, self._has_read, *self._labels,
        ).save(path)  # fmt: skip

    def load(self, path: PathLike) -> Self:
        """Resume the sequence saved at `path`, and lock the file until `close`.

        Raises:
            InputError: The file is missing, damaged, of another rule or of other labels, or another process uses it; nothing
                changes.
        """
        found = self._read(path, lambda: AlphaState.load(path).checked(self._signature(), self._problem, path))
        self.mean, self.latest, self._published = np.array(found.mean), found.latest, found.is_published
        self.n_published, self.n_steps = found.n_published, found.n_steps
        self.total_regret, self.total_bits, self.periods = found.regret, found.bits, found.periods
        self._has_read = found.has_read
        self._labels = self._labels[0] or found.assets, self._labels[1] or found.signals
        is_begun = found.has_read or found.is_published or found.n_steps > 0
        if is_begun and found.before is not None and not self._is_fresh:
            self._law = self._law_of(found.before)
        elif is_begun and not self._is_fresh:
            self._law = self._plan.law
        return self

    def _kept(self) -> Array | None:
        """Return P before the step's decision, where it is not the rule's own."""
        return None if self._is_settled else self._law.before

    def _signature(self) -> tuple[Array, ...]:
        """Return what identifies the rule: the problem, the law of the means, its regret and the error it leaves."""
        plan, start = self._plan, self._maker.start_mean
        common = (*arrays_of(self._problem), start, np.array([plan.regret, plan.error]))
        if self._is_fresh and not isinstance(plan.law, ErrorLaw):
            return *common, plan.law.diagonal(before=True), plan.law.diagonal()
        moves = self._maker.moves
        read = moves.public_sensor, moves.cross, moves.public_covariance
        return *common, moves.transition, moves.innovation, *read, plan.law.covariance

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        return (
            f"{self.n_published} decisions published\n"
            f"cost so far     {self.total_regret:.4g} of regret, {self.total_bits:.4f} bits leaked, by the observer's law\n"
            f"this step       {self.expected_regret:.4g} of regret, {self.expected_bits:.4f} bits\n"
            f"{self._maker.status.value}"
        )
