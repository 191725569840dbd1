"""The rules of the source that neither ruff nor the type checker knows."""

from __future__ import annotations

import ast
import io
import re
import socket
import subprocess
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "inscrutable"
SOURCES = sorted(PACKAGE.rglob("*.py"))
MOST_LINES = 600
MOST_LINES_OF_A_FUNCTION = 60
# Folders of one machine. Paths inside an address (https://...) or a longer word do not count.
LOCAL_PATH = re.compile(r"(?<![\w.:/~-])/(?:home|Users|root|work|opt|mnt|tmp|srv|data)/[\w.-]")
FOREIGN = {".bz2", ".gz", ".npy", ".npz", ".png", ".svg", ".ico", ".woff2"}

each_source = pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(PACKAGE).as_posix())


def small_numbers(text: str) -> Iterator[tuple[int, str]]:
    """Line and literal of every number a tolerance could be; strings and comments do not count."""
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


@each_source
def test_module_has_a_docstring(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text("utf-8")))


@each_source
def test_files_and_functions_are_short(path: Path) -> None:
    text = path.read_text("utf-8")
    assert len(text.splitlines()) <= MOST_LINES
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            described = isinstance(node.body[0], ast.Expr) and isinstance(node.body[0].value, ast.Constant)
            start = node.body[0].end_lineno if described else node.lineno
            lines = (node.end_lineno or 0) - (start or 0)
            assert lines <= MOST_LINES_OF_A_FUNCTION, f"{node.name} (line {node.lineno}) has {lines} lines"


@each_source
def test_tolerances_have_one_home(path: Path) -> None:
    parts = path.relative_to(PACKAGE).parts
    if parts[0] not in ("tolerances.py", "kernels"):
        found = list(small_numbers(path.read_text("utf-8")))
        assert not found, f"small numbers belong in tolerances.py, each with its reason: {found}"


@each_source
def test_randomness_is_passed_in(path: Path) -> None:
    text = path.read_text("utf-8")
    drawn = re.findall(r"\bnp\.random\.(?!Generator\b|SeedSequence\b|default_rng\b|BitGenerator\b)\w+", text)
    assert not drawn, f"draw from a generator that the caller passes: {drawn}"


@each_source
def test_the_front_door_is_not_used_from_inside(path: Path) -> None:
    """`from inscrutable import Name` would pass every step at once and hide it from the import contract."""
    modules = {each.stem for each in PACKAGE.iterdir()}
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            assert "inscrutable" not in [alias.name for alias in node.names], f"line {node.lineno}"
        if isinstance(node, ast.ImportFrom) and node.module == "inscrutable":
            through = {alias.name for alias in node.names} - modules - {"__version__"}
            assert not through, f"import {sorted(through)} from the module that defines it (line {node.lineno})"


@each_source
def test_only_reports_draw(path: Path) -> None:
    parts = path.relative_to(PACKAGE).parts
    if parts[0] != "reports":
        drawing = re.findall(r"^\s*(?:import|from) (?:matplotlib|mpltern)\b.*", path.read_text("utf-8"), re.M)
        assert not drawing, "every picture is a function of reports"


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
    for path in SOURCES:
        for node in ast.parse(path.read_text("utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(path.name)
    assert {name: files for name, files in homes.items() if len(files) > 1} == {}
