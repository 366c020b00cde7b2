"""List the fields of a message, each with the shortest text of its exact value."""

from collections.abc import Iterator
from math import isfinite
from struct import pack
from typing import NamedTuple

from protocol.wire.message import LAYOUT, Field, Message


class FieldValue(NamedTuple):
    """One value; `kind` is text, integer, unsigned (64 bits) or float."""

    name: str
    kind: str
    text: str


def fields_of(message: Message) -> Iterator[FieldValue]:
    """Yield the fields of a message; each element of an array is a field."""
    for field in LAYOUT[type(message).__name__].fields:
        value, kind = getattr(message, field.name), kind_of(field)
        if field.is_text or not field.length:
            yield FieldValue(field.name, kind, text_of(field, value))
        else:
            for index, element in enumerate(value):
                yield FieldValue(f"{field.name}[{index}]", kind, text_of(field, element))


def kind_of(field: Field) -> str:
    """Return the kind of a field."""
    if field.is_text:
        return "text"
    if field.limits is None:
        return "float"
    return "unsigned" if field.code == "Q" else "integer"


def text_of(field: Field, value: object) -> str:
    """Return the shortest text of a value at the precision of the wire."""
    if field.code == "f" and isinstance(value, float) and isfinite(value):
        return shortest_single(value)
    return repr(value) if isinstance(value, float) else str(value)


def shortest_single(value: float) -> str:
    """Return the shortest text of a 32-bit value: 0.1, not 0.10000000149011612."""
    wire = pack("<f", value)
    for digits in range(6, 9):
        text = f"{value:.{digits}g}"
        if pack("<f", float(text)) == wire:
            return text
    return f"{value:.9g}"
