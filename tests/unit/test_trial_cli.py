"""`sidestep trial` as a person or a script meets it: output, exit codes, refusals."""

import csv
import json
from pathlib import Path

import pytest

from ground import cli as ground_cli
from plant.world_file import load
from plant.world_problems import WorldError
from protocol.errors import UserError
from robot.core.parameters import DEFAULTS
from sidestep import main as sidestep
from study.cli import main, parser
from study.trace import COLUMNS
from study.trial import NAVIGATORS, Trial

WORLD = """
name = "near"
size_m = [3.0, 2.0]
start = { x_m = 0.6, y_m = 1.0 }
goal = { x_m = 1.4, y_m = 1.0, heading_deg = 0.0 }
"""


@pytest.fixture
def near(tmp_path: Path) -> str:
    path = tmp_path / "near.toml"
    path.write_text(WORLD, encoding="utf-8")
    return str(path)


def test_json_is_one_object_on_standard_output(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["trial", "--world", near, "--json"]) == 0
    said = capsys.readouterr()
    outcome = json.loads(said.out)
    assert (outcome["world"], outcome["outcome"], outcome["noise"]) == (
        "near",
        "reached",
        "default",
    )
    assert said.err == ""


def test_a_person_is_told_in_words(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial", "--world", near, "--navigator", "bug", "--noise", "none"]) == 0
    assert "reached the goal of near with bug in " in capsys.readouterr().out


def test_every_way_to_drive_uses_the_robot_s_own_navigator_unless_told() -> None:
    usual = "vgm_memory"
    assert NAVIGATORS[usual] == DEFAULTS.navigator
    assert ground_cli.parse(["up"]).navigator == usual
    assert parser().parse_args(["--world", "box"]).navigator == usual
    assert Trial(world=load("box")).navigator == usual


def test_a_goal_that_is_not_reached_is_exit_code_1(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["trial", "--world", near, "--timeout", "0.5", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["outcome"] == "timeout"


def test_a_parameter_of_the_robot_is_taken(near: str, capsys: pytest.CaptureFixture[str]) -> None:
    main(["trial", "--world", near, "--json"])
    usual = json.loads(capsys.readouterr().out)
    main(["trial", "--world", near, "--json", "--param", "v_max_m_s=0.1"])
    assert json.loads(capsys.readouterr().out)["time_s"] > 1.5 * usual["time_s"]


@pytest.mark.parametrize("word", ["v_maxx=1", "v_max_m_s=99"])
def test_a_parameter_that_cannot_be_is_a_users_error(near: str, word: str) -> None:
    with pytest.raises(UserError, match=word.partition("=")[0]):
        main(["trial", "--world", near, "--param", word])


@pytest.mark.parametrize(
    "more",
    [
        ["--navigator", "vfh"],
        ["--noise", "loud"],
        ["--side", "up"],
        ["--seed", "-1"],
        ["--timeout", "0"],
        ["--timeout", "nan"],
        ["--timeout", "inf"],
        ["--param", "v_max_m_s"],
        ["--param", "v_max_m_s=inf"],
        ["--param", "v_max_m_s=fast"],
        ["--nonsense"],
    ],
)
def test_wrong_usage_is_exit_code_2(near: str, more: list[str]) -> None:
    with pytest.raises(SystemExit) as refused:
        main(["trial", "--world", near, *more])
    assert refused.value.code == 2


def test_errors_of_a_world_file_come_as_they_are(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(WORLD.replace("x_m = 0.6", "x_cm = 60"), encoding="utf-8")
    with pytest.raises(WorldError, match=r"bad\.toml"):
        main(["trial", "--world", str(path)])


def test_through_the_executable_refusals_are_one_line_and_exit_code_2(
    near: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert sidestep(["trial", "--world", "nowhere"]) == 2
    assert sidestep(["trial", "--world", near, "--param", "v_maxx=1"]) == 2
    assert sidestep(["trial", "--world", near, "--trace", "/nowhere/at/all.csv"]) == 2
    said = capsys.readouterr()
    assert said.out == ""
    assert len(said.err.splitlines()) == 3
    assert "v_maxx" in said.err


def test_a_trace_has_a_line_for_every_tick_and_ends_at_the_goal(
    near: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trace.csv"
    assert main(["trial", "--world", near, "--json", "--trace", str(path)]) == 0
    outcome = json.loads(capsys.readouterr().out)
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == outcome["ticks"] + 1
    assert [float(rows[k]["time_s"]) for k in (0, 1, 2)] == [0.0, 0.05, 0.1]
    assert abs(float(rows[-1]["true_x_m"]) - 1.4) < 0.1
    assert abs(float(rows[-1]["x_m"]) - 1.4) < 0.06
    assert float(rows[-1]["cov_hh_rad2"]) > 0.0
    assert all(None not in row.values() for row in rows)
