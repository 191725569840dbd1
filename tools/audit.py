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
from importlib.metadata import version
from pathlib import Path

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


def settings() -> dict[str, str]:
    """All cores, where the tests' own setting is one, and all instances, of which `make test` draws a part."""
    return {"LOKY_MAX_CPU_COUNT": str(os.cpu_count()), "AUDIT_SIZES": "1"}


def main(arguments: list[str]) -> int:
    """Run pytest, show its lines as they come, keep them, and pass its exit code on."""
    command = [sys.executable, "-m", "pytest", "-m", "audit", "--no-header", "--durations=0", "-s", "-v", *arguments]
    LOG.parent.mkdir(exist_ok=True)
    with (
        LOG.open("w", encoding="utf-8") as log,
        subprocess.Popen(
            command, cwd=ROOT, env=settings() | os.environ, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        ) as run,
    ):
        log.write(header())
        assert run.stdout is not None
        for line in run.stdout:
            if line.startswith(NOISE):
                continue
            clean = anonymous(line)
            log.write(clean)
            log.flush()
            sys.stdout.write(clean)
            sys.stdout.flush()
        return run.wait()


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
