"""Start-up: imports, the first call on a fresh machine, the cached start, and the warm reproduction of the paper."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from benchmarks.table import Quality, Row, Target, at_most, seconds_text, times_text

TITLE = "Start-up: each in new processes"
OVER_NUMPY = 3.0
FIRST_SECONDS, COMPILE_SECONDS = 8.0, 15.0
REPRODUCE_SECONDS = 60.0

_IMPORT = "import time; start = time.perf_counter(); import {0}; print(time.perf_counter() - start)"
_NAMES = "CounterAdversarialDecisionMaker, MarkowitzProblem, ProbabilisticDecisionMaker, consistent_beliefs"
_IMPORT_NAMES = (
    f"import time; start = time.perf_counter(); from inscrutable import {_NAMES}; print(time.perf_counter() - start)"
)
_PROBLEM = (
    "import sys, json, time, numpy as np\n"
    f"from inscrutable import {_NAMES}\n"
    "problem = MarkowitzProblem([[.02, .01, .0], [-.01, .0, .02], [.0, .01, .01]],"
    " [np.diag([.01, .02, .01]), np.diag([.02, .01, .02]), np.diag([.01, .01, .03])], 5.0)\n"
)
_NO_KERNEL = (
    _PROBLEM.replace(_NAMES, "MarkowitzProblem")
    + "problem.expected_cost([.5, .3, .2], [.5, .3, .2]); bare = 'numba' in sys.modules\n"
    + "problem.solve([.5, .3, .2]); print(json.dumps([bare, 'numba' in sys.modules]))"
)
_FIRST_CALLS = _PROBLEM + (
    "start = time.perf_counter()\n"
    "from numba.core import event\n"
    "timer = event.TimingListener(); event.register('numba:compile', timer)\n"
    "beliefs = np.random.default_rng(0).dirichlet(np.ones(3), 64)\n"
    "single = CounterAdversarialDecisionMaker(problem)\n"
    "single.decide(beliefs[0]); first = time.perf_counter() - start\n"
    "compiled = timer.duration if timer.done else 0.0\n"
    "single.decide_many(beliefs)\n"
    "mixed = ProbabilisticDecisionMaker(problem, candidates=single.candidates)\n"
    "mixed.decide(beliefs[0]); mixed.decide_many(beliefs)\n"
    "consistent_beliefs(problem, problem.solve(beliefs[0])).distance(beliefs[1])\n"
    "every, in_all = time.perf_counter() - start, timer.duration if timer.done else 0.0\n"
    "print(json.dumps([compiled, first, in_all, every]))"
)


@dataclass(frozen=True)
class Sizes:
    """How often processes are started, whether with an empty cache first, and what the reproduction is asked for."""

    imports: int = 15
    fresh: bool = True
    starts: int = 3
    reproductions: int = 2
    options: Sequence[str] = field(default=())


FULL = Sizes()
QUICK = Sizes(
    imports=1,
    fresh=False,
    starts=1,
    reproductions=0,
    options=("--markets", "2", "--simulations", "2", "--steps", "2", "--resolution", "4", "--jobs", "1"),
)


def rows(sizes: Sizes) -> Iterator[Row]:
    """Imports, compilation, cached start, reproduction."""
    yield from _imports(sizes)
    yield _numba()
    yield from _first_calls(sizes)
    yield _reproduction(sizes)


def _imports(sizes: Sizes) -> Iterator[Row]:
    """In-process seconds, best of many, in turns, so that both see the same machine."""
    numpy, whole, names = [], [], []
    for _ in range(sizes.imports):
        numpy.append(float(_python(_IMPORT.format("numpy"))[0]))
        whole.append(float(_python(_IMPORT.format("inscrutable"))[0]))
        names.append(float(_python(_IMPORT_NAMES)[0]))
    how = f"best of {sizes.imports}"
    for what, times in (("import inscrutable", whole), ("import of the decision makers by name", names)):
        ratio = min(times) / min(numpy)
        target = at_most(ratio, OVER_NUMPY) if times is whole else Target()
        peer = seconds_text(min(numpy), how)
        yield Row(what, "", seconds_text(min(times), how), "import numpy", peer, times_text(ratio), target=target)


def _numba() -> Row:
    bare, used = json.loads(_python(_NO_KERNEL)[0])
    told = ["loaded" if each else "not loaded" for each in (bare, used)]
    said = f"after a problem and a cost: {told[0]}; after one solve, which is the first kernel: {told[1]}"
    return Row("Numba before a kernel is needed", "", said, target=Target("not loaded", not bare))


def _first_calls(sizes: Sizes) -> Iterator[Row]:
    """The same calls with an empty cache of compiled kernels, then with the one they leave behind."""
    with tempfile.TemporaryDirectory() as cache:
        settings = {"NUMBA_CACHE_DIR": cache} if sizes.fresh else {}
        printed, said = _python(_FIRST_CALLS, settings)
        compiling, first, in_all, every = json.loads(printed)
        # Without an empty cache the first calls were cached ones already.
        again = range(sizes.starts if sizes.fresh else 0)
        cached = min((json.loads(_python(_FIRST_CALLS, settings)[0])[-1] for _ in again), default=every)
    what = "decoys, CDM and PDM, one and many"
    notice = "said on stderr" if said.strip() else "nothing on stderr"
    yield Row(
        "first call on a fresh machine",
        "decoys and one CDM decision",
        f"{seconds_text(first, 'once')}, of which {seconds_text(compiling)} compile",
        quality=Quality(notice),
        target=at_most(first, FIRST_SECONDS, " s in all"),
        numbers={"seconds": first, "compiling": compiling},
    )
    yield Row(
        "all first calls on a fresh machine",
        what,
        f"{seconds_text(every, 'once')}, of which {seconds_text(in_all)} compile",
        target=at_most(in_all, COMPILE_SECONDS, " s compile"),
        numbers={"seconds": every, "compiling": in_all},
    )
    how = f"best of {sizes.starts}"
    yield Row("the same calls, kernels cached", what, seconds_text(cached, how), numbers={"seconds": cached})


def _reproduction(sizes: Sizes) -> Row:
    """All of the paper's numerical section, after one run that fills every cache."""
    times = []
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "inscrutable", "reproduce", "--quiet", "--json", *sizes.options]
        for number in range(sizes.reproductions + 1):
            started = time.perf_counter()
            _run([*command, "--out", os.path.join(folder, str(number))])
            times.append(time.perf_counter() - started)
    best = min(times[1:] or times)
    how = f"best of {sizes.reproductions}, warm" if sizes.reproductions else "first run"
    target = at_most(best, REPRODUCE_SECONDS, " s")
    return Row("inscrutable reproduce", "defaults", seconds_text(best, how), target=target, numbers={"seconds": best})


def _python(code: str, settings: Mapping[str, str] | None = None) -> tuple[str, str]:
    return _run([sys.executable, "-c", code], settings)


def _run(command: Sequence[str], settings: Mapping[str, str] | None = None) -> tuple[str, str]:
    """What a command prints on both channels; an error of it is ours, with what it said."""
    environment = os.environ | {"MPLBACKEND": "Agg"} | dict(settings or {})
    run = subprocess.run(command, env=environment, capture_output=True, text=True)
    if run.returncode:
        raise RuntimeError(f"a benchmarked command failed with exit code {run.returncode}:\n{run.stderr[-2000:]}")
    return run.stdout, run.stderr
