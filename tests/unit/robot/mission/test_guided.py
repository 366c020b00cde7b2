"""A mission in GUIDED continues only while an operator sends heartbeats."""

from typing import Final

from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.wire.enums import Command, MissionState, Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.robot.mission.items import pause, ready, resume, start, state, until
from tests.support.robot.vehicles import Desk

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

orders = st.one_of(
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


def obey(desk: Desk, order: object) -> None:
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
@given(st.lists(st.tuples(orders, st.integers(0, 40)), min_size=3, max_size=20))
def test_only_a_command_leaves_guided(
    steps: list[tuple[object, int]],
) -> None:
    """Only a command enters a mode without an operator; without one GUIDED stops."""
    desk = ready(3, hold_s=0.4)
    machine = desk.vehicle.state.machine
    for order, ticks in steps:
        obey(desk, order)
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
