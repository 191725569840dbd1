"""Names of decision makers with their abbreviations written out, for people who read reports and pictures."""

from __future__ import annotations

from inscrutable.experiments.backtest_results import SEQUENTIAL

FULL_NAMES = {"ODM": "optimal", "CDM": "counter-adversarial", "PDM": "probabilistic", SEQUENTIAL: "sequential"}
"""The full names of decision makers by abbreviation."""


def spelled(name: str) -> str:
    """Return a decision maker's name with its abbreviation written out; settings after a comma stay.

    Example:
        >>> spelled("CDM"), spelled("PDM, local"), spelled("rounded")
        ('counter-adversarial (CDM)', 'probabilistic (PDM), local', 'rounded')
    """
    short, comma, settings = name.partition(",")
    return f"{FULL_NAMES[short]} ({short}){comma}{settings}" if short in FULL_NAMES else name


def full_name(name: str) -> str:
    """Return a decision maker's name without its abbreviation; settings after a comma stay."""
    short, comma, settings = name.partition(",")
    return f"{FULL_NAMES.get(short, short)}{comma}{settings}"
