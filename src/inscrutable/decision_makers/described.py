"""How a decision maker shows itself: its class, its problem, and what it was given."""

from __future__ import annotations

from typing import Any, ClassVar

from inscrutable.budgets import Budget
from inscrutable.mechanisms import Prior
from inscrutable.problems import DecisionProblem


class Described:
    """Gives a decision maker a short `repr`; `_shown` names the attributes to tell beside the problem."""

    problem: DecisionProblem
    _shown: ClassVar[tuple[str, ...]] = ()

    def __repr__(self) -> str:
        told = [f"{name.removeprefix('n_')} {_short(getattr(self, name))}" for name in self._shown]
        return f"{type(self).__name__}({', '.join([repr(self.problem), *told])})"


def _short(value: Any) -> str:
    if isinstance(value, Budget):
        return str(value)
    if isinstance(value, Prior):
        return f"of {len(value)} beliefs"
    return f"{value:.4g}" if isinstance(value, float) else repr(value)
