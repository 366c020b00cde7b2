"""Commands as classes: their parsers, the lines of their values, and their rows in the table."""

import argparse
import ast
import re
import shlex
from collections import Counter
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from checks.site.commands import INDEX, index
from checks.site.reference import command_line
from ground.cli import main as cli
from ground.commands.command import (
    FileCommand,
    Group,
    OperatorCommand,
    Reach,
    TimedCommand,
    choice,
    command,
    command_in,
    option,
    parsed,
    place,
    positive,
    switch,
)
from ground.commands.mission import CheckMission
from ground.console.app_commands import LOCAL
from ground.console.completion import complete
from ground.console.parser import help_text, summaries
from ground.console.parser import read as read_line
from protocol.options import finite, numbers_kept
from runtime.cli.command_index import COMMANDS
from runtime.cli.completion import completions
from runtime.cli.verb import MORE, Verb
from runtime.cli.verb_table import VERBS, command_of, find
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


ROOT = Path(__file__).parents[3]
reference = cache(command_line)
FOR_A_SHELL = re.compile(r" --(json|id \S+)")
"""Options of examples that the app has no use for."""


@each("kind", kinds())
def test_example_is_the_command_in_a_shell_and_in_the_app(kind: type[OperatorCommand]) -> None:
    call = find(shlex.split(kind.facts.example))
    assert call is not None
    made = command_in(cli.parse([call.word, *call.arguments]))
    assert read_line(FOR_A_SHELL.sub("", kind.facts.example)) == made


@each(("word", "row"), COMMANDS.items())
def test_command_is_completed_explained_and_in_the_reference(word: str, row: Verb) -> None:
    title = command_of(word)
    for name in (title, *(f"{title} {below}" for below in row.subcommands)):
        *before, last = name.split()
        assert last in [line.split("\t")[0] for line in completions([*before, last])], "in a shell"
        assert name in complete(name[:-1]), "in the app"
        assert f"# {name}\n" in reference()
    assert row.summary == summaries()[title] or word in LOCAL, "in the palette and the help"
    assert help_text(word)


READERS = (
    "runtime/cli/parsers.py",
    "runtime/cli/completion.py",
    "ground/cli/main.py",
    "ground/cli/operate.py",
    "ground/console/parser.py",
    "ground/console/completion.py",
    "ground/console/argument_errors.py",
    "ground/app/commands/palette.py",
    "ground/app/screens/help.py",
    "ground/app/playback/read_only_app.py",
    "checks/site/reference.py",
)
"""What follows from the index."""


def quoted(file: Path) -> set[str]:
    tree = ast.walk(ast.parse(file.read_text(encoding="utf-8")))
    return {
        one.value for one in tree if isinstance(one, ast.Constant) and isinstance(one.value, str)
    }


@each("file", READERS)
def test_what_reads_the_index_has_no_list_of_commands_of_its_own(file: str) -> None:
    named = quoted(ROOT / file) & {*COMMANDS}
    assert len(named) < 2, named


WORD = "hold"
PLACES = {
    "ground/commands/hold.py": "the command: its word, arguments, help and effect",
    "ground/app/input/keymap.py": "the table of keys: its key, and what the key bar calls it",
    "ground/robot.py": "the client of a robot: the request that it becomes",
    "tests/bus/test_verbs.py": "its test: what a shell says, and what the robot receives",
}
OTHER_FACTS = {
    "runtime/cli/command_index.py": "written by `make generate` from the class",
    "ground/client/vocabulary.py": "the meaning of the mode HOLD",
    "ground/client/missions.py": "the pause of a mission",
    "gateways/mavlink/ardupilot.py": "the name of ArduPilot's mode HOLD",
    "gateways/mavlink/motion/pilot.py": "a client in control has chosen the mode HOLD",
    "gateways/ros2/services.py": "the name of the service of a ROS 2 node",
    "vehicle_check/rows/command_rows.py": "the name of ArduPilot's mode HOLD",
    "sidestep/operations.py": "the public list of classes",
}
CLIENT_SIDE = ("ground", "gateways", "runtime", "sidestep", "protocol", "vehicle_check", "study")
"""The robot's own mode machine, and what checks it from outside by its own words, are others."""


def names_hold(file: Path) -> bool:
    """Return whether a file has the quoted word, or defines the class or such a function."""
    text = file.read_text(encoding="utf-8")
    if WORD not in text.lower():
        return False
    nodes = ast.walk(ast.parse(text))
    kinds = (ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    defined = {one.name for one in nodes if isinstance(one, kinds)}
    return WORD in {text.lower() for text in quoted(file)} or bool({WORD, "Hold"} & defined)


def test_hold_stands_in_four_places() -> None:
    files = (file for room in CLIENT_SIDE for file in (ROOT / room).rglob("*.py"))
    found = {file.relative_to(ROOT).as_posix() for file in files if names_hold(file)}
    assert found - OTHER_FACTS.keys() | {"tests/bus/test_verbs.py"} == PLACES.keys()
    assert OTHER_FACTS.keys() <= found, "an entry that is not needed any more"
    effect = import_module("ground.commands.hold").Hold.effect
    saying = [
        file.relative_to(ROOT).as_posix()
        for file in (ROOT / "tests").rglob("*.py")
        if effect in file.read_text(encoding="utf-8")
    ]
    assert saying == ["tests/bus/test_verbs.py"]
