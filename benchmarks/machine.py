"""What a reader needs in order to repeat a run."""

from __future__ import annotations

import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version

PACKAGES = ("inscrutable", "numpy", "scipy", "numba", "daqp", "piqp", "cvxpy-base", "clarabel", "PySCIPOpt")
THREADS = ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def cores() -> int:
    """The cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def described() -> str:
    """Day, machine and versions in one line."""
    day = time.strftime("%Y-%m-%d", time.gmtime())
    machine = f"{platform.system()} {platform.machine()}, {cores()} cores"
    return f"{day}, {machine}{_limits()}, Python {platform.python_version()}, " + ", ".join(_versions())


def _limits() -> str:
    """The numbers of threads that the environment prescribes; by default all cores, for the peers' BLAS as for ours."""
    limits = [f"{name}={os.environ[name]}" for name in THREADS if name in os.environ]
    return f" ({', '.join(limits)})" if limits else ""


def _versions() -> list[str]:
    found = []
    for name in PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"no {name}")
    return found
