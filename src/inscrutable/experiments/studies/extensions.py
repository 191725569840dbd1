"""Parts of a study that a user wrote: named by the caller as "module:name", known by version and source, imported to work.

A study file only uses the names; the caller of the study names the module, never a file. The rows are kept with all that is
needed to read them, so that results are read without importing anything.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import sys
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from difflib import get_close_matches
from functools import lru_cache
from hashlib import sha256
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from inscrutable.axes import few
from inscrutable.errors import InputError
from inscrutable.privacy import PrivacyMeasure
from inscrutable.problems import DecisionProblem

MEASURE, MAKER, OBSERVER, PROBLEM, EMISSION = "measure", "decision maker", "observer", "problem", "emission"
GIVEN: Mapping[str, tuple[str, ...]] = {
    MEASURE: ("mechanism", "prior", "problem"),
    MAKER: ("problem", "budget", "prior", "candidates", "rng"),
    OBSERVER: ("problem", "prior", "mechanism", "regret"),
    PROBLEM: ("means", "covariances"),
    EMISSION: (),
}
"""Parameters that a study fills in, by kind; every other parameter is a key of the study file."""

_NOT_OWN = {"inscrutable", *sys.stdlib_module_names}
"""Packages whose sources are not a user's: a part that is imported from another module changes where that one does."""
_SPEC = re.compile(r"[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*:[A-Za-z_]\w*")
_PLAIN = (bool, int, float, str)


@dataclass(frozen=True)
class Extension:
    """A user-defined part, as plain data.

    Args:
        spec: Its place, "module:name".
        kind: Its kind: "measure", "decision maker", "observer", "problem" or "emission".
        given: Parameters that the study fills in.
        needed: Parameters that a study file must set.
        defaults: Parameters that it may set; a list is swept where the default is a number, a text or a boolean.
        meaning: The first line of its documentation.
        sign: 1 for a measure that grows with privacy, else 0.
        sha256: The hash of its source and of all that it refers to in the module that defines it.
        version: The version of the module or of its distribution; empty if neither states one.
    """

    spec: str
    kind: str
    given: tuple[str, ...] = ()
    needed: tuple[str, ...] = ()
    defaults: Mapping[str, Any] = field(default_factory=dict)
    meaning: str = ""
    sign: int = 0
    sha256: str = ""
    version: str = ""

    @property
    def name(self) -> str:
        """Its name in a study file."""
        return self.spec.partition(":")[2]

    def __hash__(self) -> int:
        return hash((self.spec, self.sha256))


def extensions_of(specs: Iterable[str]) -> tuple[Extension, ...]:
    """Return the extensions that a caller names, in that order.

    Raises:
        InputError: A name is malformed, cannot be imported, is no part of a study, or is given twice.
    """
    if isinstance(specs, str):
        raise InputError(f'extensions must be a list such as ["module:name"], got the text {specs!r}')
    found: dict[str, Extension] = {}
    for spec in specs:
        each = _described(spec)
        if each.name in found:
            raise InputError(f"two extensions are called {each.name!r}: {found[each.name].spec} and {each.spec}")
        found[each.name] = each
    return tuple(found.values())


def as_text(extensions: Iterable[Extension]) -> str:
    """Return extensions as JSON."""
    return json.dumps([asdict(each) for each in extensions])


@lru_cache(maxsize=8)
def from_text(text: str) -> tuple[Extension, ...]:
    """Return extensions of JSON; nothing is imported."""
    lists = ("given", "needed")
    return tuple(Extension(**each | {name: tuple(each[name]) for name in lists}) for each in json.loads(text))


def checked_again(kept: tuple[Extension, ...], specs: Iterable[str], plan: str) -> None:
    """Raise `InputError` unless the caller names the kept extensions, and none that the plan (JSON) uses has changed."""
    now = {each.spec: each for each in extensions_of(specs)}
    if set(now) != {each.spec for each in kept}:
        want = [each.spec for each in kept]
        raise InputError(f"the study was begun with the extensions {want}; pass extensions={want}, got {list(now)}")
    for each in kept:
        if f'"{each.name}"' in plan and each.sha256 != now[each.spec].sha256:
            raise InputError(
                f"the source of {each.spec} has changed since the study was begun (SHA-256 {each.sha256[:12]}…, now "
                f"{now[each.spec].sha256[:12]}…): its rows would not be of one kind; run into another folder"
            )


@lru_cache(maxsize=64)
def _thing(spec: str, digest: str) -> Any:
    thing, found = _imported(spec)
    if found != digest:
        raise InputError(f"the source of {spec} is not the one that the study was begun with")
    return thing


def loaded(extension: Extension) -> Any:
    """Return the class, function or measure itself, imported once per process."""
    return _thing(extension.spec, extension.sha256)


def _imported(spec: str) -> tuple[Any, str]:
    """Return the object of a name, and the hash of its source."""
    if not isinstance(spec, str) or not _SPEC.fullmatch(spec):
        raise InputError(f'extension {spec!r:.80}: an extension is written as "module:name"')
    place, _, name = spec.partition(":")
    if place == "__main__":
        raise InputError(
            f"{spec} is in the script that runs, which other processes cannot import; put it into a module"
        )
    try:
        module = import_module(place)
    except ModuleNotFoundError as error:
        near = "" if error.name not in (place, place.partition(".")[0]) else (
            "; it must be importable where the study runs: install it, or set PYTHONPATH (the study file's folder is not "
            "looked into)"
        )  # fmt: skip
        raise InputError(f"the extension {spec} cannot be imported: {error}{near}") from None
    except (Exception, SystemExit) as error:  # whatever a user's module does
        raise InputError(f"the extension {spec} cannot be imported: {type(error).__name__}: {error}") from error
    if not hasattr(module, name):
        near_names = get_close_matches(name, [each for each in vars(module) if not each.startswith("_")], n=1)
        said = f"; did you mean {near_names[0]}?" if near_names else ""
        raise InputError(f"the module {place} has no {name!r}{said}")
    thing, sources = getattr(module, name), list[tuple[Any, str]]([(module, name)])
    written = thing if hasattr(thing, "__qualname__") else type(thing)
    if written.__module__ != place and written.__module__.partition(".")[0] not in _NOT_OWN:
        sources.append((sys.modules.get(written.__module__), written.__qualname__.partition(".")[0]))
    return thing, sha256("\n".join(_source(*each, place) for each in sources).encode()).hexdigest()


def _source(module: Any, name: str, place: str) -> str:
    """The statements of a module on which a name depends."""
    path = getattr(module, "__file__", None)
    if path is None:
        raise InputError(f"the module {place} has no source file, by which a change could be seen")
    try:
        return _used(Path(path).read_text("utf-8"), name)
    except (OSError, UnicodeDecodeError, SyntaxError) as error:
        raise InputError(f"the source of {place} cannot be read: {error}") from None


def _used(source: str, name: str) -> str:
    """Return the statements of a module on which a name depends, directly or not; all if none defines it.

    Imports and statements that define no name always count, because they may change every part.
    """
    statements = ast.parse(source).body
    defined = [_defined(each) for each in statements]
    known, kept = {name}, set[int]()
    if not any(name in names for names in defined):
        return source
    while True:
        more = {k for k, names in enumerate(defined) if k not in kept and (not names or names & known)}
        if not more:
            return "\n".join(ast.unparse(statements[k]) for k in sorted(kept))
        kept |= more
        known |= {node.id for k in more for node in ast.walk(statements[k]) if isinstance(node, ast.Name)}


def _defined(statement: ast.stmt) -> set[str]:
    """The names that a definition or an assignment binds; none for any other statement."""
    if isinstance(statement, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
        return {statement.name}
    if not isinstance(statement, (ast.Assign, ast.AnnAssign)):
        return set()
    targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
    return {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}


def _described(spec: str) -> Extension:
    thing, digest = _imported(spec)
    kind = _kind(thing)
    if kind is None:
        raise InputError(
            f"{spec} is no part of a study: {thing!r:.60}; expected a PrivacyMeasure or a function of mechanism, prior and "
            "problem, or a class: a decision maker (decide_many), an observer (infer, estimates), a DecisionProblem, or an "
            "emission (log_likelihoods, sample)"
        )
    given, needed, defaults = _parameters(spec, thing, kind)
    place = spec.partition(":")[0]
    meaning = (inspect.getdoc(thing) or "").partition("\n")[0]
    sign = int(isinstance(thing, PrivacyMeasure) or (inspect.isclass(thing) and issubclass(thing, PrivacyMeasure)))
    return Extension(spec, kind, given, needed, defaults, meaning, sign, digest, _version(place))


def _kind(thing: Any) -> str | None:
    if isinstance(thing, PrivacyMeasure):
        return MEASURE
    if not inspect.isclass(thing):
        return MEASURE if inspect.isfunction(thing) else None
    if issubclass(thing, PrivacyMeasure):
        return MEASURE
    if issubclass(thing, DecisionProblem):
        return PROBLEM
    for kind, methods in (
        (MAKER, ("decide_many",)),
        (OBSERVER, ("infer", "estimates")),
        (EMISSION, ("log_likelihoods", "sample")),
    ):
        if all(hasattr(thing, each) for each in methods):
            return kind
    return None


def _parameters(spec: str, thing: Any, kind: str) -> tuple[tuple[str, ...], tuple[str, ...], dict[str, Any]]:
    """Parameters that the study fills in, that a file must set, and that it may set with their defaults."""
    if isinstance(thing, PrivacyMeasure):
        return (), (), {}
    given, needed, defaults = [], [], {}
    for name, each in inspect.signature(thing).parameters.items():
        if each.kind in (each.VAR_POSITIONAL, each.VAR_KEYWORD):
            continue
        if each.kind is each.POSITIONAL_ONLY:
            raise InputError(f"{spec} takes {name!r} by position alone; a study passes parameters by name")
        if name in GIVEN[kind]:
            given.append(name)
        elif each.default is each.empty:
            needed.append(name)
        else:
            defaults[name] = _plain(each.default)
    taken = sorted({"name", "kind", "transition", "disclosure"} & {*needed, *defaults})
    if taken:
        raise InputError(f"{spec} has the parameter {taken[0]!r}, which a study file uses itself; call it otherwise")
    if kind == MEASURE and needed:
        raise InputError(
            f"{spec} needs {few(needed)}, but a study names measures alone; expected parameters {GIVEN[MEASURE]}"
        )
    return tuple(given), tuple(needed), defaults


def _plain(value: Any) -> Any:
    return value if value is None or isinstance(value, _PLAIN) else None


def _version(place: str) -> str:
    own = getattr(sys.modules[place], "__version__", "")
    if isinstance(own, str) and own:
        return own
    try:
        return version(place.partition(".")[0])
    except (PackageNotFoundError, ValueError):
        return ""
