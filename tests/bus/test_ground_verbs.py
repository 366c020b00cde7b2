"""Verbs over a real bus: every command is answered with a reason, or it is said who is missing."""

import json
import os
import signal
import threading
from collections.abc import Callable, Iterator
from math import pi
from pathlib import Path
from typing import Any

import pytest

from ground import goto
from ground.cli import main
from ground.parts import Part, in_words
from ground.status_line import goal_line
from protocol.bus import Network, open_bus
from protocol.enums import Command, GoalState, Mode, Vehicle
from protocol.messages import CommandRequest, GoalRequest
from protocol.reasons import Reason
from protocol.topics import Role
from tests.bus.robots import PlayedRobot, played

Say = Callable[..., tuple[int, str, str]]


@pytest.fixture
def stage() -> Iterator[tuple[PlayedRobot, str]]:
    with played() as found:
        yield found


@pytest.fixture
def robot(stage: tuple[PlayedRobot, str]) -> PlayedRobot:
    return stage[0]


@pytest.fixture
def say(stage: tuple[PlayedRobot, str], capsys: pytest.CaptureFixture[str]) -> Say:
    """Run a verb against the robot: exit code, standard output, standard error."""

    def run(*words: str) -> tuple[int, str, str]:
        code = main([*words, "--connect", stage[1]])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.mark.parametrize(
    ("words", "command", "param1", "param2"),
    [
        (("hold",), Command.DO_PAUSE_CONTINUE, 0.0, 0.0),
        (("resume",), Command.DO_PAUSE_CONTINUE, 1.0, 0.0),
        (("abort",), Command.SIDESTEP_ABORT_GOAL, 0.0, 0.0),
        (("estop",), Command.DO_FLIGHTTERMINATION, 1.0, 0.0),
        (("clear-estop",), Command.SIDESTEP_CLEAR_EMERGENCY_STOP, 0.0, 0.0),
        (("arm",), Command.COMPONENT_ARM_DISARM, 1.0, 0.0),
        (("disarm",), Command.COMPONENT_ARM_DISARM, 0.0, 0.0),
        (("rtl",), Command.NAV_RETURN_TO_LAUNCH, 0.0, 0.0),
        (("mode", "AUTO"), Command.DO_SET_MODE, 1.0, float(Mode.AUTO)),
        (("navigator", "bug", "right"), Command.SIDESTEP_SET_NAVIGATOR, 1.0, -1.0),
        (("navigator", "vgm"), Command.SIDESTEP_SET_NAVIGATOR, 2.0, 0.0),
    ],
)
def test_each_verb_sends_its_command_and_tells_the_answer(
    robot: PlayedRobot,
    say: Say,
    words: tuple[str, ...],
    command: Command,
    param1: float,
    param2: float,
) -> None:
    code, out, err = say(*words)
    assert code == 0
    assert out.startswith("ok ")
    assert out.endswith(" ms\n")
    assert err == ""
    (asked,) = robot.asked
    assert isinstance(asked, CommandRequest)
    assert (asked.command, asked.param1, asked.param2) == (command, param1, param2)


def test_a_refusal_gives_the_reason_and_what_to_do(robot: PlayedRobot, say: Say) -> None:
    robot.answers = [Reason.EMERGENCY_STOPPED]
    code, out, _ = say("arm", "--json")
    found = json.loads(out)
    assert code == 1
    assert (found["ok"], found["reason_code"]) == (False, Reason.EMERGENCY_STOPPED)
    robot.answers = [Reason.EMERGENCY_STOPPED]
    assert "sidestep clear-estop" in say("arm")[1]


def test_a_dropped_command_is_repeated_with_the_same_id(robot: PlayedRobot, say: Say) -> None:
    robot.answers = [None, None]
    code, _, _ = say("hold", "--timeout", "0.3")
    ids = {message.request_id for message in robot.asked if isinstance(message, CommandRequest)}
    assert (code, len(robot.asked), len(ids)) == (0, 3, 1)


def test_a_robot_that_beats_and_does_not_answer_is_told_so(robot: PlayedRobot, say: Say) -> None:
    robot.answers = [None] * 3
    code, _, err = say("hold", "--timeout", "0.1")
    assert code == 1
    assert "its heart beats, but it does not answer" in err


def test_a_robot_whose_loop_hangs_is_told_so(robot: PlayedRobot, say: Say) -> None:
    robot.fall_silent()
    robot.answers = [None] * 3
    code, _, err = say("hold", "--timeout", "0.1")
    assert code == 1
    assert "control loop does not run" in err


def test_another_robot_is_offered(say: Say) -> None:
    code, _, err = say("hold", "--id", "r2", "--timeout", "0.1")
    assert code == 1
    assert "there is r1: use --id" in err


def test_nobody_at_the_endpoint_is_said_with_the_endpoint(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["hold", "--connect", "tcp/127.0.0.1:1", "--json"]) == 1
    said = capsys.readouterr()
    assert "tcp/127.0.0.1:1" in json.loads(said.out)["reason"]
    assert "no robot and no router" in said.err


def test_a_plant_without_its_robot_is_told_apart(capsys: pytest.CaptureFixture[str]) -> None:
    network = Network(mode="peer", listen=("tcp/127.0.0.1:0",))
    with open_bus(network, Role.PLANT, "r1") as bus:
        bus.announce()
        assert main(["hold", "--connect", bus.locator(), "--timeout", "0.1"]) == 1
    assert "only its plant is" in capsys.readouterr().err


def test_goto_arms_a_robot_that_stands_by_and_waits_for_the_end(
    robot: PlayedRobot, say: Say
) -> None:
    def arrive() -> None:
        robot.goal = GoalState.REACHED

    robot.answers = [Reason.NOT_ARMED]
    robot.after_goal = arrive
    code, out, err = say("goto", "1", "2", "90")
    assert code == 0
    assert out.startswith("reached after ")
    assert "armed" in err
    assert robot.vehicle is Vehicle.ACTIVE
    assert robot.beats >= 1
    goals = [message for message in robot.asked if isinstance(message, GoalRequest)]
    assert [(goal.x_mm, goal.y_mm, goal.mode) for goal in goals] == [(1000, 2000, Mode.GUIDED)] * 2


def test_goto_does_not_show_the_end_of_the_goal_before(
    robot: PlayedRobot, say: Say, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    def line(*arguments: Any) -> list[Part]:
        parts = goal_line(*arguments)
        shown.append(in_words(parts))
        if "set off" in shown[-1]:
            robot.stale = None
        if "driving" in shown[-1]:
            robot.goal = GoalState.REACHED
        return parts

    monkeypatch.setattr(goto, "goal_line", line)
    monkeypatch.setattr(goto, "SHOW_PLAIN_NS", 1_000_000)
    robot.vehicle, robot.goal_id, robot.goal = Vehicle.ACTIVE, 7, GoalState.REACHED
    robot.stale = robot.status()
    assert say("goto", "1", "2", "--timeout", "20")[0] == 0
    first = next(text for text in shown if "robot's status" not in text)
    assert first == "waiting for the robot to set off"
    assert any("driving" in text for text in shown)


def test_goto_never_arms_out_of_a_failsafe(robot: PlayedRobot, say: Say) -> None:
    robot.vehicle = Vehicle.FAILSAFE
    robot.answers = [Reason.NOT_ARMED]
    code, out, _ = say("goto", "1", "2")
    assert code == 1
    assert "arm first" in out
    assert Command.COMPONENT_ARM_DISARM not in robot.commands


def test_goto_ends_with_1_and_the_reason_when_stuck(robot: PlayedRobot, say: Say) -> None:
    def get_stuck() -> None:
        robot.goal, robot.goal_reason = GoalState.STUCK, Reason.NO_PROGRESS

    robot.after_goal = get_stuck
    code, out, _ = say("goto", "1", "2", "--json")
    found = json.loads(out)
    assert code == 1
    assert (found["outcome"], found["reason"]) == ("stuck", "has come no closer for too long")


def test_goto_aborts_when_its_time_is_up(robot: PlayedRobot, say: Say) -> None:
    code, out, _ = say("goto", "1", "2", "--timeout", "0.3", "--json")
    assert code == 1
    assert json.loads(out)["outcome"] == "timeout"
    assert robot.commands[-1] == Command.SIDESTEP_ABORT_GOAL


def test_ctrl_c_aborts_the_goal_first(robot: PlayedRobot, say: Say) -> None:
    robot.after_goal = lambda: threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
    code, _, err = say("goto", "1", "2")
    assert code == 130
    assert "goal aborted" in err
    assert robot.commands[-1] == Command.SIDESTEP_ABORT_GOAL


def test_goto_without_waiting_leaves_the_robot_to_itself(robot: PlayedRobot, say: Say) -> None:
    code, out, _ = say("goto", "1", "2", "--no-wait")
    assert code == 0
    assert out.startswith("ok ")
    (goal,) = robot.asked
    assert isinstance(goal, GoalRequest)
    assert (goal.mode, goal.heading_free) == (Mode.AUTO, 1)
    assert robot.beats == 0


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
        (False, "until the robot restarts: it runs without --state"),
        (None, "the robot does not say"),
    ],
)
def test_whether_a_value_survives_a_restart_is_what_the_robot_says(
    robot: PlayedRobot, say: Say, saves: bool | None, words: str
) -> None:
    robot.saves = saves
    assert words in say("param", "set", "d_obs_m", "0.5")[1]
    assert json.loads(say("param", "set", "d_obs_m", "0.5", "--json")[1])["saved"] is saves
    code, out, _ = say("param", "save")
    assert (code, "d_obs_m" in out) == ((0, True) if saves else (1, False))


def test_a_parameter_nobody_knows_is_refused_with_a_reason(say: Say) -> None:
    assert say("param", "get", "zzz")[0] == 2
    code, out, _ = say("param", "set", "zzz", "1")
    assert code == 1
    assert "no such parameter" in out


def test_watch_once_shows_what_is_live_and_what_is_not(say: Say) -> None:
    code, out, _ = say("watch", "--json")
    found = json.loads(out)
    assert code == 0
    assert found["streams"]["tlm/status"]["state"] == "live"
    assert found["streams"]["tlm/odometry"]["message"] is None


def test_the_doctor_misses_the_plant_and_the_silent_streams(say: Say) -> None:
    code, out, _ = say("doctor", "--timeout", "0.2", "--json")
    found = json.loads(out)
    said = [finding["what"] for finding in found["findings"]]
    assert code == 1
    assert found["processes"] == ["robot r1"]
    assert "no plant is there" in said
    assert "nothing on tlm/odometry" in said
    assert not [what for what in said if "sonar" in what or "srv/" in what]


def test_the_doctor_says_so_when_nobody_is_there(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--connect", "tcp/127.0.0.1:1"]) == 1
    assert "sidestep robot" in capsys.readouterr().out


def test_parameters_go_to_a_file_and_back(robot: PlayedRobot, say: Say, tmp_path: Path) -> None:
    path = tmp_path / "p.toml"
    assert say("param", "save", str(path))[1] == f"{path}: d_obs_m\n"
    assert say("param", "load", str(path))[1] == "nothing was other than the file says\n"
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


def test_a_goal_seen_from_the_robot_becomes_a_place_of_the_world(
    robot: PlayedRobot, say: Say
) -> None:
    robot.pose = (1.0, 2.0, pi / 2)
    assert say("goto", "2", "-0.5", "90", "--frame", "body", "--no-wait")[0] == 0
    (goal,) = robot.asked
    assert isinstance(goal, GoalRequest)
    assert (goal.x_mm, goal.y_mm, abs(goal.heading_urad)) == (1500, 4000, round(pi * 1e6))


def test_a_robot_that_does_not_say_where_it_is_cannot_be_sent_from_there(
    robot: PlayedRobot, say: Say
) -> None:
    code, _, err = say("goto", "1", "0", "--frame", "body", "--no-wait")
    assert code == 1
    assert "does not say where it is" in err
    assert robot.asked == []
