"""Commands as classes: their parsers, the lines of their values, and their rows in the table."""

import argparse
import shlex
from collections import Counter
from importlib import import_module
from typing import Any

import pytest

from checks.site.commands import INDEX, index
from ground.commands.command import (
    FileCommand,
    Group,
    OperatorCommand,
    Reach,
    TimedCommand,
    choice,
    command,
    option,
    parsed,
    place,
    positive,
    switch,
)
from ground.commands.mission import CheckMission
from protocol.options import finite, numbers_kept
from runtime.cli.command_index import COMMANDS
from runtime.cli.verb import MORE
from runtime.cli.verb_table import VERBS
from runtime.errors import UserError
from tests.support.each import each

SPEEDS = {"slow": 0.1, "fast": 0.5}
TOYS = Group(MORE, 1, "toy push 1 2", "play with a toy", suffixes=(".toy",))


@command(TOYS, example="toy push 1 2", moves=True, short="push")
class Push(TimedCommand):
    """Push the toy to X Y.

    Not in the table: it is in no module of commands.
    """

    x_m: float = place("X", "metres", parse=finite)
    y_m: float | None = place("Y", "metres", default=None, parse=finite)
    speed_m_s: float = choice(SPEEDS, "--speed", default=0.1)
    reach_m: float = option(
        "--reach", "-r", default=0.5, parse=positive, metavar="M", help="how far", after="seize"
    )
    corner: tuple[float, ...] | None = option(
        "--corner", default=None, parse=finite, metavar=("X", "Y"), joined=tuple, help="a corner"
    )
    waits: bool = switch("--no-wait", default=True, help="do not wait")
    arms: bool = True

    def __post_init__(self) -> None:
        if self.x_m < 0.0:
            raise UserError("X is negative")


@command(TOYS, example="toy sing la la")
class Sing(FileCommand):
    """Sing."""

    text: str = place("TEXT", joined=" ".join)


def parser_of(kind: type[OperatorCommand]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="toy")
    kind.declare(parser)
    return parser


def read(kind: type[OperatorCommand], line: str) -> Any:
    return kind.parsed(parser_of(kind).parse_args(numbers_kept(shlex.split(line))))


def test_fields_are_arguments_and_shared_options_have_their_place() -> None:
    actions = parser_of(Push)._actions[1:]
    names = [[*action.option_strings, action.metavar][0] for action in actions]
    own, shared = (
        ["X", "Y", "--speed", "--corner", "--no-wait"],
        ["--connect", "--run", "--context"],
    )
    assert names[:8] == [*own, *shared]
    assert names[8:] == ["--id", "--config", "--json", "--timeout", "--seize", "--reach"]


def test_command_on_files_reaches_no_robot() -> None:
    options = {name for action in parser_of(Sing)._actions for name in action.option_strings}
    assert options == {"-h", "--help", "--json"}


@each(
    ("line", "made"),
    [
        ("1", Push(x_m=1.0)),
        ("1 -2e-1", Push(x_m=1.0, y_m=-0.2)),
        ("1 --speed FAST -r 2", Push(x_m=1.0, speed_m_s=0.5, reach_m=2.0)),
        ("1 --no-wait --timeout 3", Push(x_m=1.0, waits=False, timeout_s=3.0)),
        ("1 --corner 3 4", Push(x_m=1.0, corner=(3.0, 4.0))),
    ],
)
def test_words_become_the_values_of_fields(line: str, made: Push) -> None:
    assert read(Push, line) == made


def test_value_out_of_range_is_refused_by_the_class() -> None:
    with pytest.raises(UserError, match="X is negative"):
        read(Push, "-1")


@each(
    ("made", "line"),
    [
        (Push(x_m=1.0), "push 1"),
        (Push(x_m=0.1 + 0.2, y_m=-2.0), "push 0.3 -2"),
        (Push(x_m=1.0, speed_m_s=0.5, waits=False, arms=False), "push 1 --speed fast --no-wait"),
        (Sing(text="it's la"), """toy sing 'it'"'"'s la'"""),
    ],
)
def test_line_is_what_would_be_typed(made: OperatorCommand, line: str) -> None:
    assert made.line == line


def test_options_that_verbs_share_are_a_value_too() -> None:
    found = parser_of(Push).parse_args(["1", "--id", "r2", "--json", "--seize"])
    assert parsed(Reach, found) == Reach(id="r2", json=True, seize=True)


def test_facts_follow_from_the_class() -> None:
    assert (Push(x_m=0.0).verb, Push.summary(), Push(x_m=0.0).moves) == (
        "toy push",
        "push the toy to X Y",
        True,
    )
    assert TOYS.commands == {"push": Push, "sing": Sing}
    assert TOYS.parsed(argparse.Namespace(action="sing", text=["la"])) == Sing(text="la")


def test_the_committed_index_is_the_generated_one() -> None:
    assert INDEX.read_text(encoding="utf-8") == index(), "run `make generate`"


def test_no_two_verbs_of_a_section_have_one_rank() -> None:
    ranks = Counter((verb.section, verb.rank) for verb in VERBS.values() if verb.rank)
    assert [place for place, count in ranks.items() if count > 1] == []
    assert {verb.section for verb in COMMANDS.values() if not verb.rank} == set()


def kinds() -> list[type[OperatorCommand]]:
    named = (getattr(import_module(verb.module), verb.words) for verb in COMMANDS.values())
    return [
        kind
        for one in named
        for kind in (one.commands.values() if isinstance(one, Group) else [one])
    ]


def test_line_of_a_mission_file_has_its_home() -> None:
    line = "m.plan --home 47.3977 8.5456 --drop"
    assert read(CheckMission, line).line == f"mission check {line}"


@each("kind", kinds())
def test_line_of_an_example_is_read_as_the_same_command(kind: type[OperatorCommand]) -> None:
    made = read(kind, kind.facts.example.partition(f"{kind.facts.word} ")[2])
    assert read(kind, made.line.removeprefix(kind.facts.short or kind.facts.word)) == made
