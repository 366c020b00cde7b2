"""`param` over a real bus: what the robot has, what it takes, and whether that will last."""

import json
from pathlib import Path

import pytest

from ground.client.requests import ATTEMPTS
from tests.support.bus.robots import PlayedRobot, Say


def test_parameters_are_listed_found_and_set(say: Say) -> None:
    _, table, _ = say("param", "list")
    assert "0.4 *" in table
    assert "zone" in table
    assert say("param", "get", "d_*")[1] == "d_obs_m = 0.4 m\n"
    assert json.loads(say("param", "get", "side", "--json")[1])["parameters"][0]["value"] == 1


@pytest.mark.parametrize(
    ("saves", "words"),
    [
        (True, "d_obs_m = 0.5, saved on the robot"),
        (False, "until the robot restarts: without --state"),
        (None, "the robot does not report"),
    ],
)
def test_saved_flag_is_the_one_the_robot_reports(
    robot: PlayedRobot, say: Say, saves: bool | None, words: str
) -> None:
    robot.saves = saves
    assert words in say("param", "set", "d_obs_m", "0.5")[1]
    assert json.loads(say("param", "set", "d_obs_m", "0.5", "--json")[1])["saved"] is saves
    code, out, _ = say("param", "save")
    assert (code, "d_obs_m" in out) == ((0, True) if saves else (1, False))


def test_robot_on_a_slow_disk_is_asked_until_it_has_saved(robot: PlayedRobot, say: Say) -> None:
    robot.saving = 2 * ATTEMPTS
    assert say("param", "set", "d_obs_m", "0.5")[1] == "d_obs_m = 0.5, saved on the robot\n"
    assert robot.saving == 0


def test_named_values_are_shown_and_typed_by_name(robot: PlayedRobot, say: Say) -> None:
    assert say("param", "get", "side")[1] == "side = left\n"
    code, _, err = say("param", "set", "side", "upwards")
    assert code == 2
    assert "side = 'upwards': must be a finite number or one of left, right" in err


def test_unknown_parameter_is_refused_with_a_reason(say: Say) -> None:
    assert say("param", "get", "zzz")[0] == 2
    code, out, _ = say("param", "set", "zzz", "1")
    assert code == 1
    assert "no such parameter" in out


def test_parameters_go_to_a_file_and_back(robot: PlayedRobot, say: Say, tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    assert say("param", "save", str(path))[1] == f"{path}: d_obs_m\n"
    assert say("param", "load", str(path))[1] == "no change: the robot has all values of the file\n"
    path.write_text("[parameters]\nd_obs_m = 0.6\nside = -1\n")
    code, out, _ = say("param", "load", str(path))
    assert code == 1
    assert out == "refused: side = -1: the robot has no such parameter; set: d_obs_m\n"
    path.write_text("[parameters]\nd_obs_m = 99\n")
    code, _, err = say("param", "load", str(path))
    assert code == 2
    assert "99 is out of range; give 0.05 to 3 m" in err


def test_what_was_changed_is_shown_and_set_back(say: Say) -> None:
    assert "side" not in say("param", "diff")[1]
    assert "0.4 *" in say("param", "diff")[1]
    assert say("param", "reset", "d_obs_m")[1].startswith("d_obs_m = 0.3, ")
    assert "did you mean d_obs_m?" in say("param", "reset", "d_obs")[2]
