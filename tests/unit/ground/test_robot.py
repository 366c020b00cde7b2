"""The client of one robot, in a thread: what it sends for goals, drives, stops and the lease."""

import asyncio
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

from ground.blocking import BlockingRobot, run_blocking
from ground.client.goal import destination
from ground.client.outcomes import Accepted, Refused, RefusedError
from ground.robot import Robot
from protocol.topics import LEASE, ODOMETRY, STATUS
from protocol.wire.enums import Command, LeaseAction, Mode, Vehicle
from protocol.wire.messages import CommandRequest, GoalRequest, LeaseRequest
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError
from tests.support.each import each
from tests.support.ground.client import HELD, STANDBY, Stage, lease_of, status

GOAL = destination([1.0, 2.0])
Call = Callable[[Robot], Coroutine[Any, Any, Any]]


def done(stage: Stage, call: Call) -> Any:
    return run_blocking(call(BlockingRobot(stage.session)))


def sent(stage: Stage) -> list[str]:
    return [name_of(request) for request in stage.bus.requests]


def name_of(request: LeaseRequest | GoalRequest | CommandRequest) -> str:
    if isinstance(request, LeaseRequest):
        return LeaseAction(request.action).name
    if isinstance(request, GoalRequest):
        return Mode(request.mode).name
    return Command(request.command).name


@each(
    ("call", "wire"),
    [
        (lambda robot: robot.hold(), (Command.DO_PAUSE_CONTINUE, 0.0, 0.0)),
        (lambda robot: robot.resume(), (Command.DO_PAUSE_CONTINUE, 1.0, 0.0)),
        (lambda robot: robot.abort(), (Command.SIDESTEP_ABORT_GOAL, 0.0, 0.0)),
        (lambda robot: robot.arm(), (Command.COMPONENT_ARM_DISARM, 1.0, 0.0)),
        (lambda robot: robot.disarm(), (Command.COMPONENT_ARM_DISARM, 0.0, 0.0)),
        (lambda robot: robot.return_home(), (Command.NAV_RETURN_TO_LAUNCH, 0.0, 0.0)),
        (lambda robot: robot.restart(), (Command.PREFLIGHT_REBOOT_SHUTDOWN, 1.0, 0.0)),
        (lambda robot: robot.set_mode("auto"), (Command.DO_SET_MODE, 1.0, float(Mode.AUTO))),
        (lambda robot: robot.set_navigator("bug", "left"), (Command.SIDESTEP_SET_NAVIGATOR, 1, 1)),
    ],
)
def test_command_is_one_request_without_the_lease(
    call: Call, wire: tuple[int, float, float]
) -> None:
    stage = Stage()
    assert isinstance(done(stage, call), Accepted)
    (request,) = stage.bus.requests
    assert (request.command, request.param1, request.param2) == wire


@each("attended", [False, True])
def test_goal_of_an_attended_robot_is_only_sent(attended: bool) -> None:
    stage = Stage(attended=attended)
    answer, goal_id = done(stage, lambda robot: robot.send_goal(GOAL, Mode.AUTO))
    (request,) = stage.bus.requests
    assert (answer.ok, request.request_id) == (True, goal_id)


def test_drive_that_another_operator_forbids_begins_nothing() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.set_newest(*HELD)
    with pytest.raises(RefusedError, match="anna"):
        done(stage, lambda robot: robot.drive_to(GOAL))
    assert sent(stage) == ["TAKE"]


def test_drive_that_cannot_be_armed_ends_in_hold() -> None:
    stage = Stage(Reason.NONE, Reason.NONE, Reason.NO_SENSES)
    stage.bus.set_newest(*STANDBY)
    refused = done(stage, lambda robot: robot.drive(0.1, 0.0))
    assert isinstance(refused, Refused)
    arm, mode = "COMPONENT_ARM_DISARM", "DO_SET_MODE"
    assert sent(stage) == ["TAKE", mode, arm, mode, "LEAVE"]
    manual, hold = (one for one in stage.bus.requests if name_of(one) == mode)
    assert (hold.param2, hold.ends_id) == (Mode.HOLD, manual.request_id)


def test_refusal_for_the_lease_names_its_holder() -> None:
    stage = Stage(Reason.LEASE_HELD)
    stage.bus.set_newest(LEASE, lease_of("ben"))
    assert done(stage, lambda robot: robot.arm()).holder == "ben"


def test_stop_that_is_not_known_is_that_of_the_status() -> None:
    stage = Stage(Reason.NEWER_STOP, Reason.NONE)
    stage.bus.set_newest(STATUS, status(Vehicle.EMERGENCY_STOP, stop_id=9))
    assert done(stage, lambda robot: robot.clear_emergency_stop(7, 8)).ok
    assert done(stage, lambda robot: robot.clear_emergency_stop()).ok
    assert [request.stop_id for request in stage.bus.requests] == [7, 8, 9]


def test_robot_without_a_pose_has_no_place_ahead_of_it() -> None:
    stage = Stage()
    with pytest.raises(RemoteError, match="the robot publishes no pose"):
        done(stage, lambda robot: robot.pose())
    assert ODOMETRY.path in stage.bus.boxes


def test_coroutine_that_needs_an_event_loop_is_a_defect() -> None:
    with pytest.raises(RuntimeError, match="waits for an event loop"):
        run_blocking(asyncio.sleep(0))
