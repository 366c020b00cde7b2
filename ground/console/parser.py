"""Parse a typed line into the operation that the shell would run for the same words.

Short words stand for words of the command line. Nothing here prints or exits: UserError holds the
reason and the remedy.
"""

import argparse
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from difflib import get_close_matches
from itertools import chain
from types import MappingProxyType
from typing import Final, NoReturn

from ground.client.outcomes import Outcome
from ground.client.session import Operation
from ground.commands.command import command_in, kind_of
from ground.commands.export import Export
from ground.commands.mission import OfMissionFile
from ground.console.app_commands import LOCAL, AppArguments, AppCommand
from ground.console.argument_errors import in_words
from protocol.options import numbers_kept
from runtime.cli.parsers import subcommands_of
from runtime.cli.verb import GROUPS
from runtime.cli.verb_table import VERBS, command_of
from runtime.errors import UserError

MAX_LENGTH: Final = 1000


def words_of(text: str) -> list[str]:
    """Return the words of a command; UserError if the line cannot be split."""
    if len(text) > MAX_LENGTH:
        raise UserError(f"a command has at most {MAX_LENGTH} characters, not {len(text)}")
    line = text.replace("\t", " ").strip().removeprefix(":").strip()
    if odd := next((letter for letter in line if not letter.isprintable()), ""):
        raise UserError(f"{odd!r} cannot be part of a command: one line of plain text")
    try:
        return shlex.split(line)
    except ValueError:
        raise UserError("unbalanced quote: close it, or put \\ before it") from None


def last_word(text: str) -> tuple[list[str], str]:
    """Return the words before the one being typed, and that one, empty after a blank."""
    for closing in ("", "'", '"'):
        try:
            words = shlex.split(f"{text}{closing}")
        except ValueError:
            continue
        if words and (closing or text[-1:] not in (" ", "\t")):
            return words[:-1], words[-1]
        return words, ""
    return [], text


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


UNAVAILABLE: Final[Mapping[str, str]] = MappingProxyType(
    {
        "up": "it starts its own robot: run it in another terminal",
        "ground": "the ground station is running already",
        "berth": "it is for processes in a container",
        "health": "it is for health checks of containers: doctor reports more",
    }
)
"""Verbs of the command line that the app does not have, and why."""
FIXED_OPTIONS: Final = ("connect", "run", "context", "id", "config", "json")
"""Options that were fixed when the app started."""
COMMANDS: Final = {word: verb for word, verb in VERBS.items() if verb.words}
"""The verbs that are typed operations, which the app's command line has too."""
MAX_GUESSED: Final = 24
COLUMNS: Final = 60


class ConsoleParser(argparse.ArgumentParser):
    """A parser that raises UserError where argparse would print and exit."""

    def __init__(self, prog: str = "", **how: object) -> None:
        how |= {"add_help": False, "allow_abbrev": False, "formatter_class": narrow_formatter}
        super().__init__(prog, **how)  # type: ignore[arg-type]

    def error(self, message: str) -> NoReturn:
        """Raise UserError with the message in plain words and an example."""
        raise UserError(in_words(self, message))


def narrow_formatter(prog: str) -> argparse.HelpFormatter:
    """Return a formatter of fixed width, so that help fits the log."""
    return argparse.HelpFormatter(prog, max_help_position=16, width=COLUMNS)


def usage_of(parser: argparse.ArgumentParser) -> str:
    """Return the usage in one line, without options that are fixed in the app."""
    return " ".join(parser.format_usage().removeprefix("usage:").split())


def verbs() -> list[str]:
    """Return every word a command can begin with."""
    return sorted(
        {*COMMANDS, *LOCAL, *(word for word in ALIASES if word.isalpha() and word != "q")}
    )


def words_of_group(group: str) -> list[str]:
    """Return the words that may follow a group of verbs in the app."""
    found = (words for words, meant in PAIRS.items() if meant[0] in {*COMMANDS, *LOCAL})
    return [second for first, second in found if first == group]


def is_local(words: Sequence[str]) -> bool:
    """Return whether the app carries it out itself.

    `teleop` alone is a mode of the app; with speeds it is the verb.
    """
    first = words[0]
    return first in LOCAL and not (first == "teleop" and len(words) > 1)


def parser_for(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of a command; UserError for an unknown verb."""
    word = words[0]
    if is_local(words):
        parser = ConsoleParser(word, description=LOCAL[word].summary)
        LOCAL[word].declare(parser)
    elif word in COMMANDS:
        parser = ConsoleParser(command_of(word), description=COMMANDS[word].summary)
        kind_of(COMMANDS[word]).declare(parser)
    else:
        raise UserError(_unknown(word))
    for inner in all_parsers(parser):
        hide_fixed_options(inner)
    return parser


def _unknown(word: str) -> str:
    if word in GROUPS:
        names = ", ".join(words_of_group(word)) or "none of them is available here"
        return f"{word!r} needs a second word: {names}"
    if word in VERBS:
        why = UNAVAILABLE.get(word, "run it in another terminal")
        return f"{command_of(word)!r} is not available here: {why}"
    shown = word if len(word) <= MAX_GUESSED else f"{word[:MAX_GUESSED]}..."
    near = get_close_matches(word[:MAX_GUESSED], verbs(), n=1)
    return f"no such command: {shown!r}; {f'did you mean {near[0]!r}?' if near else 'try help'}"


def all_parsers(parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """Return the parser and those of its subcommands."""
    inner = subcommands_of(parser).values()
    return [parser, *chain.from_iterable(map(all_parsers, inner))]


def hide_fixed_options(parser: argparse.ArgumentParser) -> None:
    """Hide the options that are fixed in the app, or for a shell."""
    for action in parser._actions:
        if action.dest in (*FIXED_OPTIONS, "seize") and action.option_strings:
            action.help = argparse.SUPPRESS


def read(text: str, draft: Callable[[], str] | None = None) -> Operation[Outcome] | AppCommand:
    """Parse a line into an operation or a command of the app; UserError if it is invalid.

    `draft` returns what `mission upload -` sends, where a shell would have standard input.
    """
    words = words_of(text)
    if not words:
        raise UserError("nothing to do: type a command, or help")
    words = expanded(words)
    rest = numbers_kept(words[1:])
    if is_local(words):
        arguments = parser_for(words).parse_args(rest, AppArguments())
        return LOCAL[words[0]].command(arguments)
    found = parser_for(words).parse_args(rest, argparse.Namespace(verb=words[0]))
    for name in FIXED_OPTIONS:
        if getattr(found, name, None):
            raise UserError(f"--{name} cannot be used here: it was fixed when the app started")
    if getattr(found, "seize", False):
        raise UserError("--seize is for a shell: give `lease seize` first")
    operation: Operation[Outcome] = command_in(found)
    if isinstance(operation, OfMissionFile):
        operation = replace(operation, draft=draft)
    if isinstance(operation, Export) and operation.out is None:
        raise UserError("there is no standard output here: add --out FILE")
    return operation
