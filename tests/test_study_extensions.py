"""Studies with parts of a user's own: what they measure, how they are kept, and what is refused."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

import inscrutable as ins
from inscrutable import InputError, Study, resume_study, run_study
from inscrutable.cli import main
from inscrutable.experiments.studies.extensions import as_text
from inscrutable.experiments.studies.grid_tasks import GridRunner
from inscrutable.experiments.studies.tasks import Work

MODULE = '''
"""Parts of a user's own."""
__version__ = "1.2"
from typing import NamedTuple
import numpy as np
from inscrutable import CategoricalEmission, DecisionProblem, NaiveAdversary, PrivacyMeasure, box, simplex, MarkowitzProblem

class Coin(CategoricalEmission):
    """Heads or tails."""
    def __init__(self, heads):
        super().__init__([[p, 1 - p] for p in heads])

class Shares(MarkowitzProblem):
    """A portfolio."""
    def __init__(self, risk_aversion=3.0, yields=None):
        super().__init__(yields, [0.1 * np.eye(2)] * len(yields), risk_aversion)

class Fixed(Shares):
    def __init__(self, yields=None):
        super().__init__(2.0, yields)

class LastHidden(PrivacyMeasure):
    """How far the guess at the last state is off."""
    def __call__(self, belief, belief_set):
        return 1.0 if belief_set.is_empty else float(abs(belief_set.center()[-1] - belief[-1]))

firm = LastHidden()

def played(mechanism, prior):
    """Decisions a belief."""
    return len(mechanism.actions) / len(prior)

class Played(NamedTuple):
    action: np.ndarray

class Shrinking:
    """Acts as if nearer to the middle."""
    def __init__(self, problem, share=0.5):
        self.problem, self.share = problem, share
    def decide_many(self, beliefs):
        return Played(self.problem.solve((1 - self.share) * np.asarray(beliefs) + self.share / self.problem.n_states))

class Spender(Shrinking):
    """Shrinks by its budget."""
    def __init__(self, problem, budget, rng):
        super().__init__(problem, min(budget.amount, 1.0))

class Reader(NaiveAdversary):
    """Takes every decision for optimal."""
    def __init__(self, problem):
        super().__init__(problem)

def words(mechanism):
    """No number."""
    return "many"

class Failing:
    """Fails."""
    def __init__(self, problem):
        raise RuntimeError("no licence")
    def decide_many(self, beliefs): ...

class Positional:
    def __init__(self, problem, /): ...
    def decide_many(self, beliefs): ...

class Tagged:
    def __init__(self, name): ...
    def decide_many(self, beliefs): ...

class ODM(Shrinking):
    """Has a name that is taken."""

def needs(mechanism, level):
    """Needs a key that measures have none of."""

number = 3
'''
NAMES = ("Coin", "Shares", "LastHidden", "firm", "played", "Shrinking", "Spender", "Reader")
DATA = {
    "name": "own parts",
    "seed": 3,
    "repeats": 2,
    "world": {"kind": "Coin", "heads": [0.9, 0.2], "transition": [[0.9, 0.1], [0.3, 0.7]]},
    "problem": {"kind": "Shares", "risk_aversion": [2.0, 4.0], "yields": [[0.2, 0.0], [0.0, 0.2]]},
    "beliefs": {"kind": "path", "steps": 5},
    "candidates": {"resolution": 6},
    "decision_makers": ["ODM", {"name": "Shrinking", "share": [0.2, 0.6]}, "Spender"],
    "budgets": {"unit": "regret", "values": 0.4},
    "adversaries": ["naive", "Reader"],
    "measures": ["error", "LastHidden", "firm", "played", "naive_privacy"],
}


@pytest.fixture
def module(tmp_path, monkeypatch):
    """The module `own_parts_N`, importable, with its extensions; each test has a module of its own."""
    name = f"own_parts_{tmp_path.name.replace('-', '_')}"
    place = tmp_path / "library"
    place.mkdir()
    (place / f"{name}.py").write_text(MODULE)
    monkeypatch.syspath_prepend(str(place))
    yield name
    sys.modules.pop(name, None)


def own(module, *names):
    return [f"{module}:{name}" for name in names or NAMES]


def test_own_parts_are_measured_as_the_librarys_are(module, tmp_path):
    study = run_study(Study.of(DATA, extensions=own(module)), tmp_path / "out")
    rows = study.frame()
    assert (rows["status"] == "done").all(), list(study.errors())
    assert len(rows) == 2 * 2 * 4 * 2
    # the same observer and measure under another name
    theirs, ours = (rows[rows["adversary"] == each]["error"].to_numpy() for each in ("naive", "Reader"))
    np.testing.assert_array_equal(theirs, ours)
    np.testing.assert_array_equal(rows["LastHidden"], rows["firm"])
    # of two states, |difference of the last| is the distance over √2 where one belief explains a decision
    bare = rows[rows["decision_maker"] == "ODM"]
    np.testing.assert_allclose(bare["LastHidden"], bare["naive_privacy"] / np.sqrt(2), atol=1e-6)
    shrunk = rows[(rows["decision_maker"] == "Shrinking") & (rows["problem.risk_aversion"] == 4.0)]
    more = shrunk.groupby("decision_maker.share")["LastHidden"].mean()
    assert more[0.2] < more[0.6]
    spender = rows[rows["decision_maker"] == "Spender"]
    assert (spender["budget"] == 0.4).all()
    assert study.manifest()["extensions"][0]["version"] == "1.2"
    assert "how far the guess" in ins.Study.load(tmp_path / "out").plan.measure_kinds["LastHidden"].meaning.lower()


GOALS = {
    "name": "goals",
    "world": {"kind": "random"},
    "beliefs": {"kind": "grid", "resolution": 3},
    "candidates": {"resolution": 6},
    "budgets": {"unit": "silence", "values": 0.3},
    "decision_makers": [
        {"name": "CDM", "goal": ["maximal", "LastHidden", "firm"]},
        {"name": "PDM", "goal": "LastHidden"},
        "uniform",
    ],
    "measures": ["LastHidden", "expected_regret"],
}


def test_a_measure_of_ones_own_is_a_goal(module, tmp_path):
    own = [f"{module}:LastHidden", f"{module}:firm"]
    done = run_study(Study.of(GOALS, extensions=own), tmp_path / "study", extensions=own)
    assert done.status().failed == 0, list(done.errors())
    rows = done.frame()
    hidden = rows.set_index([rows["decision_maker"], rows["decision_maker.goal"].fillna("")])["LastHidden"]
    assert hidden["CDM", "LastHidden"] == hidden["CDM", "firm"]
    assert hidden["PDM", "LastHidden"] >= hidden["CDM", "LastHidden"] - 1e-9
    assert hidden["CDM", "LastHidden"] > hidden["uniform", ""]  # whose decisions are affordable, too
    runner = GridRunner(Work(GridRunner, done.plan.model_dump_json(), None, "[]", as_text(done.extensions)))
    setting = runner.setting((0, 0, 0, 0, 0))
    limit, offered = 0.3 * setting.silence_regret, setting.candidates.actions
    sets = [ins.consistent_beliefs(setting.problem, each) for each in offered]
    best = [
        max(
            abs(known.center()[-1] - belief[-1])
            for each, known in zip(offered, sets, strict=True)
            if setting.problem.regret(belief, each) <= limit
        )
        for belief in setting.prior.beliefs
    ]
    assert hidden["CDM", "LastHidden"] == pytest.approx(setting.prior.weights @ best, rel=1e-9)
    kept = Study.load(tmp_path / "study").plan.decision_makers[0]
    assert kept.goal == ("maximal", "LastHidden", "firm")
    (said,) = Study.load(tmp_path / "study").cautions()
    assert said.startswith("LastHidden, firm: CDM and PDM choose among the candidates alone")


@pytest.mark.parametrize("kind", ["given", "random"])
def test_a_problem_of_ones_own_in_worlds_of_the_library(module, tmp_path, kind):
    given = {"means": [[0.1], [0.2]], "covariances": [[[1.0]], [[1.0]]]} if kind == "given" else {"regimes": 2}
    plan = {
        "name": "own problem",
        "world": {"kind": kind, **given},
        "problem": {"kind": "Fixed", "yields": [[0.2, 0.0], [0.0, 0.2]]},
        "beliefs": {"kind": "grid", "resolution": 3},
        "candidates": {"resolution": 3},
        "decision_makers": ["ODM"],
        "measures": ["error"],
    }
    own = [f"{module}:Fixed"]
    done = run_study(Study.of(plan, extensions=own), tmp_path, extensions=own)
    assert done.status().failed == 0, list(done.errors())


@pytest.mark.parametrize("goal", ["LastHiden", "played"])
def test_a_goal_is_a_privacy_measure(module, goal):
    plan = GOALS | {"decision_makers": {"name": "CDM", "goal": goal}}
    said = r"unknown 'LastHiden'; did you mean LastHidden\?" if goal == "LastHiden" else "unknown 'played'"
    with pytest.raises(InputError, match=said):
        Study.of(plan, extensions=[f"{module}:LastHidden", f"{module}:played"])


def test_results_are_read_without_importing_anything(module, tmp_path, monkeypatch):
    run_study(Study.of(DATA, extensions=own(module)), tmp_path / "out", limit=3)
    sys.modules.pop(module)
    monkeypatch.setattr(sys, "path", [each for each in sys.path if each != str(tmp_path / "library")])
    study = Study.load(tmp_path / "out")
    assert study.frame() is not None
    for read in (study.means, study.status, study.manifest):
        assert read() is not None
    assert module not in sys.modules
    assert (study.n_tasks, study.extensions[5].name) == (32, "Shrinking")


def test_a_study_goes_on_with_the_same_source_alone(module, tmp_path):
    extensions = own(module)
    whole = run_study(Study.of(DATA, extensions=extensions), tmp_path / "whole").frame()
    run_study(Study.of(DATA, extensions=extensions), tmp_path / "half", limit=5)
    for wrong in ([], extensions[:3]):
        with pytest.raises(InputError, match=r"was begun with the extensions .*; pass extensions="):
            resume_study(tmp_path / "half", extensions=wrong)
    path = tmp_path / "library" / f"{module}.py"
    path.write_text(MODULE.replace("[[p, 1 - p]", "[[1 - p, p]"))
    sys.modules.pop(module)
    with pytest.raises(InputError, match=r"the source of .*:Coin has changed since the study was begun"):
        resume_study(tmp_path / "half", extensions=extensions)
    # A remark, and parts that the study does not name, may change.
    path.write_text(MODULE.replace('return "many"', 'return "few"') + "# a remark\n")
    sys.modules.pop(module)
    found = resume_study(tmp_path / "half", extensions=extensions).frame()
    assert found.equals(whole)


def test_a_part_is_known_by_the_module_that_defines_it(module, tmp_path):
    """A package that only imports its parts stays as it is where they change."""
    (tmp_path / "library" / f"{module}_all.py").write_text(f"from {module} import played")
    plan = {"name": "s", "measures": "played", "decision_makers": "ODM", "world": {"kind": "random"}}
    plan |= {"beliefs": {"kind": "grid", "resolution": 4}, "candidates": {"resolution": 4}}
    found = []
    for text in (MODULE, MODULE + "# a remark\n", MODULE.replace("/ len(prior)", "* len(prior)")):
        (tmp_path / "library" / f"{module}.py").write_text(text)
        for name in (module, f"{module}_all"):
            sys.modules.pop(name, None)
        found.append(Study.of(plan, extensions=[f"{module}_all:played"]).extensions[0].sha256)
    assert found[0] == found[1] != found[2]


def test_the_command_line_takes_extensions(module, tmp_path, monkeypatch, capsys):
    (tmp_path / "study.toml").write_text(
        'name = "s"\ndecision_makers = "Shrinking"\nmeasures = "played"\nworld = {kind = "random"}\n'
        'beliefs = {kind = "grid", resolution = 4}\ncandidates = {resolution = 4}\n'
    )
    (tmp_path / "beside.py").write_text(MODULE)  # the study's folder is not looked into
    monkeypatch.chdir(tmp_path)
    commands = [
        " ".join(["study run study.toml --out out --jobs 1 -q", *(f"--extension {each}" for each in extensions)])
        for extensions in (["beside:Shrinking"], own(module, "Shrinking", "played"))
    ]
    assert [main(each.split()) for each in commands] == [3, 0]
    said = " ".join(capsys.readouterr().err.split())
    assert said.count("cannot be imported") == 1
    assert "Traceback" not in said


# What is asked for, what the file holds beside, and what is said.
WRONG_CALLS = [
    ("mine", {}, 'an extension is written as "module:name"'),
    ("mine:", {}, 'an extension is written as "module:name"'),
    (":Shrinking", {}, 'an extension is written as "module:name"'),
    ("../mine:Shrinking", {}, 'an extension is written as "module:name"'),
    ("mine:a.b", {}, 'an extension is written as "module:name"'),
    (3, {}, 'an extension is written as "module:name"'),
    ("no_such_module_here:Shrinking", {}, "cannot be imported: No module named.*PYTHONPATH"),
    ("__main__:Shrinking", {}, "is in the script that runs"),
    ("{m}:Shrinkin", {}, "has no 'Shrinkin'; did you mean Shrinking"),
    ("{m}:number", {}, "is no part of a study: 3"),
    ("{m}:Positional", {}, "takes 'problem' by position alone"),
    ("{m}:Tagged", {}, "has the parameter 'name', which a study file uses itself"),
    ("{m}:ODM", {}, "has the name of a decision maker that is there already"),
    ("{m}:needs", {}, "needs level, but a study names measures alone"),
    ("{m}:Shrinking", {"decision_makers": "Shrinkin"}, "unknown 'Shrinkin'; did you mean Shrinking"),
    ("{m}:Shrinking", {"decision_makers": {"name": "Shrinking", "shar": 0.2}}, "there is no such key; did you mean share"),
    ("{m}:Shrinking", {"decision_makers": {"name": "Shrinking", "share": []}}, "should have at least 1 entry"),
    ("{m}:Shrinking", {"decision_makers": {"name": "Shrinking", "share": [0.1, 0.1]}}, "0.1 stands twice"),
    ("{m}:Shrinking", {"measures": ["error", "LastHidden"]}, "unknown 'LastHidden'"),
    ("{m}:Coin", {"world": {"kind": "Coin", "transition": [[1.0]]}}, "the key world.heads|the key heads is missing"),
    ("{m}:Coin", {"world": {"kind": "Coin", "heads": [0.5]}}, "the key transition is missing"),
    ("{m}:Coin", {"world": {"kind": "Coins", "heads": [0.5]}}, "unknown 'Coins'; did you mean Coin"),
    ("{m}:Shrinking", {"kind": "reproduction"}, "has no place for extensions"),
    ("json:decoder", {}, "is no part of a study"),
    ("sys:path", {}, "is no part of a study|has no source file"),
]  # fmt: skip


@pytest.mark.parametrize(("spec", "changes", "said"), WRONG_CALLS)
def test_wrong_extensions_are_refused_in_words(module, spec, changes, said):
    plain = {"name": "s", "world": {"kind": "random"}, "decision_makers": "ODM", "measures": "error"}
    asked = spec.replace("{m}", module) if isinstance(spec, str) else spec
    with pytest.raises(InputError, match=said):
        Study.of(plain | changes, extensions=[asked])


@pytest.mark.parametrize(
    "column", ["number", "task", "decision_maker", "adversary", "budget", "repeat", "seed", "status", "duration"]
)
def test_a_measure_is_not_called_as_a_column_of_the_rows(module, column):
    (Path(sys.path[0]) / f"{module}.py").write_text(f"{MODULE}\ndef {column}(mechanism): return 7.0\n")
    with pytest.raises(
        InputError, match=rf"{module}:{column} has the name of a column of the rows that is there already"
    ):
        Study.of(DATA | {"measures": ["error", column]}, extensions=own(module, *NAMES, column))


def test_a_part_that_fails_is_a_row_that_says_so(module, tmp_path):
    data = {
        "name": "s", "world": {"kind": "random"}, "beliefs": {"kind": "grid", "resolution": 3}, "candidates": {"resolution": 3},
        "decision_makers": ["ODM", "Failing"], "measures": ["error", "words"],
    }  # fmt: skip
    study = run_study(Study.of(data, extensions=own(module, "Failing", "words")), tmp_path / "out")
    told = "\n".join(study.errors())
    assert study.status().failed == 2
    assert "RuntimeError: no licence" in told
    assert "words: the value must be one number, got 'many'" in told
    with pytest.raises(InputError, match="two extensions are called 'firm'"):
        Study.of(data, extensions=[*own(module, "firm"), *own(module, "firm")])
    with pytest.raises(InputError, match="extensions must be a list"):
        Study.of(data, extensions=f"{module}:firm")
    broken = Path(sys.modules[module].__file__).with_name("broken_parts.py")
    broken.write_text("raise SystemExit(3)\n")
    with pytest.raises(InputError, match=r"broken_parts:x cannot be imported: SystemExit: 3"):
        Study.of(data, extensions=["broken_parts:x"])


def test_an_unknown_kind_hints_at_extensions():
    plain = {"name": "s", "beliefs": DATA["beliefs"], "decision_makers": "ODM", "world": {"kind": "random"}}
    for part in ("world", "problem"):
        with pytest.raises(InputError, match=r"unknown 'Gauge'.*--extension module:name"):
            Study.of({**plain, part: {"kind": "Gauge"}})
