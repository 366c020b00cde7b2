"""Name the keys and commands of the app that remedy a refusal, with the keymap in force."""

from collections.abc import Mapping
from string import Formatter
from types import MappingProxyType
from typing import Final

from ground.app.input.keymap import Keymap, shown
from ground.client.vocabulary import HINTS
from protocol.wire.reasons import Reason

REMEDIES: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.NOT_ARMED: "`{arm}` arm",
        Reason.EMERGENCY_STOPPED: "`{clear-estop}` clear it: press twice",
        Reason.NEWER_STOP: "`{clear-estop}` clear it: press twice",
        Reason.NO_GOAL: "`{goal}` sets a goal",
        Reason.DRIVING: "`{abort}` abort",
        Reason.NO_SENSES: "`{screen-5}` Links shows what arrives",
        Reason.NO_OPERATOR: "`{screen-5}` Links shows what arrives",
        Reason.NO_MISSION: "`{cursor}`, then `{waypoint}` drafts one, or `:mission upload FILE`",
        Reason.FENCE_UNCHECKED: "`{place}` sets the place, or `:fence off`",
    }
)
"""The remedy of each refusal; keys by the id of their action."""
SHELL: Final = "sidestep "


def key_hints(keymap: Keymap) -> Mapping[int, str]:
    """Return the remedies of refusals: keys if the keymap has them, otherwise commands."""
    named = {
        reason: words.format_map({id: shown(keymap[id].keys[:1]) for id in ids_in(words)})
        for reason, words in REMEDIES.items()
        if all(keymap[id].keys for id in ids_in(words))
    }
    commands = {reason: in_the_app(words) for reason, words in HINTS.items()}
    return {**commands, **named}


def ids_in(words: str) -> list[str]:
    """Return the ids of actions that a remedy names."""
    return [id for _, id, _, _ in Formatter().parse(words) if id]


def in_the_app(words: str) -> str:
    """Convert a shell command to a command of the app's command line."""
    return f"`:{words.removeprefix(SHELL)}`" if words.startswith(SHELL) else words
