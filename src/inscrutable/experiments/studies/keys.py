"""The keys of a study file and the measures it may name, as tables made from what checks the file."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable
from typing import Any, NamedTuple, get_args

from inscrutable.experiments.measures import MEASURES
from inscrutable.experiments.studies import layout

_WORDS = {"integer": "whole number", "number": "number", "string": "text"}
_LIMITS = {"minimum": "≥", "exclusiveMinimum": ">", "maximum": "≤", "exclusiveMaximum": "<"}
_TOP = ("name", "note", "seed", "repeats", "measures")
_SECTIONS = ("world", "problem", "beliefs", "candidates", "budgets", "rival")
_HEAD = ("key", "holds", "left out")


class KeyTable(NamedTuple):
    """The keys of a section, or the names that one may hold.

    Args:
        section: Its name in the file; "top" for keys outside sections, "measures" for the measures.
        title: Its heading.
        text: What it is.
        head: Names of the columns.
        rows: A row per key or name, which comes first.
    """

    section: str
    title: str
    text: str
    head: tuple[str, ...]
    rows: list[tuple[str, ...]]


def key_tables() -> list[KeyTable]:
    """Return the tables of all keys of a study file, the last one that of the measures."""
    found = [KeyTable("top", "At the top of the file", "", _HEAD, keys_of(layout.StudyFile, _TOP))]
    for field in _SECTIONS:
        for model in _models(layout.StudyFile.model_fields[field].annotation):
            text = " ".join(inspect.cleandoc(model.__doc__ or "").split())
            found.append(KeyTable(field, f"[{field}]{_kind(model)}", text, _HEAD, keys_of(model)))
    head = ("name", "what it is", "its own keys")
    for field, union in (("decision_makers", layout.MakerSection), ("adversaries", layout.ObserverSection)):
        found.append(KeyTable(field, f"[[{field}]]", "", head, _named(get_args(union))))
    measures: list[tuple[str, ...]] = [(name, MEASURES[name].meaning) for name in get_args(layout.Measure)]
    return [*found, KeyTable("measures", "Measures", "", head[:2], measures)]


def keys_of(model: Any, keys: Iterable[str] | None = None) -> list[tuple[str, ...]]:
    """Return key, what it may hold, and its value where it is left out, of some keys of a section or of all."""
    schema = model.model_json_schema()
    found: list[tuple[str, ...]] = []
    for key in keys or schema["properties"]:
        entry = schema["properties"][key]
        if "const" not in entry:
            default = "needed" if key in schema.get("required", ()) else _left_out(model, key)
            found.append((key, "names of the table of measures" if key == "measures" else _holds(entry), default))
    return found


def _models(annotation: Any) -> list[Any]:
    """Return the sections that an annotation allows."""
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models(part)]


def _kind(model: Any) -> str:
    """Return how a section names its kind, if it does."""
    field = model.model_fields.get("kind")
    return f', kind = "{get_args(field.annotation)[0]}"' if field is not None and field.is_required() else ""


def _named(models: Iterable[Any]) -> list[tuple[str, ...]]:
    """Return decision makers or observers with their keys."""
    return [
        (
            str(get_args(model.model_fields["name"].annotation)[0]),
            " ".join((model.__doc__ or "").split()),
            "; ".join(f"`{key}`: {held} (left out: {default})" for key, held, default in keys_of(model)) or "–",
        )
        for model in models
    ]


def _left_out(model: Any, key: str) -> str:
    """Return the value of a key that is left out, as one would write it."""
    value = model.model_fields[key].get_default(call_default_factory=True)
    if value is None:
        return "–"
    return json.dumps(value[0] if isinstance(value, tuple) and len(value) == 1 else value)


def _holds(entry: dict[str, Any]) -> str:
    """Return in words what a key may hold."""
    if "anyOf" in entry:
        kinds = [each for each in entry["anyOf"] if each.get("type") != "null"]
        if len(kinds) > 1:
            return " or ".join(map(_holds, kinds))
        entry = kinds[0]
    if entry.get("type") == "object":
        return "a table"
    if entry.get("type") == "array":
        return _list(entry)
    if "enum" in entry:
        return "one of " + ", ".join(map(json.dumps, entry["enum"]))
    return "true or false" if entry["type"] == "boolean" else f"{_WORDS[entry['type']]}{_limits(entry)}"


def _list(entry: dict[str, Any]) -> str:
    if "minLength" in entry:  # one or several
        return f"{_holds(entry['items'])}; or a list"
    if "prefixItems" in entry:
        return f"two numbers{_limits(entry['prefixItems'][0])}, least and largest"
    of, depth = entry["items"], 1
    while of.get("type") == "array":
        of, depth = of["items"], depth + 1
    of_what = "texts" if of.get("type") == "string" else "numbers"
    return {1: f"a list of {of_what}{_limits(of)}", 2: "a matrix", 3: "a list of matrices"}[depth]


def _limits(entry: dict[str, Any]) -> str:
    """Return the limits of a number, after a space, if it has any."""
    said = " and ".join(f"{sign} {entry[key]:g}" for key, sign in _LIMITS.items() if key in entry)
    return f" {said}".rstrip()
