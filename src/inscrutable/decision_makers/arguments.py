"""Checks of the arguments of decision makers, and their `repr`."""

from __future__ import annotations

from typing import Any, ClassVar

from inscrutable.budgets import Budget
from inscrutable.errors import InputError
from inscrutable.mechanisms import Prior
from inscrutable.privacy import MaximalObfuscation, PrivacyMeasure
from inscrutable.problems import DecisionProblem


def checked_measure(measure: Any) -> PrivacyMeasure:
    """Return a privacy measure, `MaximalObfuscation()` for None, or raise `InputError`."""
    chosen = MaximalObfuscation() if measure is None else measure
    if not isinstance(chosen, PrivacyMeasure):
        raise InputError(f"measure must be a privacy measure such as MaximalObfuscation(), got {measure!r}")
    return chosen


def checked_choice(value: Any, name: str, kinds: tuple[type, ...]) -> Any:
    """Return `value`, an instance of the first kind for None, or raise `InputError`."""
    chosen = kinds[0]() if value is None else value
    if not isinstance(chosen, kinds):
        expected = " or ".join(f"{kind.__name__}()" for kind in kinds)
        raise InputError(f"{name} must be {expected}, got {value!r}")
    return chosen


def checked_on_empty(value: Any) -> str:
    """Return the policy for decisions that no belief explains, or raise `InputError`."""
    if value not in ("exclude", "infinite"):
        raise InputError(f'on_empty must be "exclude" or "infinite", got {value!r}')
    return str(value)


class Described:
    """Gives a decision maker a short `repr`; `_shown` names the attributes shown beside the problem."""

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
