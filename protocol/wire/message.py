"""Base class of all messages, and the check of their fields."""

import msgspec

from protocol.wire.layout import LAYOUT, Field
from runtime.errors import LocalError


class Message(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """One message of the dialect; its fields have the names of the XML.

    Lengths of arrays and texts are checked on construction. Ranges of numbers are checked by
    `check` and by the encoder. All checks raise LocalError.
    """

    def __init_subclass__(cls) -> None:
        assert cls.__name__ in LAYOUT, f"{cls.__name__} is not in the dialect"


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
