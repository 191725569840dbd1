"""Documents tell the truth: their code runs, their commands print what is shown, their links lead somewhere.

In README.md, CONTRIBUTING.md, CHANGELOG.md and docs/, in the order of the page and in one empty folder per page:

* ```python blocks are executed, or compared as doctests where they have prompts; all of a page share their names.
  A ```text block that follows directly is what the code prints.
* ```console blocks: each `$ inscrutable ...` is run and the lines below it are compared with what it prints.
  `...` stands for anything, white space does not matter, no lines means that only success is asked.
  `$ make NAME` must be a target; other commands that set up a machine are only recognised.
* A word after the language changes that: `exit=3` is the expected exit code (errors are then compared too),
  `audit` leaves the block to `make audit`.

* The scripts of docs/concepts and examples/ run with warnings as errors. Pictures are painted, pages of results written and
  long calculations done in full only in `make audit`: there, in test_site.py, the pages of the scripts are made.
"""

from __future__ import annotations

import contextlib
import doctest
import io
import re
import runpy
import shlex
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

from inscrutable import cli
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem
from inscrutable.reports import backtest as backtest_reports
from small_runs import coarse_rivals, few_starts, learned_from_few, repeated_fits

ROOT = Path(__file__).resolve().parent.parent
MADE = ROOT / "docs" / "made"
PAGES = [ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")] + sorted(
    page for page in ROOT.glob("docs/**/*.md") if MADE not in page.parents
)
LONG_SCRIPTS = (
    "7_alphas.py",
    "7_over_time.py",
    "7_worth.py",
    "7_worth_to_others.py",
    "herding.py",
    "kelly_bettor.py",
)  # left to the pages that `make audit` makes
SCRIPTS = sorted(
    script
    for script in [*ROOT.glob("docs/concepts/*.py"), *ROOT.glob("examples/*.py")]
    if script.name not in LONG_SCRIPTS
)
FENCE = re.compile(r"^```(\w*)([^\n]*)\n(.*?)^```[ \t]*$", re.M | re.S)
LINK = re.compile(r"\]\((?!https?://|mailto:|#)([^)#\s]+)")
SET_UP = ("git", "cd", "pip", "python3", "source", "open")  # what a reader types before and after, not ours to run
OPTIONS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS

each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())


@dataclass(frozen=True)
class Block:
    """One fenced block of a page."""

    language: str
    words: tuple[str, ...]
    text: str
    line: int
    follows: bool  # nothing but white space since the block before

    @property
    def exit_code(self) -> int:
        """The exit code that the block announces."""
        return next((int(word.removeprefix("exit=")) for word in self.words if word.startswith("exit=")), 0)


def blocks_of(text: str) -> list[Block]:
    """All fenced blocks of a Markdown text, in order."""
    found, end = [], None
    for match in FENCE.finditer(text):
        follows = end is not None and not text[end : match.start()].strip()
        line = text.count("\n", 0, match.start()) + 2
        found.append(Block(match[1], tuple(match[2].split()), match[3], line, follows))
        end = match.end()
    return found


def commands_of(text: str) -> list[tuple[str, str]]:
    """Each command of a console block with the lines shown below it; a backslash continues a command."""
    parts = re.split(r"^\$ ", text, flags=re.M)
    assert not parts[0].strip(), "a console block starts with '$ '"
    pairs = [re.match(r"((?:[^\n]*\\\n)*[^\n]*)\n?(.*)", part, re.S) for part in parts[1:]]
    return [(pair[1].replace("\\\n", " "), pair[2]) for pair in pairs if pair]


def same(shown: str, printed: str, place: str) -> None:
    """Fail unless what a page shows is what was printed."""
    example = doctest.Example("", shown)
    checker = doctest.OutputChecker()
    if not checker.check_output(example.want, printed, OPTIONS):
        pytest.fail(f"{place}\n{checker.output_difference(example, printed, OPTIONS)}", pytrace=False)


def run_command(command: str, folder: Path) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of one of our commands, where its output is no terminal.

    It runs in this process, which has imported the package and loaded its kernels already; test_cli.py starts processes.
    Its warnings are said, as in a process of its own: only a page's Python is held to warn of nothing.
    """
    printed, errors = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(printed),
        contextlib.redirect_stderr(errors),
        warnings.catch_warnings(),
        pytest.MonkeyPatch.context() as settings,
    ):
        warnings.simplefilter("default")
        for name, value in {"MPLBACKEND": "Agg", "NO_COLOR": "1", "TERM": "dumb", "COLUMNS": "80"}.items():
            settings.setenv(name, value)
        code = cli.main(shlex.split(command)[1:])
    return code, printed.getvalue(), errors.getvalue()


def check_console(block: Block, page: str, folder: Path, *, audit: bool) -> None:
    """Run what is ours, recognise the rest, refuse what cannot be checked.

    Outside blocks of the audit no figure of an aware observer of a backtest is shown, who is a coarse one but in `make audit`.
    """
    for command, shown in commands_of(block.text):
        place = f"{page}:{block.line}: $ {command}"
        words = shlex.split(command)
        if words[0] == "inscrutable":
            with contextlib.nullcontext() if audit or words[1] != "backtest" else coarse_rivals():
                # Worker processes import the package first, for longer than they work.
                code, printed, errors = run_command(
                    command if audit else command.replace("--jobs 2", "--jobs 1"), folder
                )
            assert code == block.exit_code, f"{place}\nexit code {code}\n{errors}"
            if shown.strip():
                same(shown, printed + errors if block.exit_code else printed, place)
        elif words[0] == "make":
            targets = re.findall(r"^(\w+):", (ROOT / "Makefile").read_text("utf-8"), re.M)
            unknown = [word for word in words[1:] if "=" not in word and word not in targets]
            assert not unknown, f"{place}: no such target: {unknown}"
        else:
            assert words[0] in SET_UP, f"{place}: cannot be checked, so it cannot be promised"


def check_python(block: Block, page: str, names: dict[str, object]) -> str:
    """Execute a block in the page's names; returns what it printed."""
    if ">>> " in block.text:
        test = doctest.DocTestParser().get_doctest(block.text, names, page, page, block.line - 1)
        report = io.StringIO()
        failed, _ = doctest.DocTestRunner(optionflags=OPTIONS).run(test, out=report.write, clear_globs=False)
        names.update(test.globs)
        if failed:
            pytest.fail(report.getvalue(), pytrace=False)
        return ""
    code = compile("\n" * (block.line - 1) + block.text, page, "exec")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        exec(code, names)
    return printed.getvalue()


def check_page(text: str, page: str, folder: Path, *, audit: bool) -> None:
    """Run all blocks of a page in order."""
    names: dict[str, object] = {"__name__": "__main__"}
    printed = None
    for block in blocks_of(text):
        if "audit" in block.words and not audit:
            printed = None
        elif block.language in ("python", "pycon"):
            printed = check_python(block, page, names)
        elif block.language == "console":
            check_console(block, page, folder, audit=audit)
            printed = None
        elif block.language == "text" and block.follows and printed is not None:
            same(block.text, printed, f"{page}:{block.line}")
            printed = None


@pytest.fixture(scope="module")
def fitted_once() -> Iterator[None]:
    """Several pages begin with the same backtest, whose fit does not need all its starting points."""
    with repeated_fits(), few_starts():
        yield


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which a page runs; what the page adds to the places of imports is gone after it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return tmp_path


@each_page
@pytest.mark.usefixtures("undrawn", "unpaged", "fitted_once")
def test_page_runs(page: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(backtest_reports, "draw_backtest", lambda *_, **__: [])  # test_backtest_plots.py draws
    check_page(page.read_text("utf-8"), page.relative_to(ROOT).as_posix(), folder, audit=False)


@pytest.mark.audit
@each_page
def test_page_runs_with_its_long_commands_and_its_pictures(page: Path, folder: Path) -> None:
    check_page(page.read_text("utf-8"), page.relative_to(ROOT).as_posix(), folder, audit=True)


@pytest.mark.usefixtures("undrawn", "coarse")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.relative_to(ROOT).as_posix())
def test_script_runs(script: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Figure, "savefig", lambda figure, path, **_: Path(path).write_bytes(b""))
    with contextlib.redirect_stdout(io.StringIO()) as printed, learned_from_few():
        runpy.run_path(str(script), run_name="__main__")
    pyplot.close("all")
    assert printed.getvalue().strip()


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    text = FENCE.sub("", page.read_text("utf-8"))
    # What the build of the documents makes is followed there.
    written = [target for target in LINK.findall(text) if MADE not in (page.parent / target).parents]
    assert not [target for target in written if not (page.parent / target).exists()]


GOOD = """
```python
x = 2
print(x + 1)
```

```text
3
```

Some words.

```text
not compared
```

```python
>>> x * 2
4
```

```console
$ git clone somewhere
$ make test
```

```console audit
$ inscrutable takes-for-ever
```
"""


def test_a_page_without_code_passes(tmp_path: Path) -> None:
    check_page("# Title\n\nWords.\n", "page.md", tmp_path, audit=False)


def test_a_true_page_passes(tmp_path: Path) -> None:
    check_page(GOOD, "page.md", tmp_path, audit=False)


@pytest.mark.parametrize(
    ("true", "false"),
    [
        ("print(x + 1)", "print(x + 2)"),
        ("print(x + 1)", "print(y)"),
        (">>> x * 2\n4", ">>> x * 2\n5"),
        ("make test", "make tests"),
        ("git clone", "rm -rf"),
    ],
)
def test_a_false_page_fails(true: str, false: str, tmp_path: Path) -> None:
    assert true in GOOD
    with pytest.raises((AssertionError, NameError, OSError, pytest.fail.Exception)):
        check_page(GOOD.replace(true, false), "page.md", tmp_path, audit=False)


@pytest.mark.parametrize(
    ("answer", "words", "shown", "is_true"),
    [
        ((0, "privacy  0.61\n", "progress\n"), "", "", True),
        ((0, "privacy  0.61\n", "progress\n"), "", "privacy 0.61\n", True),
        ((0, "privacy  0.61\n", "progress\n"), "", "privacy ...\n", True),
        ((0, "privacy  0.61\n", "progress\n"), "", "privacy 0.62\n", False),
        ((3, "", "bad row 4\n"), "", "", False),
        ((3, "", "bad row 4\n"), " exit=3", "bad row 4\n", True),
        ((3, "", "bad row 4\n"), " exit=3", "bad row 5\n", False),
        ((0, "", ""), " exit=3", "", False),
        ((1, "", ""), " audit", "", True),
    ],
)
def test_commands_are_held_to_what_is_shown(
    answer: tuple[int, str, str],
    words: str,
    shown: str,
    is_true: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(globals(), "run_command", lambda command, folder: answer)
    page = f"```console{words}\n$ inscrutable attack\n{shown}```\n"
    verdict = contextlib.nullcontext() if is_true else pytest.raises((AssertionError, pytest.fail.Exception))
    with verdict:
        check_page(page, "page.md", tmp_path, audit=False)


def test_commands_are_read_with_their_output() -> None:
    assert commands_of("$ one \\\n    two\nthree\nfour\n$ five\n") == [("one      two", "three\nfour\n"), ("five", "")]


def test_contributing_names_what_a_new_class_must_write() -> None:
    page = " ".join((ROOT / "CONTRIBUTING.md").read_text("utf-8").split())
    measures, problems = page.split("## Adding a privacy measure ")[1].split("## Adding a decision problem ")
    required = problems.split("and write ")[1].split(";")[0]
    assert set(re.findall(r"`(\w+)`", required)) == DecisionProblem.__abstractmethods__ | {"constraints"}
    assert PrivacyMeasure.__abstractmethods__ == {"__call__"}
    assert measures.startswith("Derive a class from `PrivacyMeasure`")
    for name in re.findall(r"`([a-z]\w+)`", measures):
        assert hasattr(PrivacyMeasure, name), name
