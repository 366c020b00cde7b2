"""Name the keys that remedy a refusal, from the keymap in force."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from ground.app.input.keymap import Keymap, shown
from ground.client.vocabulary import HINTS
from protocol.wire.reasons import Reason

REMEDIES: Final[Mapping[int, tuple[str, str]]] = MappingProxyType(
    {
        Reason.NOT_ARMED: ("arm", "arm"),
        Reason.EMERGENCY_STOPPED: ("clear-estop", "clear it: press twice"),
        Reason.NO_GOAL: ("goal", "sets a goal"),
        Reason.DRIVING: ("abort", "abort"),
    }
)
"""The id of the key that remedies a refusal, and what the key does."""


def key_hints(keymap: Keymap) -> Mapping[int, str]:
    """Return the remedies of refusals, as keys where the keymap has one, else as commands."""
    keys = {reason: (keymap[id].keys[:1], words) for reason, (id, words) in REMEDIES.items()}
    named = {reason: f"`{shown(key)}` {words}" for reason, (key, words) in keys.items() if key}
    return {**HINTS, **named}
