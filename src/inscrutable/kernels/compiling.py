"""Warns that kernels are being compiled, where that takes long: once per machine, then they come from a cache.

One line at level WARNING of the logger `inscrutable.kernels`, which Python writes to stderr unless told otherwise:
`logging.getLogger("inscrutable.kernels").setLevel(logging.ERROR)` silences it. Kernels that are loaded from the cache
raise no event and no warning, nor do functions that a user compiles.

Meanwhile the garbage collector is off: a compiler makes millions of lasting objects, and scanning them took a sixth of the
time.
"""

from __future__ import annotations

import gc
import logging
from threading import Timer
from time import monotonic
from typing import Any

from numba.core import event

PATIENCE = 1.0
"""Seconds of compilation before the warning."""
MESSAGE = "inscrutable: compiling numerical kernels, once per machine; this can take a minute or two"

_PACKAGE = __name__.partition(".")[0]
_LOGGER = logging.getLogger(__name__.rpartition(".")[0])


class CompilationNotice(event.Listener):
    """Warns once, when the package's own compilations have taken `patience` seconds in all; the collector is off meanwhile."""

    def __init__(self, patience: float = PATIENCE) -> None:
        self._left = patience
        self._said = False
        self._depth, self._paused = 0, False
        self._started = 0.0
        self._timer: Timer | None = None

    def on_start(self, event: Any) -> None:
        """A kernel, or one that it calls, starts to compile."""
        if not _is_ours(event):
            return
        self._depth += 1
        if self._depth == 1:
            self._paused = gc.isenabled()
            gc.disable()
        if self._depth == 1 and not self._said:
            self._started = monotonic()
            self._timer = Timer(self._left, self._say)
            self._timer.daemon = True
            self._timer.start()

    def on_end(self, event: Any) -> None:
        """It ends; the outermost one stops the clock."""
        if not _is_ours(event):
            return
        self._depth -= 1
        if self._depth == 0 and self._paused:
            gc.enable()
        if self._depth == 0 and self._timer is not None:
            self._timer.cancel()
            self._timer = None
            self._left = max(0.0, self._left - (monotonic() - self._started))

    def _say(self) -> None:
        self._said = True
        _LOGGER.warning(MESSAGE)


def _is_ours(event: Any) -> bool:
    function = getattr((event.data or {}).get("dispatcher"), "py_func", None)
    return getattr(function, "__module__", "").partition(".")[0] == _PACKAGE


def listen() -> CompilationNotice:
    """Begin to listen; done once, when the first kernel is imported."""
    notice = CompilationNotice()
    event.register("numba:compile", notice)  # type: ignore[no-untyped-call]
    return notice
