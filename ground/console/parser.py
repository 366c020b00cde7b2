"""A typed command to the operation that the shell would have made of the same verb.

Nothing here prints or exits: what cannot be done is a UserError with the reason and the fix.
"""

import argparse
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from itertools import chain
from types import MappingProxyType
from typing import Final, NoReturn

from ground.client.operations import Operation
from ground.client.results import Outcome
from ground.console.aliases import ALIASES, unfolded
from ground.console.app_commands import LOCAL, AppCommand
from ground.console.tokenizer import words_of
from ground.grammar.missions import MissionWords
from ground.grammar.words import common_verbs
from ground.grammar.words import words_of as words_class
from ground.reports.export import Export
from protocol.options import numbers_kept
from runtime.errors import UserError

ELSEWHERE: Final[Mapping[str, str]] = MappingProxyType(
    {
        "up": "it starts a robot of its own: run it in another terminal",
        "router": "it runs until it is stopped: run it in another terminal",
        "bridge": "it runs until it is stopped: run it in another terminal",
        "ground": "this is it",
        "berth": "it is for a process that begins in a container",
        "health": "it is for the health checks of containers: doctor says more",
    }
)
"""Verbs of the command line that make no sense inside of the app, and why."""
ANSWERED: Final = ("connect", "id", "config", "json")
"""Options that were answered when the app was started."""
COMMANDS: Final = common_verbs()
LONGEST_GUESSED: Final = 24
COLUMNS: Final = 60


class ConsoleParser(argparse.ArgumentParser):
    """Reads as argparse does, and raises where that would print and exit."""

    def __init__(self, prog: str = "", **how: object) -> None:
        how |= {"add_help": False, "allow_abbrev": False, "formatter_class": narrow}
        super().__init__(prog, **how)  # type: ignore[arg-type]

    def error(self, message: str) -> NoReturn:
        raise UserError(f"{message}; it takes: {usage_of(self)}")


def narrow(prog: str) -> argparse.HelpFormatter:
    """Help that fits the log, whatever the terminal is like."""
    return argparse.HelpFormatter(prog, max_help_position=16, width=COLUMNS)


def usage_of(parser: argparse.ArgumentParser) -> str:
    """In one line, without what the app has answered already."""
    return " ".join(parser.format_usage().removeprefix("usage:").split())


def verbs() -> list[str]:
    """Every word a command can begin with."""
    return sorted(
        {*COMMANDS, *LOCAL, *(word for word in ALIASES if word.isalpha() and word != "q")}
    )


def is_local(words: Sequence[str]) -> bool:
    """Whether the app does it itself. `teleop` alone is its mode, with speeds it is the verb."""
    first = words[0]
    return first in LOCAL and not (first == "teleop" and len(words) > 1)


def parser_for(words: Sequence[str]) -> argparse.ArgumentParser:
    """What reads the rest of these words; UserError when there is no such verb."""
    word = words[0]
    if is_local(words):
        parser = ConsoleParser(word, description=LOCAL[word].says)
        LOCAL[word].words.declare(parser)
    elif word in COMMANDS:
        parser = ConsoleParser(word, description=COMMANDS[word].summary)
        words_class(COMMANDS[word]).declare(parser)
    else:
        raise UserError(_unknown(word))
    for inner in everything_in(parser):
        hide_answered(inner)
    return parser


def _unknown(word: str) -> str:
    if word in ELSEWHERE:
        return f"{word!r} cannot be done here: {ELSEWHERE[word]}"
    shown = word if len(word) <= LONGEST_GUESSED else f"{word[:LONGEST_GUESSED]}..."
    near = get_close_matches(word[:LONGEST_GUESSED], verbs(), n=1)
    return f"no such command: {shown!r}; {f'did you mean {near[0]!r}?' if near else 'try help'}"


def everything_in(parser: argparse.ArgumentParser) -> list[argparse.ArgumentParser]:
    """The parser and those of its subcommands."""
    inner = subcommands_of(parser).values()
    return [parser, *chain.from_iterable(map(everything_in, inner))]


def subcommands_of(parser: argparse.ArgumentParser) -> dict[str, argparse.ArgumentParser]:
    # argparse has no public way to look into a parser.
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            return dict(action.choices)
    return {}


def hide_answered(parser: argparse.ArgumentParser) -> None:
    for action in parser._actions:
        if action.dest in ANSWERED and action.option_strings:
            action.help = argparse.SUPPRESS


def read(text: str, draft: Callable[[], str] | None = None) -> Operation[Outcome] | AppCommand:
    """Return what was typed as the value that does it; UserError says why it cannot be one.

    `draft` returns what `mission upload -` sends, where a shell would have standard input.
    """
    words = words_of(text)
    if not words:
        raise UserError("nothing to do: type a command, or help")
    words = unfolded(words)
    rest = numbers_kept(words[1:])
    if is_local(words):
        return parser_for(words).parse_args(rest, LOCAL[words[0]].words(words[0])).command()
    found = parser_for(words).parse_args(rest, words_class(COMMANDS[words[0]])(words[0]))
    for name in ANSWERED:
        if getattr(found, name, None):
            raise UserError(f"--{name} cannot be used here: it was settled when the app started")
    if isinstance(found, MissionWords):
        found.typed = draft
    operation = found.operation()
    if isinstance(operation, Export) and operation.out is None:
        raise UserError("there is no standard output here: add --out FILE")
    return operation
