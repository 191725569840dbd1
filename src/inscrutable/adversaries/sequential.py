"""The aware observer over time: it knows the mechanism and the world, and sees successive decisions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import tolerances, validation
from inscrutable.adversaries.agent_steps import AgentModel
from inscrutable.adversaries.belief_moves import moves_of
from inscrutable.adversaries.belief_particles import BeliefParticles
from inscrutable.adversaries.belief_points import BeliefPoints
from inscrutable.adversaries.decision_tables import DecisionTables, KnownRule, check_problem, nearest_count
from inscrutable.adversaries.inverse_filter import InverseFilter
from inscrutable.adversaries.sequence_evidence import (
    Evidence,
    checked_sensor,
    decision_points,
    public_evidence,
    state_evidence,
    told_memories,
    unseen_points,
)
from inscrutable.adversaries.sequence_results import InferredBeliefs
from inscrutable.adversaries.shown_steps import ShownSteps
from inscrutable.axes import Axis, check_same_order
from inscrutable.errors import InputError
from inscrutable.mechanisms import Disclosure, Mechanism
from inscrutable.mechanisms.chains import BeliefChain
from inscrutable.mechanisms.memory import MechanismRule, MemoryMechanism
from inscrutable.validation import Array
from inscrutable.worlds import CategoricalEmission, Emission, HiddenMarkovModel
from inscrutable.worlds.observations import in_rows, symbols
from inscrutable.worlds.public import PublicPart, joint_symbols


class SequentialAdversary:
    """The inverse filter of an agent that filters its world and plays a known mechanism.

    Formula: α_{t+1}(x',π') ∝ K(u_{t+1}|π') Σ P[x,x'] B[x',y] α_t(x,π) over all x, π, y with π' = T(π,y), from
    α_0(x,π) ∝ K(u_0|π) Σ initial(x) B[x,y] over π = π_0(y): the joint law of state and private belief. Where the world has a
    public sensor, the sum is over the observations that agree with the public reading z_{t+1}.

    On a grid, a belief between the mechanism's beliefs is a mixture of the corners of its cell of a triangulation. This is
    exact where the mechanism lists every belief that the agent can reach (`reachable_beliefs`); otherwise the result states the
    error. A decision of probability 0 on the grid is read with a tolerance of two cells: half of the law moves to the nearest
    beliefs that play it, half stays. Particles follow the agent's beliefs without a grid and interpolate K alone. They suit
    mechanisms that draw little, for which a grid's extra beliefs often contradict the decisions.

    Args:
        world: The observer's model of the world; or a `BeliefChain` on the mechanism's beliefs.
        mechanism: K(u|π); a `MemoryMechanism`, whose memory the filter tracks as well; or a `MechanismRule`, such as
            `SequentialDecisionMaker`, which chooses K_t given the belief's law for an observer of the earlier decisions alone.
        agent_world: The world of the agent's own filter; None: the same. After an observation that this world rules out, the
            agent keeps its prediction. With a `BeliefChain`: the chain that a rule assumes, perhaps without public
            observations.
        sensor: The observer's own sensor on the same states, an `Emission`; pass its reports as `observations`.
        interpolation: "linear", or "nearest": each belief moves to the nearest one of the mechanism. From five states on always
            "nearest".
        n_particles: Number of particles; 0: the grid, which needs a `CategoricalEmission`.
        rng: The source of the particles' draws.
        disclosure: What the observer sees of decisions, how often and how late, such as `every(3) | delayed(2)`, also as text;
            None: all, at once. `filter` then takes the disclosed values `disclosure(actions)`, one row per step with NaN where
            nothing is disclosed; it still infers the belief of the step itself.

    Raises:
        InputError: Numbers of states or symbols differ, or labels of states; observations are real numbers without particles; a
            disclosure differs from the one of the rule, hides steps of a public memory, or has a delay with particles.

    Cost: O(X²·B·Y) per step on B beliefs with Y symbols, or pairs with public ones; N·Y look-ups per step with N particles, 4·N
    for sensors without symbols.

    Source: Mattila, Lourenço, Krishnamurthy, Rojas, Wahlberg, arXiv 1910.07332, where the observer knows the state; here it
    need not. Kerckhoffs' principle.

    Example:
        >>> import numpy as np
        >>> from inscrutable import CategoricalEmission, FiniteProblem, HiddenMarkovModel, OriginalDecisionMaker, mechanism
        >>> world = HiddenMarkovModel([[0.9, 0.1], [0.2, 0.8]], CategoricalEmission([[0.9, 0.1], [0.2, 0.8]]))
        >>> agent = OriginalDecisionMaker(FiniteProblem([[0.0, 1.0], [1.0, 0.0]]))
        >>> adversary = SequentialAdversary(world, mechanism(agent, np.c_[np.linspace(0, 1, 101), np.linspace(1, 0, 101)]))
        >>> print(adversary.filter([0, 1, 1]).mean.round(3))
        [[0.9   0.1  ]
         [0.379 0.621]
         [0.098 0.902]]
    """

    def __init__(
        self,
        world: HiddenMarkovModel | BeliefChain,
        mechanism: Mechanism | MemoryMechanism | MechanismRule,
        *,
        agent_world: HiddenMarkovModel | BeliefChain | None = None,
        sensor: Emission | None = None,
        interpolation: str = "linear",
        n_particles: int = 0,
        rng: np.random.Generator | None = None,
        disclosure: Disclosure | str | None = None,
    ) -> None:
        self.disclosure = Disclosure.of(disclosure)
        self._shown = ShownSteps(mechanism, self.disclosure)
        rule = self._shown.rule
        if n_particles and self.disclosure.schedule.lag:
            raise InputError(
                f"particles do not follow what is shown late, as {self.disclosure} is: use a grid of beliefs"
            )
        self.world, self.mechanism = world, mechanism
        self.agent_world = world if agent_world is None else agent_world
        check_problem(mechanism, world)
        self.sensor = checked_sensor(sensor, rule.beliefs.shape[1], getattr(world, "names", None))
        self.n_particles = validation.count(n_particles, "n_particles", least=0)
        self._rng = None if not self.n_particles else validation.generator(rng)
        if interpolation not in ("linear", "nearest"):
            raise InputError(f"interpolation must be 'linear' or 'nearest', got {interpolation!r}")
        points = BeliefPoints(rule.beliefs, linear=interpolation == "linear")
        self._reader = self._made(world, self.agent_world, rule, points)
        same = self.agent_world is world
        self._agents_own = self._reader if same else self._made(self.agent_world, self.agent_world, rule, points)
        self._rule = rule

    def _made(
        self, world: Any, agent_world: Any, rule: KnownRule, points: BeliefPoints
    ) -> InverseFilter | BeliefParticles:
        """Return the filter of a world: on a grid of beliefs, or with particles."""
        if isinstance(world, BeliefChain):
            if self.sensor is not None or self.n_particles:
                raise InputError("a chain of beliefs has no states: it takes no sensor or n_particles")
            if not isinstance(agent_world, BeliefChain):
                raise InputError(f"agent_world must be a BeliefChain, as the world is, got {agent_world!r}")
            return InverseFilter(moves_of(world, points), rule)
        _check_worlds(world, agent_world, rule.beliefs.shape[1], needs_symbols=not self.n_particles)
        if self.n_particles:
            return BeliefParticles(world, AgentModel(agent_world), rule, points, self.n_particles)
        return InverseFilter(moves_of(world, points, agent_world), rule)

    @property
    def interpolation_error(self) -> Array:
        """Expected distance of T(π_b,y) from the points that represent it, shape (B,Y); on a grid only.

        Raises:
            InputError: The adversary uses particles; only the result has the error then.
        """
        if isinstance(self._reader, BeliefParticles):
            raise InputError("particles have no fixed interpolation error: see the result's `interpolation_error`")
        return self._reader.moves.errors

    @property
    def is_exact(self) -> bool:
        """Whether every successor of every belief of the mechanism is one of its beliefs; see also `is_exact` of a result."""
        return not self.n_particles and bool(self.interpolation_error.max() <= tolerances.SAME_BELIEF)

    def filter(
        self,
        actions: ArrayLike,
        *,
        states: ArrayLike | None = None,
        observations: Any = None,
        memories: ArrayLike | None = None,
        public: Any = None,
        nearest: int = 0,
        returns: ArrayLike | None = None,
    ) -> InferredBeliefs:
        """Return the law of each belief given the decisions up to its step.

        Args:
            actions: u_0..u_{T-1}, shape (T,U), or (T,) choices; a row of NaN where no decision was seen. Under a disclosure
                what it shows at each step, `disclosure(actions)`.
            states: x_0..x_{T-1}, where the observer knows them.
            observations: The T reports of the observer's own sensor. Labelled rows are aligned with those of the decisions.
            memories: The agent's memory before the first decision and after each, T+1 numbers, where it is public.
            public: The T public observations in a world with a public sensor: symbols or real rows, NaN where the observer did
                not read them.
            nearest: k: a decision that the mechanism never plays is read as one of the k nearest that it plays, without those
                ten thousand times farther than the nearest, with the sum of their likelihoods; 0: it is skipped, with a
                status; True: k = 1.
            returns: Returns of the period of each decision, (T,U), where the disclosure uses them.

        Raises:
            InputError: Shapes or lengths disagree.
            ModelError: States or observations are impossible in the observer's world.
        """
        beside = _Beside(states, observations, public, returns)
        return self._inferred(actions, beside, memories, nearest, smooth=False)

    def smooth(
        self,
        actions: ArrayLike,
        *,
        states: ArrayLike | None = None,
        observations: Any = None,
        memories: ArrayLike | None = None,
        public: Any = None,
        nearest: int = 0,
        returns: ArrayLike | None = None,
    ) -> InferredBeliefs:
        """Return the law of each belief given all decisions, later ones included; arguments as `filter`.

        Particles are traced back to their ancestors, which are few far from the end: see `effective_size`.
        """
        beside = _Beside(states, observations, public, returns)
        return self._inferred(actions, beside, memories, nearest, smooth=True)

    def unseen(
        self, n_steps: int, *, states: ArrayLike | None = None, observations: Any = None, public: Any = None
    ) -> InferredBeliefs:
        """Return the law of `n_steps` beliefs given no decision, under which the observer's error is largest.

        Other arguments as `filter`. Where all observations of the agent are public, the error is 0.
        """
        points = unseen_points(validation.count(n_steps, "n_steps"))
        beside = _Beside(states, observations, public, None)
        steps = Axis("step", learns=True)
        return self._run(points, None, steps, beside, nearest=0, smooth=False, tables=None)

    def _inferred(
        self, actions: ArrayLike, beside: _Beside, memories: ArrayLike | None, nearest: int, *, smooth: bool
    ) -> InferredBeliefs:
        steps = Axis("step", learns=True)
        points = self._shown.decided(decision_points(actions, self._shown.actions, steps))
        told = told_memories(memories, len(points), self.mechanism)
        tables = self._shown.tables(beside.returns, len(points), steps)
        return self._run(points, told, steps, beside, nearest=nearest, smooth=smooth, tables=tables)

    def _run(
        self,
        points: Array,
        told: np.ndarray | None,
        steps: Axis,
        beside: _Beside,
        *,
        nearest: int,
        smooth: bool,
        tables: list[DecisionTables] | None,
    ) -> InferredBeliefs:
        if isinstance(self.world, BeliefChain) and beside.states is not None:
            raise InputError("a chain of beliefs has no states")
        n_states = 1 if isinstance(self.world, BeliefChain) else self.world.n_states
        known = None if beside.states is None else symbols(beside.states, n_states, "states", steps)
        reported = in_rows(beside.observations, steps)
        seen, offsets = state_evidence(len(points), n_states, self.sensor, known, reported)
        read = public_evidence(self.world, beside.public, len(points), steps)
        evidence = Evidence(points, nearest_count(nearest), told, seen, offsets, read)
        if not (self._rule.is_fixed or evidence.is_all_read):
            raise InputError("public has missing rows, but the rule depends on all public observations: pass them")
        alone = evidence.without_states(has_public=self.agent_world.public is not None)
        if self._rule.is_fixed or (self._agents_own is self._reader and (alone.states == seen).all()):
            return self._read(self._reader, evidence, tables, smooth=smooth)[0]
        # The rule decides by the law given decisions and public observations, in the agent's world.
        tables = self._read(self._agents_own, alone, None, smooth=False)[1]
        return self._read(self._reader, evidence, tables, smooth=smooth)[0]

    def _read(
        self,
        reader: InverseFilter | BeliefParticles,
        evidence: Evidence,
        tables: list[DecisionTables] | None,
        *,
        smooth: bool,
    ) -> tuple[InferredBeliefs, list[DecisionTables]]:
        """Return the result with the decisions of every step."""
        if isinstance(reader, BeliefParticles):
            assert self._rng is not None
            return reader.run(evidence, self._rng, smooth=smooth, tables=tables)
        is_late = self.disclosure.schedule.lag > 0 and not smooth
        passed, used = reader.forward(evidence, tables=tables, keep=smooth or is_late)
        if is_late:
            passed = self._shown.late(reader, evidence, passed)
        return reader.result(passed, reader.smoothed(evidence, passed) if smooth else None), used

    def summary(self) -> str:
        """Return what the observer knows and sees, as a few lines of text."""
        return f"{self!r}\nknows   {self.mechanism!r}\nsees    {self.disclosure.summary()}"

    def __repr__(self) -> str:
        by = f"{self.n_particles} particles" if self.n_particles else f"{len(self._rule.beliefs)} beliefs"
        return f"SequentialAdversary({self.world!r}, by {by})"


class _Beside(NamedTuple):
    """An observer's evidence besides decisions."""

    states: ArrayLike | None
    observations: Any
    public: Any
    returns: ArrayLike | None


def _check_worlds(world: Any, agent_world: Any, n_states: int, *, needs_symbols: bool) -> None:
    if not isinstance(world, HiddenMarkovModel):
        raise InputError(f"world must be a HiddenMarkovModel or a BeliefChain, got {world!r}")
    if world.n_states != n_states:
        raise InputError(f"the mechanism has {n_states} states, the world {world.n_states}")
    if not isinstance(agent_world, HiddenMarkovModel) or agent_world.n_states != world.n_states:
        raise InputError(f"agent_world must be a HiddenMarkovModel of {world.n_states} states, got {agent_world!r}")
    check_same_order("state", ("agent_world", agent_world.names), ("world", world.names))
    if needs_symbols and any(joint_symbols(each.emission, each.public) is None for each in (world, agent_world)):
        raise InputError("real observations have no finite number of successors: pass n_particles and rng")
    _check_alike("symbols", world.emission, agent_world.emission)
    if world.public is not None or agent_world.public is not None:
        _check_alike("public symbols", world.public_emission, agent_world.public_emission)
        parts = [each.public for each in (world, agent_world) if isinstance(each.public, PublicPart)]
        if len(parts) == 1 or (parts and not np.array_equal(parts[0].matrix, parts[1].matrix)):
            raise InputError(
                f"world and agent_world must have the same public part, got {world.public!r} and {agent_world.public!r}"
            )


def _check_alike(what: str, one: Any, other: Any) -> None:
    sizes = {each.n_symbols for each in (one, other) if isinstance(each, CategoricalEmission)}
    if len(sizes) > 1 or type(one) is not type(other):
        raise InputError(f"world and agent_world must report the same {what}, got {one!r} and {other!r}")
