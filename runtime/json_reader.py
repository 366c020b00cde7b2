"""JSON from others: read, or refused by one kind of error, however deep or long it is."""

import json
from typing import Any, Final

MAX_DEPTH: Final = 100
TOO_DEEP: Final = "nested too deeply"
MAX_DIGITS: Final = 18
"""Digits; a longer whole number is a float, perhaps infinite, as it would be anywhere else."""


def value_in(text: str | bytes) -> Any:
    """What the text says; ValueError when it is no JSON."""
    try:
        value = json.loads(text, parse_int=_number)
    except RecursionError as error:
        raise ValueError(TOO_DEEP) from error
    _check_depth(value)
    return value


def _check_depth(value: object) -> None:
    """ValueError for what the parser takes and a recursive reader or writer would not."""
    level = [value]
    for _ in range(MAX_DEPTH):
        nested = [one for one in level if isinstance(one, dict | list)]
        level = [
            inner for one in nested for inner in (one.values() if isinstance(one, dict) else one)
        ]
        if not level:
            return
    raise ValueError(TOO_DEEP)


def _number(digits: str) -> int | float:
    return int(digits) if len(digits) <= MAX_DIGITS else float(digits)
