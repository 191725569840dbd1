"""Benchmarks: what the library does against everything a user could pick instead, quality beside time.

`make bench` runs all but the slow group `large`, which `make audit` runs. Only the public names of `inscrutable` are
used. The oracles of the tests serve as peers, so that no formulation is written twice.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
_TESTS = str(ROOT / "tests")
if _TESTS not in sys.path:
    sys.path.append(_TESTS)
