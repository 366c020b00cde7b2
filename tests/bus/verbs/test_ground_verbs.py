"""Verbs over a real bus: each command returns a reason, or an error that names the missing peer."""

import json
import re

import pytest

from ground.cli.main import main
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from protocol.wire.enums import Command, Mode, Vehicle
from protocol.wire.messages import CommandRequest
from protocol.wire.reasons import Reason
from tests.support.bus.robots import PlayedRobot, Say


@pytest.mark.parametrize(
    ("words", "command", "param1", "param2", "effect"),
    [
        (("hold",), Command.DO_PAUSE_CONTINUE, 0.0, 0.0, "holding, the goal is kept"),
        (("resume",), Command.DO_PAUSE_CONTINUE, 1.0, 0.0, "driving on"),
        (("abort",), Command.SIDESTEP_ABORT_GOAL, 0.0, 0.0, "stopped, the goal is dropped"),
        (
            ("clear-estop",),
            Command.SIDESTEP_CLEAR_EMERGENCY_STOP,
            0.0,
            0.0,
            "emergency stop cleared",
        ),
        (("arm",), Command.COMPONENT_ARM_DISARM, 1.0, 0.0, "motors armed"),
        (("disarm",), Command.COMPONENT_ARM_DISARM, 0.0, 0.0, "motors disarmed"),
        (("rtl",), Command.NAV_RETURN_TO_LAUNCH, 0.0, 0.0, "driving back along the trail"),
        (("mode", "AUTO"), Command.DO_SET_MODE, 1.0, float(Mode.AUTO), "mode set"),
        (("navigator", "bug", "right"), Command.SIDESTEP_SET_NAVIGATOR, 1.0, -1.0, "navigator set"),
        (("navigator", "vgm"), Command.SIDESTEP_SET_NAVIGATOR, 2.0, 0.0, "navigator set"),
    ],
)
def test_each_verb_sends_its_command_and_prints_the_answer(
    robot: PlayedRobot,
    say: Say,
    words: tuple[str, ...],
    command: Command,
    param1: float,
    param2: float,
    effect: str,
) -> None:
    code, out, err = say(*words)
    assert code == 0
    assert re.fullmatch(rf"ok \d+ ms: {effect}\n", out)
    assert err == ""
    (asked,) = set(robot.asked)  # a busy machine repeats it
    assert isinstance(asked, CommandRequest)
    assert (asked.command, asked.param1, asked.param2) == (command, param1, param2)


def test_estop_is_acknowledged_by_the_status_alone(robot: PlayedRobot, say: Say) -> None:
    code, out, err = say("estop")
    assert (code, err) == (0, "")
    assert out.startswith("E-STOP acknowledged by r1 after ")
    assert robot.commands == [Command.DO_FLIGHTTERMINATION]
    assert robot.vehicle is Vehicle.EMERGENCY_STOP
    robot.deaf = True
    robot.vehicle = Vehicle.ACTIVE
    code, out, _ = say("estop", "--timeout", "0.3", "--json")
    found = json.loads(out)
    assert code == 1
    assert (found["ok"], found["reason_code"]) == (False, None)


def test_estop_of_all_has_a_line_and_a_row_for_each_robot(robot: PlayedRobot, say: Say) -> None:
    code, out, err = say("estop", "--all")
    assert (code, err) == (0, "")
    assert out.startswith("r1: E-STOP acknowledged by r1 after ")
    seen = robot.stop_id
    code, out, _ = say("clear-estop", "--all", "--json")
    found = json.loads(out)
    release = robot.asked[-1]
    assert isinstance(release, CommandRequest)
    assert release.stop_id == seen != 0
    assert (code, found["verb"], found["ok"]) == (0, "clear-estop", True)
    assert [one["robot"] for one in found["robots"]] == ["r1"]
    robot.deaf = True
    robot.vehicle = Vehicle.ACTIVE
    code, out, _ = say("estop", "all", "--timeout", "0.3", "--json")
    found = json.loads(out)
    assert (code, found["ok"], found["robots"][0]["ok"]) == (1, False, False)


def test_all_robots_and_one_robot_exclude_each_other(robot: PlayedRobot, say: Say) -> None:
    code, _, err = say("estop", "--all", "--id", "r1")
    assert code == 2
    assert "--all cannot be combined with --id" in err
    assert robot.asked == []


def test_a_refusal_gives_the_reason_and_what_to_do(robot: PlayedRobot, say: Say) -> None:
    robot.answers = [Reason.EMERGENCY_STOPPED]
    code, out, _ = say("arm", "--json")
    found = json.loads(out)
    assert code == 1
    assert (found["ok"], found["reason_code"]) == (False, Reason.EMERGENCY_STOPPED)
    for reason, hint in (
        (Reason.EMERGENCY_STOPPED, "sidestep clear-estop"),
        (Reason.FENCE_BREACHED, "sidestep fence off"),
    ):
        robot.answers = [reason]
        assert hint in say("arm")[1]


def test_a_dropped_command_is_repeated_with_the_same_id(robot: PlayedRobot, say: Say) -> None:
    robot.answers = [None, None]
    code, _, _ = say("hold", "--timeout", "0.3")
    ids = {message.request_id for message in robot.asked if isinstance(message, CommandRequest)}
    assert (code, len(robot.asked), len(ids)) == (0, 3, 1)


def test_unanswered_command_with_heartbeat_is_reported(robot: PlayedRobot, say: Say) -> None:
    robot.answers = [None] * 3
    code, _, err = say("hold", "--timeout", "0.1")
    assert code == 1
    assert "sends its heartbeat, but does not answer" in err


def test_hung_control_loop_is_reported(robot: PlayedRobot, say: Say) -> None:
    robot.fall_silent()
    robot.answers = [None] * 3
    code, _, err = say("hold", "--timeout", "0.1")
    assert code == 1
    assert "its control loop does not" in err


def test_another_robot_is_offered(say: Say) -> None:
    code, _, err = say("hold", "--id", "r2", "--timeout", "0.1")
    assert code == 1
    assert "only r1: use --id" in err


def test_missing_peer_message_names_the_endpoint(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["hold", "--connect", "tcp/127.0.0.1:1", "--json"]) == 1
    said = capsys.readouterr()
    assert "tcp/127.0.0.1:1" in json.loads(said.out)["reason"]
    assert "no robot and no router" in said.err


def test_plant_without_robot_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    network = Network(mode="peer", listen=("tcp/127.0.0.1:0",))
    with open_bus(network, Role.PLANT, "r1") as bus:
        bus.announce()
        assert main(["hold", "--connect", bus.locator(), "--timeout", "0.1"]) == 1
    assert "only its plant is" in capsys.readouterr().err


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
    assert "no plant is running" in said
    assert "nothing on tlm/odometry" in said
    assert not [what for what in said if "sonar" in what or "srv/" in what]


def test_doctor_reports_a_missing_robot(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--connect", "tcp/127.0.0.1:1"]) == 1
    assert "sidestep run robot" in capsys.readouterr().out
