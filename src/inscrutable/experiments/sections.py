"""Sections of settings, for files and Python: their keys are checked at construction."""

from __future__ import annotations

import unicodedata
from itertools import pairwise
from typing import Annotated, Any, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from inscrutable.errors import InputError

_Entry = TypeVar("_Entry")
_LONGEST = 60


def _listed(value: Any) -> Any:
    """Return a list as a tuple, and any other value as a tuple of one."""
    return tuple(value) if isinstance(value, list) else value if isinstance(value, tuple) else (value,)


def _distinct(values: tuple[Any, ...]) -> tuple[Any, ...]:
    for place, value in enumerate(values):
        if value in values[:place]:
            raise ValueError(f"{value!r} stands twice")
    return values


def _ascending(pair: tuple[float, float]) -> tuple[float, float]:
    if pair[0] > pair[1]:
        raise ValueError("should be a lowest and a highest value")
    return pair


def _even(rows: list[list[float]]) -> list[list[float]]:
    lengths = [len(row) for row in rows]
    if len(set(lengths)) > 1:
        raise ValueError(f"should be rows of one length, not of {', '.join(map(str, lengths))}")
    return rows


def rising(values: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return ascending numbers, or raise `ValueError`."""
    if any(later <= earlier for earlier, later in pairwise(values)):
        raise ValueError("should be numbers that rise")
    return values


def _composed(label: str) -> str:
    """Return a label as tables read from files have it: an accent is one character with its letter."""
    return unicodedata.normalize("NFC", label)


def written_share(value: Any) -> Any:
    """Return the number of "0.25" or "25%", and any other value as it is."""
    try:
        number = float(value.strip().removesuffix("%"))
    except (AttributeError, ValueError):
        return value
    return number / (100.0 if value.strip().endswith("%") else 1.0)


Label = Annotated[str, AfterValidator(_composed)]
Grid = Annotated[
    tuple[_Entry, ...], BeforeValidator(_listed), Field(min_length=1, strict=False), AfterValidator(_distinct)
]
"""One value, or a list of different ones to run the study for."""

Several = Annotated[tuple[_Entry, ...], BeforeValidator(_listed), Field(min_length=1, strict=False)]
Rising = Annotated[tuple[_Entry, ...], BeforeValidator(_listed), Field(strict=False), AfterValidator(rising)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
Likely = Annotated[float, Field(gt=0, le=1)]
WRITTEN_SHARE = BeforeValidator(written_share)
Share = Annotated[float, WRITTEN_SHARE]
Count = Annotated[int, Field(ge=1)]
AtLeastTwo = Annotated[int, Field(ge=2)]
_PAIR = (BeforeValidator(_listed), Field(strict=False), AfterValidator(_ascending))
Pair = Annotated[tuple[float, float], *_PAIR]
PositivePair = Annotated[tuple[Positive, Positive], *_PAIR]
Matrix = list[list[float]]
EvenMatrix = Annotated[Matrix, AfterValidator(_even)]


class Section(BaseModel):
    """A section of settings: unknown keys and values of the wrong type are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False, frozen=True)

    def __init__(self, **values: Any) -> None:
        plain = {key: each.item() if isinstance(each, np.generic) else each for key, each in values.items()}
        try:
            super().__init__(**plain)
        except ValidationError as error:
            raise InputError(first_mistake(error, plain)) from None

    # Values from a file keep pydantic's own errors, from which the reader names file, line and key.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]


def mistakes(error: ValidationError, data: Any) -> list[Any]:
    """Return pydantic's errors in data, one for each place and none for one that contains another: a choice between types has
    several errors, with a tag each."""
    found: dict[tuple[Any, ...], Any] = {}
    for problem in error.errors(include_url=False):
        place, inner = list[Any](), data
        for part in problem["loc"]:
            listed = range(len(inner)) if isinstance(inner, (list, tuple)) else inner if isinstance(inner, dict) else ()
            if part in listed:
                inner = inner[part]
                place.append(part)
        if problem["type"] == "missing":
            place.append(problem["loc"][-1])
        found.setdefault(tuple(place), problem | {"loc": tuple(place)})
    around = {place[:depth] for place in found for depth in range(len(place))}
    return [problem for place, problem in found.items() if place not in around]


def first_mistake(error: ValidationError, data: Any) -> str:
    """Return the first error and its place as one line."""
    first, *others = mistakes(error, data)
    more = f" (and {len(others)} more)" if others else ""
    where = ".".join(map(str, first["loc"]))
    if not where:  # a check of several keys: the message has its own numbers
        return f"{expected(first)}{more}"
    return f"{where}: {expected(first)}, got {shortened(first['input'])}{more}"


def expected(problem: Any) -> str:
    """Return the expectation for a value, from one of pydantic's errors."""
    kind, context = problem["type"], problem.get("ctx", {})
    if kind in ("too_short", "too_long"):
        bound, number = ("least", context["min_length"]) if kind == "too_short" else ("most", context["max_length"])
        return f"should have at {bound} {number} {'entry' if number == 1 else 'entries'}"
    if kind == "string_too_short":
        return "should have at least one character"
    words = {
        "int_type": "should be a whole number",
        "float_type": "should be a number",
        "string_type": "should be text in quotes",
        "list_type": "should be a list",
        "tuple_type": "should be a list",
        "model_type": "should be a table of keys, such as [section]",
        "model_attributes_type": "should be a table of keys, such as [section]",
    }
    return words.get(kind) or str(problem["msg"]).removeprefix("Value error, ").removeprefix("Input ")


def shortened(value: Any) -> str:
    """Return a value as it would be written, cut where it is long."""
    text = repr(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


class PlanFile(Section):
    """The keys of every kind of study."""

    name: Annotated[str, Field(min_length=1)]
    note: str = ""
    seed: Annotated[int, Field(ge=0)] = 0
