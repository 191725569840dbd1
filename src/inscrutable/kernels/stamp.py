"""Compiled kernels are kept for the sources that they were made from, all of them.

Numba looks at the file of a kernel alone. It takes what it kept where a kernel of another file, copied into this one, has
changed since: the answers are then those of the former code. And it cannot read what it kept where a named tuple is gone.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

_SOURCES = Path(__file__).parent
_STAMP = "kernels.stamp"


def forget_other_sources(sources: Path = _SOURCES) -> None:
    """Delete the kernels kept beside the sources where any source has changed since; say nothing where that cannot be."""
    facts = [(path.name, path.stat()) for path in sorted(sources.glob("*.py"))]
    found = "\n".join(f"{name} {fact.st_size} {fact.st_mtime_ns}" for name, fact in facts)
    kept = sources / "__pycache__"
    # A folder of somebody else's, or two processes at once: at worst a kernel is compiled again.
    with contextlib.suppress(OSError):
        stamp = kept / _STAMP
        if stamp.exists() and stamp.read_text("utf-8") == found:
            return
        kept.mkdir(exist_ok=True)
        for path in kept.glob("*.nb[ic]"):
            path.unlink(missing_ok=True)
        stamp.write_text(found, "utf-8")
