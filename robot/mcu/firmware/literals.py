"""Constants that can be written as literals, which MicroPython keeps in flash."""

import ast
from decimal import Decimal
from typing import Final

MAX_DIGITS: Final = 15
MAX_EXPONENT: Final = 22
"""MicroPython reads a number with so few digits and this decimal exponent exactly."""


def is_literal(value: object) -> bool:
    """Return whether MicroPython reads the literal of this value exactly and keeps it in flash."""
    if isinstance(value, bool):
        return False
    if isinstance(value, int | str):
        return True
    if isinstance(value, float):
        return is_short(value)
    return isinstance(value, tuple) and bool(value) and all(type(one) is int for one in value)


def is_short(value: float) -> bool:
    """Return whether a number has so few digits that MicroPython reads it exactly."""
    if value - value != 0.0 or value < 0.0:
        return False
    _, digits, exponent = Decimal(repr(value)).normalize().as_tuple()
    assert isinstance(exponent, int)
    return len(digits) <= MAX_DIGITS and -MAX_EXPONENT <= exponent <= MAX_EXPONENT


def literal(value: object) -> ast.expr:
    """Return the expression of a constant."""
    return ast.parse(repr(value), mode="eval").body
