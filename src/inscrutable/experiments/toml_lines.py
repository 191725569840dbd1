"""Read TOML with the line of every key, for messages.

The text is parsed first; a second pass over its tokens counts lines.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from inscrutable.errors import InputError, InscrutableError

Place = tuple[str | int, ...]

_MOST_PARTS = 32
_DEEP = re.compile(rf"""(?:[\w"'-]{{1,99}}[ \t]*\.[ \t]*){{{_MOST_PARTS}}}""")
_NEAR = 0.5

_TOKEN = re.compile(
    r'(?P<text>"""(?:\\.|[^\\])*?"{3,5}|' + r"'''.*?'{3,5}" + r'|"(?:\\.|[^"\\\n])*"|' + r"'[^'\n]*')"
    r"|(?P<mark>[\n\[\]{}=,.])|(?P<bare>[^\s\[\]{}=,.#\"']+)|#[^\n]*",
    re.S,
)


@dataclass(frozen=True)
class TomlSource:
    """The source of a text, and the line of each key."""

    name: str
    lines: Mapping[Place, int] = field(default_factory=dict)

    def at(self, place: Place) -> str:
        """Return file, line and key of a place, as text."""
        for length in range(len(place), 0, -1):
            if place[:length] in self.lines:
                return f"{self.name}, line {self.lines[place[:length]]}, key {key_text(place)}"
        return f"{self.name}, key {key_text(place)}" if place else self.name

    @contextmanager
    def saying(self, place: Place) -> Iterator[None]:
        """Add file, line and key to the message of a library error."""
        try:
            yield
        except InscrutableError as error:
            raise type(error)(f"{self.at(place)}: {error}") from None


def read_toml(path: Path, what: str, folder_hint: str = "") -> tuple[dict[str, Any], TomlSource]:
    """Return the data of a TOML file and the lines of its keys, or raise one `InputError`.

    Args:
        path: The file.
        what: Kind of file in messages, such as "study".
        folder_hint: Hint for a path that is a folder.
    """
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except IsADirectoryError:
        raise InputError(f"{path} is a folder, expected a {what} file (TOML){folder_hint}") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise InputError(f"{path} is not UTF-8 text: byte {error.start}; expected a {what} file in TOML") from None
    if _DEEP.search(text):  # a parser takes hours for tens of thousands of parts
        raise InputError(f"{path} has a key of more than {_MOST_PARTS} parts joined by dots; no {what} has such")
    try:
        data = tomllib.loads(text)
    except ValueError as error:  # also a number of thousands of digits
        instead = "; it is JSON, and what is asked for is a file in TOML" if text.lstrip().startswith("{") else ""
        raise InputError(f"{path} is not TOML: {error}{instead}") from None
    except RecursionError:
        raise InputError(f"{path} is nested too deeply to be a {what}") from None
    return data, TomlSource(str(path), key_lines(text))


def nearest(given: str, known: Iterable[str]) -> str:
    """Return "; did you mean X?" for the nearest known name, empty where none is near."""
    names = list(known)
    lowered = {each.lower(): each for each in names}
    close = get_close_matches(given.lower(), lowered, n=1, cutoff=_NEAR)
    return f"; did you mean {lowered[close[0]]}?" if close else ""


def key_text(place: Place) -> str:
    """Return a place as one would write it: world.means[0]."""
    text = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place)
    return text.lstrip(".")


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
    """Tracks the place that each token of a text opens."""

    def __init__(self) -> None:
        self.lines: dict[Place, int] = {}
        self._tables: dict[Place, int] = {}  # number of tables in an array of tables
        self._table: Place = ()
        self._brackets = 0  # brackets of a header, before its name
        self._keys: Place = ()  # key parts before the next = or ]
        self._value: Place | None = None  # the key that currently gets a value
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
        """Return the place that a [table] or [[array of tables]] opens; an array of tables means its latest table."""
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
