"""Reads the robot's parameter list from JSON: bounded, typed, and with printable text only."""

import re
from math import isfinite
from typing import Final, TypeAlias

from protocol.wire.limits import MAX_PARAMETER_NAME_BYTES
from runtime.cli.terminal import printable
from runtime.errors import RemoteError
from runtime.files import value_in

Row: TypeAlias = dict[str, object]
NAME: Final = re.compile(rf"[A-Za-z0-9_]{{1,{MAX_PARAMETER_NAME_BYTES}}}\Z")
NAME_RULE: Final = f"1 to {MAX_PARAMETER_NAME_BYTES} letters, digits and _"
KEY: Final = re.compile(r"[a-z_]{1,32}\Z")
NUMBERS: Final = ("default", "minimum", "maximum", "configured")
TEXTS: Final = ("unit", "doc", "group", "direction")
MAX_ROWS: Final = 1000
MAX_KEYS: Final = 32
MAX_TEXT: Final = 300


def rows_in(answer: bytes | str) -> list[Row]:
    """Return one row per parameter; RemoteError names the fault of a list that cannot be used."""
    try:
        found = value_in(answer)
    except ValueError as error:
        raise RemoteError(f"cannot read the parameter list from the robot: {error}") from error
    if not isinstance(found, list) or len(found) > MAX_ROWS:
        raise _malformed(f"not a list of at most {MAX_ROWS} items")
    rows = [_row(number, one) for number, one in enumerate(found)]
    if len({row["name"] for row in rows}) < len(rows):
        raise _malformed("duplicate name")
    return rows


def _row(number: int, found: object) -> Row:
    """Return a name, a value and the other plain facts of one item."""
    if not isinstance(found, dict) or len(found) > MAX_KEYS:
        raise _bad_item(number, "is not a table")
    name = found.get("name")
    if not isinstance(name, str) or not NAME.match(name):
        raise _bad_item(number, f"has no name of {NAME_RULE}")
    if not is_number(found.get("value")):
        raise _bad_item(number, "has no finite number as its value")
    for key in NUMBERS:
        if found.get(key) is not None and not is_number(found[key]):
            raise _bad_item(number, f"has a {key} that is not a finite number")
    for key in TEXTS:
        if not isinstance(found.get(key, ""), str):
            raise _bad_item(number, f"has a {key} that is not text")
    return {key: _plain(value) for key, value in found.items() if _kept(key, value)}


def _kept(key: str, value: object) -> bool:
    return bool(KEY.match(key)) and (isinstance(value, bool | str) or is_number(value))


def _plain(value: object) -> object:
    return printable(value[:MAX_TEXT]) if isinstance(value, str) else value


def is_number(value: object) -> bool:
    """Return whether a value is a finite number, and not a bool."""
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _bad_item(number: int, why: str) -> RemoteError:
    return _malformed(f"item {number + 1} {why}")


def _malformed(why: str) -> RemoteError:
    return RemoteError(f"malformed parameter list received from the robot: {why}")
