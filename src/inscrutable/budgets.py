"""Budgets: the largest regret that an agent accepts for privacy."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from inscrutable import validation
from inscrutable.errors import InputError
from inscrutable.validation import Array

_BASIS_POINT = 0.0001
_BP = ("bp", "bps")
_MUCH_REGRET = 0.05
_WRITTEN = re.compile(
    r"(?:(?P<kind>regret|relative|silence):)?\s*(?P<number>[+-]?(?:\d+\.?\d*|\.\d+)(?:e[+-]?\d{1,3})?)\s*(?P<unit>%|bps?)?",
    re.ASCII,
)


@dataclass(frozen=True)
class Budget:
    """A cost budget: a share of the optimal cost, or an amount of regret.

    Formula: ρ ≤ c_b·|c*| for `Budget.relative(c_b)`; ρ ≤ r for `Budget.regret(r)`.

    The paper's bound c* (1 + c_b) is the relative budget wherever c* > 0. With |c*| it stays feasible for negative c*, the
    usual case on real returns. Decisions under `Budget.regret` do not change when a constant is added to all costs.

    Args:
        amount: c_b, a share of |c*|, or r in the cost's unit; at least 0.
        is_relative: Whether the amount is a share.

    Raises:
        InputError: The amount is negative or not finite.

    Source: the paper, eq. (8).

    Example:
        >>> Budget.relative(0.1).limit(-2.0)
        0.2
        >>> Budget.regret(0.05).limit(-2.0)
        0.05
    """

    amount: float
    is_relative: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "amount", validation.non_negative(self.amount, "budget"))
        if not isinstance(self.is_relative, bool):
            raise InputError(f"is_relative must be True or False, got {self.is_relative!r}; use Budget.regret(amount)")

    @classmethod
    def relative(cls, share: float) -> Budget:
        """Return the budget ρ ≤ share·|c*|."""
        return cls(share, True)

    @classmethod
    def regret(cls, regret: float) -> Budget:
        """Return the budget ρ ≤ regret, in the cost's unit."""
        return cls(regret, False)

    @classmethod
    def parse(cls, text: str | float, *, silence: float | None = None) -> Budget:
        """Return the budget written as a text.

        Args:
            text: "0.1" or "10%" for a share of |c*|; "5bp" for a regret of five basis points, "regret:0.002" for one in the
                cost's unit; "silence:0.5" for a share of the silence regret; "relative:0.1" is "0.1".
            silence: The silence regret of the problem, in the cost's unit; needed for a share of it.

        Raises:
            InputError: The text is none of these, or a share of silence comes without the silence regret.

        Example:
            >>> Budget.parse("10%"), Budget.parse("5bp")
            (Budget(amount=0.1, is_relative=True), Budget(amount=0.0005, is_relative=False))
            >>> Budget.parse("silence:0.5", silence=0.004)
            Budget(amount=0.002, is_relative=False)
        """
        found = written_budget(text)
        if isinstance(found, Budget):
            return found
        if silence is None:
            raise InputError(
                f"budget {text!r} is a share of the silence regret, which depends on the problem and the law of its beliefs: "
                "give it as silence=, or give a regret"
            )
        return found.of(silence)

    @property
    def remark(self) -> str:
        """A warning about an unusual amount, in one sentence; empty where there is none."""
        if self.amount == 0.0:
            return "a budget of 0 allows only decisions that cost as little as the optimal one"
        if self.is_relative and self.amount > 1.0:
            percent = f" ({self.amount:g} per cent are written {self.amount:g}%)" if self.amount >= 2.0 else ""
            return f"a budget of {self.amount:g} of |c*| is more than the optimal cost itself{percent}"
        if not self.is_relative and self.amount > _MUCH_REGRET:
            share = f"{self.amount:.0%} of wealth in every row of returns"
            return f"a regret of {self.amount:g} is {share}; basis points are written 5bp"
        return ""

    def limit(self, optimal_cost: float) -> float:
        """Return the largest affordable regret at an optimal cost c*, in the cost's unit."""
        return self.amount * abs(float(optimal_cost)) if self.is_relative else self.amount

    def limits(self, optimal_costs: Array) -> Array:
        """Return the largest affordable regret at each of many optimal costs (T,), in the cost's unit."""
        return self.amount * np.abs(optimal_costs) if self.is_relative else np.full(len(optimal_costs), self.amount)

    def __str__(self) -> str:
        return f"{self.amount:.4g} of |c*|" if self.is_relative else f"regret of {self.amount:.4g}"


@dataclass(frozen=True)
class SilenceShare:
    """A budget as a share of the silence regret, the regret at which one constant decision suffices.

    Args:
        share: At least 0.

    Example:
        >>> SilenceShare(0.5).of(0.004)
        Budget(amount=0.002, is_relative=False)
    """

    share: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "share", validation.non_negative(self.share, "budget"))

    @property
    def remark(self) -> str:
        """A caution about an unusual share, in one sentence; empty for a usual one."""
        if self.share <= 1.0:
            return ""
        percent = f" ({self.share:g} per cent are written silence:{self.share:g}%)" if self.share >= 2.0 else ""
        return f"a budget of {self.share:.0%} of the silence regret is more than a constant decision costs{percent}"

    def of(self, silence: float) -> Budget:
        """Return the budget where the silence regret is known, in the cost's unit."""
        return Budget.regret(self.share * validation.non_negative(silence, "silence"))


def remarks_of(budget: Budget | SilenceShare | None) -> list[str]:
    """Return what is odd about a budget, as cautions beside a result."""
    return [f"Caution: {budget.remark}."] if budget is not None and budget.remark else []


def written_budget(text: str | float) -> Budget | SilenceShare:
    """Return the budget of a text, as `Budget.parse` without a silence regret."""
    if not isinstance(text, str):
        return Budget.relative(text)
    found = _parts(text)
    if found is None:
        raise InputError(
            f"budget {text!r}: expected a share of |c*| such as 0.1 or 10%, a regret such as 5bp or regret:0.002 in the cost's "
            "unit, or silence:0.5, a share of the silence regret"
        )
    kind, unit = found["kind"], found["unit"]
    amount = float(found["number"]) * (0.01 if unit == "%" else _BASIS_POINT if unit in _BP else 1.0)
    if amount < 0.0:
        raise InputError(f"budget must be at least 0, got {text.strip()}")
    if kind == "silence":
        return SilenceShare(amount)
    return Budget(amount, not (kind == "regret" or unit in _BP))


def is_budget(text: str) -> bool:
    """Whether a text is written as a budget, whatever its amount."""
    return _parts(text) is not None


def _parts(text: str) -> re.Match[str] | None:
    found = _WRITTEN.fullmatch(text.strip().lower())
    if found is None or (found["unit"] in _BP and found["kind"] in ("relative", "silence")):
        return None
    return found


def as_budget(value: Budget | float | str) -> Budget:
    """Return a budget; a number is a share of |c*|, a text is read as by `Budget.parse`."""
    return value if isinstance(value, Budget) else Budget.parse(value)
