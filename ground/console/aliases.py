"""Short words and names of two words of the console, and the verbs that they replace."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

from runtime.cli.verb_table import VERBS, command_of

ALIASES: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "goal": ("goto",),
        "algo": ("navigator",),
        "set": ("param", "set"),
        "get": ("param", "get"),
        "stop": ("estop",),
        "q": ("quit",),
        "exit": ("quit",),
        "?": ("help",),
    }
)
PAIRS: Final[Mapping[tuple[str, ...], tuple[str, ...]]] = MappingProxyType(
    {tuple(command_of(word).split()): (word,) for word, verb in VERBS.items() if verb.is_grouped}
    | {
        ("mode", "rtl"): ("rtl",),
        ("mission", "restart"): ("mission", "start", "1"),
        ("record", "mark"): ("mark",),
        ("rec", "start"): ("record", "start"),
        ("rec", "stop"): ("record", "stop"),
        ("wp", "upload"): ("mission", "upload", "-"),
    }
)


def expanded(words: Sequence[str]) -> list[str]:
    """Replace a short word by the words of the command line."""
    pair = PAIRS.get(tuple(word.lower() for word in words[:2]))
    if pair is not None:
        return [*pair, *words[2:]]
    first, *rest = words
    return [*ALIASES.get(first, (first,)), *rest]
