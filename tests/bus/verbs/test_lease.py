"""Two operators and one robot, over the whole stack: only the lease holder commands."""

from protocol.topics import LEASE, PARAMETER
from protocol.wire.enums import Command, LeaseAction, Mode, Vehicle
from protocol.wire.messages import GoalRequest, LeaseStatus, ParamSet
from protocol.wire.reasons import Reason
from tests.support.harness import Stack, reason_in
from tests.support.operators import Operator, stops

GOAL = GoalRequest(
    request_id=5,
    x_mm=2000,
    y_mm=1000,
    heading_urad=0,
    position_tolerance_mm=50,
    heading_tolerance_urad=52_360,
    heading_free=1,
    mode=Mode.AUTO,
)
ZONE = ParamSet(param_id="d_obs_m", param_value=0.4, param_type=9)


def test_operator_without_the_lease_may_only_stop() -> None:
    with Stack("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert bob.lease(LeaseAction.TAKE) == Reason.LEASE_HELD
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        assert bob.command(Command.DO_PAUSE_CONTINUE, 1) == Reason.LEASE_HELD
        assert reason_in(bob.ask(GOAL)) == Reason.LEASE_HELD
        assert reason_in(bob.ask(ZONE, PARAMETER)) == Reason.LEASE_HELD
        assert bob.upload(stops((1.0, 1.0))).reason == Reason.LEASE_HELD
        assert stack.arm() == Reason.LEASE_HELD, "nor the operator who was there before"
        assert reason_in(ada.ask(GOAL)) == Reason.NONE
        stack.until(stack.driving, within_s=3.0)
        assert bob.command(Command.DO_PAUSE_CONTINUE) == Reason.NONE
        stack.until(stack.standing, within_s=1.0)
        assert ada.command(Command.DO_PAUSE_CONTINUE, 1) == Reason.NONE
        stack.until(stack.driving, within_s=3.0)
        assert bob.command(Command.DO_FLIGHTTERMINATION) == Reason.NONE
        assert stack.state == Vehicle.EMERGENCY_STOP
        stack.until(stack.standing, within_s=1.0)


def test_it_lapses_three_seconds_after_its_holder_has_fallen_silent() -> None:
    with Stack("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        assert ada.lease(LeaseAction.TAKE) == Reason.NONE
        for _ in range(10):
            ada.beat()
            bob.beat()
            stack.forward(0.5)
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        ada.beat()
        for _ in range(5):
            bob.beat()
            stack.forward(0.5)
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        stack.forward(0.6)
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        assert any("lapsed" in text for text in stack.texts)


def test_seized_lease_is_published_and_allows_commands() -> None:
    with Stack("open") as stack:
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        box = stack.ground.mailbox(LEASE)
        ada.lease(LeaseAction.TAKE)
        assert bob.lease(LeaseAction.SEIZE) == Reason.NONE
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.LEASE_HELD
        assert bob.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE
        stack.until(lambda: named(box.latest()) == "bob", within_s=2.0)
        assert any("LEASE SEIZED by bob from ada" in text for text in stack.texts)
        assert bob.lease(LeaseAction.RELEASE) == Reason.NONE
        stack.until(lambda: named(box.latest()) == "", within_s=2.0)
        assert ada.command(Command.COMPONENT_ARM_DISARM, 1) == Reason.NONE


def named(newest: tuple[LeaseStatus, int] | None) -> str | None:
    return None if newest is None else newest[0].name


def test_only_the_heartbeat_of_the_holder_keeps_guided() -> None:
    with Stack("open") as stack:
        stack.operator = False
        ada, bob = Operator(stack, "ada"), Operator(stack, "bob")
        ada.lease(LeaseAction.TAKE)
        ada.beat()
        stack.forward(0.1)
        ada.command(Command.COMPONENT_ARM_DISARM, 1)
        assert ada.command(Command.DO_SET_MODE, 1, Mode.MANUAL) == Reason.NONE
        for _ in range(10):
            bob.beat()
            stack.forward(0.2)
        assert stack.why == Reason.OPERATOR_LOST
