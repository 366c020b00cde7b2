"""The fields of a message one by one, each with its value as the shortest text that says it."""

from collections.abc import Iterator
from math import isfinite
from struct import pack
from typing import NamedTuple

from protocol.wire.layout import LAYOUT, Field
from protocol.wire.message import Message


class Cell(NamedTuple):
    """One value; `kind` is text, integer, unsigned (64 bits) or float."""

    name: str
    kind: str
    text: str


def cells_of(message: Message) -> Iterator[Cell]:
    """Elements of an array are fields of their own."""
    for field in LAYOUT[type(message).__name__].fields:
        value, kind = getattr(message, field.name), kind_of(field)
        if field.is_text or not field.length:
            yield Cell(field.name, kind, text_of(field, value))
        else:
            for index, element in enumerate(value):
                yield Cell(f"{field.name}[{index}]", kind, text_of(field, element))


def kind_of(field: Field) -> str:
    if field.is_text:
        return "text"
    if field.limits is None:
        return "float"
    return "unsigned" if field.code == "Q" else "integer"


def text_of(field: Field, value: object) -> str:
    """The shortest text that stands for the value, at the precision the wire has."""
    if field.code == "f" and isinstance(value, float) and isfinite(value):
        return shortest_single(value)
    return repr(value) if isinstance(value, float) else str(value)


def shortest_single(value: float) -> str:
    """0.1 sent as 32 bits comes back as 0.10000000149011612; here it is 0.1 again."""
    wire = pack("<f", value)
    for digits in range(6, 9):
        text = f"{value:.{digits}g}"
        if pack("<f", float(text)) == wire:
            return text
    return f"{value:.9g}"
