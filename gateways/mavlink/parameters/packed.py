"""The packed parameter file `@PARAM/param.pck` of ArduPilot (row 20 of the list).

A header of three 16-bit numbers: kind, parameters in this file, parameters in all. Then for each
parameter: type and flags, lengths of the name's shared and own parts, the own part, the value, and
the default if it differs. ArduPilot pads entries because values may change while the file is read.
Here the file contains the values at the time when it was opened, so it needs no padding.
"""

from itertools import takewhile
from struct import Struct
from typing import Final, NamedTuple
from urllib.parse import parse_qsl

from gateways.mavlink.parameters.table import MavParameter, MavTable

PLAIN, WITH_DEFAULTS = 0x671B, 0x671C
HEADER: Final = Struct("<HHH")
INTEGER: Final = (3, Struct("<i"))
REAL: Final = (4, Struct("<f"))
HAS_DEFAULT: Final = 0x10
MAX_SHARED: Final = 15
MAX_NUMBER: Final = 0xFFFE


class Selection(NamedTuple):
    """The parameters that a client asks for; a limit of 0 is all from `start` on."""

    start: int = 0
    limit: int = 0
    with_defaults: bool = False


def selection_in(query: str) -> Selection | None:
    """Parse the text after the `?` of a name; None if a number is invalid."""
    found = {"start": 0, "count": 0, "withdefaults": 0}
    limits = {"start": MAX_NUMBER, "count": MAX_NUMBER, "withdefaults": 1}
    for key, text in parse_qsl(query, keep_blank_values=True):
        if key in found:
            if not (text.isascii() and text.isdecimal() and len(text) <= len(str(MAX_NUMBER))):
                return None
            found[key] = int(text)
            if found[key] > limits[key]:
                return None
    return Selection(found["start"], found["count"], found["withdefaults"] == 1)


def packed(table: MavTable, selection: Selection) -> bytes | None:
    """Return the file; None if it begins behind the last parameter."""
    total = len(table)
    if selection.start >= total:
        return None
    end = selection.start + selection.limit if selection.limit else total
    chosen = table.parameters[selection.start : end]
    kind = WITH_DEFAULTS if selection.with_defaults else PLAIN
    parts = [HEADER.pack(kind, len(chosen), total)]
    before = ""
    for one in chosen:
        parts.append(_entry(one, before, with_default=selection.with_defaults))
        before = one.name
    return b"".join(parts)


def _entry(one: MavParameter, before: str, *, with_default: bool) -> bytes:
    kind, layout = INTEGER if one.own.integer else REAL
    cast = int if one.own.integer else float
    value, default = layout.pack(cast(one.value)), layout.pack(cast(one.default))
    has_default = with_default and value != default
    equal = takewhile(lambda pair: pair[0] == pair[1], zip(before, one.name, strict=False))
    shared = min(MAX_SHARED, len(one.name) - 1, len(list(equal)))
    own = one.name[shared:].encode()
    head = bytes([kind | (HAS_DEFAULT if has_default else 0), shared | (len(own) - 1) << 4])
    return head + own + value + (default if has_default else b"")
