"""The last line: the keys that count now, the most needed first."""

from collections.abc import Sequence
from typing import Final

from ground.app.input.key_table import Key
from ground.app.input.keymap import shown
from ground.app.widgets.rows import Row, Span, cut, row, width_of

STOPS: Final = ("estop-here",)
LAST: Final = ("palette", "help")
ORDER: Final = (
    *("goal", "cursor", "hold", "resume", "arm", "mode", "navigator", "teleop"),
    *("explain", "abort", "missions", "rtl"),
)
"""What every screen has; what only the present one has comes before it."""


def keybar_row(keys: Sequence[Key], width: int) -> Row:
    """As many as there is room for; the way to all the others keeps its place at the end."""
    named = sorted((key for key in keys if key.short and key.keys), key=place)
    tail = [span for key in named if key.id in LAST for span in button(key)]
    room = width - width_of(tuple(tail))
    spans: list[Span] = []
    for key in named:
        more = () if key.id in LAST else button(key)
        room -= width_of(more)
        if room < 0:
            break
        spans += more
    gap = max(0, width - width_of(tuple(spans)) - width_of(tuple(tail)))
    return cut(row(*spans, Span(" " * gap), *tail), width)


def place(key: Key) -> int:
    if key.id in STOPS:
        return -2
    return ORDER.index(key.id) if key.id in ORDER else -1


def button(key: Key) -> Row:
    role = "alarm" if key.id in STOPS else "key"
    return row(" ", Span(shown(key.keys[:1]), role), Span(f" {key.short} "))
