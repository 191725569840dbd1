"""The package as a reader meets it: its front door, its versions, its citation, its requirements."""

from __future__ import annotations

import ast
import inspect
import json
import re
import subprocess
import sys
from importlib import import_module
from importlib.metadata import version
from pathlib import Path

import pytest

import inscrutable

ROOT = Path(__file__).resolve().parent.parent
FRONT_DOOR = ROOT / "src" / "inscrutable" / "__init__.py"
MOST_PARAMETERS = 7
MOST_OF_A_CLASS = 8
"""A constructor may take one more: its options are keyword-only."""
MOST_MODULES = 20


def in_fresh_python(code: str) -> str:
    """What `code` prints in a new interpreter."""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    return run.stdout


def parameters(thing: object) -> int:
    """How many parameters a caller sees, without `self`."""
    signature = inspect.signature(thing)  # type: ignore[arg-type]
    kinds = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    return sum(p.kind not in kinds and p.name != "self" for p in signature.parameters.values())


def public_methods(thing: object) -> list[tuple[str, object]]:
    """Methods and properties' getters that a public class defines itself."""
    if not inspect.isclass(thing):
        return []
    return [(name, each) for name, each in vars(thing).items() if not name.startswith("_") and inspect.isroutine(each)]


def test_all_is_sorted_and_complete() -> None:
    names = inscrutable.__all__
    assert names == sorted(set(names))
    assert set(names) == set(inscrutable._EXPORTS)
    assert set(names) <= set(dir(inscrutable))


def test_the_list_that_type_checkers_read_is_the_list() -> None:
    branch = next(node for node in ast.parse(FRONT_DOOR.read_text("utf-8")).body if isinstance(node, ast.If))
    imports = [node for node in branch.body if isinstance(node, ast.ImportFrom)]
    assert len(imports) == len(branch.body) == len(inscrutable.__all__), "one `from ... import Name as Name` a name"
    for node in imports:
        (alias,) = node.names
        assert alias.name == alias.asname, "write `import Name as Name`: it marks a re-export"
        assert inscrutable._EXPORTS[alias.name] == (node.module or "").removeprefix("inscrutable.")


def test_a_module_of_the_same_name_hides_no_function() -> None:
    code = """
import inscrutable.experiments.protect, inscrutable.experiments.comparison, inscrutable.reports.protect
from inscrutable import InvestorModel, attack_weights, compare, protect, reproduce, run_backtest
print(all(map(callable, (attack_weights, compare, inscrutable.protect, protect, reproduce, run_backtest))))
"""
    assert in_fresh_python(code).strip() == "True"


def test_public_names_resolve() -> None:
    for name in inscrutable.__all__:
        module = import_module(f"inscrutable.{inscrutable._EXPORTS[name]}")
        assert getattr(inscrutable, name) is getattr(module, name), name
        assert name in vars(inscrutable), f"a loaded name is kept: {name}"


def test_public_names_are_documented() -> None:
    for name in inscrutable.__all__:
        thing = getattr(inscrutable, name)
        text = vars(thing).get("__doc__") if inspect.isclass(thing) else thing.__doc__
        assert (text or "").strip(), f"{name} has no docstring of its own"
        if not (inspect.isclass(thing) and issubclass(thing, BaseException)):
            assert ">>> " in text, f"{name} shows no example"


def test_public_names_take_few_parameters() -> None:
    for name in inscrutable.__all__:
        thing = getattr(inscrutable, name)
        results = inspect.isclass(thing) and hasattr(thing, "summary")  # made by the library, not typed by a reader
        if callable(thing) and not results and not (inspect.isclass(thing) and issubclass(thing, BaseException)):
            most = MOST_OF_A_CLASS if inspect.isclass(thing) else MOST_PARAMETERS
            assert parameters(thing) <= most, f"{name} has {parameters(thing)} parameters"
        for method_name, method in public_methods(thing):
            function = method.__func__ if isinstance(method, (classmethod, staticmethod)) else method
            if inspect.isfunction(function):
                assert parameters(function) <= MOST_PARAMETERS, f"{name}.{method_name}"


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'inscrutable' has no attribute 'Decoder'"):
        inscrutable.Decoder  # type: ignore[attr-defined]  # noqa: B018
    with pytest.raises(ImportError, match="Decoder"):
        exec("from inscrutable import Decoder")


def test_importing_the_package_loads_itself_and_little_of_the_standard_library() -> None:
    """What an import costs, counted, so that it does not depend on how busy the machine is."""
    code = (
        "import json, sys; before = set(sys.modules); import inscrutable; print(json.dumps([*{*sys.modules} - before]))"
    )
    loaded = set(json.loads(in_fresh_python(code)))
    assert {name for name in loaded if name.split(".")[0] not in sys.stdlib_module_names} == {"inscrutable"}
    assert len(loaded) <= MOST_MODULES


def test_a_problem_is_made_without_compiled_kernels_tables_and_pictures() -> None:
    code = """
import json, sys
from inscrutable import HiddenMarkovModel, MarkowitzProblem, consistent_beliefs, simplex
assert "numpy" in sys.modules
problem = MarkowitzProblem([[0.2, 0.0], [0.0, 0.2]], [[[1, 0], [0, 1]]] * 2, 1.0)
print(json.dumps([m for m in ("numba", "pandas", "matplotlib", "pydantic", "joblib", "scipy.stats") if m in sys.modules]))
"""
    assert json.loads(in_fresh_python(code)) == []


def test_package_is_marked_as_typed() -> None:
    assert (FRONT_DOOR.parent / "py.typed").is_file()


def test_versions_agree() -> None:
    released = re.findall(r"^## \[(\d+\.\d+\.\d+)\] - (unreleased|\d{4}-\d{2}-\d{2})$", read("CHANGELOG.md"), re.M)
    assert released, "no entry of the form '## [1.2.3] - 2030-01-31'"
    assert released[0][0] == inscrutable.__version__
    assert version("inscrutable") == inscrutable.__version__
    assert re.findall(r"^version: (.+)$", read("CITATION.cff"), re.M) == [inscrutable.__version__]


def test_citation_has_what_the_format_requires_and_names_the_paper() -> None:
    text = read("CITATION.cff")
    assert "\t" not in text
    lines = [line for line in text.splitlines() if line.strip()]
    assert all(re.match(r" *(- )?[a-z-]+:( .+)?$| *- .+$| {2,}\S", line) for line in lines)
    top = [line.split(":")[0] for line in lines if not line.startswith(" ")]
    assert {"cff-version", "message", "title", "authors", "preferred-citation"} <= set(top)
    assert len(top) == len(set(top)), "a key stands twice"
    assert re.findall(r"family-names: (\w+)", text) == ["Lourenço", "Mattila", "Rojas", "Wahlberg"]
    assert "2004.04119" in text


def test_constraints_are_names_and_versions_only() -> None:
    lines = read("constraints.txt").splitlines()
    assert [line for line in lines if not re.fullmatch(r"[A-Za-z0-9._-]+==[A-Za-z0-9.]+", line)] == []
    names = [re.sub(r"[._-]+", "-", line.split("==")[0]).lower() for line in lines]
    assert len(names) == len(set(names)), "a package is pinned twice"
    assert "inscrutable" not in names


def test_every_requirement_is_pinned() -> None:
    import tomllib

    project = tomllib.loads(read("pyproject.toml"))
    extras = project["project"]["optional-dependencies"]
    wanted = [*project["project"]["dependencies"], *project["build-system"]["requires"]]
    wanted += [each for extra in extras for each in extras[extra]]
    names = {re.sub(r"[._-]+", "-", re.split(r"[<>=!~\[; ]", each)[0]).lower() for each in wanted}
    pinned = {re.sub(r"[._-]+", "-", line.split("==")[0]).lower() for line in read("constraints.txt").splitlines()}
    assert names - pinned == set()


def read(name: str) -> str:
    """A file of the project's root."""
    return (ROOT / name).read_text("utf-8")


ORDERED = ("problem", "measure", "budget", "decoy")
"""What a decision maker or an observer takes by position, in this order; every argument with a default beyond is named."""


def test_arguments_stand_in_one_order() -> None:
    """Of public decision makers and observers; whatever else has a default is keyword-only."""
    for name in inscrutable.__all__:
        kind = getattr(inscrutable, name)
        if not inspect.isclass(kind) or not name.endswith(("DecisionMaker", "Adversary")):
            continue
        given = [
            each for each in inspect.signature(kind).parameters.values() if each.kind == each.POSITIONAL_OR_KEYWORD
        ]
        places = [ORDERED.index(each.name) for each in given if each.name in ORDERED]
        assert places == sorted(places), name
        optional = [each.name for each in given if each.default is not each.empty]
        assert set(optional) <= set(ORDERED), f"{name}: {optional} should be keyword-only"
