"""Deletes compiled kernels when any of the package's kernel sources, or a tolerance, has changed.

Numba checks the file of a kernel alone. Where a function of another file, inlined into the kernel, has changed, it would load
the old machine code and give the old answers. And it cannot load a kernel whose named tuple was deleted.
"""

from __future__ import annotations

import contextlib
from pathlib import Path

_SOURCES = Path(__file__).parent
_STAMP = "kernels.stamp"


def forget_other_sources(sources: Path = _SOURCES) -> None:
    """Delete the kernels cached beside the sources where any source has changed since; errors of the disk are ignored."""
    # Kernels read tolerances.
    read = [*sources.glob("*.py"), *sources.parent.glob("tolerances.py")]
    facts = [(path.name, path.stat()) for path in sorted(read)]
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
