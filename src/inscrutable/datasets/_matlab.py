"""Read the tables of a MATPOWER case: assignments of numbers only; code raises an error."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np

from inscrutable.errors import InputError
from inscrutable.files import PathLike, path_of, reason
from inscrutable.validation import Array

_MOST_BYTES = 500_000_000
_ASSIGNED = re.compile(r"(?:\w+\.)?(\w+)\s*=\s*")
_HARMLESS = re.compile(r"(?:function\b[^\n]*|return|end|define_constants|clear\b[^\n;]*)[ \t]*;?")
_NUMBER = re.compile(r"[^;\n]*")
_LINE_END = re.compile(r"\r\n|\r|\n")
_QUOTED_OR_END = re.compile(r"""'[^'\n]*'|"[^"\n]*"|[]}]""")
_CLOSING = {"[": "]", "{": "}", "'": "'", '"': '"'}
_SHOWN = 40


class CaseTable(NamedTuple):
    """A table of a case: its numbers, and the line of each row in the file."""

    values: Array  # (rows, columns)
    lines: tuple[int, ...]


def read_case(path: PathLike, needed: Mapping[str, int]) -> tuple[dict[str, CaseTable], set[str]]:
    """Return the tables of a case by name, and the names of all its other variables.

    Args:
        path: The file.
        needed: The tables to read, each with its least number of columns; a scalar is a table of one number.

    Raises:
        InputError: The file cannot be read, contains code, or a table is malformed; the message names the line.
    """
    source = path_of(path, "a MATPOWER case")
    text = _plain_text(source)
    tables, others = {}, set()
    for name, body, line in _assignments(text, source):
        if name not in needed:
            others.add(name)
        elif name in tables:
            raise InputError(f"{source}, line {line}: {name} stands twice")
        else:
            tables[name] = _table(name, body, line, needed[name], source)
    return tables, others


def _plain_text(source: Path) -> str:
    """Return the text without comments and continuations; line numbers stay."""
    try:
        if source.is_file() and source.stat().st_size > _MOST_BYTES:
            raise InputError(f"{source} has {source.stat().st_size} bytes, more than any MATPOWER case")
        data = source.read_bytes()
    except IsADirectoryError:
        raise InputError(f"{source} is a folder, expected a MATPOWER case (.m)") from None
    except OSError as error:
        raise InputError(f"{source} cannot be read: {reason(error)}; expected a MATPOWER case (.m)") from None
    except ValueError as error:
        raise InputError(f"{str(source)!r} is no path: {error}") from None
    if b"\x00" in data:
        raise InputError(
            f"{source} is no text; expected a MATPOWER case as .m, which savecase(name, mpc) writes of a .mat"
        )
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = data.decode("latin-1")  # names in comments
    kept, hidden, carried = [], False, 0
    for line in _LINE_END.split(text):  # others, such as a form feed, may stand in a comment
        bare = line.strip()
        hidden = (hidden or bare == "%{") and bare != "%}"
        shown = "" if hidden or bare == "%}" else _without_comment(line)
        if shown.rstrip().endswith("..."):
            kept.append(shown.rstrip()[:-3] + " ")
            carried += 1
            continue
        kept.append(shown + "\n" * (1 + carried))
        carried = 0
    return "".join(kept)


def _without_comment(line: str) -> str:
    quote = ""
    for place, character in enumerate(line):
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character == "%":
            return line[:place]
        elif line.startswith("...", place):  # a line that goes on; what follows is a comment
            return line[: place + 3]
    return line


def _assignments(text: str, source: Path) -> Iterator[tuple[str, str, int]]:
    """Return names, their values, and the lines where the values begin."""
    place = 0
    while True:
        place += len(text[place:]) - len(text[place:].lstrip(" \t\r\n;,"))
        if place == len(text):
            return
        line = text.count("\n", 0, place) + 1
        passed = _HARMLESS.match(text, place)
        if passed:
            place = passed.end()
            continue
        found = _ASSIGNED.match(text, place)
        if not found:
            statement = text[place:].split("\n", 1)[0].strip()
            raise InputError(
                f"{source}, line {line}: {statement[:_SHOWN]!r} is code, or no MATPOWER case; only assignments of numbers such "
                "as mpc.bus = [...] are read: run the file in MATLAB or Octave and write the result by savecase(name, mpc)"
            )
        body, place = _body(text, found.end(), f"{source}, line {line}: {found[1]}")
        rest = text[place:].split("\n", 1)[0].strip(" \t\r;,")
        if rest and not _ASSIGNED.match(rest):
            raise InputError(
                f"{source}, line {line}: {found[1]} is followed by {rest[:_SHOWN]!r}; expected numbers alone"
            )
        yield found[1], body, line


def _body(text: str, start: int, where: str) -> tuple[str, int]:
    closing = _CLOSING.get(text[start : start + 1])
    if closing is None:
        found = _NUMBER.match(text, start)
        assert found is not None
        return found[0], found.end()
    ends = (found.start() for found in _QUOTED_OR_END.finditer(text, start + 1) if found[0] == closing)
    end = text.find(closing, start + 1) if closing in "'\"" else next(ends, -1)
    if end < 0:
        raise InputError(f"{where} has no closing {closing}; the file is cut off")
    return text[start + 1 : end], end + 1


def _table(name: str, body: str, line: int, least: int, source: Path) -> CaseTable:
    rows, lines = [], []
    for number, part in enumerate(body.split("\n"), start=line):
        for written in part.split(";"):
            words = written.replace(",", " ").split()
            if words:
                rows.append(_numbers(words, f"{source}, line {number}: {name}"))
                lines.append(number)
    width = len(rows[0]) if rows else least
    for row, number in zip(rows, lines, strict=True):
        if len(row) != width:
            raise InputError(
                f"{source}, line {number}: a row of {name} has {len(row)} numbers, the first one {width}; fill it with zeros"
            )
    if width < least:
        raise InputError(f"{source}, line {line}: {name} has {width} columns, expected at least {least}")
    return CaseTable(np.array(rows, dtype=np.float64).reshape(len(rows), width), tuple(lines))


def _numbers(words: list[str], where: str) -> list[float]:
    try:
        return [_number(word) for word in words]
    except ValueError:
        for word in words:
            try:
                _number(word)
            except ValueError:
                raise InputError(f"{where} has {word[:_SHOWN]!r}; expected numbers") from None
        raise


def _number(word: str) -> float:
    """Python's own reading takes 5_0 for 50; in a case it is a slip."""
    if "_" in word:
        raise ValueError
    return float(word)
