"""JSON from others: read, or refused by one kind of error, however deep or long it is."""

import json
from typing import Any, Final

LONGEST_WHOLE: Final = 18
"""Digits; a longer whole number is a float, perhaps infinite, as it would be anywhere else."""


def value_in(text: str | bytes) -> Any:
    """What the text says; ValueError when it is no JSON."""
    try:
        return json.loads(text, parse_int=_number)
    except RecursionError as error:
        raise ValueError("nested too deeply") from error


def _number(digits: str) -> int | float:
    return int(digits) if len(digits) <= LONGEST_WHOLE else float(digits)
