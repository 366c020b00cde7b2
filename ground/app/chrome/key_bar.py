"""Make the key bar: the keys of the present screen, each with its name."""

from collections.abc import Sequence
from typing import Final

from ground.app.chrome.button_row import Button, buttons_width
from ground.app.input.default_keys import KeyBinding
from ground.app.input.keymap import shown
from ground.app.widgets.rows import Span, row

STOPS: Final = ("estop-here",)
LAST: Final = ("palette", "help")
ORDER: Final = (
    *("goal", "cursor", "hold", "resume", "arm", "mode", "navigator", "teleop"),
    *("explain", "abort", "missions", "rtl"),
)
"""The order of keys that all screens have, behind the keys of the present screen."""
Sides = tuple[list[Button], list[Button]]


def key_buttons(keys: Sequence[KeyBinding], width: int) -> Sides:
    """Return as many keys as fit; the palette and the help keep their place at the end."""
    named = sorted((key for key in keys if key.short and key.keys), key=place)
    tail = [button(key) for key in named if key.id in LAST]
    room = width - buttons_width(tail)
    buttons: list[Button] = []
    for key in named:
        more = [] if key.id in LAST else [button(key)]
        room -= buttons_width(more)
        if room < 0:
            break
        buttons += more
    return buttons, tail


def place(key: KeyBinding) -> int:
    """Return the position of a key on the key bar."""
    if key.id in STOPS:
        return -2
    return ORDER.index(key.id) if key.id in ORDER else -1


def button(key: KeyBinding) -> Button:
    """Return a key and its short name."""
    role = "alarm" if key.id in STOPS else "key"
    words = row(" ", Span(shown(key.keys[:1]), role), Span(f" {key.short} "))
    return Button(words, f"do('{key.id}')")
