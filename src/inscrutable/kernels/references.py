"""Named tuples of arrays that kernels hand on by reference.

A compiled call passes a named tuple as the fields of its arrays, some nine numbers each, and a search has eighty arrays. A
reference is one pointer; its fields are read where they are used, and a field that is a named tuple is a reference as well.
Searches of ten kinds of markets have the same bits and take .8 to 1 of the time, and all kernels compile in .84 of the time.

The record must outlive its references: an argument of a kernel that Python calls does, one that a kernel makes does until
`release`.
"""

from __future__ import annotations

from typing import Any

from numba import extending, types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate

# Numba is only partly typed.
_extending: Any = extending
_types: Any = types
_cgutils: Any = cgutils
_borrowed: Any = impl_ret_borrowed


def by_reference(record: Any) -> Any:
    """Return a reference to a named tuple; to the interpreter it is the tuple itself."""
    return record


def release(record: Any) -> None:
    """Let go of a named tuple that a kernel made: until here it lives."""


class RecordReference(types.Type):
    """The type of references to a type of named tuples."""

    def __init__(self, record: Any) -> None:
        self.record = record
        super().__init__(name=f"Reference({record})")

    def place_of(self, field: str) -> int:
        """The index of a field, −1 where there is none."""
        names = self.record.instance_class._fields
        return names.index(field) if field in names else -1


_extending.register_model(RecordReference)(_extending.models.OpaqueModel)
_RECORDS = (_types.NamedTuple, _types.NamedUniTuple)


def _reference_type(context: Any) -> Any:
    return lambda record: RecordReference(record) if isinstance(record, _RECORDS) else None


def _by_reference(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    place = _cgutils.alloca_once_value(builder, arguments[0])
    return builder.bitcast(place, _cgutils.voidptr_t)


_extending.type_callable(by_reference)(_reference_type)
for _record in _RECORDS:
    _extending.lower_builtin(by_reference, _record)(_by_reference)


def _release(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    return context.get_dummy_value()


_extending.type_callable(release)(lambda context: lambda record: _types.none)
_extending.lower_builtin(release, _types.Any)(_release)


@_extending.infer_getattr
class _FieldTypes(AttributeTemplate):
    key = RecordReference

    def generic_resolve(self, reference: Any, field: str) -> Any:  # type: ignore[override]
        place = reference.place_of(field)
        if place < 0:
            return None
        kind = reference.record[place]
        return RecordReference(kind) if isinstance(kind, _RECORDS) else kind


def _field(context: Any, builder: Any, reference: Any, value: Any, field: str) -> Any:
    record, place = reference.record, reference.place_of(field)
    held = builder.bitcast(value, context.get_value_type(record).as_pointer())
    address, kind = _cgutils.gep_inbounds(builder, held, 0, place), record[place]
    if isinstance(kind, _RECORDS):
        return builder.bitcast(address, _cgutils.voidptr_t)
    return _borrowed(context, builder, kind, builder.load(address))


_extending.lower_getattr_generic(RecordReference)(_field)
