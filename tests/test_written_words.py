"""Public text uses the field's terms: words of this project's own do not occur, or are defined where they are used.

Public text is README, CHANGELOG, CONTRIBUTING and the pages of docs/, the sources of the story and the examples, the
documentation of public names, and the texts in the code that readers see: errors, summaries, help, pages.
"""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

import inscrutable

ROOT = Path(__file__).resolve().parent.parent
SOURCE = ROOT / "src" / "inscrutable"
PAGES = [ROOT / name for name in ("README.md", "CHANGELOG.md", "CONTRIBUTING.md")]
PAGES += sorted(page for page in ROOT.glob("docs/*.md"))
NAMES = [name for name in dir(inscrutable) if not name.startswith("_")]
SCRIPTS = sorted([*ROOT.glob("docs/concepts/*.py"), *ROOT.glob("examples/*.py")])

# What is searched for, and the field's word. Each exception stands with its reason.
OWN_WORDS = {
    r"\bfaces?\b": "critical region",
    r"\batlas\b": "partition",
    r"\bplanes?\b": "critical region",
    r"\bseams?\b": "boundary",
    r"\bleaf\b": "cluster",
    r"\bsettl(e|es|ed|ing)\b": "converge; KKT solve on the active set",
    r"\bclimb(s|ed|ing)?\b": "projected Newton step; local search",
    r"\bscene\b|\bseats?\b": "workspace",
    r"\bfelt\b": "active",
    r"\bin reach\b": "nearly active",
    r"\blargest-error maker\b": "persuasion with commitment; Stackelberg",
    r"\bbends?\b": "curvature; strictly convex; kink; breakpoint",
    r"\bwoven\b": "inline",
    r"\blots\b|\bby lot\b": "randomised decision; samples",
    r"\bluck\b": "other draws; control variate",
    r"\bless what [^.]* explain": "control variate",
    r"\b[Oo]ne decision is not a career\b": "leakage accumulates over repeated decisions",
    r"\bhow much farther\b": "by how much larger",
    r"\b(bits|rule) told\b|\btold from honest\b": "leakage in bits; detectability",
    r"\bwhatever the (order, the )?company\b": "whatever the other beliefs",
    r"\b(hears|boasts|nobody's|half-hearted)\b": "a plain verb",
    r"\b(one|rival|observer|adversary) (who |also )*knows? (the rules?|the method|the mechanism)\b": "aware observer",
    r"\b(aware|informed|naive) (adversary|rival|attacker)\b": "aware observer; naive observer",
}
EXCEPTIONS = {
    "face value": "the common word for the naive observer's premise",
    "faces of the simplex": "the field's word for parts of a polytope's boundary",
    "its faces": "the same",
    "of a face": "the same",
    "faces: For linear": "an argument's name in `decoy_grid`",
    "faces=True": "the same",
    "`faces`": "the same",
    "cutting planes": "the field's word",
    "cutting plane": "the field's word",
    "cutting-plane": "the field's word",
    "| aware adversary, informed adversary": "the glossary's table of other names",
    "| naive adversary, a rival": "the same",
    '"a rival who knows the rule"': "what a user of 0.1 replaces",
    "`bits told`": "the same",
    "`told from honest, AUC`": "the same",
    "`…, rule told`": "the same",
}
# Not searched for: line, pattern, here, ground, bench, told, column, price, part, bare, whole and draw have uses of their
# own in public text (lines of a file or a network, prices of a dual programme, the whole of a table).

# Words that stay, and what defines them where they occur first on a page.
DEFINED = {
    r"[Dd]ecoy": r"[Dd]ecoys?\b[^.]{0,120}belief|beliefs?\b[^.]{0,120}decoy|\{term\}`decoy|glossary",
    r"silence regret": r"value of (the )?information|constant (decision|portfolio)|glossary",
    r"price of privacy": r"one more unit of (privacy|it)|glossary",
    r"plausibility gap": r"inverse-optimality|least regret|glossary",
    r"\blottery\b": r"randomised|glossary",
}
TERMS = (
    "observation model",
    "randomised mechanism",
    "privacy-utility trade-off",
    "aware observer",
    "naive observer",
    "decoy",
)


_EXCEPTED = re.compile("|".join(map(re.escape, EXCEPTIONS)), re.I)


def _found(text: str) -> list[str]:
    text = _EXCEPTED.sub("", re.sub(r"\s+", " ", text))
    return [
        f"…{text[max(0, match.start() - 40) : match.end() + 40]}… → {term}"
        for pattern, term in OWN_WORDS.items()
        for match in re.finditer(pattern, text)
    ]


def _documented() -> Iterator[tuple[str, str]]:
    """The documentation of every public name, and of the public members of public classes that are this package's."""
    for name in NAMES:
        member = getattr(inscrutable, name)
        if inspect.ismodule(member):
            continue
        yield name, inspect.getdoc(member) or ""
        if inspect.isclass(member):
            for own, each in vars(member).items():
                if not own.startswith("_"):
                    yield f"{name}.{own}", inspect.getdoc(each) or ""


@cache
def _texts_in_code() -> tuple[tuple[str, str], ...]:
    """Texts of several words in the code that are no documentation: errors, summaries, tables, pages, help."""
    found = []
    for path in sorted(SOURCE.rglob("*.py")):
        if "kernels" in path.parts:  # no texts that readers see
            continue
        documentation, shown = set(), path.name == "cli.py" or path.name.startswith("cli_")  # help is documentation
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):  # a statement comes before what it holds
            if isinstance(node, ast.Expr) and not shown:
                documentation.add(node.value)
            if not isinstance(node, ast.Constant) or node in documentation:
                continue
            if isinstance(node.value, str) and " " in node.value.strip():
                found.append((f"{path.relative_to(SOURCE)}:{node.lineno}", node.value))
    for path in sorted(SOURCE.rglob("*.toml")) + sorted(SOURCE.rglob("assets/*")):
        found.append((str(path.relative_to(SOURCE)), path.read_text("utf-8")))
    return tuple(found)


@pytest.mark.parametrize("page", [*PAGES, *SCRIPTS], ids=lambda page: page.relative_to(ROOT).as_posix())
def test_pages_use_the_terms_of_the_field(page: Path) -> None:
    assert _found(page.read_text("utf-8")) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_words_that_stay_are_defined_on_every_page(page: Path) -> None:
    text = re.sub(r"\s+", " ", page.read_text("utf-8"))
    missing = [word for word, meaning in DEFINED.items() if re.search(word, text) and not re.search(meaning, text)]
    assert missing == []


def test_documentation_of_public_names_uses_the_terms_of_the_field() -> None:
    found = [f"{name}: {each}" for name, text in _documented() for each in _found(text)]
    assert found == []


def test_texts_of_the_code_use_the_terms_of_the_field() -> None:
    found = [f"{place}: {each}" for place, text in _texts_in_code() for each in _found(text)]
    assert found == []


def test_no_public_name_is_a_word_of_this_project() -> None:
    own = {"Met", "Kept", "Picked", "Hiding", "Spot", "Shop", "Workshop", "Ways", "Terms", "Play"}
    assert not own & set(NAMES)


def test_terms_that_a_reader_searches_for_are_in_the_glossary() -> None:
    entries = re.findall(r"^([^\s`{|#].*)$", (ROOT / "docs" / "glossary.md").read_text("utf-8"), re.M)
    assert set(TERMS) <= set(entries)


def test_a_word_of_this_project_is_found() -> None:
    assert _found("The search climbs on\na face.") != []
    assert _found("A rival who knows the rule reads it at face value.") != []
    assert _found("The naive observer takes it at face value; a cutting plane.") == []
