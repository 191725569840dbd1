"""Numbers that count as zero in kernels, in double precision (2.2e-16 of a number)."""

from __future__ import annotations

FLAT = 1e-13
"""Length or slope of a row of unit size that moves with nothing: some hundred roundings."""

DEPENDENT = 1e-14
"""Square of the length that is left of a unit row after its part along others, below which it depends on them: of a
length of 1e-7, half of the digits of a direction are rounding."""

NO_DISTANCE = 1e-12
"""A distance between beliefs without a direction: its derivatives are divided by no less."""

LEAST_SUM = 1e-290
"""A sum of powers below this has lost digits, and one above its inverse overflows soon."""
