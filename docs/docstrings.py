"""From this project's docstrings to pages: plain formulas are kept from being read as markup, public names become links."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from typing import Any

from sphinx.util.inspect import TypeAliasForwardRef, stringify_signature

import inscrutable

NAMED = re.compile(r"`([A-Za-z]\w*)(?:\(\))?`")


def plain(lines: list[str]) -> Iterator[str]:
    """Yield the lines of a docstring with |c*| and u* as they stand; examples stay untouched."""
    in_example = False
    for line in lines:
        in_example = line.lstrip().startswith(">>>") or (
            in_example and bool(line.strip())
        )
        yield line if in_example else linked(line)


def linked(line: str) -> str:
    """Return a line whose formulas are escaped and whose public names are links."""
    parts = re.split(r"(``.*?``|`[^`]*`)", line)
    parts[::2] = [re.sub(r"(?<!\\)([|*])", r"\\\1", part) for part in parts[::2]]
    parts[1::2] = [NAMED.sub(reference, part) for part in parts[1::2]]
    return "".join(parts)


def reference(match: re.Match[str]) -> str:
    """Return a link for a public name, else the name as code."""
    known = match[1] in inscrutable.__all__
    return f":py:obj:`~inscrutable.{match[1]}`" if known else match[0]


def clean(
    app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]
) -> None:
    """Clean a docstring in place, before its sections are read."""
    lines[:] = plain(lines)
    # What stands before a colon is no type here: neither in the line of an attribute nor in what is returned.
    if what in ("attribute", "property", "data"):
        lines.insert(0, "")
    lines[:] = [":returns:" if line == "Returns:" else line for line in lines]


def signature(
    app: Any,
    what: str,
    name: str,
    thing: Any,
    options: Any,
    found: str,
    returned: str,
) -> Any:
    """Return a signature as the source has it, `ArrayLike` and not what that stands for."""
    if what not in ("class", "function", "method") or not found:
        return None
    written = inspect.signature(thing)
    kept = [
        each
        for each in written.parameters.values()
        if each.name not in ("self", "cls")
    ]
    result = written.return_annotation
    shown = (
        str(result)
        if what != "class" and result is not inspect.Signature.empty
        else None
    )
    return stringify_signature(
        written.replace(parameters=kept, return_annotation=inspect.Signature.empty)
    ), shown


def resolve(app: Any, env: Any, node: Any, content: Any) -> Any:
    """Link a name by which a module knows a public class to where it is documented; other types are named alone."""
    if node.get("refdomain") != "py" or "refwarn" in node:
        return None  # written out in a text: it must lead somewhere
    name = str(node.get("reftarget", "")).rpartition(".")[2]
    if name not in inscrutable.__all__:
        return content
    domain = env.get_domain("py")
    return domain.resolve_xref(
        env,
        node["refdoc"],
        app.builder,
        "obj",
        f"inscrutable.{name}",
        node,
        content,
    )


def setup(app: Any) -> dict[str, Any]:
    """Connect the steps."""
    app.setup_extension("sphinx.ext.autodoc")
    # Inside a tuple the name of an alias is printed by its `repr`.
    TypeAliasForwardRef.__repr__ = lambda self: self.name  # type: ignore[method-assign]
    app.connect("autodoc-process-docstring", clean, priority=100)
    app.connect("autodoc-process-signature", signature)
    app.connect("missing-reference", resolve)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
