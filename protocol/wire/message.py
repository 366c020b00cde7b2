"""Base class of all messages, their wire layouts, the check of their fields, and their packing.

Packing and unpacking of a payload is one expression for each type, built from the generated layout
table and compiled on first use. Compiled, it is three times as fast as a loop over the fields; the
control loop needs that speed.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from math import inf
from struct import Struct
from typing import Any, Final, NamedTuple, TypeAlias, cast

import msgspec

from protocol.wire.layouts import LAYOUTS
from runtime.errors import LocalError

Value: TypeAlias = str | float | int | None
CODE_BITS: Final = {"B": 8, "b": 8, "H": 16, "h": 16, "I": 32, "i": 32, "Q": 64, "q": 64}


class Field(NamedTuple):
    """One field: `length` elements of struct code `code`, or a scalar when `length` is 0."""

    name: str
    code: str
    length: int

    @property
    def is_text(self) -> bool:
        """Return whether the field is a text."""
        return self.code == "s"

    @property
    def limits(self) -> tuple[int, int] | None:
        """Smallest and largest value of an integer field; None for other fields."""
        if self.code not in CODE_BITS:
            return None
        bits = CODE_BITS[self.code]
        return (
            (-(1 << bits - 1), (1 << bits - 1) - 1) if self.code.islower() else (0, (1 << bits) - 1)
        )


class Layout(NamedTuple):
    """A message: its name in the dialect, id, crc_extra and fields in wire order."""

    name: str
    number: int
    crc_extra: int
    fields: tuple[Field, ...]


def class_name(name: str) -> str:
    """Return the Python class name of a message: SONAR_SCAN becomes SonarScan."""
    return "".join(part.capitalize() for part in name.split("_"))


def _field(word: str) -> Field:
    name, _, kind = word.partition(":")
    return Field(name, kind[-1], int(kind[:-1] or 0))


def _layout(line: str) -> Layout:
    name, number, crc_extra, *fields = line.split()
    return Layout(name, int(number), int(crc_extra), tuple(_field(word) for word in fields))


LAYOUT: Final = {
    class_name(layout.name): layout
    for layout in map(_layout, LAYOUTS.replace("\n  ", " ").split("\n")[1:-1])
}


class SonarRanges:
    """The ranges of a sonar scan in metres."""

    __slots__ = ()

    @property
    def ranges_m(self) -> tuple[float | None, ...]:
        """Ranges from the rim, from right to left: inf without an echo, None if not measured."""
        scan: Any = self
        return tuple(
            None if not scan.valid >> place & 1 else mm / 1e3 if scan.echo >> place & 1 else inf
            for place, mm in enumerate(scan.range_mm)
        )


class Message(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """One message of the dialect; its fields have the names of the XML.

    Lengths of arrays and texts are checked on construction. Ranges of numbers are checked by
    `check` and by the encoder. All checks raise LocalError.
    """

    def __init_subclass__(cls) -> None:
        assert cls.__name__ in LAYOUT, f"{cls.__name__} is not in the dialect"

    def to_dict(self) -> "dict[str, Value]":
        """Return the fields in SI units, each element of an array by itself, as in `range_m[0]`.

        What is not a number, because it was not measured or does not apply, is None.
        """
        found: dict[str, Value] = {}
        for field in LAYOUT[type(self).__name__].fields:
            name, factor = si_name(field.name)
            values = getattr(self, field.name)
            if field.name == "range_mm" and isinstance(self, SonarRanges):
                values, factor = self.ranges_m, 1.0
            if field.is_text or not field.length:
                found[name] = si_value(values, factor)
                continue
            for place, value in enumerate(values):
                found[f"{name}[{place}]"] = si_value(value, factor)
        return found


def si_value(value: Value, factor: float) -> Value:
    """Return a value of the wire over a factor; NaN becomes None."""
    if value != value:
        return None
    if value is None or isinstance(value, str) or factor == 1.0:
        return value
    return value / factor


UNITS: Final = (
    *(("_mrad_s", "_rad_s", 1e3), ("_mm_s", "_m_s", 1e3), ("_urad", "_rad", 1e6)),
    *(("_mm", "_m", 1e3), ("_ns", "_s", 1e9), ("_us", "_s", 1e6), ("_ms", "_s", 1e3)),
)
"""Ending of a name on the wire, that of the SI unit, and how many are one of it."""


def si_name(name: str) -> tuple[str, float]:
    """Return the name of a field in SI units, and the divisor of its values."""
    for ending, unit, factor in UNITS:
        if name.endswith(ending):
            return name.removesuffix(ending) + unit, factor
    return name, 1.0


def problem(message: Message) -> str:
    """Return the first field that does not fit, with value and limit; empty if all fit."""
    for field in LAYOUT[type(message).__name__].fields:
        value = getattr(message, field.name)
        limit = _limit_of_text(field, value) if field.is_text else _limit_of_numbers(field, value)
        if limit:
            return f"{type(message).__name__}.{field.name} = {value!r}: {limit}"
    return ""


def check(message: Message) -> None:
    """Raise LocalError unless every field fits the wire."""
    if found := problem(message):
        raise LocalError(found)


def unfit(message: Message) -> LocalError:
    """Return the error for a message that failed a quick check."""
    return LocalError(problem(message) or f"{message!r} does not fit the wire")


def _limit_of_text(field: Field, value: object) -> str:
    if not isinstance(value, str):
        return "must be text"
    if "\0" in value:
        return "must not contain NUL"
    try:
        size = len(value.encode())
    except UnicodeEncodeError:
        return "must be valid Unicode"
    return f"must be at most {field.length} bytes of UTF-8" if size > field.length else ""


def _limit_of_numbers(field: Field, value: object) -> str:
    if not field.length:
        return _limit_of_number(field, value)
    if not isinstance(value, tuple | list) or len(value) != field.length:
        return f"must be {field.length} numbers"
    return next((limit for element in value if (limit := _limit_of_number(field, element))), "")


def _limit_of_number(field: Field, value: object) -> str:
    if field.limits is None:
        return _limit_of_float(field, value)
    low, high = field.limits
    fits = isinstance(value, int) and low <= value <= high
    return "" if fits else f"must be an integer from {low} to {high}"


FLOAT32_LIMIT = 3.4028235677973366e38  # from here on a value rounds to infinity


def _limit_of_float(field: Field, value: object) -> str:
    if not isinstance(value, int | float):
        return "must be a number"
    infinite = value in (float("inf"), float("-inf"))
    if field.code == "f" and abs(value) >= FLOAT32_LIMIT and not infinite:
        return "must fit 32 bits (magnitude at most 3.4028235e38)"
    return ""


def too_long(text: str, size: int) -> bool:
    """Return whether a text exceeds `size` bytes, or contains a NUL, which would truncate it."""
    return len(text.encode(errors="replace")) > size or "\0" in text


@dataclass(frozen=True, slots=True, kw_only=True)
class Wire:
    """Encoding of one message type. `pack` raises the errors of `struct`, `unpack` UnicodeError."""

    name: str
    number: int
    number_low: int
    number_high: int
    crc_extra: bytes
    size: int
    pack: Callable[[Message], bytes]
    unpack: Callable[[bytes], Message]


@cache
def wire_of(message: type[Message]) -> Wire:
    """Return the encoding of a message type."""
    layout = LAYOUT[message.__name__]
    struct = Struct("<" + "".join(f"{field.length or ''}{field.code}" for field in layout.fields))
    return Wire(
        name=layout.name,
        number=layout.number,
        number_low=layout.number & 0xFFFF,
        number_high=layout.number >> 16,
        crc_extra=bytes([layout.crc_extra]),
        size=struct.size,
        pack=cast(Callable[[Message], bytes], _packing(struct, layout.fields)),
        unpack=cast(Callable[[bytes], Message], _unpacking(struct, layout.fields, message)),
    )


def _packing(struct: Struct, fields: tuple[Field, ...]) -> object:
    values = ", ".join(_packed(field) for field in fields)
    return _compiled(f"lambda m: pack({values})", pack=struct.pack)


def _packed(field: Field) -> str:
    if field.is_text:
        return f"m.{field.name}.encode()"
    return f"*m.{field.name}" if field.length else f"m.{field.name}"


def _unpacking(struct: Struct, fields: tuple[Field, ...], message: type[Message]) -> object:
    values, place = [], 0
    for field in fields:
        values.append(f"{field.name}={_unpacked(field, place)}")
        place += 1 if field.is_text else field.length or 1
    source = f"lambda payload: (v := unpack(payload)) and message({', '.join(values)})"
    return _compiled(source, unpack=struct.unpack, message=message)


def _unpacked(field: Field, place: int) -> str:
    if field.is_text:
        return f"v[{place}].partition(b'\\0')[0].decode()"
    return f"v[{place}:{place + field.length}]" if field.length else f"v[{place}]"


def _compiled(source: str, **names: Any) -> object:
    return eval(source, names)
