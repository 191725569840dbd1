"""One point of a growth curve, in a process of its own: `python -m benchmarks.point '{"steps": 1000, …}'` prints JSON."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks import ROOT
from inscrutable.kernels.calls import compiled_at_once

BUDGET = 0.1
_WARM_UP = 64
_FEW = 64  # members of a sequence that are looked at one by one
STATUS, _CLEAR = Path("/proc/self/status"), Path("/proc/self/clear_refs")


@dataclass(frozen=True)
class Point:
    """What is decided: T steps, candidates on a grid of this resolution (0: the default), U assets, X states."""

    steps: int
    resolution: int = 100
    assets: int = 3
    states: int = 3
    maker: str = "PDM"


@dataclass(frozen=True)
class Measured:
    """Seconds for candidates and decisions; bytes: the result, and the peak above the start without the result."""

    candidates: int
    prepared_seconds: float
    decided_seconds: float
    working_bytes: float
    result_bytes: float
    overspent: float


def measured_apart(point: Point, patience: float) -> Measured | None:
    """Measure in a new process, so that memory is that of this point alone; None after `patience` seconds."""
    command = [sys.executable, "-m", "benchmarks.point", json.dumps(asdict(point))]
    try:
        run = subprocess.run(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True, timeout=patience)
    except subprocess.TimeoutExpired:
        return None
    return Measured(**json.loads(run.stdout.splitlines()[-1]))


def measured(point: Point) -> Measured:
    """Make the candidates, warm up, then decide all steps at once."""
    from benchmarks import markets
    from inscrutable import CounterAdversarialDecisionMaker, ProbabilisticDecisionMaker, decoy_grid

    problem = markets.problem_of(markets.market(point.states, point.assets))
    if point.resolution:
        decoy_grid(problem, 2)
    started = time.perf_counter()
    candidates = decoy_grid(problem, point.resolution) if point.resolution else None
    is_lottery = point.maker == "PDM"
    maker = ProbabilisticDecisionMaker if is_lottery else CounterAdversarialDecisionMaker
    agent: Any = maker(problem, budget=BUDGET, candidates=candidates)
    n_candidates = len(agent.candidates)
    prepared = time.perf_counter() - started
    agent.decide_many(markets.beliefs(min(_WARM_UP, point.steps), point.states, 1))
    beliefs = markets.beliefs(point.steps, point.states)
    known = stored(agent).keys() | stored(beliefs).keys()
    gc.collect()
    forget_peak()
    before = resident_bytes()
    started = time.perf_counter()
    result = agent.decide_many(beliefs)
    decided = time.perf_counter() - started
    peak = peak_bytes()
    size = float(sum(n for key, n in stored(result).items() if key not in known))
    working = max(0.0, peak - before - size)
    regret = result.expected_cost - result.optimal_cost if is_lottery else result.regret
    overspent = float((regret / (BUDGET * np.abs(result.optimal_cost))).max() - 1)
    return Measured(n_candidates, prepared, decided, working, size, overspent)


def stored(thing: Any) -> dict[int, int]:
    """Bytes of every array and long sequence that an object stores, by identity.

    Objects inside long sequences are not entered: a result of a million steps that keeps an object for each is charged
    for them as working memory.
    """
    found: dict[int, int] = {}
    waiting, seen = [thing], set()
    while waiting:
        each = waiting.pop()
        if id(each) in seen:
            continue
        seen.add(id(each))
        if isinstance(each, np.ndarray):
            if isinstance(each.base, np.ndarray):
                waiting.append(each.base)
            else:
                found[id(each)] = each.nbytes
        elif isinstance(each, (tuple, list)):
            found[id(each)] = sys.getsizeof(each)
            waiting += each if len(each) <= _FEW else []
        elif isinstance(each, dict):
            waiting += each.values() if len(each) <= _FEW else []
        else:
            waiting += getattr(each, "__dict__", {}).values()
            names = [name for kind in type(each).__mro__ for name in getattr(kind, "__slots__", ())]
            waiting += [getattr(each, name) for name in names if hasattr(each, name)]
    return found


def resident_bytes() -> float:
    """Memory of this process now."""
    return _status("VmRSS") if STATUS.exists() else peak_bytes()


def peak_bytes() -> float:
    """The largest memory of this process since `forget_peak`, or since its start where that is not to be had."""
    if STATUS.exists():
        return _status("VmHWM")
    import resource

    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(most if sys.platform == "darwin" else most * 1024)


def forget_peak() -> None:
    """Set the peak to what is used now, where the system can."""
    try:
        _CLEAR.write_text("5")
    except OSError:
        return


def _status(name: str) -> float:
    line = next(line for line in STATUS.read_text().splitlines() if line.startswith(name))
    return float(line.split()[1]) * 1024


if __name__ == "__main__":
    with compiled_at_once():
        print(json.dumps(asdict(measured(Point(**json.loads(sys.argv[1]))))))
