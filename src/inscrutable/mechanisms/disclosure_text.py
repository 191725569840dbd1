"""The text of a disclosure, "every(3)|delayed(2)", as names and values: parsed, never evaluated."""

from __future__ import annotations

import ast
from typing import Any

from inscrutable.errors import InputError

Call = tuple[str, list[Any], dict[str, Any]]


def parsed_calls(text: str) -> list[Call]:
    """Return the names, values and keywords of a text; raise `InputError` where it is none of this form.

    Example:
        >>> parsed_calls("grouped([energy, 'food'])|every(3, offset=2)")
        [('grouped', [['energy', 'food']], {}), ('every', [3], {'offset': 2})]
    """
    try:
        return _calls(ast.parse(text.strip(), mode="eval").body)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise InputError(
            f'a disclosure is written as "every(3)|delayed(2)|rounded(1)" or "form_13f()", with brackets, got {text!r}'
        ) from None


def _calls(node: ast.expr) -> list[Call]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
        return [*_calls(node.left), *_calls(node.right)]
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        keywords = {each.arg: _value(each.value) for each in node.keywords if each.arg is not None}
        if len(keywords) == len(node.keywords):
            return [(node.func.id, [_value(each) for each in node.args], keywords)]
    raise ValueError("no call")


def _value(node: ast.expr) -> Any:
    """A number, a text, a bare word as text, or a list of these."""
    if isinstance(node, ast.Name):
        return node.id
    if isinstance(node, (ast.List, ast.Tuple)):
        return [_value(each) for each in node.elts]
    return ast.literal_eval(node)
