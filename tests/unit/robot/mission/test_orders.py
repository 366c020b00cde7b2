"""Interrupted missions: every cause of their end, and any order of messages."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.wire.enums import Command, GoalState, MissionState, Mode, Vehicle
from protocol.wire.messages import MissionClearAll
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.robot.mission.items import (
    circle,
    estop,
    item,
    pause,
    ready,
    start,
    until,
    upload,
)
from tests.support.robot.vehicles import Desk


def disarm(desk: Desk) -> None:
    desk.command(Command.COMPONENT_ARM_DISARM, 0)


def another_goal(desk: Desk) -> None:
    desk.goto(5.0, 0.0)


def home(desk: Desk) -> None:
    assert desk.command(Command.NAV_RETURN_TO_LAUNCH) == Reason.NONE


def by_hand(desk: Desk) -> None:
    desk.operator = True
    desk.step()
    assert desk.command(Command.DO_SET_MODE, 1, Mode.MANUAL) == Reason.NONE


def blind(desk: Desk) -> None:
    desk.step(scan=None)


ENDS = [
    (estop, Reason.BY_EMERGENCY_STOP),
    (disarm, Reason.DISARMED),
    (another_goal, Reason.REPLACED),
    (home, Reason.REPLACED),
    (by_hand, Reason.BY_HAND),
    (blind, Reason.SCAN_LOST),
]


@each(("end", "reason"), ENDS)
@each("when", [MissionState.RUNNING, MissionState.HOLDING, MissionState.PAUSED])
def test_cause_of_the_end_is_the_failure_reason(
    end: Any, reason: Reason, when: MissionState
) -> None:
    desk = ready(2, hold_s=5.0)
    start(desk)
    if when == MissionState.PAUSED:
        desk.step()
        pause(desk)
    until(desk, when)
    end(desk)
    desk.step()
    assert desk.vehicle.mission.state == MissionState.FAILED
    assert desk.vehicle.mission.reason == reason


orders = st.one_of(
    st.builds(lambda first: (Command.MISSION_START, first), st.integers(-1, 4)),
    st.builds(lambda at: (Command.DO_SET_MISSION_CURRENT, at), st.integers(0, 4)),
    st.builds(lambda on: (Command.DO_PAUSE_CONTINUE, on), st.integers(0, 1)),
    st.builds(lambda on: (Command.COMPONENT_ARM_DISARM, on), st.integers(0, 1)),
    st.sampled_from(
        [
            (Command.SIDESTEP_ABORT_GOAL, 0),
            (Command.DO_FLIGHTTERMINATION, 0),
            (Command.SIDESTEP_CLEAR_EMERGENCY_STOP, 0),
            (Command.NAV_RETURN_TO_LAUNCH, 0),
        ]
    ),
    st.builds(lambda mode: (Command.DO_SET_MODE, mode), st.sampled_from([*Mode])),
    st.sampled_from(["upload", "fence", "clear", "goto", "blind"]),
)


def obey(desk: Desk, order: Any) -> None:
    if order == "upload":
        upload(desk, [item(0, 0.2, 0.0, 0.1), item(1, 0.3, 0.1), item(2, 0.5, 0.0)])
    elif order == "fence":
        upload(desk, circle(0.0, 0.0, 0.4))
    elif order == "clear":
        desk.vehicle.receive(MissionClearAll(), desk.now_ns)
    elif order == "goto":
        desk.goto(0.3, -0.1)
    elif order == "blind":
        desk.step(scan=None)
    else:
        command, value = order
        desk.command(command, value, value)


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(orders, st.integers(0, 30)), min_size=3, max_size=25))
def test_any_order_of_messages_keeps_the_status_consistent(
    steps: list[tuple[Any, int]],
) -> None:
    desk = ready(3, hold_s=0.2)
    desk.operator = True
    machine, mission = desk.vehicle.state.machine, desk.vehicle.mission
    for order, ticks in steps:
        obey(desk, order)
        for _ in range(ticks):
            desk.vehicle.mission.step(desk.now_ns // 1_000_000)
            check(desk)
            desk.step()
        assert mission.state == MissionState.NONE or 0 <= mission.current < len(mission.items)
    assert machine.vehicle in [*Vehicle]


def check(desk: Desk) -> None:
    """Check what must hold after the mission's step."""
    machine, mission = desk.vehicle.state.machine, desk.vehicle.mission
    status = mission.status(0)
    if mission.active:
        assert machine.vehicle == Vehicle.ACTIVE
        assert (status.state == MissionState.PAUSED) == (machine.mode == Mode.HOLD)
    if status.state in (MissionState.RUNNING, MissionState.HOLDING):
        assert machine.goal is not None
        wanted = mission.items[mission.current]
        assert machine.goal.x_m == pytest.approx(wanted.x / 10_000)
    if status.state == MissionState.HOLDING:
        assert machine.goal_state == GoalState.REACHED
        assert status.hold_left_ms > 0
    if status.state == MissionState.FAILED:
        assert status.reason != Reason.NONE
