"""Parse a typed line into the command that the shell would run for the same words.

Short words stand for words of the command line. Nothing here prints or exits: UserError holds the
reason and the remedy.
"""

import argparse
import shlex
from collections.abc import Iterator, Mapping, Sequence
from difflib import get_close_matches
from itertools import chain
from types import MappingProxyType
from typing import Final, NoReturn

from ground.commands.command import SHARED, OperatorCommand, kind_of
from ground.commands.export import Export
from ground.console.app_commands import LOCAL
from ground.console.argument_errors import in_words
from protocol.options import numbers_kept
from runtime.cli.parsers import subcommands_of
from runtime.cli.verb import APP, GROUPS, Verb
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


COMMANDS: Final = {word: row for word, row in VERBS.items() if row.words}
"""The verbs of the shell that are commands, which the app has too."""
MAX_GUESSED: Final = 24
COLUMNS: Final = 60


def other_words() -> Iterator[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Yield the other words for commands, in lower case, each with those that it stands for."""
    for word, row in (*VERBS.items(), *LOCAL.items()):
        if row.is_grouped:
            yield tuple(command_of(word).split()), (word,)
        for also, arguments in row.also.items():
            yield tuple(also.split()), (word, *arguments)
        for name, below in row.subcommands.items():
            for also, arguments in below.also.items():
                yield tuple(also.split()), (word, name, *arguments)


MEANT: Final[Mapping[tuple[str, ...], tuple[str, ...]]] = MappingProxyType(dict(other_words()))


def expanded(words: Sequence[str]) -> list[str]:
    """Replace a short word, or a pair of words, by the words of the command line."""
    if len(words) > 1 and (pair := MEANT.get(tuple(word.lower() for word in words[:2]))):
        return [*pair, *words[2:]]
    return [*MEANT.get((words[0],), words[:1]), *words[1:]]


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
    short = {words[0] for words in MEANT if len(words) == 1 and words[0].isalpha()} - {"q"}
    return sorted({*COMMANDS, *LOCAL, *short})


def words_of_group(group: str) -> dict[str, str]:
    """Return the words that may follow a group of verbs in the app, each with its command."""
    pairs = {words: meant for words, meant in MEANT.items() if words[0] == group}
    here = {*COMMANDS, *LOCAL}
    return {words[-1]: meant[0] for words, meant in pairs.items() if meant[0] in here}


def row_for(words: Sequence[str]) -> Verb:
    """Return the row of a command; UserError for an unknown verb.

    A word that both have, such as `teleop`, is the app's alone, and with arguments the shell's.
    """
    word = words[0]
    rows = (COMMANDS, LOCAL) if len(words) > 1 else (LOCAL, COMMANDS)
    row = rows[0].get(word) or rows[1].get(word)
    if row is None:
        raise UserError(_unknown(word))
    return row


def parser_for(words: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser of a command; UserError for an unknown verb."""
    row = row_for(words)
    title = words[0] if row.section == APP else command_of(words[0])
    parser = ConsoleParser(title, description=row.summary)
    kind_of(row).declare(parser)
    for inner in all_parsers(parser):
        hide_fixed_options(inner)
    return parser


def _unknown(word: str) -> str:
    if word in GROUPS:
        names = ", ".join(words_of_group(word)) or "none of them is available here"
        return f"{word!r} needs a second word: {names}"
    if word in VERBS:
        return f"{command_of(word)!r} is not available here: {VERBS[word].elsewhere}"
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
        if action.dest in (*SHARED, "seize") and action.option_strings:
            action.help = argparse.SUPPRESS


def read(text: str) -> OperatorCommand:
    """Parse a line into a command; UserError if it is invalid."""
    words = words_of(text)
    if not words:
        raise UserError("nothing to do: type a command, or help")
    words = expanded(words)
    found = parser_for(words).parse_args(numbers_kept(words[1:]))
    for name in SHARED:
        if getattr(found, name, None):
            raise UserError(f"--{name} cannot be used here: it was fixed when the app started")
    if getattr(found, "seize", False):
        raise UserError("--seize is for a shell: give `lease seize` first")
    command = kind_of(row_for(words)).parsed(found)
    if isinstance(command, Export) and command.out is None:
        raise UserError("there is no standard output here: add --out FILE")
    return command


def summaries() -> dict[str, str]:
    """Return the summary of every command."""
    rows = {command_of(word): row.summary for word, row in COMMANDS.items()}
    return rows | {word: row.summary for word, row in LOCAL.items()}


def help_text(word: str) -> str:
    """Return the usage of a command and its arguments; UserError if there is no such command."""
    parser = parser_for(expanded([word]))
    rest = parser.format_help().split("\n\n", 1)[-1].strip()
    return f"{usage_of(parser)}\n{rest}"
