"""Every row of the failsafe table, over the whole stack: the robot stops, says why, and when."""

from dataclasses import dataclass

import pytest

from protocol.enums import GoalState, Mode, Vehicle
from protocol.reasons import Reason
from tests.harness import Stack

STOPPING_S = 0.40
"""From the failsafe to a standing robot: braking from 0.3 m/s and the lag of the motors."""


@dataclass(frozen=True)
class Row:
    """A fault, what the robot must call it, and when it must have noticed."""

    kind: str
    target: str
    value: float
    reason: Reason
    limit_s: float


ROWS = [
    Row("ticks_stopped", "", 0.0, Reason.TICKS_LOST, 0.25),
    Row("scan_stopped", "", 0.0, Reason.SCAN_LOST, 0.35),
    Row("encoder_stuck", "both", 0.0, Reason.WHEEL_STUCK, 1.05),
    Row("encoder_stuck", "left", 0.0, Reason.WHEEL_STUCK, 1.05),
    Row("encoder_jump", "left", 50_000.0, Reason.ENCODER_IMPOSSIBLE, 0.10),
    Row("wheel_stuck", "both", 0.0, Reason.WHEEL_STUCK, 1.05),
    Row("sonar_frozen", "all", 0.0, Reason.SONAR_FROZEN, 2.0),
    Row("sonar_fixed", "3", 9.0, Reason.SONAR_IMPOSSIBLE, 0.10),
    Row("bumper_stuck", "", 1.0, Reason.BUMPER, 0.10),
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.kind}-{row.target or 'all'}")
def test_the_robot_stops_and_says_why(row: Row) -> None:
    with Stack("corridor", noise="default") as stack:
        stack.forward(1.0)
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        stack.forward(0.5)
        stack.inject(row.kind, row.target, row.value)
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=5.0)
        assert stack.why == row.reason
        assert noticed_s <= row.limit_s + 1e-9
        assert stack.goal_state == GoalState.ABORTED
        stack.forward(STOPPING_S)
        assert stack.standing()
        stack.forward(0.1)
        assert stack.status.vehicle_reason == row.reason


def test_a_failsafe_holds_until_its_cause_is_gone_and_the_operator_arms_again() -> None:
    with Stack("open") as stack:
        stack.arm()
        stack.goto_goal()
        stack.until(stack.driving)
        stack.inject("scan_stopped")
        stack.until(lambda: stack.state == Vehicle.FAILSAFE)
        assert stack.arm() in (Reason.SCAN_LOST, Reason.NO_SENSES)
        stack.clear_faults()
        stack.forward(1.0)
        assert stack.state == Vehicle.FAILSAFE
        assert stack.standing()
        assert stack.arm() == Reason.NONE
        stack.goto_goal()
        stack.until(stack.reached)


def test_guided_stops_without_its_operator_and_auto_goes_on() -> None:
    with Stack("open") as stack:
        stack.arm()
        stack.goto_goal(Mode.GUIDED)
        stack.until(stack.driving)
        stack.operator = False
        noticed_s = stack.until(lambda: stack.state == Vehicle.FAILSAFE)
        assert stack.why == Reason.OPERATOR_LOST
        assert 1.3 <= noticed_s <= 1.65
        stack.operator = True
        stack.forward(0.5)
        stack.arm()
        stack.goto_goal(Mode.AUTO)
        stack.operator = False
        stack.until(stack.reached)


def test_noise_without_a_fault_trips_nothing() -> None:
    with Stack("corridor", noise="harsh", navigator="bug") as stack:
        stack.arm()
        stack.goto_goal()
        stack.forward(20.0)
        assert stack.state in (Vehicle.ACTIVE, Vehicle.FAILSAFE)
        assert stack.why in (Reason.NONE, Reason.BUMPER)
