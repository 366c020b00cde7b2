"""Verbs over a real bus: results, reasons, missing peers, and broken pipes."""

import json
import os
import re
import subprocess
import sys
import threading
from math import pi
from pathlib import Path
from typing import Any

import pytest

from checks.harness.until import PATIENCE_S, interrupt_when, until
from ground.cli.main import main
from ground.client.requests import ATTEMPTS
from ground.client.status_line import goal_line
from ground.recording.log_reader import record_bytes
from ground.text.wording import Part, in_words
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.topics import WORLD, Role
from protocol.wire.codec import Encoder
from protocol.wire.enums import Command, GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.messages import CommandRequest, GoalRequest
from protocol.wire.reasons import Reason
from tests.support.played_robot import BEAT, PlayedRobot, Say, played


@pytest.mark.parametrize(
    ("words", "command", "param1", "param2", "effect"),
    [
        (("hold",), Command.DO_PAUSE_CONTINUE, 0.0, 0.0, "holding, the goal is kept"),
        (("resume",), Command.DO_PAUSE_CONTINUE, 1.0, 0.0, "driving on"),
        (
            ("abort",),
            Command.SIDESTEP_ABORT_GOAL,
            0.0,
            0.0,
            r"stopped, the goal is ended; `sidestep resume --connect \S+` would go on to it",
        ),
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
    assert "slow or hangs, its process is alive but sends no heartbeat" in err


def test_another_robot_is_offered(say: Say) -> None:
    code, _, err = say("hold", "--id", "r2", "--timeout", "0.1")
    assert code == 1
    assert "only r1: name one that is there, as in --id r1" in err


def test_missing_peer_message_names_the_endpoint(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["hold", "--connect", "tcp/127.0.0.1:1", "--json"]) == 1
    said = capsys.readouterr()
    assert "tcp/127.0.0.1:1" in json.loads(said.out)["reason"]
    first, *_, last = said.err.splitlines()
    assert first.startswith("no process listens at tcp/127.0.0.1:1: trying; `sidestep up`")
    assert "no robot and no router" in last


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


def test_goto_arms_a_standby_robot_and_waits_for_the_end(robot: PlayedRobot, say: Say) -> None:
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


def test_goto_outside_the_world_is_an_error_unless_it_is_sent_anyway(
    robot: PlayedRobot, say: Say
) -> None:
    robot.vehicle = Vehicle.ACTIVE
    start = {"x_m": 0.6, "y_m": 2.0, "heading_deg": 0.0}
    goal = {"x_m": 5.0, "y_m": 2.0, "heading_deg": None}
    goal |= {"position_tolerance_m": 0.05, "heading_tolerance_deg": 3.0}
    facts = {"name": "box", "size_m": [6.0, 4.0], "start": start, "goal": goal, "obstacles": []}
    robot.bus.serve(WORLD, lambda incoming: incoming.reply(json.dumps(facts).encode()), "r1")
    code, _, err = say("goto", "100", "100", "--no-wait")
    assert code == 2
    assert "goal (100.000, 100.000) lies outside the world box (6 x 4 m); --anyway" in err
    assert not [message for message in robot.asked if isinstance(message, GoalRequest)]
    assert say("goto", "100", "100", "--no-wait", "--anyway")[0] == 0
    assert say("goto", "1", "1", "--no-wait")[0] == 0
    assert len([message for message in robot.asked if isinstance(message, GoalRequest)]) == 2


def test_goto_ignores_the_result_of_the_previous_goal(
    robot: PlayedRobot, say: Say, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown: list[str] = []

    def line(*arguments: Any) -> list[Part]:
        parts = goal_line(*arguments)
        shown.append(in_words(parts))
        if "driving" in shown[-1]:
            robot.goal = GoalState.REACHED
        return parts

    monkeypatch.setattr("ground.robot.goal_line", line)
    monkeypatch.setattr("ground.robot.SHOW_PLAIN_NS", 1_000_000)
    robot.vehicle, robot.goal_id, robot.goal = Vehicle.ACTIVE, 7, GoalState.REACHED
    robot.stale = robot.status()

    def show() -> None:
        until(lambda: robot.beats > 3)
        assert shown == []
        robot.stale = None

    threading.Thread(target=show, daemon=True).start()
    code, _, err = say("goto", "1", "2", "--timeout", "20")
    assert code == 0
    assert "driving" in shown[0], "nothing of the goal before"
    assert "waiting" not in err


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


def test_goto_shows_the_doubt_of_a_lost_robot(robot: PlayedRobot, say: Say) -> None:
    def get_lost() -> None:
        robot.goal, robot.goal_reason = GoalState.STUCK, Reason.LOST

    robot.after_goal = get_lost
    code, out, _ = say("goto", "1", "2")
    assert code == 1
    assert re.match(r"lost: found no way .*; position doubt (\d\.\d\d m|unknown) after ", out)


def test_goto_aborts_when_its_time_is_up(robot: PlayedRobot, say: Say) -> None:
    code, out, _ = say("goto", "1", "2", "--timeout", "0.3", "--json")
    assert code == 1
    assert json.loads(out)["outcome"] == "timeout"
    assert robot.commands[-1] == Command.SIDESTEP_ABORT_GOAL


def test_ctrl_c_aborts_the_goal_first(robot: PlayedRobot, say: Say) -> None:
    interrupt_when(lambda: robot.goal_id != 0 and robot.beats >= 2)
    code, _, err = say("goto", "1", "2")
    assert code == 130
    assert "goal aborted" in err
    assert robot.commands[-1] == Command.SIDESTEP_ABORT_GOAL


def test_goto_without_waiting_leaves_the_robot_to_itself(robot: PlayedRobot, say: Say) -> None:
    code, out, _ = say("goto", "1", "2", "--no-wait")
    assert code == 0
    assert out.startswith("ok ")
    (goal,) = set(robot.asked)
    assert isinstance(goal, GoalRequest)
    assert (goal.mode, goal.heading_free) == (Mode.AUTO, 1)
    assert robot.beats == 0


def test_body_frame_goal_is_converted_to_the_world_frame(robot: PlayedRobot, say: Say) -> None:
    robot.pose = (1.0, 2.0, pi / 2)
    assert say("goto", "2", "-0.5", "90", "--frame", "body", "--no-wait")[0] == 0
    (goal,) = set(robot.asked)
    assert isinstance(goal, GoalRequest)
    assert (goal.x_mm, goal.y_mm, abs(goal.heading_urad)) == (1500, 4000, round(pi * 1e6))


def test_body_frame_goal_needs_a_known_pose(robot: PlayedRobot, say: Say) -> None:
    code, _, err = say("goto", "1", "0", "--frame", "body", "--no-wait")
    assert code == 1
    assert "publishes no pose" in err
    assert robot.asked == []


def test_goto_holds_the_lease_while_it_runs(robot: PlayedRobot, say: Say) -> None:
    say("goto", "1", "2", "--timeout", "0.2")
    kinds = [request.action for request in robot.desk.actions]
    assert kinds == [LeaseAction.TAKE, LeaseAction.LEAVE]
    assert robot.desk.held is None


def test_goto_names_the_lease_holder_when_refused(robot: PlayedRobot, say: Say) -> None:
    robot.desk.held = ("anna/1", "anna")
    code, out, err = say("goto", "1", "2", "--json")
    assert code == 1
    assert ": anna" in json.loads(out)["reason"]
    assert "commands the robot: anna (--seize takes it over" in err
    assert robot.asked == []


def test_goto_may_seize_the_lease(robot: PlayedRobot, say: Say) -> None:
    robot.desk.held = ("anna/1", "anna")
    say("goto", "1", "2", "--seize", "--timeout", "0.2")
    kinds = [request.action for request in robot.desk.actions]
    assert kinds == [LeaseAction.SEIZE, LeaseAction.TAKE, LeaseAction.LEAVE]
    assert isinstance(robot.asked[0], GoalRequest)


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


ROOT = Path(__file__).parents[2]
BROKEN_PIPE = 141
START_US = 1_790_000_000_000_000


def read_one_line_of(*words: str, both: bool = False) -> tuple[str, int, str]:
    """Return the first line, the exit code after the pipe closes, and standard error."""
    error = subprocess.STDOUT if both else subprocess.PIPE
    with subprocess.Popen(
        [sys.executable, "-m", "sidestep", *words],
        stdout=subprocess.PIPE,
        stderr=error,
        text=True,
    ) as verb:
        assert verb.stdout is not None
        line = verb.stdout.readline()
        verb.stdout.close()
        said = "" if verb.stderr is None else verb.stderr.read()
        return line, verb.wait(timeout=PATIENCE_S), said


def test_head_of_a_table_exits_with_broken_pipe(tmp_path: Path) -> None:
    encoder = Encoder(1, 1)
    log = tmp_path / "x.tlog"
    log.write_bytes(b"".join(record_bytes(START_US, encoder.encode(BEAT)) for _ in range(20_000)))
    assert read_one_line_of("rec", "export", str(log)) == (
        "time_s,utc_s,topic,message,field,value\n",
        BROKEN_PIPE,
        "",
    )


@pytest.mark.parametrize("both", [False, True])
def test_head_of_watch_output_exits_with_broken_pipe(both: bool) -> None:
    with played() as (_, endpoint):
        line, code, said = read_one_line_of("watch", "--connect", endpoint, both=both)
    assert "STANDBY" in line
    assert (code, said) == (BROKEN_PIPE, "")


@pytest.mark.parametrize("words", [("param", "list"), ("watch", "--once")])
def test_reader_closed_before_output_gives_broken_pipe(words: tuple[str, ...]) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with played() as (_, endpoint):
        done = subprocess.run(
            [sys.executable, "-m", "sidestep", *words, "--connect", endpoint],
            stdout=writer,
            stderr=subprocess.PIPE,
            check=False,
            timeout=PATIENCE_S,
        )
    os.close(writer)
    assert (done.returncode, done.stderr) == (BROKEN_PIPE, b"")
