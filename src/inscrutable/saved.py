"""Results on disk: one npz file with the arrays and a JSON description of everything else; never pickle."""

from __future__ import annotations

import dataclasses
import io
import json
import os
from enum import Enum
from typing import Any, ClassVar, Self, TypeVar

import numpy as np

from inscrutable.errors import InputError, InscrutableError
from inscrutable.files import path_of, whole_file

_FORMAT = "inscrutable-result-1"
_Choice = TypeVar("_Choice", bound=Enum)
_Plain = TypeVar("_Plain")


def saved_choice(choice: type[_Choice]) -> type[_Choice]:
    """Make the members of an enumeration known to saved results."""
    Saved._known[choice.__name__] = choice
    return choice


def saved_plainly(kind: type[_Plain]) -> type[_Plain]:
    """Make a class with `to_dict` and `from_dict` known to saved results."""
    Saved._known[kind.__name__] = kind
    return kind


class Summarised:
    """A result that prints its summary."""

    def summary(self) -> str:
        """Return the summary."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return self.summary()


class Saved:
    """A frozen dataclass that can be saved and loaded; a field with metadata `saved=False` is left out.

    `_derived` of a subclass names cached properties that are saved like fields, and loaded instead of computed.
    """

    _known: ClassVar[dict[str, Any]] = {}
    _derived: ClassVar[tuple[str, ...]] = ()

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        Saved._known[cls.__name__] = cls

    @property
    def is_loaded(self) -> bool:
        """Whether the result was read from a file; then it was only checked that its numbers do not contradict each other."""
        return "_is_loaded" in vars(self)

    def _parts(self) -> dict[str, Any]:
        """The saved values, by name."""
        declared: Any = self
        kept = [f.name for f in dataclasses.fields(declared) if f.metadata.get("saved", True)]
        return {name: getattr(self, name) for name in (*kept, *self._derived)}

    @classmethod
    def _made(cls, parts: dict[str, Any]) -> Self:
        """Return the result from saved values; raise `InputError` where they contradict each other."""
        made_of: Any = cls
        missing = [
            f.name for f in dataclasses.fields(made_of) if f.default is dataclasses.MISSING and f.name not in parts
        ]
        if missing:
            raise InputError(f"another version wrote it, without {', '.join(missing)}: compute it again")
        derived = {name: parts[name] for name in cls._derived if name in parts}
        found = cls(**{name: value for name, value in parts.items() if name not in derived})
        vars(found).update(derived)
        return found

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the result to `path` as npz, all or nothing; raise `InputError` where it cannot be written."""
        arrays: dict[str, Any] = {}
        try:
            described = json.dumps({"format": _FORMAT, "result": _encode(self, arrays)})
        except TypeError as error:  # such as a label that is a date
            raise InputError(f"{path} was not written: {error}; expected labels that are texts or numbers") from None
        # A stream, because numpy adds an ending to a name.
        with whole_file(path) as temporary, temporary.open("wb") as stream:
            np.savez_compressed(stream, description=np.array(described), **arrays)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Self:
        """Return the result saved at `path`; raise `InputError` for a missing, damaged or foreign file."""
        source = path_of(path, "a saved result")
        try:
            # Read whole first: numpy leaves a damaged file open.
            held = source.read_bytes()
            if not held.startswith(b"PK"):
                raise InputError("it was not written by this package")
            with np.load(io.BytesIO(held), allow_pickle=False) as stored:
                described = json.loads(str(stored["description"]))
                if described.get("format") != _FORMAT:
                    raise InputError(f"its format is {described.get('format')!r}, expected {_FORMAT!r}")
                found = _decode(described["result"], stored)
        except Exception as error:
            # One damaged byte can raise anything in zlib, zipfile or numpy's header parser.
            reason = "it is a folder" if source.is_dir() else "it is damaged"
            told = str(error) if isinstance(error, (InscrutableError, FileNotFoundError)) else reason
            raise InputError(f"{path} is not a saved result: {told}") from error
        if not isinstance(found, cls):
            raise InputError(f"{path} holds a {type(found).__name__}, expected a {cls.__name__}")
        return found


def _encode(value: Any, arrays: dict[str, Any]) -> Any:
    if isinstance(value, np.ndarray):
        name = f"array{len(arrays)}"
        arrays[name] = value
        return {"array": name}
    if hasattr(value, "tocsr"):
        rows = value.tocsr()
        return {
            "sparse": [_encode(part, arrays) for part in (rows.data, rows.indices, rows.indptr)],
            "of": list(rows.shape),
        }
    if isinstance(value, Enum):
        return {"member": value.name, "of": type(value).__name__}
    if isinstance(value, tuple):
        return {"tuple": [_encode(item, arrays) for item in value]}
    if isinstance(value, Saved):
        parts = {name: _encode(part, arrays) for name, part in value._parts().items()}
        return {"record": type(value).__name__, "fields": parts}
    if type(value).__name__ in Saved._known:
        return {"plain": value.to_dict(), "of": type(value).__name__}
    plain = value.item() if isinstance(value, np.generic) else value
    if isinstance(plain, float) and not np.isfinite(plain):
        return {"float": repr(plain)}
    return plain


def _decode(value: Any, stored: Any) -> Any:
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return stored[value["array"]]
    if "sparse" in value:
        from scipy.sparse import csr_array

        return csr_array(tuple(_decode(part, stored) for part in value["sparse"]), shape=tuple(value["of"]))
    if "member" in value:
        kind: Any = Saved._known[value["of"]]
        if value["member"] not in kind.__members__:
            raise InputError(f"it has the unknown {value['of']} {value['member']!r}")
        return kind[value["member"]]
    if "plain" in value:
        return Saved._known[value["of"]].from_dict(value["plain"])
    if "tuple" in value:
        return tuple(_decode(item, stored) for item in value["tuple"])
    if "float" in value:
        return float(value["float"])
    found: Saved = Saved._known[value["record"]]._made(
        {name: _decode(item, stored) for name, item in value["fields"].items()}
    )
    vars(found)["_is_loaded"] = True
    return found
