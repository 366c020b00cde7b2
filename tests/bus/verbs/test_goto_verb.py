"""`goto` over a real bus: it arms, waits, reports the result, and leaves no goal behind."""

import json
import re
import threading
from math import pi
from typing import Any

import pytest

from ground.client.operations import goals
from ground.client.status_line import goal_line
from ground.text.status_parts import Part, in_words
from protocol.topics import WORLD
from protocol.wire.enums import Command, GoalState, LeaseAction, Mode, Vehicle
from protocol.wire.messages import GoalRequest
from protocol.wire.reasons import Reason
from tests.support.bus.robots import PlayedRobot, Say
from tests.support.interrupt import interrupt_when
from tests.support.until import until


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
    facts = b'{"name": "box", "size_m": [6.0, 4.0]}'
    robot.bus.serve(WORLD, lambda incoming: incoming.reply(facts), "r1")
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

    monkeypatch.setattr(goals, "goal_line", line)
    monkeypatch.setattr(goals, "SHOW_PLAIN_NS", 1_000_000)
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
    robot.desk.held = ("beef", "anna")
    code, out, err = say("goto", "1", "2", "--json")
    assert code == 1
    assert ": anna" in json.loads(out)["reason"]
    assert "commands the robot: anna (--seize takes it over" in err
    assert robot.asked == []


def test_goto_may_seize_the_lease(robot: PlayedRobot, say: Say) -> None:
    robot.desk.held = ("beef/1", "anna")
    say("goto", "1", "2", "--seize", "--timeout", "0.2")
    kinds = [request.action for request in robot.desk.actions]
    assert kinds == [LeaseAction.SEIZE, LeaseAction.TAKE, LeaseAction.LEAVE]
    assert isinstance(robot.asked[0], GoalRequest)
