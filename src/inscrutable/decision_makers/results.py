"""Results of decision makers: rows of one table, with summaries and checks."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from inscrutable import validation
from inscrutable.adversaries.inverse import belief_set_of
from inscrutable.decision_makers.statuses import OF_LOTTERIES, check_loaded
from inscrutable.decision_makers.statuses import DecisionStatus as DecisionStatus
from inscrutable.errors import InputError
from inscrutable.geometry import BeliefSet
from inscrutable.problems import DecisionProblem
from inscrutable.saved import Saved, Summarised
from inscrutable.validation import Array


@dataclass(frozen=True, eq=False)
class ResultTable:
    """T lotteries of at most k decisions; padding has probability 0, and a single decision is a lottery of one."""

    problem: DecisionProblem | None
    actions: Array  # (T,k,U) decisions in the problem's coordinates, or those (M,U) among which they have `places`
    probabilities: Array  # (T,k)
    regrets: Array  # (T,k)
    privacies: Array  # (T,k)
    decoys: Array  # (T,k,X)
    optimal_cost: Array  # (T,)
    bound: Array  # (T,) of the affordable privacy, before rounding
    status: tuple[DecisionStatus, ...]
    price: Array = None  # type: ignore[assignment]  # (T,); None becomes NaN
    oracle_calls: np.ndarray = None  # type: ignore[assignment]  # (T,) of the proofs; None becomes 0
    places: np.ndarray | None = None  # (T,k)

    def __post_init__(self) -> None:
        for name, nothing in (("price", np.nan), ("oracle_calls", 0)):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.full(len(self.status), nothing))

    @classmethod
    def of_single(
        cls, problem: DecisionProblem | None, action: Array, regret: Array, privacy: Array, decoy: Array, *rest: Any
    ) -> Self:
        """Return the table of single decisions (T,U), with regrets and privacies (T,) and decoys (T,X)."""
        atoms = regret[:, None], privacy[:, None], decoy[:, None]
        return cls(problem, action[:, None], np.ones((len(action), 1)), *atoms, *rest)

    @property
    def cost(self) -> Array:
        """Optimal cost + regret, shape (T,)."""
        return self.optimal_cost + self.regret

    @property
    def regret(self) -> Array:
        """Σ_l p_l ρ_l, shape (T,)."""
        return expected(self.probabilities, self.regrets)

    @cached_property
    def privacy(self) -> Array:
        """Σ_l p_l Ψ_l, shape (T,); a privacy of probability 0 does not count, even if infinite."""
        return expected(self.probabilities, self.privacies)

    @cached_property
    def privacy_bound(self) -> Array:
        """No affordable decision or lottery has more privacy, shape (T,)."""
        return np.maximum(self.bound, self.privacy)

    @cached_property
    def points(self) -> Array:
        """All decisions, shape (T,k,U); those of finite problems as whole numbers (T,k)."""
        return self.shown(slice(None))

    def shown(self, rows: Any) -> Array:
        """Return the decisions of a row (k,U) or of many (n,k,U) in the form that results have."""
        return _as_met(self.problem, self.actions[rows if self.places is None else self.places[rows]])

    def one_of_each(self, chosen: np.ndarray) -> ResultTable:
        """Return the table of one decision of each row, which has no proof of its own."""
        rows = np.arange(len(self.status))
        return replace(
            self,
            actions=self.actions[rows, chosen, None] if self.places is None else self.actions,
            places=None if self.places is None else self.places[rows, chosen, None],
            probabilities=np.ones((len(rows), 1)),
            regrets=self.regrets[rows, chosen, None],
            privacies=self.privacies[rows, chosen, None],
            decoys=self.decoys[rows, chosen, None],
            optimal_cost=self.optimal_cost.copy(),
            bound=self.privacy_bound,
            status=tuple(drawn_status(each) for each in self.status),
            price=np.full(len(rows), np.nan),
        )


def drawn_status(status: DecisionStatus) -> DecisionStatus:
    """Return the status of one decision drawn from a lottery."""
    return DecisionStatus.DRAWN if status in OF_LOTTERIES else status


def expected(probabilities: Array, values: Array) -> Array:
    """Σ_l p_l v_l of lotteries (T,k), column by column: much faster than rows of two."""
    total = np.zeros(len(values))
    for share, value in zip(probabilities.T, values.T, strict=True):
        drawn = share > 0.0
        total += np.where(drawn, share * np.where(drawn, value, 0.0), 0.0)
    return total


class _Result(Summarised, Saved):
    """A result whose `repr` says if it was read from a file."""

    def __repr__(self) -> str:
        note = "\nread from a file: its sums agree; privacies were not judged again, as a file holds neither problem nor belief"
        return self.summary() + (note if self.is_loaded else "")


Progress = Callable[[int, int], None]
"""Called with (steps done, steps in all) in long runs."""

_MOST_SHOWN = 12
"""Atoms of a lottery that a summary lists."""


@dataclass(frozen=True, eq=False, repr=False)
class Decision(_Result):
    """One decision, its regret, and the beliefs that explain it.

    Args:
        action: ū, shape (U,); an int where decisions are finite choices.
        cost: π·s(ū), in the cost's unit.
        optimal_cost: c* = V(π), in the cost's unit.
        regret: cost − optimal cost, at least 0.
        privacy: Ψ(ū), the privacy against the naive observer.
        privacy_bound: No affordable decision has more privacy than this.
        decoy: A belief for which the decision is optimal, shape (X,); NaN where there is none.
        status: How the decision came about.
        problem: The decision problem; from it `belief_set`, the consistent beliefs Π(ū), is computed on access.
        price: ∂Ψ/∂budget, the privacy that one more unit of regret would add; NaN where the search does not know it.
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

    @property
    def _is_unexplained(self) -> bool:
        return self.problem is None and "belief_set" not in vars(self)

    @cached_property
    def belief_set(self) -> BeliefSet:
        """Π(ū), what the observer reconstructs."""
        return _set_of(self.problem, self.action)

    @classmethod
    def _made(cls, parts: dict[str, Any]) -> Self:
        found = super()._made(parts)
        check_loaded(stack([found], None).table, parts)
        return found

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        share = f" ({self.regret / abs(self.optimal_cost):.1%} of |c*|)" if self.optimal_cost else ""
        return "\n".join(
            [
                f"action        {_numbers(self.action)}",
                f"cost          {self.cost:.6g}, {self.regret:.3g} above the optimal {self.optimal_cost:.6g}{share}",
                f"privacy       {self.privacy:.4f} (at most {self.privacy_bound:.4f})",
                f"observer sees {'what the file does not say' if self._is_unexplained else _describe(self.belief_set)}",
                f"status        {self.status.value}",
            ]
        )


@dataclass(frozen=True, eq=False, repr=False)
class MixedDecision(_Result):
    """A lottery (randomised decision); `sample` draws one of its atoms.

    Args:
        actions: Atoms, shape (k,U).
        probabilities: Shape (k,), summing to one.
        regrets: Regret of each atom, shape (k,), in the cost's unit.
        privacies: Ψ of each atom, shape (k,).
        expected_cost: Σ p_l π·s(ū_l), in the cost's unit.
        expected_privacy: Σ p_l Ψ(ū_l).
        optimal_cost: c* = V(π).
        privacy_bound: No affordable mixture has more expected privacy than this.
        price: Slope of the expected privacy in the budget: the privacy that one more unit of expected regret would add.
        decoys: A belief for which each atom is optimal, shape (k,X); NaN where there is none.
        status: How the decision came about.
        problem: The decision problem; from it `belief_sets`, Π of each atom, are computed on access.
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

        `rng` None draws from the operating system's entropy, because whoever knows the seed knows the draw.
        """
        source = np.random.default_rng() if rng is None else validation.generator(rng)
        index = int(source.choice(len(self.probabilities), p=self.probabilities))
        drawn = _decision(stack_mixed([self], self.problem).table.one_of_each(np.array([index])), 0)
        if "belief_sets" in vars(self):
            vars(drawn)["belief_set"] = self.belief_sets[index]
        return drawn

    @classmethod
    def _made(cls, parts: dict[str, Any]) -> Self:
        found = super()._made(parts)
        check_loaded(stack_mixed([found], None).table, parts)
        return found

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


def _column(name: str, *which: int) -> Any:
    """A column of the table behind many results, whole or of one atom."""
    return property(
        lambda many: getattr(many.table, name)[(slice(None), *which)] if which else getattr(many.table, name)
    )


class _Many(_Result):
    """The rows of a table, and the fields that all kinds of rows have."""

    _saved: ClassVar[tuple[str, ...]] = ("optimal_cost", "privacy_bound", "status", "price", "oracle_calls")

    optimal_cost: Array = _column("optimal_cost")
    privacy_bound: Array = _column("privacy_bound")
    status: tuple[DecisionStatus, ...] = _column("status")
    price: Array = _column("price")
    oracle_calls: np.ndarray = _column("oracle_calls")

    def __init__(self, table: ResultTable) -> None:
        self.table = table

    def _parts(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in (*_Many._saved, *self._saved, *self._derived)}

    def __len__(self) -> int:
        return len(self.table.status)

    def _summary(self, kind: str, of: str) -> str:
        regret, privacy, width = self.table.regret, self.table.privacy, len(of) + 9
        return "\n".join(
            [
                f"{len(self)} {kind}",
                f"{of + 'regret':{width}}mean {regret.mean():.3g}, largest {regret.max():.3g}",
                f"{of + 'privacy':{width}}mean {privacy.mean():.4f}, least {privacy.min():.4f}",
                *(f"{count:6d} × {status.value}" for status, count in Counter(self.table.status).most_common()),
            ]
        )


class Decisions(_Many):
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

    _saved = ("cost", "regret", "privacy", "decoy")
    _derived = ("action", "belief_set")

    regret: Array = _column("regrets", 0)
    privacy: Array = _column("privacies", 0)
    decoy: Array = _column("decoys", 0)
    cost: Array = _column("cost")
    action: Array = _column("points", 0)

    @classmethod
    def _made(cls, parts: dict[str, Any]) -> Self:
        found = cls(_read(parts, ResultTable.of_single, "action", "regret", "privacy", "decoy"))
        vars(found)["belief_set"] = parts["belief_set"]
        return found

    @cached_property
    def belief_set(self) -> tuple[BeliefSet, ...]:
        """Π(ū) of every step, made at first use."""
        return tuple(_set_of(self.table.problem, action) for action in self.action)

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        return self._summary("decisions", "")

    def __getitem__(self, step: int) -> Decision:
        """Return the decision of one step."""
        found = _decision(self.table, step)
        if "belief_set" in vars(self):
            vars(found)["belief_set"] = self.belief_set[step]
        return found


class MixedDecisions(_Many):
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

    _saved = ("probabilities", "regrets", "privacies", "decoys", "expected_cost", "expected_privacy")
    _derived = ("actions",)

    probabilities: Array = _column("probabilities")
    regrets: Array = _column("regrets")
    privacies: Array = _column("privacies")
    decoys: Array = _column("decoys")
    expected_cost: Array = _column("cost")
    expected_privacy: Array = _column("privacy")
    actions: Array = _column("points")

    @classmethod
    def _made(cls, parts: dict[str, Any]) -> Self:
        return cls(_read(parts, ResultTable, "actions", "probabilities", "regrets", "privacies", "decoys"))

    def summary(self) -> str:
        """Return a few lines for a person to read."""
        return self._summary("lotteries", "expected ")

    def __getitem__(self, step: int) -> MixedDecision:
        """Return the mixture of one step, without its padding."""
        table, kept = self.table, self.probabilities[step] > 0
        return MixedDecision(
            table.shown(step)[kept],
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
            table.problem,
            int(self.oracle_calls[step]),
        )

    def sample(self, *, rng: np.random.Generator | None = None) -> Decisions:
        """Return one drawn decision per step; `rng` None draws from the operating system's entropy."""
        source = np.random.default_rng() if rng is None else validation.generator(rng)
        return Decisions(self.table.one_of_each(_drawn(self.probabilities, source)))


def _read(parts: dict[str, Any], make: Callable[..., ResultTable], *names: str) -> ResultTable:
    """The table of a saved result, checked; `names` are those of its atoms' columns."""
    table = make(None, *(parts[name] for name in names), *(parts.get(name) for name in _Many._saved))
    check_loaded(table, parts)
    return table


def _decision(table: ResultTable, step: int) -> Decision:
    """The single decision of a row."""
    optimal_cost, regret = float(table.optimal_cost[step]), float(table.regrets[step, 0])
    return Decision(
        table.shown(step)[0],
        optimal_cost + regret,
        optimal_cost,
        regret,
        float(table.privacies[step, 0]),
        float(table.privacy_bound[step]),
        table.decoys[step, 0],
        table.status[step],
        table.problem,
        float(table.price[step]),
        int(table.oracle_calls[step]),
    )


def stack(decisions: Sequence[Decision], problem: DecisionProblem | None) -> Decisions:
    """Return single decisions as one result with a leading T."""
    names = "action", "regret", "privacy", "decoy"
    action, *atoms = (np.array([getattr(each, name) for each in decisions]) for name in names)
    return Decisions(ResultTable.of_single(problem, _points(problem, action), *atoms, *_rows(decisions)))


def stack_mixed(decisions: Sequence[MixedDecision], problem: DecisionProblem | None) -> MixedDecisions:
    """Return single mixtures as one result with a leading T, atoms padded to the largest number."""
    width = max(len(each.probabilities) for each in decisions)

    def padded(name: str, **how: Any) -> Array:
        values = (getattr(each, name) for each in decisions)
        return np.array([np.pad(v, [(0, width - len(v)), *[(0, 0)] * (v.ndim - 1)], **how) for v in values])

    actions, *atoms = (padded(name, mode="edge") for name in ("actions", "regrets", "privacies", "decoys"))
    rest: Any = (padded("probabilities"), *atoms, *_rows(decisions))
    return MixedDecisions(ResultTable(problem, _points(problem, actions), *rest))


def _points(problem: DecisionProblem | None, actions: Array) -> Array:
    return actions if problem is None else problem.as_points(actions)


def _rows(decisions: Sequence[Any]) -> Any:
    """What a table has for each row, as it takes it."""
    optimal_cost, bound, status, price, calls = ([getattr(each, name) for each in decisions] for name in _Many._saved)
    return np.array(optimal_cost), np.array(bound), tuple(status), np.array(price), np.array(calls)


def counted(beliefs: Array, progress: Progress | None) -> Iterator[tuple[int, Array]]:
    """Yield (step, belief) over beliefs (T,X) and report each step when it is done."""
    for step, belief in enumerate(beliefs):
        yield step, belief
        if progress is not None:
            progress(step + 1, len(beliefs))


def _drawn(probabilities: Array, source: np.random.Generator) -> np.ndarray:
    """One column number per row, drawn by the row's probabilities; padding is never drawn."""
    edges = np.cumsum(probabilities, axis=1)
    places = (source.random(len(edges))[:, None] * edges[:, -1:] >= edges).sum(axis=1)
    last = probabilities.shape[1] - 1 - (probabilities[:, ::-1] > 0).argmax(axis=1)
    return np.asarray(np.minimum(places, last))


def _set_of(problem: DecisionProblem | None, action: Array) -> BeliefSet:
    if problem is None:
        raise InputError("this result was made without its problem: its belief sets are not known")
    return belief_set_of(problem, problem.as_points(action))


def _own(result: object, **values: Array) -> None:
    """Keep copies: a change of a result changes neither another result nor a decision maker's own."""
    for name, value in values.items():
        object.__setattr__(result, name, value.copy() if isinstance(value, np.ndarray) else value)


def _as_met(problem: DecisionProblem | None, actions: Array) -> Array:
    """Decisions in the form that results have: whole numbers for a problem without coordinates."""
    return actions if problem is None or not problem.is_discrete else problem.as_actions(np.asarray(actions))


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
