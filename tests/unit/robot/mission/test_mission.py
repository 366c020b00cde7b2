"""The mission: driving from stop to stop, pause, abort, jump, and other events in between."""

import pytest

from protocol.wire.enums import Command, GoalState, MissionState, Mode, Severity
from protocol.wire.reasons import Reason
from robot.core import states
from runtime.units import UINT32
from tests.support.each import each
from tests.support.robot.mission.items import (
    circle,
    line,
    pause,
    ready,
    resume,
    start,
    state,
    until,
    upload,
    x_m,
)
from tests.support.robot.vehicles import Desk


def test_a_mission_goes_from_stop_to_stop_without_an_operator() -> None:
    desk = ready(3)
    assert state(desk) == (MissionState.READY, 0)
    assert start(desk) == Reason.NONE
    seen = set()
    while desk.vehicle.mission.state != MissionState.DONE:
        desk.step()
        seen.add(desk.vehicle.mission.current)
        assert len(seen) <= 3
    assert seen == {0, 1, 2}
    assert x_m(desk) == pytest.approx(0.9, abs=0.06)
    assert desk.vehicle.state.machine.mode == Mode.AUTO


def test_it_waits_at_each_stop_for_its_hold_time() -> None:
    desk = ready(2, hold_s=1.5)
    start(desk)
    until(desk, MissionState.HOLDING)
    status = desk.vehicle.mission.status(9)
    assert (status.current, status.count, status.hold_left_ms) == (0, 2, 1500)
    at_m = x_m(desk)
    assert until(desk, MissionState.RUNNING) == pytest.approx(1.5)
    assert x_m(desk) == pytest.approx(at_m, abs=0.005)
    assert desk.vehicle.mission.status(9).hold_left_ms == 0
    until(desk, MissionState.HOLDING)
    assert until(desk, MissionState.DONE) == pytest.approx(1.5)


def test_a_mission_can_begin_at_any_of_its_items() -> None:
    desk = ready(3)
    assert start(desk, 2) == Reason.NONE
    assert state(desk) == (MissionState.RUNNING, 2)
    until(desk, MissionState.DONE)


@each("first", [3, 99, -2])
def test_start_and_jump_refuse_a_missing_item(first: int) -> None:
    desk = ready(3)
    assert start(desk, first) == Reason.MISSION_ITEM_BAD
    assert desk.command(Command.DO_SET_MISSION_CURRENT, first) == Reason.MISSION_ITEM_BAD


def test_start_and_jump_refuse_a_missing_mission() -> None:
    desk = Desk()
    desk.arm()
    assert start(desk) == Reason.NO_MISSION
    assert desk.command(Command.DO_SET_MISSION_CURRENT, 0) == Reason.NO_MISSION


def test_the_number_of_a_mission_fits_its_field_and_is_never_0() -> None:
    desk = ready(2)
    desk.vehicle.mission.number = UINT32
    desk.vehicle.mission.clear()
    upload(desk, line(2))
    assert desk.vehicle.mission.number == 1


def test_a_start_that_is_refused_changes_nothing() -> None:
    desk = Desk()
    desk.step()
    upload(desk, line(2))
    assert start(desk) == Reason.NOT_ARMED
    assert state(desk) == (MissionState.READY, 0)


def test_a_pause_keeps_the_place_in_the_mission() -> None:
    desk = ready(3)
    start(desk)
    desk.step()
    pause(desk, 2.0)
    assert state(desk) == (MissionState.PAUSED, 0)
    assert desk.vehicle.mission.status(0).reason == Reason.BY_OPERATOR
    at_m = x_m(desk)
    for _ in range(40):
        desk.step()
    assert x_m(desk) == at_m
    assert resume(desk) == Reason.NONE
    desk.step()
    assert state(desk) == (MissionState.RUNNING, 0)
    until(desk, MissionState.DONE)


def test_a_pause_stops_the_clock_of_a_hold() -> None:
    desk = ready(1, hold_s=2.0)
    start(desk)
    until(desk, MissionState.HOLDING)
    for _ in range(20):
        desk.step()
    pause(desk, 5.0)
    assert desk.vehicle.mission.state == MissionState.PAUSED
    assert resume(desk) == Reason.NONE
    assert until(desk, MissionState.DONE) == pytest.approx(1.0, abs=0.051)


def test_aborted_mission_can_start_where_it_was() -> None:
    desk = ready(3)
    start(desk, 1)
    desk.step()
    assert desk.command(Command.SIDESTEP_ABORT_GOAL) == Reason.NONE
    assert state(desk) == (MissionState.FAILED, 1)
    assert desk.vehicle.mission.reason == Reason.BY_OPERATOR
    assert desk.vehicle.state.machine.goal_state == GoalState.ABORTED
    for _ in range(20):
        desk.step()
    assert start(desk, -1) == Reason.NONE
    assert state(desk) == (MissionState.RUNNING, 1)


def test_a_hold_can_be_aborted_too() -> None:
    desk = ready(2, hold_s=5.0)
    start(desk)
    until(desk, MissionState.HOLDING)
    assert desk.command(Command.SIDESTEP_ABORT_GOAL) == Reason.NONE
    assert state(desk) == (MissionState.FAILED, 0)
    assert desk.command(Command.SIDESTEP_ABORT_GOAL) == Reason.NO_GOAL


def test_a_jump_under_way_goes_there_at_once() -> None:
    desk = ready(3)
    start(desk)
    desk.step()
    assert desk.command(Command.DO_SET_MISSION_CURRENT, 2) == Reason.NONE
    desk.step()
    assert state(desk) == (MissionState.RUNNING, 2)
    until(desk, MissionState.DONE)


def test_jump_in_a_pause_counts_on_resume() -> None:
    desk = ready(3)
    start(desk)
    desk.step()
    pause(desk)
    assert desk.command(Command.DO_SET_MISSION_CURRENT, 2) == Reason.NONE
    desk.step()
    assert state(desk) == (MissionState.PAUSED, 2)
    assert resume(desk) == Reason.NONE
    desk.step()
    assert state(desk) == (MissionState.RUNNING, 2)
    until(desk, MissionState.DONE)


def test_jump_while_inactive_sets_the_next_start() -> None:
    desk = ready(3)
    assert desk.command(Command.DO_SET_MISSION_CURRENT, 1) == Reason.NONE
    assert state(desk) == (MissionState.READY, 1)
    start(desk, -1)
    assert state(desk) == (MissionState.RUNNING, 1)


def test_unreachable_stop_fails_the_mission_with_its_reason() -> None:
    desk = ready(2)
    start(desk)
    desk.step()
    machine = desk.vehicle.state.machine
    machine.goal_state, machine.goal_reason = states.STUCK, Reason.UNREACHABLE
    desk.step()
    assert state(desk) == (MissionState.FAILED, 0)
    assert desk.vehicle.mission.reason == Reason.UNREACHABLE


def test_stop_outside_a_new_fence_fails_at_its_turn() -> None:
    desk = ready(4)
    start(desk)
    desk.step()
    assert upload(desk, circle(0.0, 0.0, 0.7)).reason == Reason.NONE
    until(desk, MissionState.FAILED)
    assert state(desk) == (MissionState.FAILED, 2)
    assert desk.vehicle.mission.reason == Reason.OUTSIDE_FENCE


def test_goals_have_the_id_of_the_start_request() -> None:
    desk = ready(2)
    desk.goto(0.1, 0.0)
    start(desk)
    started = desk.request_id
    assert desk.vehicle.commands.goal_id == started
    until(desk, MissionState.DONE)
    assert desk.vehicle.commands.goal_id == started
    desk.command(Command.NAV_RETURN_TO_LAUNCH)
    assert desk.vehicle.commands.goal_id == desk.request_id


def test_status_shows_the_progress() -> None:
    desk = ready(2)
    start(desk)
    until(desk, MissionState.DONE)
    published = [(text.severity, text.text) for text in desk.vehicle.texts()]
    assert (Severity.INFO, "mission DONE (item 2 of 2)") in published
    start(desk)
    desk.step()
    desk.step(scan=None)
    desk.step()
    published = [
        (text.severity, text.text) for text in desk.vehicle.texts() if "FAILED" in text.text
    ]
    assert published[0][0] == Severity.ERROR


@each(
    ("command", "words"),
    [
        (Command.DO_FLIGHTTERMINATION, " by the emergency stop"),
        (Command.COMPONENT_ARM_DISARM, ": disarmed by the operator"),
        (Command.SIDESTEP_ABORT_GOAL, ": by the operator"),
    ],
)
def test_mission_that_an_operator_stops_is_aborted(command: Command, words: str) -> None:
    desk = ready(2)
    start(desk)
    desk.step()
    desk.command(command)
    desk.step()
    assert f"mission aborted{words} (item 1 of 2)" in "".join(
        text.text for text in desk.vehicle.texts()
    )


def test_mission_status_is_sent_twice_a_second_and_on_change() -> None:
    desk = ready(2)
    published = []
    for _ in range(41):
        desk.step()
        published.append(desk.vehicle.mission_status(desk.now_ns, desk.now_ns) is not None)
    assert sum(published) == 5
    start(desk)
    status = desk.vehicle.mission_status(desk.now_ns, desk.now_ns)
    assert status is not None
    assert (status.mission_id, status.state, status.count) == (1, MissionState.RUNNING, 2)
