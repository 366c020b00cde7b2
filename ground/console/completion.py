"""Completions of a command that is being typed, as whole lines."""

import argparse
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ground.client.vocabulary import NAVIGATORS
from ground.console.aliases import expanded
from ground.console.parser import parser_for, subcommands_of, verbs
from ground.console.tokenizer import MAX_LENGTH, last_word
from ground.map import LAYERS
from ground.text.theme_names import THEMES
from runtime.errors import UserError

MAX_LINES: Final = 200
FILE_WORDS: Final = ("FILE", "DIR", "CSV", "IN", "OUT")
PARAMETER_WORDS: Final = ("NAME", "GLOB")
CHOICES: Final[Mapping[str, Iterable[str]]] = MappingProxyType(
    {"LAYER": LAYERS, "NAVIGATOR": tuple(NAVIGATORS), "THEME": THEMES}
)
"""Choices of arguments whose parser does not know them."""


def complete(text: str, parameters: Iterable[str] = (), folder: Path = Path()) -> list[str]:
    """Return completions as whole lines, in order.

    `parameters` are the robot's names; files are looked up in `folder`.
    """
    if len(text) > MAX_LENGTH or not text.isprintable():
        return []
    before, begun = last_word(text.removeprefix(":"))
    found = verbs() if not before else _arguments(before, begun, parameters, folder)
    head = "".join(f"{shlex.quote(word)} " for word in before)
    fitting = (word for word in found if word.startswith(begun) and word != begun)
    return [f"{head}{_quoted(word)}" for word, _ in zip(fitting, range(MAX_LINES), strict=False)]


def _quoted(word: str) -> str:
    return word if shlex.quote(word) == word or word.startswith("~") else shlex.quote(word)


def _arguments(
    before: Sequence[str], begun: str, parameters: Iterable[str], folder: Path
) -> Iterable[str]:
    words = expanded(before)
    # With the word being typed, `teleop` is parsed as the verb with speeds.
    try:
        parser = parser_for([*words, begun])
    except UserError:
        return []
    parser, action = place_in(parser, words[1:])
    if begun.startswith("-"):
        shown = [one for one in parser._actions if one.help is not argparse.SUPPRESS]
        return sorted(name for one in shown for name in one.option_strings)
    return [] if action is None else _values(action, begun, parameters, folder)


def place_in(
    parser: argparse.ArgumentParser, words: Sequence[str]
) -> tuple[argparse.ArgumentParser, argparse.Action | None]:
    """Return the parser of the subcommand reached, and the argument that comes next."""
    positionals = _positionals(parser)
    option: argparse.Action | None = None
    for word in words:
        if option is not None:
            option = None
        elif word.startswith("--"):
            option = _option(parser, word)
        elif word in subcommands_of(parser):
            parser = subcommands_of(parser)[word]
            positionals = _positionals(parser)
        elif positionals and positionals[0].nargs not in ("*", "+"):
            positionals = positionals[1:]
    return parser, option or next(iter(positionals), None)


def _positionals(parser: argparse.ArgumentParser) -> list[argparse.Action]:
    return [action for action in parser._actions if not action.option_strings]


def _option(parser: argparse.ArgumentParser, word: str) -> argparse.Action | None:
    """Return the option if a value follows it."""
    for action in parser._actions:
        if word in action.option_strings and action.nargs != 0:
            return action
    return None


def _values(
    action: argparse.Action, begun: str, parameters: Iterable[str], folder: Path
) -> Iterable[str]:
    if action.choices is not None:
        return [str(choice) for choice in action.choices]
    metavar = action.metavar if isinstance(action.metavar, str) else ""
    if metavar in PARAMETER_WORDS:
        return parameters
    if action.dest == "word":
        return verbs()
    if metavar in CHOICES:
        return CHOICES[metavar]
    return _files(begun, folder) if metavar in FILE_WORDS else ()


def _files(begun: str, folder: Path) -> Iterator[str]:
    """Yield matching files; folders end in /, hidden files need a typed dot."""
    parent, slash, start = begun.rpartition("/")
    try:
        there = sorted((folder / Path(f"{parent}{slash}").expanduser()).iterdir())
        for path in there:
            if path.name.startswith(start) and (start or not path.name.startswith(".")):
                yield f"{parent}{slash}{path.name}{'/' if path.is_dir() else ''}"
    except (OSError, RuntimeError):
        return
