"""Makes the tables of the reference from the code, so that they cannot become outdated."""

import argparse
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, fields
from math import degrees, inf
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final
from unittest.mock import patch

from ground.app.input.keymap import KEYS, Layer
from ground.client.outcomes import answer_row
from ground.missions.mission import Circle, Home, Waypoint
from plant.corpus.generate import EVERY_FAMILY
from plant.model.configuration import LEVELS, Body, Fault, Noise
from protocol.outcome import OUTCOMES, REPLACED, Outcome
from protocol.wire.reasons import REASON_TEXTS, Reason
from robot.parameter_table import SPECS
from runtime.cli.parsers import parser_of, program_parsers
from runtime.cli.verb import MORE, REC, RUN, Verb
from runtime.cli.verb_table import VERBS, command_of
from study.runner.store import SCHEMA

WIDTH: Final = 88
TITLES: Final = {RUN: "Run one process", REC: "Recordings", MORE: "Further groups"}
"""Headings of sections of verbs, where they differ from the name of the section."""
GROUPS: Final = {
    range(1, 30): "refusals",
    range(30, 60): "failsafes",
    range(60, 80): "ends of a goal",
    range(80, 100): "guard",
    range(100, 120): "further refusals",
}


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(
        "| " + " | ".join(str(cell).replace("|", "\\|").replace("\n", " ") for cell in line) + " |"
        for line in lines
    )


def command_line() -> str:
    """Return a section for each verb: its summary, usage, arguments and options."""
    parts, section = [], ""
    with patch.dict(os.environ):
        os.environ.pop("XDG_STATE_HOME", None)  # helps show the usual folder, not that of this user
        for word, verb in VERBS.items():
            if verb.section != section:
                section = verb.section
                parts.append(f"## {TITLES.get(section, section.capitalize())}")
            parts += verb_section(word, verb)
    return "\n\n".join(parts)


def verb_section(word: str, verb: Verb) -> Iterator[str]:
    """Yield heading, summary, usage and tables of a verb and of the verbs below it."""
    yield f"### {command_of(word)}"
    yield f"{verb.summary[:1].upper()}{verb.summary[1:]}."
    yield from parser_parts(parser_of(word))
    for name, parser in program_parsers(word).items():
        yield f"#### {command_of(word)} {name}"
        yield f"{verb.subcommands[name].summary.capitalize()}."
        yield from parser_parts(parser)


def parser_parts(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Yield usage, arguments and sub-commands of a parser."""
    parser.formatter_class = wide
    yield f"```text\n{parser.format_usage().removeprefix('usage: ').strip()}\n```"
    rows, below = [], []
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            helps = {one.dest: one.help or "" for one in action._choices_actions}
            below += [(name, helps.get(name, ""), one) for name, one in action.choices.items()]
        elif action.help != argparse.SUPPRESS and not isinstance(action, argparse._HelpAction):
            rows.append((f"`{name_of(action)}`", help_of(parser, action)))
    if rows:
        yield table(("argument", "meaning"), rows)
    if parser.epilog:
        yield f"```text\n{parser.epilog.strip()}\n```"
    for name, summary, one in below:
        yield f"#### {parser.prog.removeprefix('sidestep ')} {name}"
        if summary:
            yield f"{summary[:1].upper()}{summary[1:]}."
        yield from parser_parts(one)


def wide(prog: str) -> argparse.HelpFormatter:
    """Return a formatter whose width does not depend on the terminal."""
    return argparse.HelpFormatter(prog, width=WIDTH)


def name_of(action: argparse.Action) -> str:
    """Return how an argument is written: its flags and the name of its value."""
    value = action.metavar or (
        "{" + ",".join(map(str, action.choices)) + "}" if action.choices else action.dest.upper()
    )
    words = " ".join(value) if isinstance(value, tuple) else value
    if not action.option_strings:
        return words if action.nargs not in ("?", "*") else f"[{words}]"
    takes_value = action.nargs != 0
    return ", ".join(action.option_strings) + (f" {words}" if takes_value else "")


def help_of(parser: argparse.ArgumentParser, action: argparse.Action) -> str:
    """Return the help of an argument with its values filled in; the home folder is `~`."""
    text = parser._get_formatter()._expand_help(action) if action.help else ""
    return text.replace(str(Path.home()), "~")


def parameters() -> str:
    """Return the table of the robot's parameters."""
    head = ("name", "default", "unit", "from", "to", "safety", "meaning")
    return table(
        head,
        (
            (
                f"`{one.name}`",
                f"{one.default:g}",
                one.unit,
                f"{one.minimum:g}",
                f"{one.maximum:g}",
                one.safer,
                one.doc,
            )
            for one in SPECS.values()
        ),
    )


def reasons() -> str:
    """Return a table of reasons for each group of codes."""
    parts = []
    for codes, name in GROUPS.items():
        rows = [
            (code, f"`{Reason(code).name}`", text)
            for code, text in REASON_TEXTS.items()
            if code in codes
        ]
        parts += [f"## {name.capitalize()}", table(("code", "name", "text"), rows)]
    return "\n\n".join(parts)


def keys() -> str:
    """Return a table of keys for each place where they count."""
    parts = []
    for layer in Layer:
        rows = [
            (" ".join(f"`{key}`" for key in names), action, f"`{name}`")
            for name, names, action, where, _ in KEYS
            if where is layer
        ]
        if rows:
            parts += [f"## {layer.value.capitalize()}", table(("keys", "action", "id"), rows)]
    return "\n\n".join(parts)


def outcome_keys() -> str:
    """Return the keys that `up`, `trial` and `study` print with --json."""
    rows = [
        (f"`{one.name}`", f"`{getattr(one.type, '__name__', one.type)}`") for one in fields(Outcome)
    ]
    words = ", ".join(f"`{one}`" for one in OUTCOMES)
    keys = table(("key", "type"), rows)
    return f"{keys}\n\n`outcome` is one of {words}; with `up` also `{REPLACED}`."


def answer_keys() -> str:
    """Return the keys of the answer of a robot to a command."""
    row = answer_row("hold", "r1", Reason.NONE, 2_000_000)
    return table(("key", "example"), ((f"`{key}`", f"`{value}`") for key, value in row.items()))


def study_rows() -> str:
    """Return the columns of a study's results."""
    return table(
        ("column", "type", "may be missing"),
        ((f"`{one.name}`", one.type, "yes" if one.nullable else "") for one in SCHEMA),
    )


def settings(kind: Any) -> str:
    """Return the keys of a table in a file that fills a dataclass: name and default."""
    rows = []
    for one in fields(kind):
        is_angle = one.name.endswith("_rad")
        name = one.name.removesuffix("_rad") + "_deg" if is_angle else one.name
        value = one.default
        if value is MISSING:
            shown = "required"
        elif value is None or value == inf:
            shown = "none"
        else:
            shown = f"`{degrees(value) if is_angle else value}`"
        rows.append((f"`{name}`", shown))
    return table(("key", "default"), rows)


def noise_levels() -> str:
    """Return the values of each level of noise."""
    names = [one.name for one in fields(Noise)]
    rows = [
        (f"`{name}`", *(f"{getattr(LEVELS[level], name):g}" for level in LEVELS)) for name in names
    ]
    return table(("value", *LEVELS), rows)


def families() -> str:
    """Return the names of the families of generated worlds."""
    return ", ".join(f"`{name}`" for name in EVERY_FAMILY) + "."


GENERATORS: Final[Mapping[str, Callable[[], str]]] = MappingProxyType(
    {
        "answer-keys": answer_keys,
        "circle": lambda: settings(Circle),
        "command-line": command_line,
        "families": families,
        "fault": lambda: settings(Fault),
        "home": lambda: settings(Home),
        "keys": keys,
        "noise-levels": noise_levels,
        "outcome-keys": outcome_keys,
        "parameters": parameters,
        "reasons": reasons,
        "robot-body": lambda: settings(Body),
        "study-rows": study_rows,
        "waypoint": lambda: settings(Waypoint),
    }
)
"""A page asks for one of these with a comment: `<!-- generated: NAME -->`."""
