"""Turn the keymap into Textual's bindings.

All bindings belong to the app, so that each key is handled after the one before has changed the
focus.
"""

from collections.abc import Iterable
from typing import Final

from textual.binding import Binding, BindingsMap

from ground.app.input.default_keys import Layer
from ground.app.input.keymap import Keymap

NAMES: Final = {",": ("comma",), "ctrl+space": ("ctrl+space", "ctrl+@")}
"""Textual's names of keys: a comma separates keys there, and most terminals send ctrl+@ for
ctrl+space."""


def bindings_of(keymap: Keymap) -> BindingsMap:
    """Return the bindings, the most special layer first; the first active one is used."""
    return BindingsMap(
        [
            Binding(word, f"do('{key.id}')", key.description, show=False, priority=True, id=key.id)
            for layer in Layer
            for key in keymap.keys
            if key.layer is layer
            for word in names_of(key.keys)
        ]
    )


def names_of(words: Iterable[str]) -> list[str]:
    """Return Textual's names of keys."""
    return [name for word in words for name in NAMES.get(word, (word,))]
