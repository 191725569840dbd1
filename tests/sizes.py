"""How much a test draws: a part in `make test`, all of it in `make audit`, which sets the variable below.

conftest.py then marks every test of a module that uses these functions as audited.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from itertools import product
from typing import TypeVar

AUDIT = "AUDIT_SIZES"

Case = TypeVar("Case")
First = TypeVar("First")
Second = TypeVar("Second")


def audited() -> bool:
    """Whether all is asked for."""
    return bool(os.environ.get(AUDIT))


def instances(number: int, least: int = 3) -> int:
    """How many random instances: an eighth, but not fewer than the least; in `make audit` the number itself."""
    return number if audited() else max(min(number, least), number // 8)


def paired(one: Sequence[First], other: Sequence[Second]) -> list[tuple[First, Second]]:
    """Pairs in which each of both occurs, and in `make audit` all pairs."""
    if audited():
        return list(product(one, other))
    return [(one[i % len(one)], other[i % len(other)]) for i in range(max(len(one), len(other)))]


def some(cases: Sequence[Case], every: int) -> list[Case]:
    """Every so many-th of a table of cases; in `make audit` all of them."""
    return list(cases if audited() else cases[::every])
