"""A robot with an unreadable fence is armed only after the fence is replaced or removed."""

from collections.abc import Callable

import pytest

from robot.core import modes, reasons, states
from robot.core.modes import Machine
from robot.core.safety import failsafe
from robot.core.safety.fence import Fence
from robot.core.values import Pose
from tests.support.each import each
from tests.support.robot.core.driving import Driven, armed

HERE = Pose(0.0, 0.0, 0.0)
AROUND = Fence((0.0,), (0.0,), 2.0)
ELSEWHERE = Fence((9.0,), (0.0,), 2.0)


def shown(machine: Machine) -> tuple[int, int]:
    return machine.vehicle, machine.vehicle_reason


@pytest.fixture
def machine() -> Machine:
    """Return a machine in STANDBY that has lost its saved fence."""
    driven = Driven()
    modes.lose_fence(driven.machine)
    assert shown(driven.machine) == (states.BOOT, reasons.FENCE_UNREADABLE)
    driven.tick()
    return driven.machine


def test_robot_has_its_fence_at_birth() -> None:
    driven = Driven()
    driven.tick()
    assert modes.arm(driven.machine) == reasons.OK
    assert driven.machine.vehicle_reason == reasons.OK


def test_lost_fence_forbids_arming_and_is_shown(machine: Machine) -> None:
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)


@pytest.mark.parametrize("fence", [AROUND, None], ids=["another", "none"])
def test_lost_fence_is_forgotten_with_another_or_none(
    machine: Machine, fence: Fence | None
) -> None:
    assert modes.set_fence(machine, fence, HERE) == reasons.OK
    assert shown(machine) == (states.STANDBY, reasons.OK)
    assert modes.arm(machine) == reasons.OK
    modes.disarm(machine, 0)
    assert shown(machine) == (states.STANDBY, reasons.OK)


def test_refused_fence_does_not_replace_the_lost_one(machine: Machine) -> None:
    assert modes.set_fence(machine, ELSEWHERE, HERE) == reasons.FENCE_LEAVES_ROBOT_OUT
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)


def clear(machine: Machine) -> None:
    modes.estop(machine, 0)
    assert shown(machine) == (states.EMERGENCY_STOP, reasons.BY_OPERATOR)
    modes.clear_estop(machine)


def trip_and_disarm(machine: Machine) -> None:
    failsafe.trip(machine, reasons.BUMPER, 0)
    assert shown(machine) == (states.FAILSAFE, reasons.BUMPER)
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE
    modes.disarm(machine, 0)


@pytest.mark.parametrize("change", [clear, trip_and_disarm])
def test_lost_fence_outlasts_stops(machine: Machine, change: Callable[[Machine], None]) -> None:
    change(machine)
    assert shown(machine) == (states.STANDBY, reasons.FENCE_UNREADABLE)
    assert modes.arm(machine) == reasons.FENCE_UNREADABLE


@each("fence", [AROUND, None])
def test_fence_leaves_the_reason_of_a_stop_alone(fence: Fence | None) -> None:
    machine = armed().machine
    failsafe.trip(machine, reasons.BUMPER, 0)
    assert modes.set_fence(machine, fence, HERE) == reasons.OK
    assert shown(machine) == (states.FAILSAFE, reasons.BUMPER)


def test_fence_leaves_an_emergency_stop_alone(machine: Machine) -> None:
    modes.estop(machine, 0)
    assert modes.set_fence(machine, None, HERE) == reasons.OK
    assert shown(machine) == (states.EMERGENCY_STOP, reasons.BY_OPERATOR)
    modes.clear_estop(machine)
    assert shown(machine) == (states.STANDBY, reasons.OK)
