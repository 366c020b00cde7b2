"""A recorded log as one long table: a row per field of every frame, in the order of arrival."""

import csv
from collections.abc import Iterator
from math import isfinite
from struct import pack
from typing import Final, NamedTuple, TextIO

from ground.tlog import Reader
from protocol.codec import decode
from protocol.errors import RemoteError
from protocol.layout import LAYOUT, Field
from protocol.message import Message

COLUMNS: Final = ("time_s", "message", "field", "value")


class Tally(NamedTuple):
    """What became of a log; `unreadable` frames are whole, but not of this dialect."""

    frames: int
    rows: int
    unreadable: int
    lost_bytes: int
    damage: str


def export(reader: Reader, target: TextIO) -> Tally:
    """Write the table; times are seconds since 1970 in UTC."""
    table = csv.writer(target, lineterminator="\n")
    table.writerow(COLUMNS)
    rows = unreadable = 0
    for record in reader:
        try:
            message = decode(record.frame).message
        except RemoteError:
            unreadable += 1
            continue
        time_s, name = f"{record.time_us / 1e6:.6f}", LAYOUT[type(message).__name__].name
        for field, value in fields_of(message):
            table.writerow((time_s, name, field, value))
            rows += 1
    return Tally(reader.records, rows, unreadable, reader.lost_bytes, reader.damage())


def fields_of(message: Message) -> Iterator[tuple[str, str]]:
    """Each field with its value as text; elements of an array are fields of their own."""
    for field in LAYOUT[type(message).__name__].fields:
        value = getattr(message, field.name)
        if field.is_text or not field.length:
            yield field.name, text_of(field, value)
        else:
            for index, element in enumerate(value):
                yield f"{field.name}[{index}]", text_of(field, element)


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
