"""Run the tests marked `audit`, and those that draw fewer instances in `make test`, and keep what they print.

audit/log.txt holds it, without the paths of this machine.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.metadata import version
from itertools import repeat
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
LOG = ROOT / "audit" / "log.txt"
NOISE = "Cannot set feasibility tolerance"  # SCIP's remark at every model, without consequence
PACKAGES = ("inscrutable", "numpy", "scipy", "numba", "daqp", "piqp", "cvxpy-base", "clarabel", "PySCIPOpt")


def header() -> str:
    """What a reader needs in order to repeat the run."""
    versions = ", ".join(f"{name} {version(name)}" for name in PACKAGES)
    machine = f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    day = time.strftime("%Y-%m-%d", time.gmtime())
    return f"make audit, {day}\nPython {platform.python_version()}, {versions}\n{machine}\n\n"


def anonymous(line: str) -> str:
    """A line without the folders of this machine."""
    places = {f"{ROOT}{os.sep}": "", str(ROOT): ".", tempfile.gettempdir() + os.sep: "", str(Path.home()): "~"}
    for place, name in places.items():
        line = line.replace(place, name)
    return line


def settings(processes: int) -> dict[str, str]:
    """The cores of each process, where the tests' own setting is one, and all instances, of which `make test` draws a part."""
    return {"LOKY_MAX_CPU_COUNT": str(max(1, (os.cpu_count() or 1) // processes)), "AUDIT_SIZES": "1"}


def shares(arguments: list[str]) -> list[list[str]]:
    """The arguments of each process: every n-th file, on n cores, or what was asked for."""
    files = sorted(str(path.relative_to(ROOT)) for path in (ROOT / "tests").glob("test_*.py"))
    processes = os.cpu_count() or 1
    return [arguments] if arguments else [files[i::processes] for i in range(processes)]


def run(arguments: list[str], processes: int, kept: list[str]) -> int:
    """Run pytest, show its lines as they come and keep them; return its exit code."""
    command = [sys.executable, "-m", "pytest", "-m", "audit", "--no-header", "--durations=0", "-s", "-v", *arguments]
    pipes: Any = {"stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen(command, cwd=ROOT, env=settings(processes) | os.environ, **pipes) as pytest:
        for line in pytest.stdout:
            if not line.startswith(NOISE):
                kept.append(anonymous(line))
                sys.stdout.write(kept[-1])
                sys.stdout.flush()
        return pytest.wait()


def main(arguments: list[str]) -> int:
    """Run a share of the files on each core, keep what they print one after the other, and pass an exit code on."""
    asked = shares(arguments)
    kept: list[list[str]] = [[] for _ in asked]
    LOG.parent.mkdir(exist_ok=True)
    try:
        with ThreadPoolExecutor(len(asked)) as pool:
            return max(pool.map(run, asked, repeat(len(asked)), kept))
    finally:
        LOG.write_text(header() + "\n".join("".join(lines) for lines in kept), "utf-8")


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
