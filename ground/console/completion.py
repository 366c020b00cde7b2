"""Completions of a command that is being typed, as whole lines."""

import argparse
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

from ground.client.vocabulary import NAVIGATORS
from ground.console.aliases import expanded
from ground.console.parser import parser_for, verbs, words_of_group
from ground.console.tokenizer import MAX_LENGTH, last_word
from ground.map.scene import LAYERS
from ground.text.theme_names import THEMES
from runtime.cli.completion import files, options_of, place_in
from runtime.cli.verb_table import GROUPS, REC
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
    found = _arguments(before, begun, parameters, folder) if before else sorted([*verbs(), REC])
    head = "".join(f"{shlex.quote(word)} " for word in before)
    fitting = (word for word in found if word.startswith(begun) and word != begun)
    return [f"{head}{_quoted(word)}" for word, _ in zip(fitting, range(MAX_LINES), strict=False)]


def _quoted(word: str) -> str:
    return word if shlex.quote(word) == word or word.startswith("~") else shlex.quote(word)


def _arguments(
    before: Sequence[str], begun: str, parameters: Iterable[str], folder: Path
) -> Iterable[str]:
    if len(before) == 1 and before[0] in GROUPS:
        return words_of_group(before[0])
    words = expanded(before)
    # With the word being typed, `teleop` is parsed as the verb with speeds.
    try:
        parser = parser_for([*words, begun])
    except UserError:
        return []
    place = place_in(parser, words[1:])
    if begun.startswith("-"):
        return options_of(place.parser)
    return [] if place.action is None else _values(place.action, begun, parameters, folder)


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
    return files(begun, folder) if metavar in FILE_WORDS else ()
