"""Kernels are compiled when first run: one command runs them all, so that nobody waits later."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from inscrutable import InputError
from inscrutable.cli import main
from inscrutable.experiments import first_calls
from inscrutable.experiments.first_calls import compile_kernels

# A new process: in this one the other tests have run kernels already.
_RUN_ALL = """
import json
import re
from importlib import import_module
from pathlib import Path

import numpy as np

import inscrutable
from inscrutable.decision_makers import *
from inscrutable.experiments.first_calls import compile_kernels
from inscrutable.privacy import *
from inscrutable.problems import MarkowitzProblem

moves = []
folder = compile_kernels(n_jobs=1, progress=lambda *move: moves.append(move))
package = Path(inscrutable.__file__).parent
used = set()
for file in package.rglob("*.py"):
    if file.parent.name != "kernels":
        found = re.findall(r"from (inscrutable[.]kernels[.]\\w+) import (?:[(]([^)]*)[)]|(.*))", file.read_text("utf-8"))
        used |= {(module, name) for module, *names in found for name in re.findall(r"(\\w+)(?: as \\w+)?", " ".join(names))}
kernels = {pair: getattr(import_module(pair[0]), pair[1]) for pair in used}
called = {pair: len(each.signatures) for pair, each in kernels.items() if hasattr(each, "signatures")}
left = [pair for pair, signatures in called.items() if not signatures]

rng = np.random.default_rng(0)
factors = rng.normal(size=(3, 6, 6))
problem = MarkowitzProblem(0.02 * rng.normal(size=(3, 6)), 0.01 * (factors @ factors.swapaxes(1, 2) + np.eye(6)), 5.0)
beliefs = rng.dirichlet(np.ones(3), 12)
single = CounterAdversarialDecisionMaker(problem)
for measure in (MaximalObfuscation(), DesiredObfuscation(beliefs[1]), NonExistence(), NonUniqueness(), Infeasibility()):
    CounterAdversarialDecisionMaker(problem, measure).decide(beliefs[0])
    CounterAdversarialDecisionMaker(problem, measure, candidates=single.candidates).decide_many(beliefs)
    ProbabilisticDecisionMaker(problem, measure, candidates=single.candidates).decide_many(beliefs)
for some in (single.candidates, random_candidates(problem, 12, rng=rng)):
    for distance in (None, DesiredObfuscation(beliefs[1])):
        privacy_frontier(problem, beliefs[0], distance, candidates=some)
CounterAdversarialDecisionMaker(problem, method=LocalSearch()).decide(beliefs[0])
CounterAdversarialDecisionMaker(problem, method=GlobalSearch(certify=0.05)).decide(beliefs[0])
again = [pair for pair, count in called.items() if len(kernels[pair].signatures) > count]
print(json.dumps([moves, len(called), left, again]))
"""


def test_after_the_first_calls_no_kernel_is_left():
    done = subprocess.run([sys.executable, "-c", _RUN_ALL], capture_output=True, text=True, check=True)
    moves, count, left, again = json.loads(done.stdout)
    assert left == []
    assert again == []  # no measure, method or kind of candidates asks for other types
    assert count > 10  # the others are called by these alone
    assert moves == [[number, 2] for number in range(3)]
    assert done.stderr == ""


@pytest.mark.parametrize("jobs", [0, -2])
def test_jobs_are_counted(jobs: int):
    with pytest.raises(InputError, match="-1 for one per core"):
        compile_kernels(n_jobs=jobs)


def test_the_command_says_where_kernels_are_kept(monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(first_calls, "compile_kernels", lambda n_jobs, progress: asked.append(n_jobs) or Path("kept"))
    assert main(["compile", "--jobs", "3", "--quiet"]) == 0
    assert capsys.readouterr() == ("All numerical kernels are compiled, in kept\n", "")
    assert main(["compile", "--json", "--quiet"]) == 0
    assert json.loads(capsys.readouterr().out) == {"folder": "kept"}
    assert asked == [3, -1]
