"""How much is computed, in calls of functions: the same number on a busy machine and on an idle one."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any


class TooMuch(AssertionError):
    """More calls than were allowed."""


@contextmanager
def at_most_calls(limit: int) -> Iterator[list[int]]:
    """Stop with `TooMuch` at the first call beyond the limit; gives a list that ends with the calls so far."""
    count = [0]
    before = sys.getprofile()

    def called(frame: FrameType, event: str, argument: Any) -> None:
        if event in ("call", "c_call"):
            count[0] += 1
            if count[0] > limit:
                sys.setprofile(before)
                raise TooMuch(f"more than {limit:,} calls")

    sys.setprofile(called)
    try:
        yield count
    finally:
        sys.setprofile(before)
