"""What an agent is willing to pay for privacy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from inscrutable import validation
from inscrutable.errors import InputError
from inscrutable.validation import Array


@dataclass(frozen=True)
class Budget:
    """A cost budget: a share of the optimal cost, or an amount of regret.

    Formula: ρ ≤ c_b·|c*| for `Budget.relative(c_b)`; ρ ≤ r for `Budget.regret(r)`.

    The paper's c* (1 + c_b) is the first one wherever c* > 0; with |c*| it stays feasible where c* < 0, which is the
    rule on real returns. Decisions under `Budget.regret` do not change when a constant is added to all costs.

    Args:
        amount: c_b, a share of |c*|, or r in the cost's unit; at least 0.
        is_relative: Which of the two.

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

    def limit(self, optimal_cost: float) -> float:
        """Return the largest affordable regret at an optimal cost c*, in the cost's unit."""
        return self.amount * abs(float(optimal_cost)) if self.is_relative else self.amount

    def limits(self, optimal_costs: Array) -> Array:
        """Return the largest affordable regret at each of many optimal costs (T,), in the cost's unit."""
        return self.amount * np.abs(optimal_costs) if self.is_relative else np.full(len(optimal_costs), self.amount)

    def __str__(self) -> str:
        return f"{self.amount:.4g} of |c*|" if self.is_relative else f"regret of {self.amount:.4g}"


def as_budget(value: Budget | float) -> Budget:
    """Return a budget; a number is a share of |c*|."""
    return value if isinstance(value, Budget) else Budget.relative(value)
