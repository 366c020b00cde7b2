"""Completions of verbs, choices, parameters and files, as whole lines."""

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from ground.client.parameter import Parameter
from ground.console.completion import assist, complete
from tests.support.each import each

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
