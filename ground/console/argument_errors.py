"""Describe wrong arguments of a typed command in plain words, from the errors of argparse."""

import argparse
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Final

from runtime.cli.parsers import advice_on, options_below
from runtime.cli.verb_table import VERBS, find, nearest
from runtime.errors import decimal_point

MAX_VALUE: Final = 24
UNITS: Final[Mapping[str, str]] = MappingProxyType(
    {
        **dict.fromkeys(("X", "Y", "M"), "metres"),
        "DEG": "degrees",
        "S": "seconds",
        "HZ": "hertz",
        "SPEED": "m/s",
        "YAW_DEG_S": "degrees per second",
    }
)
"""Unit of a number, by the name of its argument."""
MISSING: Final = "the following arguments are required: "
UNKNOWN: Final = "unrecognized arguments: "
ARGUMENT: Final = re.compile(r"argument (?P<name>.+?): (?P<why>.+)", re.DOTALL)
NOT_A_NUMBER: Final = re.compile(r"'(?P<value>.*)' is not (?P<what>a (?:finite |whole )?number)")
OUT_OF_RANGE: Final = re.compile(r"(?P<value>\S+) is not (?P<limits>(?:above|within|at least) .+)")
NO_CHOICE: Final = re.compile(r"invalid choice: '(?P<value>.*?)' \(choose from")
NO_VALUE: Final = re.compile(r"expected .*arguments?")


def in_words(parser: argparse.ArgumentParser, message: str) -> str:
    """Return the error, and an example of a correct line."""
    if message.startswith(MISSING):
        why = missing(parser, message.removeprefix(MISSING).split(", "))
    elif message.startswith(UNKNOWN):
        why = too_much(parser, message.removeprefix(UNKNOWN))
    else:
        found = ARGUMENT.fullmatch(message)
        why = message if found is None else wrong_value(parser, found["name"], found["why"])
    return f"{why}; {example_of(parser, message)}"


def missing(parser: argparse.ArgumentParser, names: list[str]) -> str:
    """Return which arguments are missing."""
    action = action_named(parser, names[0])
    if isinstance(action, argparse._SubParsersAction):
        return f"needs a second word: {', '.join(action.choices)}"
    return f"{' and '.join(names)} {'is' if len(names) == 1 else 'are'} missing"


def too_much(parser: argparse.ArgumentParser, words: str) -> str:
    """Return the surplus words, with a suggestion for a misspelt option."""
    if not words.startswith("-"):
        return f"too many words: {shown(words)}"
    option = words.split()[0].partition("=")[0]
    is_known = option in options_below(parser)
    what = "wrong place for the option" if is_known else "there is no option"
    return f"{what} {shown(option)}{advice_on(option, parser)}"


def wrong_value(parser: argparse.ArgumentParser, name: str, why: str) -> str:
    """Return the required form of a value."""
    action = action_named(parser, name)
    unit = UNITS.get(str(action.metavar), "") if action is not None else ""
    of_unit = f" in {unit}" if unit else ""
    if found := NOT_A_NUMBER.match(why):
        point = decimal_point(found["value"])
        fix = f": write {point}" if point else ""
        return f"{name} must be {found['what']}{of_unit}, not {shown(found['value'])}{fix}"
    if found := OUT_OF_RANGE.fullmatch(why):
        limits = f"{found['limits']} {unit}".rstrip()
        return f"{name} must be {limits}, not {shown(found['value'])}"
    if action is not None and action.choices and (found := NO_CHOICE.match(why)):
        choices, value = [str(one) for one in action.choices], found["value"]
        what = "the second word" if isinstance(action, argparse._SubParsersAction) else name
        guess = nearest(value, choices)
        return f"{what} must be one of {', '.join(choices)}, not {shown(value)}{guess}"
    if NO_VALUE.fullmatch(why):
        return f"{name} needs a value{of_unit}"
    return f"{name}: {why}"


def action_named(parser: argparse.ArgumentParser, name: str) -> argparse.Action | None:
    """Return the argument that an error of argparse names."""
    name_of: Callable[[argparse.Action], str | None] = argparse._get_action_name
    return next((one for one in parser._actions if name_of(one) == name), None)


def shown(value: str) -> str:
    """Return a typed value, shortened if it is long."""
    value = value.strip() or "nothing"
    return value if len(value) <= MAX_VALUE else f"{value[: MAX_VALUE - 1]}…"


def example_of(parser: argparse.ArgumentParser, message: str) -> str:
    """Return a correct line: without options, unless the error is about one of its options."""
    call = find(parser.prog.split())
    if call is None or not VERBS[call.word].words:  # a command of the app
        usage = " ".join(parser.format_usage().removeprefix("usage:").split())
        return f"write: {usage}"
    verb = VERBS[call.word]
    row = verb.subcommands.get(call.arguments[0]) if call.arguments else None
    example = verb.example if row is None else row.example
    first, dashes, options = example.partition(" --")
    names = (f"--{piece.split()[0]}" for piece in options.split(" --") if piece)
    return f"example: {example if dashes and any(one in message for one in names) else first}"
