"""Completions of a command that is being typed, as whole lines, and a hint on its arguments."""

import argparse
import shlex
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from re import split
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.client.parameter import Parameter
from ground.console.app_commands import LOCAL
from ground.console.parser import (
    COMMANDS,
    MAX_LENGTH,
    MEANT,
    expanded,
    last_word,
    parser_for,
    verbs,
    words_of_group,
)
from runtime.cli.completion import files, options_of, place_in, positionals_of
from runtime.cli.verb import GROUPS
from runtime.errors import UserError

MAX_LINES: Final = 200
FILE_WORDS: Final = ("FILE", "DIR", "CSV", "IN", "OUT")
PARAMETER_WORDS: Final = ("NAME", "GLOB")


class Candidate(NamedTuple):
    """A completion: the whole line, the word that completes it, and its meaning."""

    line: str
    word: str
    description: str = ""


class Assistance(NamedTuple):
    """What helps to type a command: completions, and the arguments that are still missing."""

    candidates: tuple[Candidate, ...] = ()
    hint: str = ""


def assist(
    text: str,
    parameters: Iterable[Parameter] = (),
    uses: Mapping[str, int] = MappingProxyType({}),
    folder: Path = Path(),
) -> Assistance:
    """Return the completions and a hint on the arguments.

    Verbs are in the order of their `uses`. `parameters` are the robot's; files are looked up in
    `folder`.
    """
    if len(text) > MAX_LENGTH or not text.isprintable():
        return Assistance()
    before, begun = last_word(text.removeprefix(":"))
    named = {one.name: parameter_words(one) for one in parameters}
    if not before:
        rows = verb_summaries().items()
        found: Mapping[str, str] = dict(sorted(rows, key=lambda row: -uses.get(row[0], 0)))
    else:
        found = _arguments(before, begun, named, folder)
    head = "".join(f"{shlex.quote(word)} " for word in before)
    fitting = [word for word in found if word.startswith(begun) and word != begun][:MAX_LINES]
    candidates = (Candidate(f"{head}{_quoted(word)}", word, found[word]) for word in fitting)
    return Assistance(tuple(candidates), _hint(before, begun, named))


def complete(text: str, parameters: Iterable[str] = (), folder: Path = Path()) -> list[str]:
    """Return completions as whole lines, in order; `parameters` are the robot's names."""
    named = [Parameter(name=name, value=0.0) for name in parameters]
    return [one.line for one in assist(text, named, folder=folder).candidates]


def parameter_words(one: Parameter) -> str:
    """Return value, unit, range and meaning of a parameter."""
    unit = f" {one.unit}" if one.unit else ""
    limits = "" if one.minimum is None else f", {one.minimum:g} to {one.maximum:g}"
    return f"{one.value:.6g}{unit}{limits}   {one.doc}".rstrip()


def verb_summaries() -> dict[str, str]:
    """Return every word that a command can begin with, and its meaning."""
    return {word: _summary(word) for word in sorted({*verbs(), *GROUPS})}


def _summary(word: str) -> str:
    if (word,) in MEANT:
        return f"short for {' '.join(MEANT[word,])}"
    if word in GROUPS and word not in COMMANDS:
        return GROUPS[word]
    return (LOCAL.get(word) or COMMANDS[word]).summary


def _quoted(word: str) -> str:
    return word if shlex.quote(word) == word or word.startswith("~") else shlex.quote(word)


def _parser_and_words(
    before: Sequence[str], begun: str
) -> tuple[argparse.ArgumentParser, list[str]]:
    """Return the parser of a command and its words; UserError if there is no such command."""
    words = expanded(before)
    # With the word being typed, `teleop` is parsed as the verb with speeds.
    return parser_for([*words, begun]), words


def _arguments(
    before: Sequence[str], begun: str, parameters: Mapping[str, str], folder: Path
) -> Mapping[str, str]:
    if len(before) == 1 and before[0] in GROUPS:
        return {word: _summary(meant) for word, meant in words_of_group(before[0]).items()}
    try:
        parser, words = _parser_and_words(before, begun)
    except UserError:
        return {}
    place = place_in(parser, words[1:])
    if begun.startswith("-"):
        helps = {name: one.help for one in place.parser._actions for name in one.option_strings}
        return {name: helps.get(name) or "" for name in options_of(place.parser)}
    return {} if place.action is None else _values(place.action, begun, parameters, folder)


def _values(
    action: argparse.Action, begun: str, parameters: Mapping[str, str], folder: Path
) -> Mapping[str, str]:
    if isinstance(action, argparse._SubParsersAction):
        helps = {one.dest: one.help for one in action._choices_actions}
        return {name: helps.get(name) or "" for name in action.choices}
    meanings: Mapping[str, str] = vars(action).get("meanings") or {}
    if action.choices is not None:
        return {str(choice): meanings.get(str(choice), "") for choice in action.choices}
    metavar = action.metavar if isinstance(action.metavar, str) else ""
    if metavar in PARAMETER_WORDS:
        return parameters
    if action.dest == "word":
        return verb_summaries()
    if meanings:
        return meanings
    return dict.fromkeys(files(begun, folder) if metavar in FILE_WORDS else (), "")


# The hint.


def _hint(before: Sequence[str], begun: str, parameters: Mapping[str, str]) -> str:
    """Return the arguments that follow the typed words, and their units or meaning."""
    words = [*before, begun] if begun else list(before)
    if not words:
        return ""
    try:
        parser, words = _parser_and_words(words, "" if begun else "x")
    except UserError:
        return ""
    known = words[-1] if len(words) > 2 and words[-1] in parameters else ""
    if known and words[1:2] == ["set"]:
        return f"VALUE  {parameters[known]}"
    rest = _left(parser, words[1:])
    if any(isinstance(action, argparse._SubParsersAction) for action in rest):
        return ""
    units = ", ".join(dict.fromkeys(filter(None, map(_unit, rest))))
    return "  ".join(filter(None, (" ".join(map(_name, rest)), units)))


def _left(parser: argparse.ArgumentParser, words: Sequence[str]) -> list[argparse.Action]:
    """Return the arguments without a flag that follow the words."""
    place = place_in(parser, words)
    if place.action is None or place.action.option_strings:
        return [] if place.action is None else [place.action]
    every = positionals_of(place.parser)
    return every[every.index(place.action) :]


def _unit(action: argparse.Action) -> str:
    """Return the first clause of an argument's help, which is its unit if it has one."""
    return "" if action.choices is not None else split(r"[;:,]", action.help or "")[0]


def _name(action: argparse.Action) -> str:
    if isinstance(action.metavar, str):
        name = action.metavar
    else:
        name = "|".join(map(str, action.choices or ())) or action.dest.upper()
    return {"?": f"[{name}]", "*": f"[{name} ...]", "+": f"{name} ..."}.get(str(action.nargs), name)
