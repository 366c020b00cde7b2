"""The keymap as Textual's bindings: all of them the app's own, so that keys are handled in the
order in which they were pressed, each after what the one before has done to the focus."""

from collections.abc import Iterable
from typing import Final

from textual.binding import Binding, BindingsMap

from ground.app.input.key_table import Layer
from ground.app.input.keymap import Keymap

NAMES: Final = {",": ("comma",), "ctrl+space": ("ctrl+space", "ctrl+@")}
"""A comma separates keys; and most terminals send the second for the first."""


def bindings_of(keymap: Keymap) -> BindingsMap:
    """The more special layer first, for the first that counts is done."""
    return BindingsMap(
        [
            Binding(word, f"do('{key.id}')", key.says, show=False, priority=True, id=key.id)
            for layer in Layer
            for key in keymap.keys
            if key.layer is layer
            for word in names_of(key.keys)
        ]
    )


def names_of(words: Iterable[str]) -> list[str]:
    return [name for word in words for name in NAMES.get(word, (word,))]
