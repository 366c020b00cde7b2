"""Look up verbs: how each is typed, which one a line means, and what a typo was meant to be."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, NamedTuple

from runtime.cli.verb_table import GROUPS, VERBS


def command_of(word: str) -> str:
    """Return how a verb is typed after `sidestep`, such as `rec plot` for `plot`."""
    verb = VERBS[word]
    return f"{verb.section} {verb.name or word}" if verb.is_grouped else word


WORDS: Final[Mapping[tuple[str, ...], str]] = MappingProxyType(
    {tuple(command_of(word).split()): word for word in VERBS}
)


class Call(NamedTuple):
    """A verb with its arguments; `is_old` for a name from before the verb had a group."""

    word: str
    arguments: list[str]
    is_old: bool = False


def find(words: Sequence[str]) -> Call | None:
    """Return the verb that a command line begins with, by its present or its old name."""
    for length in (2, 1):
        if word := WORDS.get(tuple(words[:length])):
            return Call(word, list(words[length:]))
    if words and words[0] in VERBS:
        return Call(words[0], list(words[1:]), is_old=True)
    return None


def nearest_verb(words: Sequence[str]) -> str:
    """Return a suggestion for words that are no verb, or ""."""
    commands = {word: command_of(word) for word in VERBS}
    if words[0] not in GROUPS:
        last_words = {command.split()[-1]: command for command in commands.values()}
        return nearest(words[0], last_words | commands | {group: group for group in GROUPS})
    if words[1] in VERBS:
        return nearest(words[1], commands)
    below = [command for command in commands.values() if command.startswith(f"{words[0]} ")]
    return nearest(" ".join(words[:2]), below)


def nearest(word: str, known: Iterable[str]) -> str:
    """Return a suggestion for a misspelt word: the nearest one, or what a mapping has for it."""
    from difflib import get_close_matches  # needed only after a mistake

    names = known if isinstance(known, Mapping) else {name: name for name in known}
    near = get_close_matches(word, names, n=1)
    return f"; did you mean {names[near[0]]!r}?" if near else ""


def with_present_name(words: Sequence[str]) -> list[str]:
    """Return a command line whose verb has its present name; words without a verb as they are."""
    call = find(words)
    return list(words) if call is None else [*command_of(call.word).split(), *call.arguments]
