"""An operator with late frames, or without the lease, moves no wheel."""

from protocol.bus.link_faults import LinkFaults
from protocol.wire.enums import Command, LeaseAction, Mode, Vehicle
from protocol.wire.messages import GoalRequest
from protocol.wire.reasons import Reason
from tests.support.attacks.attacker import answered, attacked, order
from tests.support.each import each
from tests.support.harness import Stack
from tests.support.operators import Operator

LOST_S = 1.7
BRAKING_S = 0.4
STILL_M = 1e-4
"""Less than the braking distance of the wheels."""


def delay(stack: Stack, seconds: float) -> None:
    """Delay all frames of operators from now on."""
    trouble = LinkFaults(delay_ms=1000.0 * seconds, paths=("op/",))
    stack.buses["robot"].faults.disturb(trouble)


def by_hand(stack: Stack, operator: Operator, seconds: float = 1.0) -> None:
    """Send heartbeats and teleop frames ten times a second."""
    for _ in range(round(10 * seconds)):
        operator.beat()
        operator.steer(0.3)
        stack.forward(0.1)


def moved_m(stack: Stack, seconds: float) -> float:
    """Return the distance that the robot moves in this time."""
    way_m = 0.0
    for _ in range(round(seconds * 20)):
        stack.cycle()
        way_m += abs(stack.truth.speed_m_s) * 0.05
    return way_m


def test_frames_three_seconds_late_do_not_move_the_robot() -> None:
    """A7: the robot drove for 3.1 s after its operator's last frame, and missed it after 4.5 s."""
    with Stack("open") as stack:
        stack.operator = False
        ada = Operator(stack, "ada")
        delay(stack, 3.0)
        by_hand(stack, ada, 4.0)
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        ada.manual()  # may be refused: there is no operator
        by_hand(stack, ada)
        stack.forward(LOST_S)
        assert moved_m(stack, 4.0) < STILL_M


@each("late_s", [1.0, 3.0])
def test_driving_robot_stops_when_frames_become_late(late_s: float) -> None:
    """A7: OPERATOR_LOST counts from when a heartbeat was sent, however late it arrives."""
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


@each("late_s", [1.0, 3.0])
def test_late_teleop_frames_stop_the_robot(late_s: float) -> None:
    """A7: the time-to-live of a frame counts from when it was sent."""
    with Stack("open") as stack:
        stack.operator = False
        ada = Operator(stack, "ada")
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        by_hand(stack, ada, 0.1)
        assert ada.manual() == Reason.NONE
        by_hand(stack, ada)
        assert stack.driving()
        delay(stack, late_s)
        by_hand(stack, ada)
        assert stack.standing()
        assert moved_m(stack, 6.0) < STILL_M


@each("late_s", [0.05, 0.9])
def test_request_is_not_acted_on_after_its_timeout(late_s: float) -> None:
    """A7: arm and goto were acted on 0.9 s after their senders had reported no answer."""
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


def test_frames_from_before_losing_the_lease_are_ignored() -> None:
    """A12: a frame from before the seizure was read after it, and moved the robot."""
    with Stack("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        ada.beat()
        stack.forward(0.1)
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert ada.manual() == Reason.NONE
        stack.forward(0.2)
        ada.steer(0.3, ttl_ms=500)
        assert bob.lease(LeaseAction.SEIZE) == Reason.NONE
        bob.beat()
        for _ in range(5):
            ada.steer(0.3, ttl_ms=500)
            assert moved_m(stack, 0.1) < STILL_M
