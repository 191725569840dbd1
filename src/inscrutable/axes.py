"""Labelled axes: labelled input is put in one order, or refused."""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from inscrutable.errors import InputError

Names = tuple[Hashable, ...]
_PLAIN = {int, float, bool, str, type(None), np.ndarray, np.float64, np.int64}
"""Types without labels; the types in a list decide for the list."""
_SIDES = ("index", "columns")
_NUMBERINGS = (("", 0), ("", 1), ("regime ", 1))
"""Words before the numbers of places, and the first number; pandas and this library write the first and the last."""


class Axis:
    """The labels along one axis of the arrays that a call or an object takes.

    Labelled input is put in the order of `names`. Where none are known, an axis that `learns` takes those of the first
    labelled input, and later input is aligned to them; any other axis accepts only labels that number the places: 0, 1, … or
    "regime 1", "regime 2", …. An array without labels is taken by position, as are columns 0, 1, … where no name is one of
    them: a table made of an array has these.

    Args:
        what: What a label stands for, in messages.
        names: The labels in their order, or None.
        learns: Whether the first labelled input may set the order.

    Example:
        >>> assets = Axis("asset", learns=True)
        >>> assets.order(("Oil", "Food"), "means"), assets.order(("Food", "Oil"), "covariances"), assets.names
        (None, [1, 0], ('Oil', 'Food'))
    """

    def __init__(self, what: str, names: Names | None = None, *, learns: bool = False) -> None:
        self.what, self.names, self._learns = what, names, learns

    def order(self, found: Names, name: str) -> list[int] | None:
        """Return the places of labels in the order to take them in, None where they stay.

        Raises:
            InputError: A label occurs twice, is missing or unknown, or nothing says in which order they belong.
        """
        place = {label: k for k, label in enumerate(found)}
        if len(place) < len(found):
            twice = next(label for label in found if found.count(label) > 1)
            raise InputError(
                f"{name} has the {self.what} label {twice!r} {found.count(twice)} times; labels must differ"
            )
        names = self.names or self.numbering(found)
        if names is None and self._learns:
            names = self.names = found
        if names == found or (self.names is None and len(found) <= 1):
            return None
        if names is None:
            raise InputError(
                f"{name} has the {self.what} labels {few(found)}, but their order is not known here: put them in order and "
                "pass the numbers alone (.to_numpy()); labels are aligned only with those of a problem or a world that was "
                "built from labelled tables"
            )
        if found == tuple(range(len(names))) and not set(found) & set(names):
            return None
        if place.keys() != set(names):
            missing = [label for label in names if label not in place]
            extra = [label for label in found if label not in set(names)]
            said = [f"{word}: {few(these)}" for word, these in (("missing", missing), ("not expected", extra)) if these]
            raise InputError(f"{name} has other {self.what} labels than expected, {few(names)}; {'; '.join(said)}")
        return [place[label] for label in names]

    @staticmethod
    def numbering(found: Names) -> Names | None:
        """Labels that number the places, in their order; pandas and this library write them where no names were given."""
        for names in (tuple(range(len(found))), tuple(f"regime {i + 1}" for i in range(len(found)))):
            if set(found) == set(names):
                return names
        return None


def check_same_order(what: str, first: tuple[str, Names | None], second: tuple[str, Names | None]) -> None:
    """Raise `InputError` where two objects, given with their names, have known labels that are not the same in order.

    Numbers of the places, such as 0, "1" or "regime 1", are not known labels beside others. Labels are compared as texts, which
    those of a world are.
    """
    (one, ours), (other, theirs) = first, second
    if ours is None or theirs is None:
        return
    texts, others = tuple(map(str, ours)), tuple(map(str, theirs))
    is_numbered = any(map(_number_places, (texts, others))) and not set(texts) & set(others)
    if texts != others and not is_numbered:
        raise InputError(
            f"{one} has the {what} labels {few(ours)}, {other} {few(theirs)}; expected the same ones in the same order"
        )


def _number_places(texts: tuple[str, ...]) -> bool:
    return any(texts == tuple(f"{word}{first + i}" for i in range(len(texts))) for word, first in _NUMBERINGS)


def ordered(value: Any, name: str, axes: Sequence[Axis | None] | None) -> Any:
    """Return labelled input as plain arrays in the order that the axes say; anything else as it is.

    Args:
        value: A Series, a DataFrame, a mapping from labels, or lists of them: labelled along each of their axes.
        name: Of the input, in messages.
        axes: The last axes of the value; an axis of None, and those before, may have any labels. Without a list only labels
            that number the places are accepted.

    Raises:
        InputError: As `Axis.order`.
    """
    if type(value) is np.ndarray or not _is_labelled(value):
        return value
    n_axes = depth(value)
    given = [Axis("row" if k < n_axes - 1 else "entry") for k in range(n_axes)] if axes is None else list(axes)
    return _ordered(value, name, ([None] * n_axes + given)[-n_axes:])


def ordered_array(value: Any, name: str, axes: Sequence[Axis | None] | None) -> np.ndarray:
    """Return `ordered` as an array; a value of fewer dimensions has the first of the axes."""
    return as_array(ordered(value, name, None if axes is None else axes[: depth(value)]), name)


def _ordered(value: Any, name: str, axes: Sequence[Axis | None]) -> Any:
    if not axes or type(value) is np.ndarray or not _is_labelled(value):
        return value
    if isinstance(value, Mapping):
        rows = [_ordered(row, f"{name}[{key!r}]", axes[1:]) for key, row in value.items()]
        return _taken(as_array(rows, name), tuple(value), 0, name, axes[0])
    if isinstance(value, (list, tuple)):
        return as_array([_ordered(row, f"{name}[{i}]", axes[1:]) for i, row in enumerate(value)], name)
    labels = [getattr(value, side, None) for side in _SIDES]
    array = value.to_numpy()
    for k, found in enumerate(labels[: array.ndim] if array.ndim == len(axes) else []):
        array = array if found is None else _taken(array, tuple(found), k, name, axes[k])
    return array


def _taken(array: Any, found: Names, k: int, name: str, axis: Axis | None) -> Any:
    order = None if axis is None else axis.order(found, name)
    return array if order is None else np.take(array, order, axis=k)


def as_array(value: Any, name: str) -> np.ndarray:
    """Return a value as an array, with its mask where it has one; raise `InputError` where rows have other lengths."""
    try:
        return value if isinstance(value, np.ma.MaskedArray) else np.asarray(value)
    except ValueError as error:
        raise InputError(f"{name} must be numbers: {error}") from None


def _is_labelled(value: Any) -> bool:
    if isinstance(value, (list, tuple)):
        return not set(map(type, value)) <= _PLAIN and any(map(_is_labelled, value))
    return isinstance(value, Mapping) or (hasattr(value, "to_numpy") and any(hasattr(value, side) for side in _SIDES))


def depth(value: Any) -> int:
    """Return the number of dimensions of nested values, which need not have equal lengths."""
    if isinstance(value, Mapping):
        return 1 + max(map(depth, value.values()), default=0)
    if isinstance(value, (list, tuple)):
        scalars = set(map(type, value)) <= _PLAIN - {np.ndarray}  # a long list is common, and asked at once
        return 1 if scalars else 1 + max(map(depth, value), default=0)
    return int(np.ndim(value))


def axis_labels(value: Any, k: int) -> Names | None:
    """Return the labels that a table carries along an axis, None where it has none or they are 0, 1, …."""
    if isinstance(value, Mapping):
        found: Any = tuple(value)
    else:
        found = getattr(value, _SIDES[k], None) if hasattr(value, "to_numpy") else None
    if found is None or tuple(found) == tuple(range(len(found))):
        return None
    return tuple(found)


def as_texts(labels: Iterable[Any], names: Sequence[str]) -> list[Any]:
    """Return labels as texts, as a file has `names`; 0, 1, … stay where none is a name: a table made of an array has them."""
    found = list(labels)
    texts = list(map(str, found))
    return found if found == list(range(len(found))) and not set(texts) & set(names) else texts


def few(labels: Iterable[Any], most: int = 8) -> str:
    """Return the first labels, and how many there are in all."""
    held = [str(label) for label in labels]
    return ", ".join(held[:most]) + (f", … ({len(held)} in all)" if len(held) > most else "")
