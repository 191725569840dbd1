"""The rules of the source that neither ruff nor the type checker knows."""

from __future__ import annotations

import ast
import gc
import io
import re
import socket
import subprocess
import tokenize
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "inscrutable"
SOURCES = sorted(PACKAGE.rglob("*.py"))
MOST_LINES = 600
MOST_LINES_OF_A_FUNCTION = 60
# Folders of one machine. Paths inside an address (https://...) or a longer word do not count.
LOCAL_PATH = re.compile(r"(?<![\w.:/~-])/(?:home|Users|root|work|opt|mnt|tmp|srv|data)/[\w.-]")
DRAWS = re.compile(r"\bnp\.random\.(?!Generator\b|SeedSequence\b|default_rng\b|BitGenerator\b)\w+")
DRAWING = re.compile(r"^\s*(?:import|from) (?:matplotlib|mpltern)\b.*", re.M)
MAY_BE_SMALL = re.compile(r"[\d.]e-|\.[0_]{4}", re.I)  # tokens take longer to find
HOMES = ("tolerances.py", "kernels")  # of small numbers
FOREIGN = {".bz2", ".gz", ".npy", ".npz", ".png", ".svg", ".ico", ".woff2"}

TEXTS = {path: path.read_text("utf-8") for path in SOURCES}


@cache
def trees() -> dict[Path, ast.Module]:
    """The parsed sources; only the process that runs these tests parses them. They are no garbage to look for meanwhile."""
    gc.disable()
    try:
        return {path: ast.parse(text) for path, text in TEXTS.items()}
    finally:
        gc.enable()


def place(path: Path, line: int = 1) -> str:
    """Where something stands, as an editor opens it."""
    return f"{path.relative_to(PACKAGE).as_posix()}:{line}"


def small_numbers(text: str) -> Iterator[tuple[int, str]]:
    """Line and literal of every number a tolerance could be; strings and comments do not count."""
    if not MAY_BE_SMALL.search(text):
        return
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.NUMBER and re.fullmatch(r"[\d._]+([eE][+-]?\d+)?", token.string):
            is_small = 0 < abs(float(token.string)) < 1e-4
            if is_small or "e-" in token.string.lower():
                yield token.start[0], token.string


def shared_files() -> list[Path]:
    """The files that git keeps or would keep."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    try:
        listing = subprocess.run(command, cwd=ROOT, capture_output=True, check=True, text=True).stdout
    except (OSError, subprocess.CalledProcessError):
        pytest.skip("not a git checkout")
    return [ROOT / name for name in listing.split("\0") if name and (ROOT / name).is_file()]


def test_the_rules_see_the_source() -> None:
    assert PACKAGE / "tolerances.py" in SOURCES
    found = [number for _, number in small_numbers("x = 1e-9  # 1e-3\ny = '1e-8' + 0.00001 + 0.5 + 1E-2\n")]
    assert found == ["1e-9", "0.00001", "1E-2"]
    assert LOCAL_PATH.search("see " + "/".join(["", "home", "jane", "x.csv"]))
    assert not LOCAL_PATH.search("https://example.org/home/jane and ../work/x")


def test_modules_have_a_docstring() -> None:
    assert [place(path) for path, tree in trees().items() if not ast.get_docstring(tree)] == []


def test_no_constant_is_stated_twice() -> None:
    """The second value would count everywhere."""
    twice = []
    for path, tree in trees().items():
        stated = [node.targets[0] for node in tree.body if isinstance(node, ast.Assign)]
        names = [name.id for name in stated if isinstance(name, ast.Name)]
        twice += [f"{place(path)} {name}" for name in sorted({name for name in names if names.count(name) > 1})]
    assert twice == []


def test_files_are_short() -> None:
    assert [place(path) for path, text in TEXTS.items() if len(text.splitlines()) > MOST_LINES] == []


def lines_of(node: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Lines of a function below its docstring."""
    described = isinstance(node.body[0], ast.Expr) and isinstance(node.body[0].value, ast.Constant)
    start = node.body[0].end_lineno if described else node.lineno
    return (node.end_lineno or 0) - (start or 0)


def test_functions_are_short() -> None:
    functions = [
        (path, node)
        for path, tree in trees().items()
        for node in ast.walk(tree)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))
    ]
    assert len(functions) > len(SOURCES)
    long = [
        f"{place(path, node.lineno)} {node.name}"
        for path, node in functions
        if lines_of(node) > MOST_LINES_OF_A_FUNCTION
    ]
    assert long == []


def test_tolerances_have_one_home() -> None:
    others = {path: text for path, text in TEXTS.items() if path.relative_to(PACKAGE).parts[0] not in HOMES}
    found = [f"{place(path, line)} {number}" for path, text in others.items() for line, number in small_numbers(text)]
    assert not found, f"small numbers belong in tolerances.py, each with its reason: {found}"


def test_randomness_is_passed_in() -> None:
    drawn = [f"{place(path)} {draw}" for path, text in TEXTS.items() for draw in DRAWS.findall(text)]
    assert not drawn, f"draw from a generator that the caller passes: {drawn}"


def front_door_imports(tree: ast.Module, modules: set[str]) -> Iterator[tuple[int, list[str]]]:
    """Line and names of what is imported from `inscrutable` itself."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import) and "inscrutable" in [alias.name for alias in node.names]:
            yield node.lineno, ["inscrutable"]
        if isinstance(node, ast.ImportFrom) and node.module == "inscrutable":
            through = {alias.name for alias in node.names} - modules - {"__version__"}
            if through:
                yield node.lineno, sorted(through)


def test_the_front_door_is_not_used_from_inside() -> None:
    """`from inscrutable import Name` would pass every step at once and hide it from the import contract."""
    modules = {each.stem for each in PACKAGE.iterdir()}
    found = [
        f"{place(path, line)} {names}"
        for path, tree in trees().items()
        for line, names in front_door_imports(tree, modules)
    ]
    assert not found, f"import from the module that defines it: {found}"


def test_only_reports_draw() -> None:
    others = {path: text for path, text in TEXTS.items() if path.relative_to(PACKAGE).parts[0] != "reports"}
    drawing = [f"{place(path)} {line.strip()}" for path, text in others.items() for line in DRAWING.findall(text)]
    assert not drawing, f"every picture is a function of reports: {drawing}"


def test_the_rules_see_what_they_forbid() -> None:
    assert DRAWS.findall("np.random.normal(3); np.random.default_rng(0)") == ["np.random.normal"]
    assert DRAWING.findall("    import matplotlib.pyplot as plt\n") != []
    tree = ast.parse("import inscrutable\nfrom inscrutable import Budget, budgets\nfrom inscrutable.x import y\n")
    assert list(front_door_imports(tree, {"budgets"})) == [(1, ["inscrutable"]), (2, ["Budget"])]
    function = ast.parse('def f():\n    """Says.\n\n    More.\n    """\n    x = 1\n    return x\n').body[0]
    assert isinstance(function, ast.FunctionDef)
    assert lines_of(function) == 2


def test_nothing_shared_names_a_machine() -> None:
    host = socket.gethostname()
    # A short or one-level name ("main", "/src") could stand in any text.
    telling = [str(place) for place in (ROOT, Path.home()) if len(place.parts) > 2]
    telling += [host] if len(host) > 5 and re.search(r"\d", host) else []
    here = re.compile("|".join(rf"(?<![\w/.]){re.escape(name)}(?!\w)" for name in telling) or r"(?!)")
    found = []
    for path in shared_files():
        if path.suffix in FOREIGN:
            continue
        for number, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), start=1):
            if LOCAL_PATH.search(line) or here.search(line):
                found.append(f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}")
    assert not found, "\n".join(found)


def test_a_public_class_has_a_name_of_its_own() -> None:
    homes: dict[str, list[str]] = {}
    for path, tree in trees().items():
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(path.name)
    assert {name: files for name, files in homes.items() if len(files) > 1} == {}
