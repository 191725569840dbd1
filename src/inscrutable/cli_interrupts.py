"""Ctrl-C: an interrupt lost in foreign code is sent again until the command ends."""

from __future__ import annotations

import _thread
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

PATIENCE = 0.05
"""Seconds before a lost interrupt is sent again: by then the callback that lost it has returned."""


@dataclass
class Interrupts:
    """Whether an interrupt has arrived, and the timers that send lost ones again."""

    lost: bool = False
    timers: list[threading.Timer] = field(default_factory=list)

    def send_again(self) -> None:
        """Raise the lost interrupt in the main thread once the code that lost it has returned."""
        self.lost = True
        timer = threading.Timer(PATIENCE, _interrupt)
        timer.daemon = True
        self.timers.append(timer)
        timer.start()

    def caused(self, error: BaseException | None) -> bool:
        """Return whether an interrupt caused an error: one was lost before, or is among the error's causes."""
        while error is not None and not self.lost:
            if isinstance(error, KeyboardInterrupt):
                return True
            error = error.__cause__ or error.__context__
        return self.lost


def _interrupt() -> None:
    if hasattr(signal, "pthread_kill"):
        # Unlike interrupt_main, a real signal also wakes a main thread that sleeps or waits.
        signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
    else:
        _thread.interrupt_main()


@contextmanager
def interrupts_kept() -> Iterator[Interrupts]:
    """Receive every interrupt, also one within a callback of C code or a destructor, where Python drops it.

    The compiler calls back from C into Python, where an exception cannot propagate: Python prints and drops it.
    """
    kept = Interrupts()
    before = sys.unraisablehook

    def hook(lost: Any, /) -> None:
        if isinstance(lost.exc_value, KeyboardInterrupt):
            kept.send_again()
        else:
            before(lost)

    sys.unraisablehook = hook
    try:
        yield kept
    finally:
        sys.unraisablehook = before
        for timer in kept.timers:
            timer.cancel()
