"""An operator whose frames come late, or who has been replaced, moves nothing."""

import pytest

from protocol.bus.faults.link_faults import LinkFaults
from protocol.wire.enums import Command, LeaseAction, Mode, Vehicle
from protocol.wire.messages import GoalRequest
from protocol.wire.reasons import Reason
from tests.support.attacks.attacker import answered, attacked, order
from tests.support.harness import Stack
from tests.support.operators import Operator

LOST_S = 1.7
BRAKING_S = 0.4
STILL_M = 1e-4
"""Less than wheels run out after braking."""


def delay(stack: Stack, seconds: float) -> None:
    """From now on whatever operators say reaches the robot so much later."""
    trouble = LinkFaults(delay_ms=1000.0 * seconds, paths=("op/",))
    stack.buses["robot"].faults.disturb(trouble)


def by_hand(stack: Stack, operator: Operator, seconds: float = 1.0) -> None:
    """Beat and steer, ten times a second."""
    for _ in range(round(10 * seconds)):
        operator.beat()
        operator.steer(0.3)
        stack.forward(0.1)


def moved_m(stack: Stack, seconds: float) -> float:
    """How far the robot comes meanwhile."""
    way_m = 0.0
    for _ in range(round(seconds * 20)):
        stack.cycle()
        way_m += abs(stack.truth.speed_m_s) * 0.05
    return way_m


def test_frames_three_seconds_late_drive_nobody_who_has_let_go() -> None:
    """A7: the robot drove until 3.1 s after its operator had let go, and missed it after 4.5 s."""
    with Stack("open") as stack:
        stack.operator = False
        ada = Operator(stack, "ada")
        delay(stack, 3.0)
        by_hand(stack, ada, 4.0)
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        ada.manual()  # may be refused: nobody is there
        by_hand(stack, ada)
        stack.forward(LOST_S)
        assert moved_m(stack, 4.0) < STILL_M


@pytest.mark.parametrize("late_s", [1.0, 3.0])
def test_a_robot_under_way_stops_when_its_operators_frames_begin_to_be_late(late_s: float) -> None:
    """A7: OPERATOR_LOST counts from when a heartbeat was sent, however late it comes."""
    with Stack("open") as stack:
        stack.operator = False
        ada = Operator(stack, "ada")
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert stack.goto_goal() == Reason.NONE
        for _ in range(10):
            ada.beat()
            stack.forward(0.1)
        assert stack.driving()
        delay(stack, late_s)
        for _ in range(10):
            ada.beat()
            stack.forward(0.1)
        lost_s = 1.0 + stack.until(lambda: stack.state == Vehicle.FAILSAFE, within_s=5.0)
        assert lost_s <= LOST_S
        assert stack.why == Reason.OPERATOR_LOST
        stack.forward(BRAKING_S)
        assert moved_m(stack, 5.0) < STILL_M, "what is still on its way sets nothing off"


@pytest.mark.parametrize("late_s", [1.0, 3.0])
def test_steering_that_begins_to_be_late_stops_the_robot_for_good(late_s: float) -> None:
    """A7: a frame's time to live counts from when it was sent."""
    with Stack("open") as stack:
        stack.operator = False
        ada = Operator(stack, "ada")
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert ada.manual() == Reason.NONE
        by_hand(stack, ada)
        assert stack.driving()
        delay(stack, late_s)
        by_hand(stack, ada)
        assert stack.standing()
        assert moved_m(stack, 6.0) < STILL_M


@pytest.mark.parametrize("late_s", [0.05, 0.9])
def test_a_request_is_not_acted_upon_after_its_asker_gave_up(late_s: float) -> None:
    """A7: arm and goto were acted upon 0.9 s after their askers had been told: no answer."""
    with attacked() as (stack, attacker):
        goal = GoalRequest(
            request_id=6, x_mm=3000, y_mm=2000, heading_urad=0, position_tolerance_mm=50,
            heading_tolerance_urad=9999, heading_free=1, mode=Mode.AUTO,
        )  # fmt: skip
        good_ns = stack.clock.now_ns() + 500_000_000
        arm = order(5, Command.COMPONENT_ARM_DISARM, 1.0)
        replies = [attacker.ask(arm, good_ns), attacker.ask(goal, good_ns)]
        stack.clock.advance(round((0.5 + late_s) * 1e9))
        answered(stack, *replies)
        assert [reply.reason for reply in replies] == [Reason.TOO_LATE, Reason.TOO_LATE]
        assert stack.state == Vehicle.STANDBY
        assert moved_m(stack, 1.0) < STILL_M


def test_who_has_lost_the_lease_steers_no_more_not_by_a_frame_already_there() -> None:
    """A12: a frame that had arrived before the seizure was read after it, and drove."""
    with Stack("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        ada.beat()
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert ada.manual() == Reason.NONE
        stack.forward(0.2)
        ada.steer(0.3, ttl_ms=500)
        assert bob.lease(LeaseAction.SEIZE) == Reason.NONE
        bob.beat()
        for _ in range(5):
            ada.steer(0.3, ttl_ms=500)
            assert moved_m(stack, 0.1) < STILL_M
