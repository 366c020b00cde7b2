"""Read JSON from untrusted sources; any problem raises ValueError, also for depth or length."""

import json
from typing import Any, Final

MAX_DEPTH: Final = 100
TOO_DEEP: Final = "nested too deeply"
MAX_DIGITS: Final = 18
"""A whole number with more digits becomes a float, possibly infinite."""


def value_in(text: str | bytes) -> Any:
    """Return the value of a JSON text; raise ValueError if it is invalid."""
    try:
        value = json.loads(text, parse_int=_number)
    except RecursionError as error:
        raise ValueError(TOO_DEEP) from error
    _check_depth(value)
    return value


def _check_depth(value: object) -> None:
    """Raise ValueError for values that are nested too deeply for recursive code."""
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
