"""Teleop over the whole stack: silence and operators without the lease stop the robot."""

from protocol.wire.enums import Command, LeaseAction, Mode, Vehicle
from protocol.wire.reasons import Reason
from tests.support.each import each
from tests.support.harness import STOPPING_S, Stack
from tests.support.operators import Operator

PERIOD_S = 0.05


def by_hand(stack: Stack) -> Operator:
    """Return an armed robot in MANUAL, driven straight ahead at full speed."""
    operator = Operator(stack, "ada")
    stack.arm()
    operator.beat()
    stack.forward(PERIOD_S)
    assert operator.manual() == Reason.NONE
    for _ in range(10):
        operator.beat()
        operator.steer(0.3)
        stack.forward(0.1)
    assert stack.driving()
    return operator


def told_to_stand(stack: Stack) -> bool:
    return stack.vehicle.state.twist == (0.0, 0.0)


@each("ttl_ms", [100, 300, 500])
def test_robot_stops_soon_after_the_last_frame(ttl_ms: int) -> None:
    with Stack("open") as stack:
        operator = by_hand(stack)
        operator.steer(0.3, ttl_ms=ttl_ms)
        told_s = stack.until(lambda: told_to_stand(stack), within_s=2.0)
        assert told_s <= ttl_ms / 1000 + 2 * PERIOD_S + 1e-9
        assert told_s >= ttl_ms / 1000, "not before its time"
        assert stack.until(stack.standing, within_s=2.0) <= STOPPING_S
        assert stack.state == Vehicle.ACTIVE, "the next frame may drive on"
        operator.beat()
        operator.steer(0.0, 0.5)
        stack.forward(0.2)
        assert stack.truth.yaw_rate_rad_s > 0.1


def test_lost_operator_stops_the_robot() -> None:
    with Stack("open") as stack:
        by_hand(stack)
        stack.kill("ground")
        assert stack.until(lambda: told_to_stand(stack), within_s=2.0) <= 0.3 + 2 * PERIOD_S


def test_frame_with_too_long_ttl_is_ignored_and_announced() -> None:
    with Stack("open") as stack:
        operator = Operator(stack, "ada")
        stack.arm()
        operator.manual()
        for _ in range(5):
            operator.steer(0.3, ttl_ms=501)
            stack.forward(0.1)
        assert stack.standing()
        stack.until(lambda: any("teleop ignored" in text for text in stack.texts), within_s=2.0)


def test_frames_drive_in_manual_only() -> None:
    with Stack("open") as stack:
        operator = Operator(stack, "ada")
        stack.arm()
        for _ in range(5):
            operator.steer(0.3)
            stack.forward(0.1)
        assert stack.standing()


def test_only_the_holder_of_the_lease_steers() -> None:
    with Stack("open") as stack:
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        ada.beat()
        stack.forward(0.1)
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert bob.manual() == Reason.LEASE_HELD
        assert ada.manual() == Reason.NONE
        for _ in range(5):
            bob.steer(0.3)
            stack.forward(0.1)
        assert stack.standing()
        for _ in range(5):
            ada.beat()
            ada.steer(0.3)
            bob.steer(-0.3)
            stack.forward(0.1)
        assert stack.driving()
        assert stack.status.mode == Mode.MANUAL


def test_teleop_does_not_hit_a_wall() -> None:
    with Stack("box") as stack:
        operator = Operator(stack, "ada")
        stack.arm()
        operator.manual()
        for _ in range(300):
            operator.steer(0.3)
            stack.forward(0.1)
        assert stack.standing()
        assert stack.truth.clearance_m > 0.0
        assert stack.truth.contact == 0
