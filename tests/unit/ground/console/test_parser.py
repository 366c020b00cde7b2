"""A typed line becomes the operation of the shell's words, or is refused with a reason."""

import time
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ground.cli import main as cli
from ground.client.goal import destination
from ground.client.operations.commands import Hold, SetMode, SetNavigator
from ground.client.operations.goals import Goto
from ground.client.operations.leases import ChangeLease
from ground.client.operations.missions import FetchMission
from ground.client.operations.parameters import SetParameter
from ground.client.operations.session import Operation
from ground.client.results import Outcome
from ground.console.app_commands import (
    LOCAL,
    AppCommand,
    RecordHere,
    RunKey,
    SaveScreen,
    SetTheme,
)
from ground.console.parser import COMMANDS, read, verbs
from ground.console.spelling import line_of
from ground.grammar.words import Words
from ground.missions.draft import AddWaypoint
from ground.missions.mission import Waypoint
from protocol.wire.enums import LeaseAction, Mode, Navigator
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.console.spoken import SPOKEN

GRACE_S = 1.0


@each(("typed", "argv"), SPOKEN)
def test_the_console_reads_what_the_command_line_reads(typed: str, argv: list[str]) -> None:
    shell = cli.parse(argv)
    assert isinstance(shell, Words)
    assert read(typed) == shell.operation()


@each(
    "operation",
    [
        Hold(),
        SetMode(mode=Mode.MANUAL),
        SetNavigator(navigator=Navigator.BUG1),
        SetNavigator(navigator=Navigator.VGM, side=-1),
        SetParameter(name="d_obs_m", value=0.1 + 0.2),
        FetchMission(),
        ChangeLease(action=LeaseAction.SEIZE),
        Goto(goal=destination([0.1, -2.25, -165.0])),
        Goto(goal=destination([9.0, 7.0])),
        AddWaypoint(Waypoint(x_m=1.5, y_m=-2.0, heading_deg=90.0)),
        SetTheme("dark"),
    ],
)
def test_what_a_key_means_is_spelt_as_it_is_typed(
    operation: Operation[Outcome] | AppCommand,
) -> None:
    found = read(line_of(operation))
    if isinstance(operation, Goto):
        assert isinstance(found, Goto)
        assert found.goal is not None
        assert operation.goal is not None
        assert found.goal.on_the_wire() == operation.goal.on_the_wire()
    else:
        assert found == operation


def test_the_table_of_commands_leaves_none_out() -> None:
    spoken = {argv[0] for _, argv in SPOKEN}
    assert set(COMMANDS) - spoken == {"export", "plot", "recordings", "share"}


def test_every_command_word_is_parsed_or_reports_its_usage() -> None:
    for word in verbs():
        error = outcome(word)
        examples = ("example: ", "write: ", "--out", "name a FILE")
        assert error is None or any(one in error for one in examples)


@each(
    ("typed", "why"),
    [
        ("", "nothing to do"),
        (" : ", "nothing to do"),
        ("flap", "no such command: 'flap'; "),
        ("godo 1 2", "did you mean 'goto'?"),
        ("up", "run it in another terminal"),
        ("router", "'run router' is not available here: run it in another terminal"),
        ("run plant", "'run plant' is not available here: run it in another terminal"),
        ("rec", "'rec' needs a second word: start, list, mark, export, plot, stop"),
        ("rec sing", "'rec' needs a second word: start, list, mark, export, plot, stop"),
        ("run", "'run' needs a second word: none of them is available here"),
        ("rec plot --owt x", "there is no option --owt; did you mean '--out'?; example: rec plot"),
        ("goal 1 -- 2 3 --timeout", "wrong place for the option --timeout; an option stands after"),
        ("goal 1", "Y is missing; example: goto 2 1.5"),
        ("goal one two", "X must be a number in metres, not one; example: goto 5.4 2 90"),
        ("goal nan 2", "X must be a finite number in metres, not nan"),
        ("goal 1 2 3 4", "too many words: 4"),
        (
            "goal 1 2 --timeout -3",
            "--timeout must be above 0 and at most 604800 seconds, not -3",
        ),
        ("goal 1 2 --timeout", "--timeout needs a value in seconds; example: goto 5.4 2 90 --tim"),
        ("goal 1 2 --frame sky", "--frame must be one of world, body, not sky"),
        ("goal " + "z" * 99 + " 2", f"in metres, not {'z' * 23}…; example: "),
        ("mode sideways", "not sideways; example: mode auto"),
        ("set", "NAME and VALUE are missing; example: param set d_obs_m 0.35"),
        ("param", "needs a second word: list, get, diff, set, reset, save, load; example: param"),
        ("param sett", "did you mean 'set'?"),
        ("wp add 1", "Y is missing; write: wp add [--hold S] X Y [DEG]"),
        ("wp remove 0", "ITEM must be within 1 to 65535, not 0; write: wp remove ITEM"),
        ("hold --json", "--json cannot be used here"),
        ("hold --id r2", "--id cannot be used here"),
        ("hold -h", "there is no option -h; example: hold"),
        ("snap 'my file", "unbalanced quote"),
        ("snap my\x1b[2Jfile", "'\\x1b' cannot be part of a command"),
        ("hold\nabort", "'\\n' cannot be part of a command"),
        ("x" * 10_000, "a command has at most 1000 characters, not 10000"),
        ("x" * 900, "no such command: 'xxxxxxxxxxxxxxxxxxxxxxxx...'"),
    ],
)
def test_invalid_command_is_refused_with_reason_and_fix(typed: str, why: str) -> None:
    with pytest.raises(UserError) as caught:
        read(typed)
    assert why in str(caught.value)


def test_quotes_keep_blanks_together() -> None:
    assert read("snap 'my robot.svg'") == SaveScreen(Path("my robot.svg"))


def test_a_negative_number_is_no_option() -> None:
    assert read("goal -1e-1 -2.5 -90") == Goto(goal=destination([-0.1, -2.5, -90.0]))


def test_the_app_s_own_words_are_read() -> None:
    assert read(":q") == RunKey("quit")
    added = AddWaypoint(Waypoint(x_m=1.0, y_m=2.0, hold_s=3.0))
    assert read("wp add 1 2 --hold 3") == added
    assert read("record start") == RecordHere(begin=True)
    assert read("teleop") == RunKey("teleop")


def test_no_word_of_the_app_hides_an_operation() -> None:
    assert {word for word in LOCAL if word in COMMANDS} == {"teleop"}


commands = st.sampled_from([*verbs(), *(typed for typed, _ in SPOKEN)])
pieces = commands | st.text() | st.sampled_from(["--", "-", "-h", "'", '"', "\\", "@", "=", "%s"])
anything = st.text() | st.lists(pieces, max_size=6).map(" ".join) | st.binary().map(repr)


@given(anything)
@example("\x00")
@example("goal " + "9" * 5000)
@example("param set x " + "9" * 900)
@example("\ud800")
@example("help %s %(prog)s")
@settings(deadline=None)
def test_any_text_gives_an_operation_or_an_error(text: str) -> None:
    began_s = time.thread_time()
    error = outcome(text)
    assert time.thread_time() - began_s < GRACE_S
    assert error is None or error.strip()


def outcome(text: str) -> str | None:
    try:
        read(text)
    except UserError as error:
        return str(error)
    return None


def test_reading_never_prints(capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("goal", "goal -h", "--version", "hold --help", "help goto", "x" * 20_000):
        outcome(text)
    assert capsys.readouterr() == ("", "")
