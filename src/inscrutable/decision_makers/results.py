"""What a decision maker returns: frozen, able to print and to check itself."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import ClassVar, Protocol

import numpy as np

from inscrutable import validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.errors import InputError
from inscrutable.geometry import BeliefSet
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Saved, saved_choice
from inscrutable.validation import Array

Progress = Callable[[int, int], None]
"""Called with (steps done, steps in all) in long runs."""

_MOST_SHOWN = 12
"""Atoms of a lottery that a summary lists."""


class Played(Protocol):
    """What was played: `actions(step)` gives one step's decisions, `actions(slice(None))` all of them."""

    @property
    def problem(self) -> DecisionProblem:
        """The decision problem."""

    def actions(self, step: int | slice) -> Array:
        """Return the decisions of a step or of many."""


@dataclass(frozen=True, eq=False)
class Kept:
    """Decisions kept as they are."""

    problem: DecisionProblem
    values: Array

    def actions(self, step: int | slice) -> Array:
        """Return the decisions of a step or of many."""
        return np.asarray(self.values[step])


@dataclass(frozen=True, eq=False)
class Picked:
    """One atom of each lottery."""

    lotteries: Played
    chosen: np.ndarray

    @property
    def problem(self) -> DecisionProblem:
        """The decision problem."""
        return self.lotteries.problem

    def actions(self, step: int | slice) -> Array:
        """Return the decisions of a step or of many."""
        found, chosen = self.lotteries.actions(step), self.chosen[step]
        return np.asarray(found[chosen] if found.ndim == 2 else found[np.arange(len(found)), chosen])


@saved_choice
class DecisionStatus(Enum):
    """How a decision came about; the text says what to do about it.

    Example:
        >>> DecisionStatus.OPTIMAL.value
        'optimal: the decision of least cost'
    """

    OPTIMAL = "optimal: the decision of least cost"
    POLISHED = "best candidate, polished by a local search: no proof that nothing better exists"
    PROVED = "proved: no affordable decision is more private"
    GAP_REACHED = "proved within the gap asked for: a smaller gap, or a finer search, may find a little more"
    BOUNDED = (
        "best bound after the limit of oracle calls, or where only less than min_slack of something mixed in would reach it: "
        "allow more calls or a smaller min_slack, or play on with the bound as it stands"
    )
    BEST_CANDIDATE = "best of the candidates: more of them may find better"
    LOCAL_OPTIMUM = "local optimum of a local search: more starts may find better"
    NO_AFFORDABLE_PRIVACY = (
        "nothing affordable reaches the goal, so the optimal is played: raise the budget; cheapest_privacy says how far"
    )
    NO_PLAUSIBLE_START = "no affordable start that a belief explains was found: use the global search"
    RULE_OF_THUMB = "a rule of thumb: nothing was searched, so the privacy is whatever the rule leaves"
    UNBOUNDED = (
        "unexplained decisions count as infinitely private and are affordable: the paper's letter has no optimum"
    )


@dataclass(frozen=True, eq=False, repr=False)
class Decision(Saved):
    """One decision and what it gives away.

    Args:
        action: ū, shape (U,); an int where decisions are finite choices.
        cost: π·s(ū), in the cost's unit.
        optimal_cost: c* = V(π), in the cost's unit.
        regret: cost − optimal cost, at least 0.
        privacy: Ψ(ū) against an observer who takes the decision at face value.
        privacy_bound: No affordable decision has more privacy than this.
        decoy: A belief that the decision is optimal for, shape (X,); NaN where there is none.
        status: How the decision came about.
        problem: The decision problem, from which `belief_set`, Π(ū), what that observer reconstructs, is made on access.
        price: ∂Ψ/∂budget, what one more unit of regret would add to the privacy; NaN where the search does not know it.
        oracle_calls: Beliefs solved for the proof of `privacy_bound`; 0 without one.

    Source: the paper, Approach 1.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> from inscrutable import OriginalDecisionMaker
        >>> print(OriginalDecisionMaker(problem).decide([0.5, 0.5]).summary())
        action        [0.5000 0.5000]
        cost          0.4, 0 above the optimal 0.4 (0.0% of |c*|)
        privacy       0.0000 (at most 0.0000)
        observer sees the belief [0.5000 0.5000]
        status        optimal: the decision of least cost
    """

    action: Array
    cost: float
    optimal_cost: float
    regret: float
    privacy: float
    privacy_bound: float
    decoy: Array
    status: DecisionStatus
    problem: DecisionProblem | None = field(default=None, metadata={"saved": False})
    price: float = float("nan")
    oracle_calls: int = 0
    _derived: ClassVar[tuple[str, ...]] = ("belief_set",)

    def __post_init__(self) -> None:
        _own(self, action=_as_met(self.problem, self.action), decoy=self.decoy)

    @cached_property
    def belief_set(self) -> BeliefSet:
        """Π(ū), what the observer reconstructs."""
        return _set_of(self.problem, self.action)

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        share = f" ({self.regret / abs(self.optimal_cost):.1%} of |c*|)" if self.optimal_cost else ""
        return "\n".join(
            [
                f"action        {_numbers(self.action)}",
                f"cost          {self.cost:.6g}, {self.regret:.3g} above the optimal {self.optimal_cost:.6g}{share}",
                f"privacy       {self.privacy:.4f} (at most {self.privacy_bound:.4f})",
                f"observer sees {_describe(self.belief_set)}",
                f"status        {self.status.value}",
            ]
        )


@dataclass(frozen=True, eq=False, repr=False)
class MixedDecision(Saved):
    """A lottery over decisions: draw one with `sample`.

    Args:
        actions: Atoms, shape (k,U).
        probabilities: Shape (k,), summing to one.
        regrets: Of each atom, shape (k,), in the cost's unit.
        privacies: Ψ of each atom, shape (k,).
        expected_cost: Σ p_l π·s(ū_l), in the cost's unit.
        expected_privacy: Σ p_l Ψ(ū_l).
        optimal_cost: c* = V(π).
        privacy_bound: No affordable mixture has more expected privacy than this.
        price: Slope of the expected privacy in the budget, per unit of cost.
        decoys: A belief each atom is optimal for, shape (k,X); NaN where there is none.
        status: How the decision came about.
        problem: The decision problem, from which `belief_sets`, Π of each atom, are made on access.
        oracle_calls: Beliefs solved for the proof of `privacy_bound`; 0 without one.

    Source: the paper, Approach 2 and eq. (12).

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> from inscrutable import ProbabilisticDecisionMaker
        >>> mixed = ProbabilisticDecisionMaker(problem, budget=0.001).decide([0.5, 0.5])
        >>> mixed.expected_regret <= 0.001 * abs(mixed.optimal_cost)
        True
    """

    actions: Array
    probabilities: Array
    regrets: Array
    privacies: Array
    expected_cost: float
    expected_privacy: float
    optimal_cost: float
    privacy_bound: float
    price: float
    decoys: Array
    status: DecisionStatus
    problem: DecisionProblem | None = field(default=None, metadata={"saved": False})
    oracle_calls: int = 0
    _derived: ClassVar[tuple[str, ...]] = ("belief_sets",)

    def __post_init__(self) -> None:
        _own(
            self,
            actions=_as_met(self.problem, self.actions),
            probabilities=self.probabilities,
            regrets=self.regrets,
            privacies=self.privacies,
            decoys=self.decoys,
        )

    @cached_property
    def belief_sets(self) -> tuple[BeliefSet, ...]:
        """Π of each atom."""
        return tuple(_set_of(self.problem, action) for action in self.actions)

    @property
    def expected_regret(self) -> float:
        """Σ p_l ρ_l, in the cost's unit."""
        return float(self.probabilities @ self.regrets)

    def sample(self, *, rng: np.random.Generator | None = None) -> Decision:
        """Return one atom as a `Decision`, drawn by its probability.

        `rng` None draws from the operating system's entropy, because a rival who knows the seed knows the draw.
        """
        source = np.random.default_rng() if rng is None else validation.generator(rng)
        index = int(source.choice(len(self.probabilities), p=self.probabilities))
        regret = float(self.regrets[index])
        drawn = Decision(
            self.actions[index],
            self.optimal_cost + regret,
            self.optimal_cost,
            regret,
            float(self.privacies[index]),
            max(self.privacy_bound, float(self.privacies[index])),
            self.decoys[index],
            self.status,
            self.problem,
            oracle_calls=self.oracle_calls,
        )
        if "belief_sets" in vars(self):
            vars(drawn)["belief_set"] = self.belief_sets[index]
        return drawn

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        lines = [
            f"expected cost     {self.expected_cost:.6g}, {self.expected_regret:.3g} above {self.optimal_cost:.6g}",
            f"expected privacy  {self.expected_privacy:.4f} (at most {self.privacy_bound:.4f})",
        ]
        shown = np.arange(len(self.probabilities))
        if len(shown) > _MOST_SHOWN:
            shown = np.argsort(-self.probabilities, kind="stable")[:_MOST_SHOWN]
        for i in shown:
            lines.append(
                f"with {self.probabilities[i]:7.2%}      {_numbers(self.actions[i])}  regret {self.regrets[i]:.3g}  "
                f"privacy {self.privacies[i]:.4f}"
            )
        left = np.setdiff1d(np.arange(len(self.probabilities)), shown)
        if len(left):
            share, most = float(self.probabilities[left].sum()), float(self.regrets[left].max())
            lines.append(f"with {share:7.2%}      one of {len(left)} others  regret at most {most:.3g}")
        return "\n".join([*lines, f"status            {self.status.value}"])


@dataclass(frozen=True, eq=False, repr=False)
class Decisions(Saved):
    """`Decision` for T beliefs: the same fields with a leading T; belief sets and statuses as tuples.

    Source: the paper, Approach 1 at every step.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> from inscrutable import OriginalDecisionMaker
        >>> OriginalDecisionMaker(problem).decide_many([[0.5, 0.5], [1.0, 0.0]]).action.shape
        (2, 2)
    """

    cost: Array
    optimal_cost: Array
    regret: Array
    privacy: Array
    privacy_bound: Array
    decoy: Array
    status: tuple[DecisionStatus, ...]
    played: Played | None = field(default=None, metadata={"saved": False})
    price: Array | None = None
    oracle_calls: np.ndarray | None = None  # (T,); None becomes zeros
    _derived: ClassVar[tuple[str, ...]] = ("action", "belief_set")

    def __post_init__(self) -> None:
        object.__setattr__(self, "oracle_calls", _counts(self.oracle_calls, len(self.status)))

    @cached_property
    def action(self) -> Array:
        """ū of every step, shape (T,U), made at first use."""
        played = _known(self.played)
        return _as_met(played.problem, played.actions(slice(None)))

    @cached_property
    def belief_set(self) -> tuple[BeliefSet, ...]:
        """Π(ū) of every step, made at first use."""
        problem = _known(self.played).problem
        return tuple(_set_of(problem, action) for action in self.action)

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        return "\n".join(
            [
                f"{len(self)} decisions",
                f"regret   mean {self.regret.mean():.3g}, largest {self.regret.max():.3g}",
                f"privacy  mean {self.privacy.mean():.4f}, least {self.privacy.min():.4f}",
                *_counted_statuses(self.status),
            ]
        )

    def __getitem__(self, step: int) -> Decision:
        """Return the decision of one step."""
        found = Decision(
            self.action[step] if self.played is None else self.played.actions(step),
            float(self.cost[step]),
            float(self.optimal_cost[step]),
            float(self.regret[step]),
            float(self.privacy[step]),
            float(self.privacy_bound[step]),
            self.decoy[step],
            self.status[step],
            None if self.played is None else self.played.problem,
            float("nan") if self.price is None else float(self.price[step]),
            int(_counts(self.oracle_calls, len(self))[step]),
        )
        if "belief_set" in vars(self):
            vars(found)["belief_set"] = self.belief_set[step]
        return found


@dataclass(frozen=True, eq=False, repr=False)
class MixedDecisions(Saved):
    """`MixedDecision` for T beliefs: its fields with a leading T, atoms padded with probability 0.

    Belief sets of a step's atoms are in `mixed[step]`.

    Source: the paper, Approach 2 at every step.

    Example:
        >>> import numpy as np
        >>> from inscrutable import MarkowitzProblem
        >>> problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [np.eye(2), np.eye(2)], 1.0)
        >>> from inscrutable import ProbabilisticDecisionMaker
        >>> mixed = ProbabilisticDecisionMaker(problem, budget=0.001).decide_many([[0.5, 0.5], [0.9, 0.1]])
        >>> len(mixed), mixed.sample(rng=np.random.default_rng(0)).action.shape
        (2, (2, 2))
    """

    probabilities: Array  # (T, k)
    regrets: Array  # (T, k)
    privacies: Array  # (T, k)
    expected_cost: Array
    expected_privacy: Array
    optimal_cost: Array
    privacy_bound: Array
    price: Array
    decoys: Array  # (T, k, X)
    status: tuple[DecisionStatus, ...]
    played: Played | None = field(default=None, metadata={"saved": False})
    oracle_calls: np.ndarray | None = None  # (T,); None becomes zeros
    _derived: ClassVar[tuple[str, ...]] = ("actions",)

    def __post_init__(self) -> None:
        object.__setattr__(self, "oracle_calls", _counts(self.oracle_calls, len(self.status)))

    @cached_property
    def actions(self) -> Array:
        """The atoms of every step, shape (T,k,U), made at first use."""
        played = _known(self.played)
        return _as_met(played.problem, played.actions(slice(None)))

    def __len__(self) -> int:
        return len(self.status)

    def __repr__(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        regrets = self.expected_cost - self.optimal_cost
        privacy = self.expected_privacy
        return "\n".join(
            [
                f"{len(self)} lotteries",
                f"expected regret   mean {regrets.mean():.3g}, largest {regrets.max():.3g}",
                f"expected privacy  mean {privacy.mean():.4f}, least {privacy.min():.4f}",
                *_counted_statuses(self.status),
            ]
        )

    def __getitem__(self, step: int) -> MixedDecision:
        """Return the mixture of one step, without its padding."""
        kept = self.probabilities[step] > 0
        actions = self.actions[step] if self.played is None else self.played.actions(step)
        return MixedDecision(
            actions[kept],
            self.probabilities[step][kept],
            self.regrets[step][kept],
            self.privacies[step][kept],
            float(self.expected_cost[step]),
            float(self.expected_privacy[step]),
            float(self.optimal_cost[step]),
            float(self.privacy_bound[step]),
            float(self.price[step]),
            self.decoys[step][kept],
            self.status[step],
            None if self.played is None else self.played.problem,
            int(_counts(self.oracle_calls, len(self))[step]),
        )

    def sample(self, *, rng: np.random.Generator | None = None) -> Decisions:
        """Return one drawn decision per step; `rng` None draws from the operating system's entropy."""
        source = np.random.default_rng() if rng is None else validation.generator(rng)
        chosen = _drawn(self.probabilities, source)
        rows = np.arange(len(self))
        regret, privacy = self.regrets[rows, chosen], self.privacies[rows, chosen]
        played = None if self.played is None else Picked(self.played, chosen)
        drawn = Decisions(
            self.optimal_cost + regret,
            self.optimal_cost.copy(),
            regret,
            privacy,
            np.maximum(self.privacy_bound, privacy),
            self.decoys[rows, chosen],
            self.status,
            played,
            oracle_calls=self.oracle_calls,
        )
        if played is None:
            vars(drawn)["action"] = self.actions[rows, chosen]
        return drawn


def _drawn(probabilities: Array, source: np.random.Generator) -> np.ndarray:
    """One column number per row, drawn by the row's probabilities; padding is never drawn."""
    edges = np.cumsum(probabilities, axis=1)
    places = (source.random(len(edges))[:, None] * edges[:, -1:] >= edges).sum(axis=1)
    last = probabilities.shape[1] - 1 - (probabilities[:, ::-1] > 0).argmax(axis=1)
    return np.asarray(np.minimum(places, last))


def _counts(calls: np.ndarray | None, n_steps: int) -> np.ndarray:
    return np.zeros(n_steps, dtype=np.int64) if calls is None else calls


def _known(played: Played | None) -> Played:
    if played is None:
        raise InputError("this result was made without its decisions")
    return played


def _set_of(problem: DecisionProblem | None, action: Array) -> BeliefSet:
    if problem is None:
        raise InputError("this result was made without its problem: its belief sets are not known")
    return belief_set_of(problem, problem.as_points(action))


def _own(result: object, **values: Array) -> None:
    """Keep copies: what is done to a result changes neither another one nor what a decision maker keeps."""
    for name, value in values.items():
        object.__setattr__(result, name, value.copy() if isinstance(value, np.ndarray) else value)


def _as_met(problem: DecisionProblem | None, actions: Array) -> Array:
    """Decisions as a reader meets them; of a problem without coordinates, whole numbers."""
    return actions if problem is None else problem.as_actions(np.asarray(actions))


def counted(beliefs: Array, progress: Progress | None) -> Iterator[tuple[int, Array]]:
    """Yield (step, belief) over beliefs (T,X) and report each step when it is done."""
    for step, belief in enumerate(beliefs):
        yield step, belief
        if progress is not None:
            progress(step + 1, len(beliefs))


def stack(decisions: list[Decision], problem: DecisionProblem) -> Decisions:
    """Return single decisions as one result with a leading T."""
    return Decisions(
        np.array([d.cost for d in decisions]),
        np.array([d.optimal_cost for d in decisions]),
        np.array([d.regret for d in decisions]),
        np.array([d.privacy for d in decisions]),
        np.array([d.privacy_bound for d in decisions]),
        np.array([d.decoy for d in decisions]),
        tuple(d.status for d in decisions),
        Kept(problem, np.array([problem.as_points(d.action) for d in decisions])),
        np.array([d.price for d in decisions]),
        np.array([d.oracle_calls for d in decisions]),
    )


def stack_mixed(decisions: list[MixedDecision], problem: DecisionProblem) -> MixedDecisions:
    """Return single mixtures as one result with a leading T, atoms padded to the largest number."""
    most = max(len(d.probabilities) for d in decisions)

    def padded(values: Array) -> Array:
        extra = most - len(values)
        return np.concatenate([values, np.repeat(values[:1], extra, axis=0)]) if extra else values

    def zero_padded(values: Array) -> Array:
        return np.concatenate([values, np.zeros(most - len(values))])

    return MixedDecisions(
        np.array([zero_padded(d.probabilities) for d in decisions]),
        np.array([padded(d.regrets) for d in decisions]),
        np.array([padded(d.privacies) for d in decisions]),
        np.array([d.expected_cost for d in decisions]),
        np.array([d.expected_privacy for d in decisions]),
        np.array([d.optimal_cost for d in decisions]),
        np.array([d.privacy_bound for d in decisions]),
        np.array([d.price for d in decisions]),
        np.array([padded(d.decoys) for d in decisions]),
        tuple(d.status for d in decisions),
        Kept(problem, np.array([padded(problem.as_points(d.actions)) for d in decisions])),
        np.array([d.oracle_calls for d in decisions]),
    )


def _counted_statuses(statuses: tuple[DecisionStatus, ...]) -> list[str]:
    return [f"{count:6d} × {status.value}" for status, count in Counter(statuses).most_common()]


def _numbers(values: Array) -> str:
    values = np.asarray(values)
    if values.ndim == 0:
        return f"choice {values}"
    return "[" + " ".join(f"{value:.4f}" for value in values) + "]"


def _describe(belief_set: BeliefSet) -> str:
    if belief_set.is_empty:
        return f"a decision that no belief explains (least regret {belief_set.plausibility_gap:.3g})"
    shape = {0: "the belief", 1: "a segment of beliefs around"}.get(belief_set.dimension, "a set of beliefs around")
    return f"{shape} {_numbers(belief_set.interior_point())}"
