"""Constants as literals, which MicroPython keeps in flash, and their exact values.

MicroPython's compiler neither reads nor prints floating-point numbers exactly: the last bits of a
frozen literal may differ from those in CPython. So the frozen C source is corrected: each number is
replaced by the literal of the program that it came from.
"""

import ast
import re
from bisect import bisect_left
from collections.abc import Iterable
from math import inf
from typing import Final

from runtime.errors import LocalError

FROZEN_FLOAT: Final = re.compile(r"(\{\{&mp_type_float\}, \(mp_float_t\))([^}]+)(\})")
MAX_FLOAT: Final = 1e38
"""Largest number that is frozen; the tool converts each one to single precision, too."""
NEAR: Final = 1e-14
"""Relative difference of a frozen number from its literal: a few units in the last place."""


def is_literal(value: object) -> bool:
    """Return whether MicroPython keeps the literal of this value in flash."""
    if isinstance(value, bool):
        return False
    if isinstance(value, int | str):
        return True
    if isinstance(value, float):
        return 0.0 <= value <= MAX_FLOAT
    if type(value) is tuple:  # not a named one, whose text is a call
        return bool(value) and all(type(one) is int for one in value)
    return False


def literal(value: object) -> ast.expr:
    """Return the expression of a constant."""
    return ast.parse(repr(value), mode="eval").body


def floats_in(source: str) -> set[float]:
    """Return the floating-point literals of a program."""
    nodes = ast.walk(ast.parse(source))
    return {
        node.value
        for node in nodes
        if isinstance(node, ast.Constant) and isinstance(node.value, float)
    }


def exact(frozen: str, wanted: Iterable[float]) -> str:
    """Return frozen C source in which every number is one of the wanted ones.

    Raises LocalError for a number that is not near exactly one of them.
    """
    ordered = sorted(wanted)

    def corrected(found: re.Match[str]) -> str:
        return f"{found[1]}{nearest(float(found[2]), ordered)!r}{found[3]}"

    return FROZEN_FLOAT.sub(corrected, frozen)


def nearest(value: float, ordered: list[float]) -> float:
    """Return the only ordered number near a value; raise LocalError unless there is just one."""
    place = bisect_left(ordered, value)
    around = [-inf, *ordered, inf][max(0, place - 1) : place + 4]
    near = [one for one in around if one == value or abs(one - value) <= NEAR * abs(value)]
    if value in near:
        return value
    if len(near) != 1:
        raise LocalError(f"frozen number {value!r} is near {near}, not near one literal")
    return near[0]
