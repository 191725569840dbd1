"""Where in a TOML text a key stands, so that a message can name the line.

The text has been parsed before, so it is known to be TOML; this goes over its marks once more and counts lines.
"""

from __future__ import annotations

import re
import tomllib

Place = tuple[str | int, ...]

_TOKEN = re.compile(
    r'(?P<text>"""(?:\\.|[^\\])*?"{3,5}|' + r"'''.*?'{3,5}" + r'|"(?:\\.|[^"\\\n])*"|' + r"'[^'\n]*')"
    r"|(?P<mark>[\n\[\]{}=,.])|(?P<bare>[^\s\[\]{}=,.#\"']+)|#[^\n]*",
    re.S,
)


def key_lines(text: str) -> dict[Place, int]:
    """Return the line, from 1, of every key, table and array entry of a valid TOML text, by its place.

    Args:
        text: The text.

    Example:
        >>> key_lines('a = 1\\n[[b]]\\nc = [2,\\n 3]')
        {('a',): 1, ('b',): 2, ('b', 0): 2, ('b', 0, 'c'): 3, ('b', 0, 'c', 0): 3, ('b', 0, 'c', 1): 4}
    """
    found, line = _Places(), 1
    for token in _TOKEN.finditer(text):
        if token.lastgroup is not None:
            for place in found.after(token.lastgroup, token[0]):
                found.lines.setdefault(place, line)
        line += token[0].count("\n")
    return found.lines


class _Places:
    """Which places the tokens of a text open, one token after another."""

    def __init__(self) -> None:
        self.lines: dict[Place, int] = {}
        self._tables: dict[Place, int] = {}  # how many an array of tables has
        self._table: Place = ()
        self._brackets = 0  # of a header, before its name
        self._keys: Place = ()  # those before the next = or ]
        self._value: Place | None = None  # what is given a value just now
        self._open: list[tuple[str, Place]] = []  # arrays and inline tables
        self._counts: list[int] = []  # commas in each

    def after(self, kind: str, got: str) -> list[Place]:
        """Return the places that a token opens."""
        array = self._value is None and bool(self._open) and self._open[-1][0] == "["
        entry: Place = (*self._open[-1][1], self._counts[-1]) if array else self._value or ()
        if got == "\n":
            self._value = self._value if self._open else None
        elif got in ("[", "{") and (array or self._value is not None):
            self._open.append((got, entry))
            self._counts.append(0)
            self._value = None
        elif got in ("]", "}") and self._open:
            self._open.pop()
            self._counts.pop()
            self._value = None
            return []
        elif got == "," and self._open:
            self._counts[-1] += 1
            self._value = None
            return []
        elif not array and self._value is None:
            return self._named(kind, got)
        return [entry] if array and got != "\n" else []

    def _named(self, kind: str, got: str) -> list[Place]:
        """The same among keys and headers."""
        within = self._open[-1][1] if self._open else self._table
        if got == "[":
            self._brackets += 1
        elif got == "]":
            return self._header() if self._keys else []
        elif got == "=":
            self._value, self._keys = (*within, *self._keys), ()
        elif kind != "mark":
            self._keys = (*self._keys, tomllib.loads(f"x = {got}")["x"] if kind == "text" else got)
            return [] if self._brackets else [(*within, *self._keys)]
        return []

    def _header(self) -> list[Place]:
        """What a [table] or [[array of tables]] opens; on the way the latest table, wherever there is an array of them."""
        places: list[Place] = []
        place: Place = ()
        for key in self._keys:
            if place in self._tables:
                place = (*place, self._tables[place] - 1)
            place = (*place, key)
            places.append(place)
        if self._brackets == 2:
            number = self._tables.get(place, 0)
            self._tables[place] = number + 1
            place = (*place, number)
            places.append(place)
        self._table, self._keys, self._brackets = place, (), 0
        return places
