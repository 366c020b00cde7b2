"""Make the key bar: the keys of the present screen, each with its name."""

from collections.abc import Mapping, Sequence
from typing import Final

from ground.app.chrome.button_row import Button, buttons_width
from ground.app.chrome.next_keys import NextKey
from ground.app.input.default_keys import KeyBinding
from ground.app.input.keymap import shown
from ground.app.widgets.rows import Span, row

STOPS: Final = ("estop-here", "estop")
STOP: Final = "E-STOP"
LAST: Final = ("palette", "help")
ORDER: Final = (
    *("goal", "cursor", "hold", "resume", "arm", "mode", "navigator", "teleop"),
    *("explain", "abort", "missions", "rtl"),
)
"""The order of keys that all screens have, behind the keys of the present screen."""
Sides = tuple[list[Button], list[Button]]


def key_buttons(keys: Sequence[KeyBinding], width: int, following: Sequence[NextKey] = ()) -> Sides:
    """Return as many keys as fit, each once: the stop, the keys that follow now, all others.

    The palette and the help keep their place at the end.
    """
    known = {key.id: key for key in keys if key.keys}
    stop = next((known[id] for id in STOPS if id in known), None)
    first = [one for one in following if one.id in known]
    taken = {*STOPS, *LAST, *(id for one in first for id in (one.id, *one.others))}
    others = sorted((key for key in known.values() if key.short and key.id not in taken), key=place)
    tail = [button(known[id], known[id].short) for id in LAST if id in known]
    buttons = [
        *([] if stop is None else [button(stop, STOP, "alarm")]),
        *(
            button(known[one.id], one.name, presses=one.presses, others=keys_of(one.others, known))
            for one in first
        ),
        *(button(key, key.short) for key in others),
    ]
    room = width - buttons_width(tail)
    while buttons and buttons_width(buttons) > room:
        buttons.pop()
    return buttons, tail


def keys_of(ids: Sequence[str], known: Mapping[str, KeyBinding]) -> str:
    """Return the first keys of these actions, as they are shown."""
    return "".join(shown(known[id].keys[:1]) for id in ids if id in known)


def place(key: KeyBinding) -> int:
    """Return the position of a key on the key bar."""
    return ORDER.index(key.id) if key.id in ORDER else -1


def button(
    key: KeyBinding, name: str, role: str = "key", *, presses: int = 1, others: str = ""
) -> Button:
    """Return a button: the key, repeated as often as it must be pressed, `others`, and a name."""
    words = " ".join([shown(key.keys[:1])] * presses) + others
    return Button(row(" ", Span(words, role), Span(f" {name} ")), f"do('{key.id}')")
