"""The keys of a study file and the measures it may name, as tables made from what checks the file."""

from __future__ import annotations

import inspect
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, get_args

WORDS = {"integer": "whole number", "number": "number", "string": "text"}
LIMITS = {
    "minimum": "≥",
    "exclusiveMinimum": ">",
    "maximum": "≤",
    "exclusiveMaximum": "<",
}
TOP = ("name", "note", "seed", "repeats", "measures")
"""Keys that are no sections."""


def literal(text: str) -> str:
    """Return text that no character of is read as markup."""
    return re.sub(r"([|*`\\])", r"\\\1", text)


def spoken(text: str) -> str:
    """Return a docstring, in which names between single marks are code."""
    return literal(inspect.cleandoc(text)).replace("\\`", "`")


def study_keys(folder: Path) -> None:
    """Write the tables of keys and of measures."""
    from inscrutable.experiments.studies import layout

    parts = [table("At the top of the file", "", rows(layout.StudyFile, TOP))]
    for field in ("world", "problem", "beliefs", "candidates", "budgets", "rival"):
        models = sections(layout.StudyFile.model_fields[field].annotation)
        parts += [
            table(f"[{field}]{kind(each)}", each.__doc__, rows(each))
            for each in models
        ]
    for field, union in (
        ("decision_makers", layout.MakerSection),
        ("adversaries", layout.ObserverSection),
    ):
        parts.append(
            table(
                f"[[{field}]]",
                "",
                named(get_args(union)),
                ("name", "what it is", "its own keys"),
            )
        )
    folder.mkdir(parents=True)
    folder.joinpath("keys.rst").write_text("\n".join(parts), "utf-8")
    folder.joinpath("measures.rst").write_text(
        measures(get_args(layout.Measure)), "utf-8"
    )


def model_keys(folder: Path) -> None:
    """Write the tables of the keys of a model file, with what each means."""
    from inscrutable.experiments import own_model

    head = ("key", "holds", "what it is; what it is where left out")
    named = {
        "investor": own_model.InvestorPart,
        "constraints": own_model.LimitsPart,
        "regimes": own_model.RegimesPart,
    }
    parts = [
        table(f"[{name}]", model.__doc__, described(model), head)
        for name, model in named.items()
    ]
    folder.mkdir(parents=True)
    folder.joinpath("keys.rst").write_text("\n".join(parts), "utf-8")


def described(model: Any) -> list[tuple[str, ...]]:
    """Return key, what it may hold, and what it means."""
    found = []
    for key, (_, held, _) in zip(model.model_fields, rows(model), strict=True):
        field = model.model_fields[key]
        needed = "needed: " if field.is_required() else ""
        found.append((f"``{key}``", held, needed + spoken(field.description)))
    return found


def sections(annotation: Any) -> list[Any]:
    """Return the sections that an annotation allows."""
    if hasattr(annotation, "model_fields"):
        return [annotation]
    return [model for part in get_args(annotation) for model in sections(part)]


def kind(model: Any) -> str:
    """Return how a section names its kind, if it does."""
    field = model.model_fields.get("kind")
    known = (
        get_args(field.annotation)
        if field is not None and field.is_required()
        else ()
    )
    return f', kind = "{known[0]}"' if known else ""


def rows(model: Any, keys: Iterable[str] | None = None) -> list[tuple[str, ...]]:
    """Return key, what it may hold, and what it is where it is left out; some keys, or all."""
    schema = model.model_json_schema()
    found = []
    for key in keys or schema["properties"]:
        entry = schema["properties"][key]
        if "const" not in entry:
            default = (
                "needed"
                if key in schema.get("required", ())
                else left_out(model, key)
            )
            told = "names of the table below" if key == "measures" else holds(entry)
            found.append((f"``{key}``", told, default))
    return found


def left_out(model: Any, key: str) -> str:
    """Return the value of a key that is left out, as one would write it."""
    value = model.model_fields[key].get_default(call_default_factory=True)
    if value is None:
        return "–"
    if isinstance(value, tuple) and len(value) == 1:
        value = value[0]
    return literal(json.dumps(value))


def holds(entry: dict[str, Any]) -> str:
    """Return in words what a key may hold."""
    if "anyOf" in entry:
        kinds = [each for each in entry["anyOf"] if each.get("type") != "null"]
        if len(kinds) > 1:
            return " or ".join(holds(each) for each in kinds)
        entry = kinds[0]
    if entry.get("type") == "object":
        return "a table"
    if entry.get("type") == "array":
        if "minLength" in entry:  # one or several
            return f"{holds(entry['items'])}; or a list"
        if "prefixItems" in entry:
            of = entry["prefixItems"][0]
            return f"two numbers{limits(of)}, least and largest"
        of = entry["items"]
        depth = 1
        while of.get("type") == "array":
            of, depth = of["items"], depth + 1
        of_what = "texts" if of.get("type") == "string" else "numbers"
        shape = {
            1: f"a list of {of_what}{limits(of)}",
            2: "a matrix",
            3: "a list of matrices",
        }
        return shape[depth]
    if "enum" in entry:
        return "one of " + literal(", ".join(map(json.dumps, entry["enum"])))
    if entry["type"] == "boolean":
        return "true or false"
    return f"{WORDS[entry['type']]}{limits(entry)}"


def limits(entry: dict[str, Any]) -> str:
    """Return the limits of a number, after a space, if it has any."""
    told = " and ".join(
        f"{sign} {entry[key]:g}" for key, sign in LIMITS.items() if key in entry
    )
    return f" {told}".rstrip()


def named(models: Iterable[Any]) -> list[tuple[str, ...]]:
    """Return decision makers or observers with their keys."""
    return [
        (
            f"``{get_args(model.model_fields['name'].annotation)[0]}``",
            " ".join(spoken(model.__doc__).split()),
            "; ".join(
                f"{key}: {held} (left out: {default})"
                for key, held, default in rows(model)
            )
            or "–",
        )
        for model in models
    ]


def measures(names: Iterable[str]) -> str:
    """Return the table of measures."""
    from inscrutable.experiments.measures import MEASURES

    return table(
        "Measures",
        "",
        [(f"``{name}``", literal(MEASURES[name].meaning)) for name in names],
        ("name", "what it is"),
    )


def table(
    title: str,
    text: str,
    lines: Iterable[tuple[str, ...]],
    head: tuple[str, ...] = ("key", "holds", "left out"),
) -> str:
    """Return a table under its title."""
    written = [f".. rubric:: {title}\n", f"{spoken(text)}\n" if text else ""]
    listed = list(lines)
    if not listed:
        return "\n".join(written)
    written += [".. list-table::", "   :header-rows: 1\n"]
    for row in (head, *listed):
        written += [
            f"   {'*' if place == 0 else ' '} - {cell}"
            for place, cell in enumerate(row)
        ]
    return "\n".join([*written, ""])
