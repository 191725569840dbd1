"""Where in a TOML text a key stands, so that a message can name the line.

The text has been parsed before, so it is known to be TOML; this walks over it once more and keeps line numbers.
"""

from __future__ import annotations

import re
import tomllib
from bisect import bisect_left

Place = tuple[str | int, ...]

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_QUOTED = re.compile(r'"(?:\\.|[^"\\\n])*"|' + r"'[^'\n]*'")
_STRING = re.compile(r'"""(?:\\.|[^\\])*?"{3,5}' + r"|'''.*?'{3,5}" + r'|"(?:\\.|[^"\\\n])*"' + r"|'[^'\n]*'", re.S)
_SCALAR = re.compile(r"[^\s,\]}#]+(?: \d\d:[^\s,\]}#]+)?")
_BLANK = re.compile(r"[ \t]*")
_BLANKS = re.compile(r"(?:[ \t\r\n]|#[^\n]*)*")


def key_lines(text: str) -> dict[Place, int]:
    """Return the line, from 1, of every key, table and array entry of a valid TOML text, by its place.

    Args:
        text: The text.

    Example:
        >>> key_lines('a = 1\\n[[b]]\\nc = [2,\\n 3]')
        {('a',): 1, ('b',): 2, ('b', 0): 2, ('b', 0, 'c'): 3, ('b', 0, 'c', 0): 3, ('b', 0, 'c', 1): 4}
    """
    return _Walk(text).run()


class _Walk:
    def __init__(self, text: str) -> None:
        self.text = text.replace("\r\n", "\n")
        self._breaks = [found.start() for found in re.finditer("\n", self.text)]
        self.at = 0
        self.lines: dict[Place, int] = {}
        self.counts: dict[Place, int] = {}

    def run(self) -> dict[Place, int]:
        table: Place = ()
        self._skip(_BLANKS)
        while self.at < len(self.text):
            if self.text.startswith("[[", self.at):
                table = self._header(2)
            elif self.text[self.at] == "[":
                table = self._header(1)
            else:
                self._pair(table)
            self._skip(_BLANKS)
        return self.lines

    def _header(self, brackets: int) -> Place:
        """The place that a [table] or [[array of tables]] opens."""
        self.at += brackets
        keys = self._keys()
        place = self._entered(keys[:-1])
        last: Place = (*place, keys[-1])
        self._note(last)
        if brackets == 2:
            number = self.counts.get(last, 0)
            self.counts[last] = number + 1
            last = (*last, number)
            self._note(last)
        self.at += brackets
        return last

    def _entered(self, keys: list[str]) -> Place:
        """A place of tables, the latest one wherever there is an array of them."""
        place: Place = ()
        for key in keys:
            place = (*place, key)
            self._note(place)
            if place in self.counts:
                place = (*place, self.counts[place] - 1)
        return place

    def _pair(self, table: Place) -> None:
        place = table
        for key in self._keys():
            place = (*place, key)
            self._note(place)
        self.at += 1  # the equals sign
        self._skip(_BLANK)
        self._value(place)

    def _keys(self) -> list[str]:
        keys = []
        while True:
            self._skip(_BLANK)
            quoted = _QUOTED.match(self.text, self.at)
            found = quoted or _BARE.match(self.text, self.at)
            assert found is not None
            self.at = found.end()
            keys.append(tomllib.loads(f"x = {found[0]}")["x"] if quoted else found[0])
            self._skip(_BLANK)
            if not self.text.startswith(".", self.at):
                return keys
            self.at += 1

    def _value(self, place: Place) -> None:
        opening = self.text[self.at]
        if opening == "[":
            self._entries(place, "]")
        elif opening == "{":
            self._entries(place, "}")
        else:
            self._skip(_STRING if opening in "\"'" else _SCALAR)

    def _entries(self, place: Place, closing: str) -> None:
        """The entries of an array or of an inline table."""
        self.at += 1
        number = 0
        while True:
            self._skip(_BLANKS)
            if self.text[self.at] == closing:
                self.at += 1
                return
            if self.text[self.at] == ",":
                self.at += 1
            elif closing == "}":
                self._pair(place)
            else:
                entry = (*place, number)
                number += 1
                self._note(entry)
                self._value(entry)

    def _note(self, place: Place) -> None:
        self.lines.setdefault(place, bisect_left(self._breaks, self.at) + 1)

    def _skip(self, pattern: re.Pattern[str]) -> None:
        found = pattern.match(self.text, self.at)
        if found is not None:
            self.at = found.end()
