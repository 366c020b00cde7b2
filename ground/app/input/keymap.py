"""Combine the table of keys with the user's file: ids are stable, keys can be changed."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from ground.app.input.default_keys import KEYS, KeyBinding, Layer
from runtime.config import line_located, read_toml, unknown_key
from runtime.errors import ConfigError

TABLE: Final = "keys"
SHOWN: Final[Mapping[str, str]] = MappingProxyType(
    {
        "escape": "esc",
        "pageup": "pgup",
        "pagedown": "pgdn",
        "backspace": "bksp",
        "up": "↑",
        "down": "↓",
        "left": "←",
        "right": "→",
    }
)
TOGETHER: Final = (
    (Layer.STOP, Layer.TELEOP),
    (Layer.TYPING,),
    (Layer.FILTER,),
    (Layer.STOP, Layer.CURSOR),
    (Layer.STOP, Layer.DRIVE, Layer.REPLAY, Layer.ROBOT, Layer.FLEET, Layer.STATION),
    *(
        (Layer.STOP, Layer.LIST, layer, Layer.FLEET, Layer.STATION)
        for layer in (Layer.PLOTS, Layer.PARAMS, Layer.LOG, Layer.WORLDS, Layer.FAULTS)
    ),
)
"""Layers that are active at the same time. The cursor and teleop hide the layers below them: the
operator enters them on purpose, and leaves them with one key."""


class Keymap:
    """All keys in force, in the order of the table."""

    def __init__(self, keys: Iterable[KeyBinding] = KEYS) -> None:
        self.keys = tuple(keys)
        self._by_id = {key.id: key for key in self.keys}
        self._found: dict[tuple[Layer, ...], tuple[KeyBinding, ...]] = {}

    def __getitem__(self, id: str) -> KeyBinding:
        return self._by_id[id]

    def of(self, *layers: Layer) -> list[KeyBinding]:
        """Return the keys that are active with these layers, the first layer first.

        Each key appears once.
        """
        if layers not in self._found:
            self._found[layers] = tuple(self._active(layers))
        return list(self._found[layers])

    def _active(self, layers: Iterable[Layer]) -> list[KeyBinding]:
        taken: set[str] = set()
        found: list[KeyBinding] = []
        for layer in layers:
            for key in self.keys:
                free = tuple(word for word in key.keys if word not in taken)
                if key.layer is layer and (free or not key.keys):
                    found.append(key._replace(keys=free))
            taken.update(word for key in found for word in key.keys)
        return found


def load(path: Path | None) -> Keymap:
    """Return the keymap with the user's file. Raise ConfigError when the file is wrong."""
    if path is None:
        return Keymap()
    with line_located(path):
        return keymap_of(read_toml(path), file=str(path))


def keymap_of(table: Mapping[str, Any], *, file: str) -> Keymap:
    """Read `[keys]` with `id = "key"` or `id = ["key", "other"]`; an empty list removes a key."""
    for name in table:
        if name != TABLE:
            raise unknown_key(name, name, [TABLE], file=file)
    chosen = table.get(TABLE, {})
    if not isinstance(chosen, Mapping):
        raise ConfigError(file=file, key=TABLE, reason="not a table", fix="write [keys]")
    known = [key.id for key in KEYS]
    for id in chosen:
        if id not in known:
            raise unknown_key(f"{TABLE}.{id}", id, known, file=file)
    keys = [
        key._replace(keys=_words(chosen[key.id], key.id, file)) if key.id in chosen else key
        for key in KEYS
    ]
    keymap = Keymap(keys)
    _check(keymap, chosen, file)
    return keymap


def _words(value: object, id: str, file: str) -> tuple[str, ...]:
    words = [value] if isinstance(value, str) else value
    if not isinstance(words, list) or not all(isinstance(word, str) and word for word in words):
        fix = 'write "x" or ["x", "f2"]'
        raise ConfigError(file=file, key=f"{TABLE}.{id}", reason="not a key", fix=fix)
    return tuple("space" if word == " " else word for word in words)


def _check(keymap: Keymap, chosen: Iterable[str], file: str) -> None:
    """Raise ConfigError for a key used twice, or an e-stop that cannot be pressed while typing."""
    if not any(len(word) > 1 for word in keymap["estop"].keys):
        fix = "keep one that types no character, such as f12"
        reason = "every key types a character, so it cannot be used on the command line"
        raise ConfigError(file=file, key=f"{TABLE}.estop", reason=reason, fix=fix)
    chosen = set(chosen)
    for first, second, word in clashes(keymap):
        if {first.id, second.id} & chosen:
            mine, other = (first, second) if first.id in chosen else (second, first)
            reason = f"{word!r} is already used by {other.id}"
            fix = f"give {other.id} another key"
            raise ConfigError(file=file, key=f"{TABLE}.{mine.id}", reason=reason, fix=fix)


def clashes(keymap: Keymap) -> list[tuple[KeyBinding, KeyBinding, str]]:
    """Return pairs of ids that share a key while both are active."""
    found: dict[tuple[KeyBinding, KeyBinding, str], None] = {}
    for layers in TOGETHER:
        owners: dict[str, KeyBinding] = {}
        for key in keymap.keys:
            for word in key.keys if key.layer in (Layer.ALWAYS, *layers) else ():
                first = owners.setdefault(word, key)
                if first is not key:
                    found[first, key, word] = None
    return list(found)


def shown(words: Sequence[str]) -> str:
    """Return keys as they are shown to the operator."""
    return " ".join(SHOWN.get(word, word) for word in words)


def as_toml(keymap: Keymap) -> str:
    """Return a file with every id, its keys and its description, as a template for users."""
    lines = ["# Ids and their keys; an id that is left out keeps its keys."]
    for layer in Layer:
        lines += ["", f"# {layer.value}"]
        for key in (key for key in keymap.keys if key.layer is layer):
            words = ", ".join(json.dumps(word) for word in key.keys)
            lines.append(f"{key.id} = [{words}]  # {key.description}")
    return "\n".join(["[keys]", *lines])
