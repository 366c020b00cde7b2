"""The mission: stop to stop, interruptions, every end, and GUIDED only with heartbeats."""

from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.wire.enums import Command, GoalState, MissionState, Mode, Severity, Vehicle
from protocol.wire.messages import MissionClearAll
from protocol.wire.reasons import Reason
from robot.core import states
from runtime.units import UINT32
from tests.support.each import each
from tests.support.robots import (
    Desk,
    armed,
    circle,
    estop,
    item,
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
    desk = armed()
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
    assert desk.command(Command.SIDESTEP_ABORT_GOAL) == Reason.NOTHING_TO_ABORT


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


OP_LOST_TICKS: Final = 31


def guided(hold_s: float = 5.0, when: MissionState = MissionState.HOLDING) -> Desk:
    """Start a mission with an operator present, and choose GUIDED."""
    desk = ready(3, hold_s=hold_s)
    desk.operator = True
    desk.step()
    assert start(desk) == Reason.NONE
    until(desk, when)
    choose(desk, Mode.GUIDED)
    return desk


def choose(desk: Desk, mode: Mode) -> None:
    assert desk.command(Command.DO_SET_MODE, 1, mode) == Reason.NONE
    assert desk.vehicle.state.machine.mode == mode


def test_without_an_operator_a_guided_mission_never_drives_on() -> None:
    desk = guided()
    for _ in range(10):
        desk.step()
    desk.operator = False
    for tick in range(400):
        outputs = desk.step()
        if tick > OP_LOST_TICKS:
            assert (outputs.left_mrad_s, outputs.right_mrad_s) == (0, 0)
        assert desk.vehicle.state.machine.mode == Mode.GUIDED
    assert state(desk) == (MissionState.FAILED, 0)
    assert desk.vehicle.mission.reason == Reason.OPERATOR_LOST


def test_a_lost_operator_ends_a_guided_mission_that_waits() -> None:
    desk = guided(hold_s=60.0)
    desk.operator = False
    for _ in range(OP_LOST_TICKS + 1):
        desk.step()
    assert state(desk) == (MissionState.FAILED, 0)
    assert desk.vehicle.mission.reason == Reason.OPERATOR_LOST
    assert desk.vehicle.state.machine.vehicle == Vehicle.ACTIVE, "nothing moved: no failsafe"


def test_a_lost_operator_on_the_way_is_a_failsafe() -> None:
    desk = guided(when=MissionState.RUNNING)
    desk.operator = False
    for _ in range(OP_LOST_TICKS + 1):
        desk.step()
    assert desk.vehicle.state.machine.vehicle_reason == Reason.OPERATOR_LOST
    assert desk.vehicle.mission.reason == Reason.OPERATOR_LOST


def test_with_an_operator_a_guided_mission_stays_guided() -> None:
    desk = guided(hold_s=0.2)
    seen = set()
    while desk.vehicle.mission.state != MissionState.DONE:
        desk.step()
        seen.add((desk.vehicle.state.machine.mode, desk.vehicle.mission.current))
        assert desk.now_ns < 60_000_000_000
    assert seen == {(Mode.GUIDED, 0), (Mode.GUIDED, 1), (Mode.GUIDED, 2)}


def test_choosing_auto_again_needs_no_operator() -> None:
    desk = guided(hold_s=0.2)
    choose(desk, Mode.AUTO)
    desk.operator = False
    until(desk, MissionState.DONE, within_s=30.0)
    assert desk.vehicle.state.machine.mode == Mode.AUTO


@each("mode", [Mode.AUTO, Mode.GUIDED])
def test_a_mission_goes_on_after_a_pause_in_the_mode_it_had(mode: Mode) -> None:
    desk = guided(hold_s=0.2)
    choose(desk, mode)
    pause(desk, 1.0)
    assert resume(desk) == Reason.NONE
    desk.step()
    assert desk.vehicle.state.machine.mode == mode
    assert desk.vehicle.mission.active


def test_resuming_a_guided_mission_needs_an_operator() -> None:
    desk = guided()
    pause(desk)
    desk.operator = False
    for _ in range(100):
        desk.step()
    assert state(desk) == (MissionState.PAUSED, 0)
    assert resume(desk) == Reason.NO_OPERATOR
    assert desk.vehicle.state.machine.mode == Mode.HOLD
    choose(desk, Mode.AUTO)
    until(desk, MissionState.DONE, within_s=40.0)


def test_a_jump_keeps_guided() -> None:
    desk = guided()
    assert desk.command(Command.DO_SET_MISSION_CURRENT, 2) == Reason.NONE
    assert desk.vehicle.state.machine.mode == Mode.GUIDED
    assert state(desk) == (MissionState.RUNNING, 2)


def test_a_start_is_auto_whatever_the_mode_was() -> None:
    desk = ready(2)
    desk.operator = True
    desk.step()
    choose(desk, Mode.GUIDED)
    assert start(desk) == Reason.NONE
    assert desk.vehicle.state.machine.mode == Mode.AUTO


RUNS: Final = {Mode.AUTO, Mode.SMART_RTL}
"""Return the modes in which a robot drives without an operator."""

guided_orders = st.one_of(
    st.builds(lambda mode: (Command.DO_SET_MODE, mode), st.sampled_from([*Mode])),
    st.sampled_from(
        [
            (Command.MISSION_START, 0),
            (Command.DO_SET_MISSION_CURRENT, 1),
            (Command.DO_PAUSE_CONTINUE, 0),
            (Command.DO_PAUSE_CONTINUE, 1),
            (Command.COMPONENT_ARM_DISARM, 0),
            (Command.COMPONENT_ARM_DISARM, 1),
            (Command.SIDESTEP_ABORT_GOAL, 0),
            (Command.NAV_RETURN_TO_LAUNCH, 0),
        ]
    ),
    st.sampled_from(["come", "go", "goto AUTO", "goto GUIDED"]),
)


def obey_guided(desk: Desk, order: object) -> None:
    if isinstance(order, tuple):
        command, value = order
        desk.command(command, value, value)
    elif order == "come":
        desk.operator = True
    elif order == "go":
        desk.operator = False
    else:
        desk.goto(0.3, 0.1, Mode[str(order).split()[1]])


@settings(max_examples=150, deadline=None)
@given(st.lists(st.tuples(guided_orders, st.integers(0, 40)), min_size=3, max_size=20))
def test_only_a_command_leaves_guided(
    steps: list[tuple[object, int]],
) -> None:
    """Only a command enters a mode without an operator; without one GUIDED stops."""
    desk = ready(3, hold_s=0.4)
    machine = desk.vehicle.state.machine
    for order, ticks in steps:
        obey_guided(desk, order)
        for _ in range(ticks):
            mode = machine.mode
            outputs = desk.step()
            assert machine.mode == mode, "no tick changes the mode"
            if machine.mode not in RUNS and not machine.operator:
                assert (outputs.left_mrad_s, outputs.right_mrad_s) == (0, 0) or slows(desk)


def slows(desk: Desk) -> bool:
    """Return whether the robot may still decelerate to a stop, in HOLD or idle GUIDED."""
    machine = desk.vehicle.state.machine
    return machine.mode == Mode.HOLD or (
        machine.mode == Mode.GUIDED and not desk.vehicle.mission.active and not living(desk)
    )


def living(desk: Desk) -> bool:
    return 1 <= desk.vehicle.state.machine.goal_state <= 4
