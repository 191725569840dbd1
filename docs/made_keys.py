"""The keys of a study file and of a model file, as tables made from what checks the file."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any


def literal(text: str) -> str:
    """Return text that no character of is read as markup."""
    return re.sub(r"([|*`\\])", r"\\\1", text)


def spoken(text: str) -> str:
    """Return a docstring, in which names between single marks are code."""
    return literal(inspect.cleandoc(text)).replace("\\`", "`")


def study_keys(folder: Path) -> None:
    """Write the tables of keys and of measures."""
    from inscrutable.experiments.studies.keys import key_tables

    *parts, measures = [
        table(each.title, each.text, each.rows, each.head) for each in key_tables()
    ]
    folder.mkdir(parents=True)
    folder.joinpath("keys.rst").write_text("\n".join(parts), "utf-8")
    folder.joinpath("measures.rst").write_text(measures, "utf-8")


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
    from inscrutable.experiments.studies.keys import keys_of

    found = []
    for key, (_, held, _) in zip(model.model_fields, keys_of(model), strict=True):
        field = model.model_fields[key]
        needed = "needed: " if field.is_required() else ""
        found.append((key, held, needed + field.description))
    return found


def table(
    title: str,
    text: str,
    lines: Iterable[tuple[str, ...]],
    head: tuple[str, ...],
) -> str:
    """Return a table under its title, the first of each line as code."""
    written = [f".. rubric:: {title}\n", f"{spoken(text)}\n" if text else ""]
    listed = [(f"``{key}``", *map(spoken, rest)) for key, *rest in lines]
    if not listed:
        return "\n".join(written)
    written += [".. list-table::", "   :header-rows: 1\n"]
    for row in (head, *listed):
        written += [
            f"   {'*' if place == 0 else ' '} - {cell}"
            for place, cell in enumerate(row)
        ]
    return "\n".join([*written, ""])
