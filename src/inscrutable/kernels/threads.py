"""How many threads a parallel kernel gets."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba

_WORTH_A_SECOND_THREAD = 512


@contextmanager
def threads_for(items: int) -> Iterator[None]:
    """Give a small job one thread: waking a second one costs more than it saves. Results do not depend on it."""
    before = numba.get_num_threads()
    if items < _WORTH_A_SECOND_THREAD:
        numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(before)
