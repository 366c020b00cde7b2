"""A typed line: its words, its operation, its completions, its help and its history."""

import shlex
import time
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from ground.cli import main as cli
from ground.client.goal import destination
from ground.client.parameter import Parameter
from ground.commands.command import OperatorCommand, command_in
from ground.commands.goto import Goto
from ground.commands.hold import Hold
from ground.commands.lease import ChangeLease
from ground.commands.mission import FetchMission
from ground.commands.mode import SetMode
from ground.commands.navigator import SetNavigator
from ground.commands.param import SetParameter
from ground.console.app_commands import (
    LOCAL,
    AddWaypoint,
    BeginTeleop,
    Quit,
    RecordHere,
    SaveScreen,
    SetTheme,
)
from ground.console.completion import assist, complete, verb_summaries
from ground.console.history import History
from ground.console.parser import (
    COMMANDS,
    MAX_LENGTH,
    MEANT,
    expanded,
    help_text,
    last_word,
    read,
    verbs,
    words_of,
)
from ground.missions.mission import Waypoint
from protocol.wire.enums import LeaseAction, Mode, Navigator
from runtime.cli.verb_table import VERBS
from runtime.errors import UserError
from tests.support.each import each
from tests.support.ground.spoken import SPOKEN

GRACE_S = 1.0


@each(("typed", "argv"), SPOKEN)
def test_the_console_reads_what_the_command_line_reads(typed: str, argv: list[str]) -> None:
    assert read(typed) == command_in(cli.parse(argv))


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
        AddWaypoint(waypoint=Waypoint(x_m=1.5, y_m=-2.0, heading_deg=90.0)),
        SetTheme(name="dark"),
    ],
)
def test_what_a_key_means_is_spelt_as_it_is_typed(
    operation: OperatorCommand,
) -> None:
    found = read(operation.line)
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
        ("goal 1,5 2", "X must be a number in metres, not 1,5: write 1.5; example"),
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
    assert read("snap 'my robot.svg'") == SaveScreen(file=Path("my robot.svg"))


def test_a_negative_number_is_no_option() -> None:
    assert read("goal -1e-1 -2.5 -90") == Goto(goal=destination([-0.1, -2.5, -90.0]))


def test_the_app_s_own_words_are_read() -> None:
    assert read(":q") == Quit()
    added = AddWaypoint(waypoint=Waypoint(x_m=1.0, y_m=2.0, hold_s=3.0))
    assert read("wp add 1 2 --hold 3") == added
    assert read("record start") == RecordHere(action="start")
    assert read("teleop") == BeginTeleop()


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


shown = st.text(st.characters(exclude_categories=("C", "Z")) | st.just(" "), max_size=20)


@each(
    ("text", "words"),
    [
        ("goal 1 2", ["goal", "1", "2"]),
        ("  :goal\t1   2 ", ["goal", "1", "2"]),
        ("snap 'a b.svg'", ["snap", "a b.svg"]),
        ('mark "it\'s here"', ["mark", "it's here"]),
        (r"snap a\ b", ["snap", "a b"]),
        ("", []),
        (":", []),
    ],
)
def test_words_are_parted_as_in_a_shell(text: str, words: list[str]) -> None:
    assert words_of(text) == words


@given(st.lists(shown, min_size=1, max_size=5))
def test_whatever_is_quoted_comes_back(words: list[str]) -> None:
    assert words_of(shlex.join(["mark", *words])) == ["mark", *words]


@each("odd", ["\x00", "\x1b[31m", "\x7f", "\u202e", "\u2028", "\ud800", "\r"])
def test_what_cannot_be_seen_is_named_and_refused(odd: str) -> None:
    with pytest.raises(UserError, match="cannot be part of a command"):
        words_of(f"mark a{odd}b")


def test_a_paste_is_refused_by_its_length_before_anything_else() -> None:
    with pytest.raises(UserError, match=f"at most {MAX_LENGTH}"):
        words_of("\x00" * 10_000)


@each(
    ("text", "before", "begun"),
    [
        ("", [], ""),
        ("go", [], "go"),
        ("goal ", ["goal"], ""),
        ("goal 1", ["goal"], "1"),
        ("snap 'a b", ["snap"], "a b"),
        ('snap "a b', ["snap"], "a b"),
        ("snap 'a b' ", ["snap", "a b"], ""),
    ],
)
def test_last_word_is_split_from_those_before(text: str, before: list[str], begun: str) -> None:
    assert last_word(text) == (before, begun)


@given(st.text())
def test_any_text_has_a_last_word(text: str) -> None:
    before, begun = last_word(text)
    assert isinstance(begun, str)
    assert all(isinstance(word, str) for word in before)


@each(
    ("words", "meant"),
    [
        (["goal", "1", "2"], ["goto", "1", "2"]),
        (["set", "side", "1"], ["param", "set", "side", "1"]),
        (["get", "d_*"], ["param", "get", "d_*"]),
        (["mode", "RTL"], ["rtl"]),
        (["mode", "AUTO"], ["mode", "AUTO"]),
        (["mission", "restart"], ["mission", "start", "1"]),
        (["record", "mark", "here"], ["mark", "here"]),
        (["record", "start"], ["record", "start"]),
        (["rec", "start"], ["record", "start"]),
        (["rec", "plot", "x.tlog"], ["plot", "x.tlog"]),
        (["plot", "x.tlog"], ["plot", "x.tlog"]),
        (["wp", "upload", "--json"], ["mission", "upload", "-", "--json"]),
        (["hold"], ["hold"]),
        (["flap", "wings"], ["flap", "wings"]),
    ],
)
def test_short_word_replaces_the_long_one(words: list[str], meant: list[str]) -> None:
    assert expanded(words) == meant


def test_every_alias_means_something_and_hides_nothing() -> None:
    assert {meant[0] for meant in MEANT.values()} <= {*VERBS, *LOCAL}
    assert not {words[0] for words in MEANT if len(words) == 1} & {*VERBS, *LOCAL}


PARAMETERS = ("d_obs_m", "d_min_m", "side")


@each(
    ("typed", "lines"),
    [
        ("est", ["estop"]),
        ("mode g", ["mode guided"]),
        (":mode g", ["mode guided"]),
        ("algo vgm", ["algo vgm_memory"]),
        ("algo bug ", ["algo bug left", "algo bug right"]),
        ("set d_o", ["set d_obs_m"]),
        ("param set d_o", ["param set d_obs_m"]),
        ("get d_", ["get d_obs_m", "get d_min_m"]),
        ("param s", ["param set", "param save"]),
        ("goto 1 2 --no", ["goto 1 2 --no-wait"]),
        ("hold --time", ["hold --timeout"]),
        ("hold --co", []),
        ("help estop", []),
        ("help est", ["help estop"]),
        ("screen pl", ["screen plots"]),
        ("re", ["rec", "record", "recordings", "replay", "resume"]),
        ("rec ", ["rec start", "rec list", "rec mark", "rec export", "rec plot", "rec stop"]),
        ("rec plot --o", ["rec plot --out"]),
        ("record s", ["record start", "record stop"]),
        ("goal 1 ", []),
        ("goal 1 2 --frame ", ["goal 1 2 --frame world", "goal 1 2 --frame body"]),
        ("theme da", ["theme dark"]),
        ("layers truth tra", ["layers truth trail"]),
        ("ghost vgm", ["ghost vgm_memory"]),
        ("mission up", ["mission upload"]),
        ("wp sa", ["wp save"]),
        ("teleop 0.1 0 --f", ["teleop 0.1 0 --for"]),
        ("fence ci", ["fence circle"]),
        ("lease s", ["lease seize", "lease show"]),
        ("nothing at all", []),
        ("hold\x1b", []),
    ],
)
def test_what_was_begun_is_carried_on(typed: str, lines: list[str]) -> None:
    assert complete(typed, PARAMETERS) == lines


def test_an_empty_line_offers_all_there_is() -> None:
    assert {"goal", "estop", "quit", "help", "wp"} <= set(complete(""))


def test_files_are_completed_folders_end_in_a_slash(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "a run.tlog").touch()
    (tmp_path / ".hidden").touch()
    assert complete("replay ", folder=tmp_path) == ["replay runs/"]
    assert complete("replay runs/", folder=tmp_path) == ["replay 'runs/a run.tlog'"]
    assert complete("replay 'runs/a r", folder=tmp_path) == ["replay 'runs/a run.tlog'"]
    assert complete("replay .h", folder=tmp_path) == ["replay .hidden"]
    assert complete("replay nowhere/", folder=tmp_path) == []


@given(
    st.text() | st.lists(st.sampled_from(["set", "goal", "'", "-", "--", "wp", "x"])).map(" ".join)
)
def test_any_text_completes_to_lines_that_are_new(text: str) -> None:
    assert text not in complete(text, PARAMETERS, Path("/nowhere"))


@each(
    ("typed", "hint"),
    [
        ("goal ", "[X] [Y] [DEG]  metres, degrees"),
        ("goal 1 ", "[Y] [DEG]  metres, degrees"),
        ("goal 1 2 3", ""),
        ("fence circle ", "X Y R  metres"),
        ("teleop 0.1 ", "YAW_DEG_S  deg/s"),
        ("wp add ", "X Y [DEG]  metres, degrees"),
        ("set d_obs_m ", "VALUE  0.4 m, 0.1 to 2   avoidance zone"),
        ("param set d_obs_m ", "VALUE  0.4 m, 0.1 to 2   avoidance zone"),
        ("fence ", ""),
        ("", ""),
        ("nothing ", ""),
    ],
)
def test_hint_names_missing_arguments_and_units(typed: str, hint: str) -> None:
    known = Parameter(
        name="d_obs_m", value=0.4, minimum=0.1, maximum=2.0, unit="m", doc="avoidance zone"
    )
    assert assist(typed, [known]).hint == hint


def test_verbs_used_often_come_first() -> None:
    found = assist("", uses={"resume": 3, "hold": 9}).candidates
    assert [one.word for one in found[:3]] == ["hold", "resume", "abort"]


@each(
    ("typed", "meaning"),
    [
        ("disa", "disarm the motors"),
        ("navigator vgm_", "vgm with a memory of recent echoes (the default)"),
        ("mission up", "send a mission and its fence, if any, to the robot"),
        ("hold --time", "give up after this time, in three attempts (default 1.5)"),
    ],
)
def test_completion_has_its_meaning(typed: str, meaning: str) -> None:
    assert assist(typed).candidates[0].description == meaning


def test_every_command_is_in_the_list() -> None:
    assert set(verbs()) <= set(verb_summaries())
    assert all(verb_summaries().values())
    assert "router" not in verb_summaries()


def test_one_command_is_explained_by_its_short_name_too() -> None:
    text = help_text("goal")
    assert text.startswith("goto [--tolerance M]")
    assert "final heading" in text
    assert "--connect" not in text


@each("word", verbs())
def test_each_command_can_be_explained(word: str) -> None:
    assert help_text(word)


def test_help_for_what_is_not_there_offers_what_is() -> None:
    with pytest.raises(UserError, match="did you mean 'goto'"):
        help_text("gotto")


def test_history_moves_both_ways_and_restores_the_draft() -> None:
    history = History()
    for line in ("arm", "goal 1 2", "hold", "goal 3 4"):
        history.add(line)
    assert history.previous("go") == "goal 3 4"
    assert history.previous("goal 3 4") == "goal 1 2"
    assert history.previous("goal 1 2") == "goal 1 2"
    assert history.next("goal 1 2") == "goal 3 4"
    assert history.next("goal 3 4") == "go"
    assert history.next("go") == "go"


def test_repeated_and_empty_lines_are_not_kept() -> None:
    history = History()
    for line in ("hold", "hold ", "", "arm", "hold", "a\x1bb"):
        history.add(line)
    assert history.lines == ["hold", "arm", "hold"]


def test_the_file_is_read_again_and_stays_bounded(tmp_path: Path) -> None:
    path = tmp_path / "state" / "history"
    history = History(path, most=3)
    for number in range(9):
        history.add(f"goal {number} 0")
    assert History(path, most=3).lines == ["goal 6 0", "goal 7 0", "goal 8 0"]
    assert path.stat().st_mode & 0o077 == 0
    assert [one.name for one in path.parent.iterdir()] == ["history"]


def test_a_broken_file_is_no_reason_to_fail(tmp_path: Path) -> None:
    path = tmp_path / "history"
    path.write_bytes(b"hold\n\xff\xfe\x00\n\x1b[2J\narm\n")
    assert History(path).lines[0] == "hold"
    assert History(path).lines[-1] == "arm"
    history = History(tmp_path)
    assert "not a regular file" in history.trouble
    history.add("hold")
    assert history.lines == ["hold"]
    assert history.trouble


@given(st.lists(st.text()), st.lists(st.booleans()))
def test_walking_never_leaves_what_is_there(lines: list[str], steps: list[bool]) -> None:
    history = History(most=5)
    for line in lines:
        history.add(line)
    assert len(history.lines) <= 5
    shown = ""
    for back in steps:
        shown = history.previous(shown) if back else history.next(shown)
        assert shown in {"", *history.lines}


def test_history_is_searched_for_words_newest_first() -> None:
    history = History()
    for line in ("goal 1 2", "hold", "goal 3 4", "goal 1 2", "mode hold"):
        history.add(line)
    assert history.search("GO 2") == ["goal 1 2"]
    assert history.search("ho") == ["mode hold", "hold"]
    assert history.search("")[0] == "mode hold"
    assert history.uses() == {"goal": 3, "hold": 1, "mode": 1}
