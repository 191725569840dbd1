"""Labels as a person writes them in tables and messages."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, time
from typing import Any


def label_text(label: Any) -> str:
    """Return a row's label as text: a date without its midnight, any other time in full.

    Args:
        label: What stands in a frame's index.

    Returns:
        Text; labels that differ as text, or by their time of day, stay different.

    Example:
        >>> from datetime import datetime
        >>> label_text(datetime(2020, 1, 31)), label_text(datetime(2020, 1, 31, 16)), label_text(7)
        ('2020-01-31', '2020-01-31 16:00:00', '7')
    """
    # Pandas' missing date is a datetime that is not equal to itself and has no time.
    if isinstance(label, datetime) and label == label and label.time() == time(0):
        return f"{label:%Y-%m-%d}"
    return str(label)


def number_text(value: float) -> str:
    """Return a number as text that reads back as the same number, with six digits where these suffice.

    Example:
        >>> number_text(0.5), number_text(0.50000001), number_text(1000)
        ('0.5', '0.50000001', '1000')
    """
    short = f"{value:g}"
    return short if float(short) == value else repr(value)


def capital(text: str) -> str:
    """Return a text with a capital first letter."""
    return text[:1].upper() + text[1:]


def listed(words: Sequence[str]) -> str:
    """Return words as a list within a sentence; "" for none.

    Example:
        >>> listed(["a"]), listed(["a", "b", "c"])
        ('a', 'a, b and c')
    """
    return " and ".join(filter(None, [", ".join(words[:-1]), *words[-1:]]))
