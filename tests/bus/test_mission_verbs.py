"""Missions and fences over a bus, with a robot that is played and with a whole stack."""

import json
from math import isnan
from pathlib import Path

import pytest

from checks.harness.in_process import InProcess
from ground.cli.main import main
from ground.missions.files import read
from protocol.topics import MISSION as TOPICS_MISSION
from protocol.topics import MISSION_SERVICE
from protocol.wire.enums import Command, GoalState, MissionState, MissionType, Vehicle
from protocol.wire.messages import CommandRequest, MissionClearAll, MissionCount, MissionStatus
from protocol.wire.reasons import Reason
from tests.support.played_robot import PlayedRobot, Say
from tests.support.robots import corners
from tests.support.stacks import STOPPING_S, Operator, fence, stops

MISSION = """
[[waypoint]]
x_m = 1.2345
y_m = -2
heading_deg = 90
hold_s = 1.5

[[waypoint]]
x_m = 3
y_m = 0
"""


FENCE = "\n[fence.circle]\nx_m = 0\ny_m = 0\nradius_m = 9\n"


@pytest.fixture
def mission(tmp_path: Path) -> str:
    path = tmp_path / "m.toml"
    path.write_text(MISSION)
    return str(path)


def test_a_mission_is_uploaded_and_comes_back_the_same(
    robot: PlayedRobot, say: Say, mission: str, tmp_path: Path
) -> None:
    Path(mission).write_text(MISSION + FENCE)
    code, out, _ = say("mission", "upload", mission)
    assert (code, out) == (
        0,
        "ok, the robot has 2 waypoints, fence: circle of 9 m around (0, 0)\n",
    )
    first, second = robot.desk.kept[MissionType.MISSION]
    assert (first.x, first.y, first.param4, first.param1) == (12345, -20000, 90.0, 1.5)
    assert isnan(second.param4)
    assert say("mission", "download", str(tmp_path / "back.toml"))[0] == 0
    assert read(tmp_path / "back.toml") == read(Path(mission))


def test_the_item_that_the_robot_refuses_is_named_with_its_reason(
    robot: PlayedRobot, say: Say, mission: str
) -> None:
    robot.desk.verdict = (Reason.GOAL_OUT_OF_RANGE, 1)
    code, out, _ = say("mission", "upload", mission)
    assert code == 1
    assert out.startswith("refused: item 2: ")
    found = json.loads(say("mission", "upload", mission, "--json")[1])
    assert (found["item"], found["reason_code"]) == (2, Reason.GOAL_OUT_OF_RANGE)
    assert robot.desk.kept[MissionType.MISSION] == []


def test_a_refused_fence_keeps_the_mission_here(robot: PlayedRobot, say: Say, mission: str) -> None:
    Path(mission).write_text(MISSION + FENCE)
    robot.desk.verdict = (Reason.FENCE_LEAVES_ROBOT_OUT, 65_535)
    code, out, _ = say("mission", "upload", mission)
    assert code == 1
    assert out.startswith("refused: the fence: ")
    assert {
        frame.mission_type for frame in robot.desk.frames if isinstance(frame, MissionCount)
    } == {MissionType.FENCE}


def test_unsaved_fence_is_reported_and_mission_still_uploaded(
    robot: PlayedRobot, say: Say, mission: str
) -> None:
    Path(mission).write_text(MISSION + FENCE)
    robot.desk.verdict = (Reason.NOT_SAVED, 65_535)
    code, out, err = say("mission", "upload", mission)
    assert code == 1
    assert out == "not saved: the change is in force but could not be saved\n"
    assert err == "the fence: the change is in force but could not be saved\n"
    kinds = [frame.mission_type for frame in robot.desk.frames if isinstance(frame, MissionCount)]
    assert kinds == [MissionType.FENCE, MissionType.MISSION]


def test_frames_that_are_lost_are_sent_again(robot: PlayedRobot, say: Say, mission: str) -> None:
    robot.desk.lost = 2
    assert say("mission", "upload", mission)[0] == 0
    assert len(robot.desk.frames) == 5
    assert len(robot.desk.kept[MissionType.MISSION]) == 2


def test_bad_mission_file_is_refused_before_connecting(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "m.toml"
    path.write_text("[[waypoint]]\nx_m = 1\ny_m = 'two'\n")
    assert main(["mission", "upload", str(path), "--connect", "tcp/127.0.0.1:1"]) == 2
    assert f"{path}:3: waypoint[0].y_m: expected `float`" in capsys.readouterr().err


def test_waypoints_outside_of_the_file_s_own_fence_are_refused(
    mission: str, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(mission).write_text(MISSION + FENCE.replace("9", "2.5"))
    assert main(["mission", "check", mission]) == 2
    assert "waypoint 2: (3, 0) is outside of the fence" in capsys.readouterr().err


def test_check_and_convert_need_no_robot(
    mission: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "m.plan"
    assert main(["mission", "check", mission]) == 0
    assert main(["mission", "convert", mission, str(plan)]) == 2
    assert main(["mission", "convert", mission, str(plan), "--home", "47.4", "8.5"]) == 0
    assert main(["mission", "convert", mission, mission]) == 2
    assert "is also the input" in capsys.readouterr().err
    assert read(plan).mission.waypoints == read(Path(mission)).mission.waypoints


def test_dropped_plan_items_are_reported(
    robot: PlayedRobot, say: Say, mission: str, tmp_path: Path
) -> None:
    plan = tmp_path / "m.plan"
    main(["mission", "convert", mission, str(plan), "--home", "47.4", "8.5"])
    found = json.loads(plan.read_text())
    found["mission"]["items"].insert(0, {"type": "SimpleItem", "command": 22, "params": []})
    plan.write_text(json.dumps(found))
    assert say("mission", "upload", str(plan))[0] == 2
    code, _, err = say("mission", "upload", str(plan), "--drop")
    assert code == 0
    assert "left out: item 1: command 22 (take off)" in err
    assert len(robot.desk.kept[MissionType.MISSION]) == 2


@pytest.mark.parametrize(
    ("words", "command", "param1"),
    [
        (("start",), Command.MISSION_START, -1.0),
        (("start", "1"), Command.MISSION_START, 0.0),
        (("start", "2"), Command.MISSION_START, 1.0),
        (("jump", "2"), Command.DO_SET_MISSION_CURRENT, 1.0),
        (("pause",), Command.DO_PAUSE_CONTINUE, 0.0),
        (("resume",), Command.DO_PAUSE_CONTINUE, 1.0),
        (("abort",), Command.SIDESTEP_ABORT_GOAL, 0.0),
    ],
)
def test_each_order_to_a_mission_is_a_command(
    robot: PlayedRobot,
    say: Say,
    mission: str,
    words: tuple[str, ...],
    command: Command,
    param1: float,
) -> None:
    say("mission", "upload", mission)
    robot.desk.status = MissionState.HOLDING
    code, out, _ = say("mission", *words)
    assert code == 0
    assert out.startswith("ok ")
    (asked,) = set(robot.asked)
    assert isinstance(asked, CommandRequest)
    assert (asked.command, asked.param1) == (command, param1)


def test_mission_start_arms_a_standby_robot(robot: PlayedRobot, say: Say) -> None:
    robot.answers = [Reason.NOT_ARMED]
    code, _, err = say("mission", "start")
    assert (code, robot.vehicle) == (0, Vehicle.ACTIVE)
    assert "armed" in err


def test_a_mission_that_is_done_starts_from_its_first_item(
    robot: PlayedRobot, say: Say, mission: str
) -> None:
    say("mission", "upload", mission)
    robot.desk.status = MissionState.DONE
    assert say("mission", "start")[0] == 0
    (asked,) = set(robot.asked)
    assert isinstance(asked, CommandRequest)
    assert asked.param1 == 0.0


def test_how_far_the_mission_is_can_be_asked(robot: PlayedRobot, say: Say, mission: str) -> None:
    assert say("mission", "status")[1] == "no mission\n"
    say("mission", "upload", mission)
    robot.desk.status = MissionState.RUNNING
    assert say("mission", "status")[1] == "running, item 1 of 2\n"
    assert json.loads(say("mission", "status", "--json")[1])["state"] == "running"
    assert say("mission", "list")[1] == "1  (1.2345, -2) at 90 deg, hold 1.5 s\n2  (3, 0)\n"
    assert say("mission", "clear")[:2] == (0, "ok, the robot has no mission\n")
    assert say("mission", "list")[1].startswith("refused: there is no mission")
    assert say("mission", "download", "x.toml")[1].startswith("refused: there is no mission")


def test_a_fence_is_set_shown_and_taken_away(robot: PlayedRobot, say: Say) -> None:
    assert say("fence", "show")[1] == "no fence\n"
    assert say("fence", "circle", "1", "-1", "4.5")[0] == 0
    assert say("fence", "show")[1] == "circle of 4.5 m around (1, -1)\n"
    assert say("fence", "polygon", "0", "0", "4", "0", "4", "-3")[0] == 0
    assert say("fence", "show")[1] == "polygon of 3 corners: (0, 0) (4, 0) (4, -3)\n"
    assert json.loads(say("fence", "show", "--json")[1])["fence"]["corners"][2] == [4.0, -3.0]
    assert say("fence", "off")[1] == "ok, there is no fence\n"
    assert robot.desk.kept[MissionType.FENCE] == []


def test_a_fence_comes_from_a_file_that_has_nothing_else(
    robot: PlayedRobot, say: Say, tmp_path: Path
) -> None:
    path = tmp_path / "fence.toml"
    path.write_text(FENCE)
    assert say("fence", "polygon", str(path))[0] == 0
    assert len(robot.desk.kept[MissionType.FENCE]) == 1
    path.write_text(MISSION)
    assert "has no fence; add [fence]" in say("fence", "polygon", str(path))[2]


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("polygon", "0", "0", "1"), "3 numbers are not pairs"),
        (("polygon", "0", "0", "1", "1"), "has 2 corners"),
        (("polygon", "a", "b"), "'a' is not a number"),
        (("circle", "0", "9e9", "1"), "y 9e+09 m is out of range"),
    ],
)
def test_what_is_no_fence_is_refused_at_once(
    words: tuple[str, ...], why: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fence", *words, "--connect", "tcp/127.0.0.1:1"]) == 2
    assert why in capsys.readouterr().err


def test_lease_refusal_names_the_holder(robot: PlayedRobot, say: Say, mission: str) -> None:
    robot.desk.held = ("anna/1", "anna")
    robot.desk.verdict = (Reason.LEASE_HELD, 65_535)
    robot.answers = [Reason.LEASE_HELD]
    refusal = "refused: another operator commands the robot: anna (--seize takes it over"
    assert say("arm")[1].startswith(refusal)
    assert say("mission", "upload", mission)[1].startswith(refusal)


class Watched:
    """A stack whose operator uploaded a mission and left, with the mission states it publishes."""

    def __init__(self, stack: InProcess, *places: tuple[float, float], hold_s: float = 0.0) -> None:
        self.stack = stack
        self.ada = Operator(stack, "ada")
        self._box = stack.ground.mailbox(TOPICS_MISSION)
        stack.operator = False
        stack.arm()
        if places:
            assert self.ada.upload(stops(*places, hold_s=hold_s)).reason == Reason.NONE

    @property
    def told(self) -> MissionStatus | None:
        newest = self._box.latest()
        return None if newest is None else newest[0]

    def until(self, state: MissionState, within_s: float = 60.0) -> float:
        return self.stack.until(
            lambda: self.told is not None and self.told.state == state, within_s
        )


def test_mission_runs_to_its_end_without_an_operator() -> None:
    with InProcess("open") as stack:
        run = Watched(stack, (1.5, 2.0), (1.5, 1.0), (0.8, 1.0), hold_s=1.0)
        assert run.ada.command(Command.MISSION_START) == Reason.NONE
        for place in ((1.5, 2.0), (1.5, 1.0)):
            run.until(MissionState.HOLDING)
            stack.assert_near(*place)
            assert 0.9 <= run.until(MissionState.RUNNING) <= 1.1
        run.until(MissionState.DONE)
        stack.assert_near(0.8, 1.0)


def test_pause_says_at_which_item_the_mission_is_paused(robot: PlayedRobot, say: Say) -> None:
    assert "holding, no mission is under way" in say("mission", "pause")[1]
    robot.desk.kept[MissionType.MISSION] = corners((1.0, 1.0), (2.0, 1.0))
    robot.desk.status = MissionState.PAUSED
    assert "mission paused at item 1 of 2" in say("mission", "pause")[1]


def test_a_mission_is_paused_goes_on_jumps_and_is_aborted() -> None:
    with InProcess("open") as stack:
        run = Watched(stack, (2.5, 2.0), (2.5, 1.0), (0.8, 1.0))
        run.ada.command(Command.MISSION_START)
        stack.until(stack.driving)
        assert run.ada.command(Command.DO_PAUSE_CONTINUE, 0) == Reason.NONE
        run.until(MissionState.PAUSED)
        stack.until(stack.standing, within_s=1.0)
        stack.forward(5.0)
        assert stack.standing()
        assert run.ada.command(Command.DO_PAUSE_CONTINUE, 1) == Reason.NONE
        run.until(MissionState.RUNNING)
        stack.until(stack.driving)
        assert run.ada.command(Command.DO_SET_MISSION_CURRENT, 2) == Reason.NONE
        stack.until(lambda: run.told is not None and run.told.current == 2, within_s=1.0)
        stack.forward(1.0)
        assert run.ada.command(Command.SIDESTEP_ABORT_GOAL) == Reason.NONE
        run.until(MissionState.FAILED)
        assert run.told is not None
        assert run.told.reason == Reason.BY_OPERATOR
        stack.until(stack.standing, within_s=1.0)
        assert stack.state == Vehicle.ACTIVE


def test_failed_mission_carries_the_reason_of_its_goal() -> None:
    with InProcess("open") as stack:
        run = Watched(stack, (2.5, 2.0))
        run.ada.command(Command.MISSION_START)
        stack.until(stack.driving)
        stack.inject("scan_stopped")
        run.until(MissionState.FAILED)
        assert run.told is not None
        assert run.told.reason == Reason.SCAN_LOST


def test_a_goal_and_a_mission_outside_of_the_fence_are_refused() -> None:
    with InProcess("open") as stack:
        run = Watched(stack)
        start = stack.world.start
        x_m, y_m = start.x_m, start.y_m
        box = fence(
            (x_m - 0.5, y_m - 1), (x_m + 2, y_m - 1), (x_m + 2, y_m + 1), (x_m - 0.5, y_m + 1)
        )
        assert run.ada.upload(box).reason == Reason.NONE
        assert stack.goto(x_m + 2.5, y_m) == Reason.OUTSIDE_FENCE
        verdict = run.ada.upload(stops((x_m + 1, y_m), (x_m + 3, y_m)))
        assert (verdict.item, verdict.reason) == (1, Reason.OUTSIDE_FENCE)
        away = fence((x_m + 1, y_m), (x_m + 2, y_m), (x_m + 2, y_m + 1))
        assert run.ada.upload(away).reason == Reason.FENCE_LEAVES_ROBOT_OUT


def test_a_robot_that_leaves_its_fence_stops_there() -> None:
    with InProcess("open") as stack:
        run = Watched(stack)
        x_m, y_m = stack.world.start.x_m, stack.world.start.y_m
        edge_m = x_m + 1.0
        run.ada.upload(
            fence((x_m - 1, y_m - 1), (edge_m, y_m - 1), (edge_m, y_m + 1), (x_m - 1, y_m + 1))
        )
        run.ada.beat()
        stack.forward(0.3)
        assert run.ada.manual() == Reason.NONE
        for _ in range(200):
            run.ada.beat()
            run.ada.steer(0.3)
            stack.forward(0.05)
            if stack.state == Vehicle.FAILSAFE:
                break
        assert stack.why == Reason.FENCE_BREACHED
        stack.forward(STOPPING_S)
        assert stack.standing()
        assert stack.truth.x_m - edge_m <= 0.10
        assert stack.arm() == Reason.FENCE_BREACHED
        run.ada.ask(MissionClearAll(mission_type=MissionType.FENCE), MISSION_SERVICE)
        stack.forward(0.1)
        assert stack.arm() == Reason.NONE


def test_the_robot_returns_to_its_start_along_its_own_trail() -> None:
    with InProcess("u_trap") as stack:
        start = stack.world.start
        stack.arm()
        stack.goto_goal()
        stack.until(stack.reached)
        before = stack.truth
        assert stack.command(Command.NAV_RETURN_TO_LAUNCH) == Reason.NONE
        stack.operator = False
        stack.until(stack.reached)
        stack.assert_near(start.x_m, start.y_m, within_m=0.15)
        assert stack.truth.contact == 0
        assert before.x_m != stack.truth.x_m
        assert stack.goal_state == GoalState.REACHED
