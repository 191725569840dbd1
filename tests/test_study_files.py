"""Study files: every mistake is said with file, line, what was expected and the nearest valid name; lists make a grid."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel

from effort import at_most_calls
from inscrutable import Study, resume_study, run_study
from inscrutable.errors import InputError, InscrutableError
from inscrutable.experiments import rivals
from inscrutable.experiments.studies import layout
from inscrutable.experiments.studies.grid_tasks import GridRunner
from inscrutable.experiments.studies.reading import StudySource, checked_study
from inscrutable.experiments.studies.tasks import Work, chunk_of_rows
from inscrutable.experiments.toml_lines import key_lines
from sizes import instances, some

ROOT = Path(__file__).resolve().parent.parent
HEAD = 'name = "a"\ndecision_makers = ["ODM"]\n'
RANDOM = '[world]\nkind = "random"\n'
TWO_FARMS = '[world]\nkind = "given"\nmeans = [[5.0, 2.0]]\ncovariances = [[[4.0, 0.0], [0.0, 1.0]]]\n'


def sections() -> list[tuple[str, type[BaseModel], str]]:
    """Every section that a file may have: how it is opened, its model, and the lines it cannot do without."""
    found = []
    for header, models in {
        "[world]": (layout.GivenWorld, layout.RandomWorld, layout.FittedWorldSection),
        "[problem]": (layout.MarkowitzSection, layout.DispatchSection),
        "[beliefs]": (layout.GridBeliefs, layout.StationaryBeliefs, layout.PathBeliefs),
        "[candidates]": (layout.CandidateSection,),
        "[budgets]": (layout.BudgetSection,),
        "[rival]": (rivals.OwnRival, rivals.MarkowitzRival, rivals.FiniteRival, rivals.NamingRival),
        "[[decision_makers]]": get_args(layout.MakerSection),
        "[[adversaries]]": get_args(layout.ObserverSection),
    }.items():
        for model in models:
            tag = next((name for name in ("kind", "name") if name in model.model_fields), None)
            needs = ""
            if (
                tag is not None
                and get_args(model.model_fields[tag].annotation)
                and model is not layout.CandidateSection
            ):
                needs = f'{tag} = "{get_args(model.model_fields[tag].annotation)[0]}"\n'
            found.append((header, model, needs))
    return found


KEYS = [(header, needs, key) for header, model, needs in sections() for key in model.model_fields]
KEYS += [("", "", key) for key in layout.StudyFile.model_fields]


_SHORT = 3
"""Letters of names such as ODM, CDM and PDM, of which a slip in one may be as near to another."""


@st.composite
def misspelt(draw: st.DrawFn, word: str) -> str:
    """A word with one slip: a letter doubled, left out, or two swapped."""
    place = draw(st.integers(0, len(word) - 2))
    slips = (
        word[:place] + word[place] + word[place:],
        word[:place] + word[place + 1 :],
        word[:place] + word[place + 1] + word[place] + word[place + 2 :],
    )
    slip = draw(st.sampled_from(slips))
    assume(slip != word)
    return slip


def refused(text: str, folder: Path) -> str:
    path = folder / "study.toml"
    path.write_text(text, "utf-8")
    with pytest.raises(InscrutableError) as error:
        Study.read(path)
    assert str(error.value).startswith(f"{path}"), error.value
    return str(error.value).removeprefix(f"{path}")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("files")


@settings(max_examples=instances(100))
@given(st.sampled_from(KEYS), st.data())
def test_a_misspelt_key_is_named_with_its_line_and_the_right_one(
    folder: Path, place: tuple[str, str, str], data: st.DataObject
) -> None:
    header, needs, key = place
    slip = data.draw(misspelt(key))
    assume(slip not in {other for where, also, other in KEYS if (where, also) == (header, needs)})
    own = f"{header}\n{needs}{slip} = 1\n"
    if key in ("kind", "name") and needs.startswith(key):
        own = f"{header}\n{slip} = 1\n"
    before = HEAD if header != "[[decision_makers]]" else 'name = "a"\n'
    text = f"{before}{own}" if not header else f"{before}\n{own}{RANDOM if header != '[world]' else ''}"
    line = next(n for n, each in enumerate(text.splitlines(), 1) if each.startswith(f"{slip} ="))
    said = refused(text, folder)
    assert said.startswith(f", line {line}, key ")
    assert f"did you mean {key}?" in said


NAMES = {
    ("[world]", "kind"): ("given", "random", "fitted"),
    ("[[decision_makers]]", "name"): [
        str(get_args(each.model_fields["name"].annotation)[0]) for each in get_args(layout.MakerSection)
    ],
    ("[[adversaries]]", "name"): [
        str(get_args(each.model_fields["name"].annotation)[0]) for each in get_args(layout.ObserverSection)
    ],
    ("", "measures"): get_args(layout.Measure),
    ("[budgets]", "unit"): ("relative", "regret", "silence", "cost"),
}


@settings(max_examples=instances(100))
@given(st.sampled_from([(where, name) for where, names in NAMES.items() for name in names]), st.data())
def test_a_misspelt_name_is_answered_with_the_nearest(
    folder: Path, case: tuple[tuple[str, str], str], data: st.DataObject
) -> None:
    (header, key), name = case
    slip = data.draw(misspelt(name))
    assume(slip not in NAMES[header, key])
    before = HEAD if header != "[[decision_makers]]" else 'name = "a"\n'
    own = f'{header}\n{key} = "{slip}"\n'
    text = f"{before}{own}{RANDOM}" if header != "[world]" else f"{before}{own}"
    line = next(n for n, each in enumerate(text.splitlines(), 1) if slip in each and each.startswith(key))
    said = refused(text, folder)
    assert f", line {line}, " in said
    near = f"{name}?" if len(name) > _SHORT else ""
    assert f"did you mean {near}" in said


@pytest.mark.parametrize(
    ("text", "line", "told"),
    [
        (HEAD + "repeats = 0\n" + RANDOM, 3, "greater than or equal to 1"),
        (HEAD + "seed = 1.5\n" + RANDOM, 3, "whole number, got 1.5"),
        (HEAD + f"repeats = {10**20}\n" + RANDOM, 3, "expected at most 10,000,000"),
        (HEAD + RANDOM + "means = [0.2, 0.1]\n", 5, "a lowest and a highest value, got [0.2, 0.1]"),
        (HEAD + RANDOM + "means = [0.1, 0.2, 0.3]\n", 5, "at most 2 entries"),
        (HEAD + RANDOM + "volatilities = [0.0, 0.1]\n", 5, "greater than 0"),
        ('name = ""\n' + HEAD.partition("\n")[2] + RANDOM, 1, "at least one character"),
        ('world = "random"\n' + HEAD, 1, "a table of keys"),
        (HEAD + "adversaries = [3]\n" + RANDOM, 3, "a name, or a table with the key name, got 3"),
        (HEAD + RANDOM + "regimes = [2, 2]\n", 5, "2 stands twice"),
        (HEAD + RANDOM + "regimes = []\n", 5, "should have at least 1 entry, got []"),
        (HEAD + RANDOM + 'persistence = [0.5,\n "much"]\n', 6, "'much'"),
        (HEAD + RANDOM + 'persistence = [0.5, 1]\n[beliefs]\nkind = "stationary"\n', 5, "numbers below 1"),
        (HEAD + RANDOM + "[budgets]\nvalues = [0.1, -1.0]\n", 6, "greater than or equal to 0"),
        (HEAD + RANDOM + "[budgets]\nvalues = [inf]\n", 6, "finite"),
        (HEAD + RANDOM + '[problem]\nkind = "dispatch"\nwind_buses = [1]\n', 6, 'world of kind "given"'),
        (HEAD + '[world]\nkind = "fitted"\ndata = "no.csv"\n', 5, "cannot be read"),
        (HEAD + '[world]\nkind = "fitted"\ntrain_until = "soon"\n', 3, "such as 1989-12 or 1989-12-31, got 'soon'"),
        (HEAD + '[world]\nkind = "fitted"\nprices = true\n', 3, "holds returns"),
        (HEAD + '[world]\nkind = "fitted"\ncovariance = "factor:0"\n', 5, 'should be "sample", "ledoit-wolf" or'),
        (HEAD + '[world]\nkind = "fitted"\ndata = "\\u0000"\n', 5, "cannot be read"),
        (HEAD + TWO_FARMS + '[problem]\nkind = "dispatch"\nwind_buses = [1, 99]\n', 7, "has bus 99, expected 0 to 29"),
        (HEAD + '[world]\nkind = "given"\nmeans = [[1.0], [2.0, 3.0]]\ncovariances = []\n', 3, "same length"),
        (
            HEAD
            + '[world]\nkind = "given"\nmeans = [[1.0], [2.0]]\ncovariances = [[[1.0]], [[1.0]]]\n'
            + '[beliefs]\nkind = "path"\n',
            8,
            "transition",
        ),
        (
            'name = "a"\n[[decision_makers]]\nname = "CDM"\n[[decision_makers]]\nname = "ODM"\ngoal = "maximal"\n',
            6,
            "goal",
        ),
        (
            'name = "a"\n[[decision_makers]]\nname = "PDM"\ngoal = "reversed"\nmethod = "candidates"\n' + RANDOM,
            2,
            'knows the goal "maximal" alone',
        ),
    ],
)
def test_a_wrong_value_is_named_with_its_line(folder: Path, text: str, line: int, told: str) -> None:
    said = refused(text, folder)
    assert said.startswith(f", line {line}, "), said
    assert told in said


def test_what_is_no_study_is_refused(tmp_path: Path) -> None:
    assert "line 1" in refused("name = \n", tmp_path)
    assert "world is missing; expected one of: given, random, fitted" in refused(HEAD, tmp_path)
    assert "decision_makers is missing; expected one of: ODM, CDM" in refused('name = "a"\n' + RANDOM, tmp_path)
    assert refused(HEAD + RANDOM + 'a = 1\n[budgets]\nunit = "b"\n', tmp_path).endswith("(and 1 more mistake)")
    with pytest.raises(InputError, match="is a folder, expected a study file"):
        Study.read(tmp_path)
    with pytest.raises(InputError, match="cannot be read"):
        Study.read(tmp_path / "none.toml")
    assert "is not TOML" in refused(f"name = {'9' * 5000}", tmp_path)
    (tmp_path / "study.toml").write_text(f"\ufeff{HEAD}{RANDOM}", "utf-8")
    assert Study.read(tmp_path / "study.toml").plan.name == "a"  # some editors begin a file with this mark
    (tmp_path / "study.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(InputError, match="UTF-8"):
        Study.read(tmp_path / "study.toml")
    with pytest.raises(InputError, match="table of keys"):
        checked_study([], StudySource("study"))


def test_lines_of_keys_in_every_notation() -> None:
    text = (
        '# [no] table\r\na = """x\n[b]\n""" # c = 1\n"d e".f = {g = [1, # 2\n {h = \'i\'}], j.k = 2}\n'
        "[[l]]\n[[l.m]]\nn = 1979-05-27 07:32:00\n[[l]]\n[l.m]\no = 1\n"
    )
    tomllib.loads(text)
    assert key_lines(text) == {
        ("a",): 2,
        ("d e",): 5,
        ("d e", "f"): 5,
        ("d e", "f", "g"): 5,
        ("d e", "f", "g", 0): 5,
        ("d e", "f", "g", 1): 6,
        ("d e", "f", "g", 1, "h"): 6,
        ("d e", "f", "j"): 6,
        ("d e", "f", "j", "k"): 6,
        ("l",): 7,
        ("l", 0): 7,
        ("l", 0, "m"): 8,
        ("l", 0, "m", 0): 8,
        ("l", 0, "m", 0, "n"): 9,
        ("l", 1): 10,
        ("l", 1, "m"): 11,
        ("l", 1, "m", "o"): 12,
    }


def plan(**changes: Any) -> dict[str, Any]:
    return {"name": "a", "world": {"kind": "random"}, "decision_makers": ["ODM", "PDM"]} | changes


def test_lists_make_a_grid_and_who_spends_nothing_has_no_budgets() -> None:
    study = Study.of(
        plan(
            repeats=3,
            world={"kind": "random", "persistence": [0.5, 0.9], "assets": [3, 4]},
            decision_makers=[
                "ODM",
                {"name": "PDM", "goal": ["maximal", "reversed"]},
                {"name": "coin", "probability": 0.1},
            ],
            budgets={"values": [0.1, 0.2, 0.3]},
            adversaries=["naive", "bayesian"],
        )
    )
    assert study.n_tasks == 2 * 2 * 3 * (1 + 2 * 3 + 1) * 2
    tasks = [study.grid.task(number) for number in range(study.n_tasks)]
    assert len({task.key for task in tasks}) == len(tasks)
    assert [task.number for task in tasks] == list(range(len(tasks)))
    assert {(task.parameters["decision_maker"]["name"], task.parameters["budget"] is None) for task in tasks} == {
        ("ODM", True),
        ("PDM", False),
        ("coin", True),
    }


def test_an_identity_hangs_on_the_task_alone() -> None:
    small = Study.of(plan(budgets={"values": [0.1]}))
    large = Study.of(
        plan(budgets={"values": [0.3, 0.1]}, decision_makers=["uniform", "PDM", "ODM"], repeats=2, note="b")
    )
    keys = {large.grid.task(number).key for number in range(large.n_tasks)}
    assert {small.grid.task(number).key for number in range(small.n_tasks)} <= keys
    task = small.grid.task(1)
    again = next(t for t in map(large.grid.task, range(large.n_tasks)) if t.key == task.key)
    assert again.number != task.number
    assert (small.grid.seed(task.text).generate_state(4) == large.grid.seed(again.text).generate_state(4)).all()


@pytest.mark.parametrize(
    ("kind", "swept", "few", "many"),
    [
        ("alphas", "budgets", [0.5], [0.1, 0.5, 0.9]),
        ("alphas", "objectives", ["error"], ["information", "error"]),
        ("masked basket", "shown", ["value", "kept mask"], ["fresh mask", "kept mask", "value"]),
    ],
)
def test_the_draws_of_a_task_do_not_hang_on_the_others(kind: str, swept: str, few: list[Any], many: list[Any]) -> None:
    seeds = []
    for values, repeats in ((few, 1), (many, 2)):
        grid = Study.of({"kind": kind, "name": "a", swept: values, "repeats": repeats}).grid
        tasks = [grid.task(number) for number in range(len(grid))]
        seeds.append({task.key: grid.task_seed(task).generate_state(4).tolist() for task in tasks})
    assert seeds[0].items() <= seeds[1].items()
    assert len({str(each) for each in seeds[1].values()}) == len(seeds[1])


def test_a_rows_seed_is_its_tasks_own() -> None:
    study = Study.of(plan(repeats=2))
    rows = chunk_of_rows(Work(GridRunner, study.plan.model_dump_json(), None, "[]"), some(range(study.n_tasks), 3))
    expected = [study.grid.task_seed(study.grid.task(row.number)).generate_state(1, np.uint64)[0] for row in rows]
    assert [row.seed for row in rows] == [str(seed) for seed in expected]


def test_whole_numbers_and_fractions_of_one_value_are_one_task() -> None:
    one, other = (Study.of(plan(problem={"risk_aversion": value})) for value in (5, 5.0))
    assert one.grid.task(0).key == other.grid.task(0).key


def test_decision_makers_share_a_market_and_repeats_do_not() -> None:
    grid = Study.of(plan(repeats=2)).grid
    first, second, other = (grid.task(number) for number in (0, 1, 2))
    draws = [grid.stream("world", each.places, ("world", "repeat")).random() for each in (first, second, other)]
    assert draws[0] == draws[1] != draws[2]


def test_all_risk_aversions_of_a_study_have_the_same_markets() -> None:
    """Which have a positive optimal cost at the least of them. Other markets than a study of one value has are other tasks."""
    study = Study.of(plan(problem={"risk_aversion": [5.0, 1.0, 20.0]}, repeats=4))
    runner = GridRunner(Work(GridRunner, study.plan.model_dump_json(), None, "[]"))
    for repeat in range(4):
        one, *others = (runner.setting((0, place, 0, 0, repeat)).problem for place in (1, 0, 2))
        assert one.risk_aversion == 1.0 < others[0].risk_aversion
        assert one.optimal_cost(np.eye(one.n_states)).min() > 0.0
        for other in others:
            np.testing.assert_array_equal(other.means, one.means)
            np.testing.assert_array_equal(other.covariances, one.covariances)
    alone = Study.of(plan(problem={"risk_aversion": 5.0})).grid
    assert "risk_aversion" not in alone.task(0).parameters["world"]
    assert alone.task(0).key != study.grid.task(0).key


@pytest.mark.parametrize("path", sorted(ROOT.glob("studies/*.toml")), ids=lambda path: path.stem)
def test_a_shipped_study_says_how_it_is_run_and_how_long(path: Path) -> None:
    top = "\n".join(path.read_text("utf-8").splitlines()[:2])
    assert f"inscrutable study run studies/{path.name} --out" in top
    assert re.search(r"second|minute", top)
    assert Study.read(path).n_tasks > 20


def test_what_no_study_holds_is_refused_at_once(tmp_path: Path) -> None:
    file = tmp_path / "study.toml"
    for text in (f"seed = {'9' * 10_000}", ".".join(["a"] * 50_000) + " = 1", "[" + " . ".join(['"a"'] * 50_000) + "]"):
        file.write_text(HEAD + text + "\n")
        with pytest.raises(InputError, match=r"not TOML|more than 32 parts"), at_most_calls(10_000):
            Study.read(file)
    file.write_text(HEAD + "".join(f"world.k{i} = {i}\n" for i in range(5000)))
    with pytest.raises(InputError, match="line 3, key world"), at_most_calls(1_000_000):  # 350,000 when written
        Study.read(file)


@pytest.mark.parametrize("wrong", [{"name": "a"}, None, 3, ["a.toml"]], ids=repr)
def test_what_is_no_study_and_no_path_is_refused(tmp_path: Path, wrong: Any) -> None:
    for ask in (lambda: run_study(wrong, tmp_path), lambda: resume_study(wrong), lambda: Study.load(wrong)):
        with pytest.raises(InputError, match=r"Study\.of|by its path"):
            ask()


@pytest.mark.parametrize(
    ("change", "where", "fits"),
    [
        ({"world": {"kind": "random", "regimes": 200_000}}, "world.regimes", r"at most 11,5\d\d"),
        ({"world": {"kind": "random", "assets": 10**8}}, "world.assets", r"at most 6,688"),
        ({"beliefs": {"kind": "grid", "resolution": 5000}}, "beliefs.resolution", r"at most 2,0\d\d"),
        (
            {"beliefs": {"kind": "stationary", "resolution": 100_000}, "decision_makers": ["ODM", "rate-distortion"]},
            "beliefs.resolution",
            r"at most \d{2,5}",
        ),
        ({"candidates": {"resolution": 10**9}}, "candidates.resolution", "at most "),
        (
            {"world": {"kind": "random", "regimes": 10**8}, "beliefs": {"kind": "grid", "resolution": 10**8}},
            "world",
            "",
        ),
        ({"beliefs": {"kind": "path", "steps": 10**12}}, "beliefs.steps", "at most "),
        ({"repeats": 10**12}, "repeats", "at most 10,000,000"),
        (
            {"decision_makers": [{"name": "Dirichlet noise", "draws": 10**12}]},
            r"decision_makers\[0\].draws",
            "at most ",
        ),
    ],
)
def test_sizes_beyond_any_memory_are_refused_at_once(change: dict[str, Any], where: str, fits: str) -> None:
    with pytest.raises(InputError, match=rf"key {where}.*{fits}"), at_most_calls(20_000):  # 900 when written
        Study.of(plan(**change))


@pytest.mark.parametrize(
    ("key", "listed", "number"),
    [
        ("decision_makers", ["ODM", "PDM", "ODM"], 2),
        ("decision_makers", [{"name": "coin", "probability": 0.1}, {"name": "coin", "probability": 0.1}], 1),
        ("adversaries", ["naive", "naive"], 1),
    ],
)
def test_what_is_listed_twice_is_refused(key: str, listed: list[Any], number: int) -> None:
    with pytest.raises(InputError, match=rf"{key}\[{number}\].*is listed twice with the same options"):
        Study.of(plan(**{key: listed}))
    others = [{"name": "coin", "probability": 0.1}, {"name": "coin", "probability": 0.2}]
    assert Study.of(plan(decision_makers=others)).n_tasks > 0


def test_what_is_said_to_fit_is_accepted() -> None:
    with pytest.raises(InputError) as refused:
        Study.of(plan(beliefs={"kind": "grid", "resolution": 5000}))
    largest = int(re.findall(r"at most ([\d,]+)", str(refused.value))[0].replace(",", ""))
    assert Study.of(plan(beliefs={"kind": "grid", "resolution": largest})).n_tasks > 0
    with pytest.raises(InputError):
        Study.of(plan(beliefs={"kind": "grid", "resolution": largest + 1}))
