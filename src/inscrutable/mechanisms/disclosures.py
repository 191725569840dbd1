"""The disclosure of decisions, as data: which parts of each, at which steps, and how late.

A disclosure is a list of operations on a stream x_t of decisions, the first applied first. A map changes every x_t alike; a
schedule leaves some steps out or moves them. Maps and schedules commute, so every disclosure is one map and one `Schedule`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from inscrutable import validation
from inscrutable.axes import Axis, depth, few, ordered, ordered_array
from inscrutable.errors import InputError
from inscrutable.mechanisms.calendars import CALENDARS, Calendar, Schedule
from inscrutable.mechanisms.disclosure_text import parsed_calls
from inscrutable.mechanisms.shown_values import MAPS
from inscrutable.problems.dispatch import DispatchProblem
from inscrutable.validation import Array

EXACT = "exact"
"""The text of the disclosure that hides nothing."""
_SCHEDULES = ("every", "delayed")
_BY_POSITION = ("grouped", "only", "bus_prices")


class Operation(NamedTuple):
    """One operation of a disclosure, by its name, with plain values."""

    name: str
    values: tuple[Any, ...] = ()

    def __str__(self) -> str:
        values = self.values[:-1] if self.values[-1:] == _LEFT_OUT.get(self.name) else self.values
        return f"{self.name}({', '.join(map(_text, values))})"


@dataclass(frozen=True)
class Disclosure:
    """The part of a sequence of decisions that an observer sees; disclosures are composed with `|` from left to right.

    Formula: (a | b)(u) = b(a(u)).

    `every`, `delayed`, `rounded`, `long_only`, `at_least`, `top`, `grouped`, `only`, `bus_prices`, `portfolio_return`,
    `form_13f` and `n_port` make one; `Disclosure()` hides nothing, and prints as "exact".

    Args:
        operations: The operations, in order.

    Raises:
        InputError: An operation is unknown or malformed, or together they never show a decision.

    Cost: that of the values shown.

    Source: the rules of `form_13f` and `n_port` are such disclosures.

    Example:
        >>> from inscrutable import delayed, every
        >>> print(every(2) | delayed(1))
        every(2)|delayed(1)
        >>> print((every(2) | delayed(1))([[0.1], [0.2], [0.3], [0.4]]).reshape(-1))
        [nan 0.1 nan 0.3]
    """

    operations: tuple[Operation, ...] = ()

    def __post_init__(self) -> None:
        if not isinstance(self.operations, (tuple, list)) or any(isinstance(each, str) for each in self.operations):
            raise InputError(
                f"operations must be a sequence of operations, got {self.operations!r}: Disclosure.of reads a text or a table"
            )
        object.__setattr__(self, "operations", tuple(_checked(each) for each in self.operations))
        self.schedule  # noqa: B018  # raises where nothing is ever shown

    @classmethod
    def of(cls, given: Any) -> Disclosure:
        """Return the disclosure of a text or a table; None discloses everything, and a disclosure is returned as it is.

        Args:
            given: A text such as "every(3)|delayed(2)"; or a mapping from names of operations, in order, to their arguments: a
                number, a list, a table of keywords, or true where there are none.

        Raises:
            InputError: It is no such text or table.
        """
        if given is None or isinstance(given, Disclosure):
            return given or cls()
        if isinstance(given, str) and given.strip() == EXACT:
            return cls()
        if isinstance(given, str):
            calls = parsed_calls(given)
        elif isinstance(given, Mapping):
            calls = [_call(name, value) for name, value in given.items()]
        else:
            raise InputError(f'a disclosure is written as "every(3)|delayed(2)", got {given!r}')
        found = cls()
        for name, values, keywords in calls:
            found = found | _made(name, values, keywords)
        return found

    def __or__(self, other: Disclosure) -> Disclosure:
        if not isinstance(other, Disclosure):
            return NotImplemented
        return Disclosure(self.operations + other.operations)

    def __str__(self) -> str:
        return "|".join(map(str, self.operations)) or EXACT

    def __repr__(self) -> str:
        return str(self)

    @cached_property
    def schedule(self) -> Schedule:
        """The schedule by which decisions are shown."""
        found = Schedule()
        for name, values in self._plain():
            left = found.thinned(*values) if name == "every" else found.moved(*values) if name == "delayed" else found
            if left is None:
                raise InputError(f"{self} never shows a decision: its schedules exclude one another")
            found = left
        return found

    @cached_property
    def maps(self) -> tuple[Operation, ...]:
        """The operations on every single decision, in order."""
        return tuple(each for each in self._plain() if each.name not in _SCHEDULES)

    @property
    def is_exact(self) -> bool:
        """Whether every decision is shown as it is, at once."""
        return self.schedule.is_immediate and not self.maps

    def of_problem(self, problem: Any) -> Disclosure:
        """Return the disclosure with `bus_prices()` taken from this problem."""
        own = Operation("bus_prices", (problem,))
        return Disclosure(tuple(own if str(each) == "bus_prices()" else each for each in self.operations))

    @property
    def needs_returns(self) -> bool:
        """Whether only the portfolio's return is disclosed, which needs the returns of the period."""
        return any(each.name == "portfolio_return" for each in self.maps)

    @property
    def calendars(self) -> tuple[Calendar, ...]:
        """The regulators' rules that are part of the disclosure."""
        return tuple(CALENDARS[each.name] for each in self.operations if each.name in CALENDARS)

    def summary(self) -> str:
        """Return the disclosure in words: its content, frequency and delay, and the rule behind it."""
        period, offset, lag = self.schedule
        often = (
            "every decision" if period == 1 else f"one decision in {period}, of steps {offset}, {offset + period}, …"
        )
        late = "at once" if lag == 0 else f"{lag} {'step' if lag == 1 else 'steps'} late"
        parts = "" if not self.maps else f", as {' | '.join(map(str, self.maps))}"
        lines = [f"{self}: {often}, {late}{parts}"]
        lines += [f"{each.rule} As of {each.as_of}: {each.source}" for each in self.calendars]
        return "\n".join(lines)

    def shown(self, actions: ArrayLike, *, returns: ArrayLike | None = None) -> Array:
        """Return the disclosed values of single decisions, shape (M,V), or (M,) for choices, without the schedule.

        Args:
            actions: Decisions (M,U), or choices (M,). The values have their order, whatever their labels;
                `grouped`, `only` and `bus_prices` count coordinates by position and refuse labels.
            returns: Returns of each decision's period, (M,U) or one (U,) for all; for `portfolio_return` alone.

        Raises:
            InputError: A map does not suit the decisions, or `portfolio_return` lacks its returns.
        """
        assets = self._assets()
        points = _points(actions, (None, assets))
        return self._mapped(points, self._returns(returns, points, (None, assets)))

    def __call__(self, actions: ArrayLike, *, returns: ArrayLike | None = None) -> Array:
        """Return the disclosed values of each step, shape (T,V), or (T,) for choices: NaN where there is none.

        Args:
            actions: u_0..u_{T-1}, shape (T,U), or choices (T,).
            returns: Returns of each decision's period, (T,U), as fractions; for `portfolio_return` alone.

        Raises:
            InputError: As `shown`.
        """
        steps, assets = Axis("step", learns=True), self._assets()
        points = _points(actions, (steps, assets))
        shown = np.asarray(self._mapped(points, self._returns(returns, points, (steps, assets))), dtype=np.float64)
        found, (period, offset, lag) = np.full(shown.shape, np.nan), self.schedule
        seen = np.arange(offset, max(len(points) - lag, 0), period)
        found[seen + lag] = shown[seen]
        return found

    def _assets(self) -> Axis:
        """The axis of assets, without labels where an operation means them by position."""
        return Axis("asset", learns=all(each.name not in _BY_POSITION for each in self.maps))

    def _mapped(self, points: Array, returns: Array | None) -> Array:
        for name, values in self.maps:
            points = MAPS[name](points, *values, returns) if name == "portfolio_return" else MAPS[name](points, *values)
        return points

    def check_returns(self, returns: ArrayLike | None) -> None:
        """Raise `InputError` where returns are missing, or not needed."""
        if returns is not None and not self.needs_returns:
            raise InputError(f"returns were given, but {self} does not use them")
        if returns is None and self.needs_returns:
            raise InputError(f"{self} needs the returns of the period: pass `returns`")

    def _returns(self, returns: ArrayLike | None, points: Array, axes: tuple[Axis | None, Axis]) -> Array | None:
        self.check_returns(returns)
        if returns is None:
            return None
        given = validation.real_array(returns, "returns", axes=axes[-depth(returns) :])
        if given.shape not in (points.shape, points.shape[1:]):
            raise InputError(f"returns must be of shape {points.shape}, as the decisions, got {given.shape}")
        return np.broadcast_to(validation.finite_array(given, "returns", ndim=given.ndim), points.shape)

    def _plain(self) -> Iterator[Operation]:
        """The operations, with named ones written out."""
        for each in self.operations:
            yield from _WRITTEN_OUT[each.name](*each.values) if each.name in _WRITTEN_OUT else (each,)


def every(n: int, offset: int = 0) -> Disclosure:
    """Return the disclosure of one decision in n.

    Formula: x_t where t = offset (mod n), else nothing.

    Args:
        n: At least 1, in steps.
        offset: The first disclosed step, in 0..n−1.

    Raises:
        InputError: A number is not whole or out of range.

    Cost: none. Source: periodic reports.

    Example:
        >>> print(every(3)([[0.1], [0.2], [0.3], [0.4]]).reshape(-1))
        [0.1 nan nan 0.4]
    """
    return Disclosure((Operation("every", (n, offset)),))


def delayed(steps: int) -> Disclosure:
    """Return the disclosure of every decision a number of steps late.

    Formula: x_{t−d}, nothing for t < d.

    Args:
        steps: d, at least 0.

    Raises:
        InputError: It is no whole number of at least 0.

    Cost: none. Source: reports that are due some time after their date.

    Example:
        >>> print(delayed(1)([[0.1], [0.2], [0.3]]).reshape(-1))
        [nan 0.1 0.2]
    """
    return Disclosure((Operation("delayed", (steps,)),))


def rounded(digits: int) -> Disclosure:
    """Return the disclosure of decisions rounded to decimals, halves to even.

    Neither of two roundings determines the other: rounded(1) does not follow from rounded(2), nor the reverse.

    Args:
        digits: Decimals kept, 0 to 15.

    Raises:
        InputError: It is no whole number in that range.

    Cost: none. Source: printed percentages.

    Example:
        >>> print(rounded(1)([[0.123, 0.877]]))
        [[0.1 0.9]]
    """
    return Disclosure((Operation("rounded", (digits,)),))


def long_only() -> Disclosure:
    """Return the disclosure of positive positions; others are disclosed as zero.

    Formula: max(u_i, 0).

    Cost: none. Source: reports in which short positions do not appear, such as Form 13F.

    Example:
        >>> print(long_only()([[0.6, -0.1, 0.5]]))
        [[0.6 0.  0.5]]
    """
    return Disclosure((Operation("long_only"),))


def at_least(weight: float) -> Disclosure:
    """Return the disclosure of positions of at least a size, long or short; smaller ones are disclosed as zero.

    Formula: u_i where |u_i| ≥ w, else 0.

    Args:
        weight: w, in the decision's unit, at least 0.

    Raises:
        InputError: It is no such number.

    Cost: none. Source: thresholds below which a position need not be reported.

    Example:
        >>> print(at_least(0.05)([[0.02, 0.38, 0.6]]))
        [[0.   0.38 0.6 ]]
    """
    return Disclosure((Operation("at_least", (weight,)),))


def top(n: int) -> Disclosure:
    """Return the disclosure of the n largest positions by size; others are disclosed as zero, ties go to the first.

    Args:
        n: At least 1.

    Raises:
        InputError: It is no such whole number.

    Cost: a sort. Source: the ten largest holdings of a fact sheet.

    Example:
        >>> print(top(1)([[0.2, 0.3, 0.5]]))
        [[0.  0.  0.5]]
    """
    return Disclosure((Operation("top", (n,)),))


def grouped(labels: ArrayLike) -> Disclosure:
    """Return the disclosure of sums over groups, such as sectors; for finite choices of the group of a choice.

    Formula: Σ_{i in group} u_i, groups in the order in which they first occur.

    Args:
        labels: One a coordinate of the decision, or one a choice, in their order: texts or whole numbers.

    Raises:
        InputError: There are none, or they are of another kind.

    Cost: none. Source: sector weights.

    Example:
        >>> print(grouped(["energy", "energy", "food"])([[0.2, 0.3, 0.5]]))
        [[0.5 0.5]]
    """
    plain = ordered(labels, "labels", (Axis("asset"),))
    listed: Any = (
        plain if isinstance(plain, str) or depth(plain) != 1 else tuple(np.asarray(plain, dtype=object).tolist())
    )
    return Disclosure((Operation("grouped", (listed,)),))


def only(places: Sequence[int]) -> Disclosure:
    """Return the disclosure of some coordinates of a decision, such as the units that an observer can watch.

    Args:
        places: Numbers of the coordinates, from 0, in the order of disclosure.

    Raises:
        InputError: There are none, or they are no different whole numbers of at least 0.

    Cost: none. Source: partial observation.

    Example:
        >>> print(only([2, 0])([[0.2, 0.3, 0.5]]))
        [[0.5 0.2]]
    """
    return Disclosure((Operation("only", (tuple(np.asarray(places, dtype=object).reshape(-1).tolist()),)),))


def bus_prices(problem: DispatchProblem | None = None) -> Disclosure:
    """Return the disclosure of the prices at a network's buses instead of the schedule.

    Formula: as `DispatchProblem.bus_prices`, to nine digits of the largest.

    Args:
        problem: The dispatch; None is the one of a study, or of `Disclosure.of_problem`.

    Raises:
        InputError: It is no dispatch problem.

    Cost: as `DispatchProblem.bus_prices`. Source: locational marginal prices (Schweppe, Caramanis, Tabors, Bohn, Spot Pricing
    of Electricity, 1988).

    Example:
        >>> bus_prices()
        bus_prices()
    """
    return Disclosure((Operation("bus_prices", () if problem is None else (problem,)),))


def portfolio_return() -> Disclosure:
    """Return the disclosure of the portfolio's return, to an observer who knows the returns of every asset.

    Formula: u_t'r_{t+1}, with r_{t+1} the returns of the period for which u_t is held.

    An observer needs the returns as public information: `disclosure(actions, returns=...)` and
    `SequentialAdversary.filter(..., returns=...)` take them.

    Cost: none. Source: the value of a fund, published every day.

    Example:
        >>> print(portfolio_return()([[0.5, 0.5]], returns=[[0.02, 0.04]]))
        [[0.03]]
    """
    return Disclosure((Operation("portfolio_return"),))


def form_13f(offset: int = 2) -> Disclosure:
    """Return what Form 13F discloses of a US manager's holdings, in months: long positions at quarter ends, 45 days later.

    Formula: long_only() | every(3, offset) | delayed(2): filings due in the middle of the second month after the quarter are
    known from the end of that month on.

    The law prescribes positions, not weights, of securities on the official list alone; here they stand for the portfolio.

    Args:
        offset: The first step that ends a quarter: 2 where step 0 is a January, April, July or October.

    Raises:
        InputError: It is not 0, 1 or 2.

    Cost: none. Source: 17 CFR 240.13f-1(a)(1), "within 45 days after the last day" of a quarter, as of February 2026; it was
    checked against a copy of the rule, not against the regulator's own page. That short positions are left out is the form's
    practice, as described by others.

    Example:
        >>> form_13f().schedule
        Schedule(period=3, offset=2, lag=2)
    """
    return Disclosure((Operation("form_13f", (offset,)),))


def n_port(offset: int = 2) -> Disclosure:
    """Return what Form N-PORT discloses of a US fund's portfolio, in months: fiscal quarter ends, 60 days later.

    Formula: every(3, offset) | delayed(2).

    The two other months of a quarter are filed but not made public; they would be, 60 days after each month, by amendments of
    2024 that are not in force: `delayed(2)`.

    Args:
        offset: The first step that ends a fiscal quarter.

    Raises:
        InputError: It is not 0, 1 or 2.

    Cost: none. Source: 17 CFR 270.30b1-9 as amended in 2019 (84 FR 7980), as of February 2026; checked against the regulator's
    announcements, not against the rule's own page. 89 FR 73764 has the amendments of 2024, postponed to November 2027.

    Example:
        >>> n_port().schedule
        Schedule(period=3, offset=2, lag=2)
    """
    return Disclosure((Operation("n_port", (offset,)),))


_WRITTEN_OUT: Mapping[str, Any] = {
    "form_13f": lambda offset: (*long_only().operations, *every(3, offset).operations, *delayed(2).operations),
    "n_port": lambda offset: (*every(3, offset).operations, *delayed(2).operations),
}
_KNOWN = {
    each.__name__: each
    for each in (
        every,
        delayed,
        rounded,
        long_only,
        at_least,
        top,
        grouped,
        only,
        bus_prices,
        portfolio_return,
        form_13f,
        n_port,
    )
}
_LEFT_OUT: Mapping[str, tuple[int]] = {"every": (0,), "form_13f": (2,), "n_port": (2,)}
"""Default of a last argument that is not written."""
_MOST_DIGITS = 15
_QUARTER = 3


def _checked(operation: Any) -> Operation:
    """An operation with checked values of plain types."""
    name, values = operation
    if name not in _KNOWN:
        raise InputError(f"there is no disclosure {name!r}; expected one of {few(_KNOWN, len(_KNOWN))}")
    return Operation(name, _CHECKS[name](*values))


def _every(n: Any, offset: Any) -> tuple[int, int]:
    count = validation.count(n, "n of every(n)")
    first = validation.count(offset, "offset", least=0)
    if first >= count:
        raise InputError(f"offset of every({count}, {first}) must be below {count}")
    return count, first


def _quarter_end(offset: Any) -> tuple[int]:
    return (_every(_QUARTER, offset)[1],)


def _digits(digits: Any) -> tuple[int]:
    count = validation.count(digits, "digits", least=0)
    if count > _MOST_DIGITS:
        raise InputError(f"digits must be at most {_MOST_DIGITS}, got {count}")
    return (count,)


def _labels(labels: Any) -> tuple[tuple[str | int, ...]]:
    if (
        not isinstance(labels, tuple)
        or not labels
        or not all(isinstance(each, (str, int, np.integer)) for each in labels)
    ):
        raise InputError(f"labels must be a list of texts or whole numbers, one at least, got {labels!r}")
    return (tuple(str(each) if isinstance(each, str) else int(each) for each in labels),)


def _places(places: Any) -> tuple[tuple[int, ...]]:
    kept = tuple(validation.count(each, "a place of only(places)", least=0) for each in places)
    if not kept or len(set(kept)) < len(kept):
        raise InputError(f"only needs different places, one at least, got {list(kept)}")
    return (kept,)


def _priced(*problem: Any) -> tuple[Any, ...]:
    if problem and not isinstance(problem[0], DispatchProblem):
        raise InputError(f"bus_prices needs a dispatch problem, got {problem[0]!r:.60}")
    return problem


def _nothing() -> tuple[()]:
    return ()


_CHECKS: Mapping[str, Any] = {
    "every": _every,
    "delayed": lambda steps: (validation.count(steps, "steps of delayed", least=0),),
    "rounded": _digits,
    "at_least": lambda weight: (validation.non_negative(weight, "weight"),),
    "top": lambda n: (validation.count(n, "n of top(n)"),),
    "grouped": _labels,
    "only": _places,
    "bus_prices": _priced,
    "long_only": _nothing,
    "portfolio_return": _nothing,
    "form_13f": _quarter_end,
    "n_port": _quarter_end,
}


def _made(name: str, values: list[Any], keywords: dict[str, Any]) -> Disclosure:
    """One operation with its arguments."""
    if name not in _KNOWN:
        raise InputError(f"there is no disclosure {name!r}; expected {EXACT} or one of {few(_KNOWN, len(_KNOWN))}")
    try:
        return _KNOWN[name](*values, **keywords)
    except TypeError:
        raise InputError(f"{name}({', '.join(map(repr, values))}) has other arguments than {name} takes") from None


def _call(name: str, value: Any) -> tuple[str, list[Any], dict[str, Any]]:
    """Name and arguments of a table's entry."""
    if isinstance(value, Mapping):
        return name, [], dict(value)
    if value is True:
        return name, [], {}
    return name, list(value) if isinstance(value, (list, tuple)) and name not in ("grouped", "only") else [value], {}


def _text(value: Any) -> str:
    """A value as it is read back, to the last digit."""
    return repr(list(value)) if isinstance(value, tuple) else repr(value).removesuffix(".0")


def _points(actions: ArrayLike, axes: tuple[Axis | None, Axis]) -> Array:
    """Decisions (T,U), or choices (T,) as whole numbers."""
    given = ordered_array(actions, "actions", axes)
    if given.ndim == 1 and given.dtype.kind in "iu":
        return given
    return validation.finite_array(given, "actions", ndim=2)
