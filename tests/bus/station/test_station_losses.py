"""Each kind of loss that real peers can cause is reported by name, and so is its end."""

import pytest

from checks.harness.relays import TcpProxy
from ground.station.link.loss import LossKind
from protocol.topics import LEASE_SERVICE, Role
from protocol.wire.enums import AckResult, LeaseAction
from protocol.wire.messages import CommandAck, LeaseRequest
from tests.support.bus.lively import Lively, watching
from tests.support.until import PATIENCE_S

pytestmark = pytest.mark.stack


def test_dead_robot_behind_a_router_is_reported_and_returns() -> None:
    with Lively(router=True) as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("robot")
        seen.until_lost(LossKind.PROCESS_DEAD)
        with stack.halted():
            stack.start("robot")
        seen.until_ready()
        assert seen.kinds() == ["ROBOT DEAD"]
        assert seen.station.restarts(Role.ROBOT) == 1
        assert seen.station.log.find("is back after")


def test_the_robot_that_is_the_hub_itself_is_dead_and_comes_back() -> None:
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("robot")
        seen.until_lost(LossKind.PROCESS_DEAD)
        with stack.halted():
            stack.start("robot")
        seen.until_ready()
        assert seen.kinds() == ["ROBOT DEAD"]


@pytest.mark.parametrize("router", [False, True], ids=["hub", "router"])
def test_stopped_loop_with_a_live_token_is_hung(router: bool) -> None:
    with Lively(router=router) as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        stack.hung = True
        seen.until_lost(LossKind.HUNG)
        assert seen.station.present.has("r1", Role.ROBOT)
        stack.hung = False
        seen.until_ready()
        assert seen.kinds() == ["ROBOT HUNG"]
        assert seen.station.restarts(Role.ROBOT) == 0


def test_hung_loop_differs_from_a_lost_link_without_peers() -> None:
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("plant")
            stack.hung = True
        seen.until_lost(LossKind.HUNG)


def test_a_plant_that_stops_leaves_the_robot_without_senses() -> None:
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        with stack.halted():
            stack.kill("plant")
        seen.until_lost(LossKind.SENSES_STALE)
        loss = seen.station.loss()
        assert loss is not None
        assert "no plant" in loss.cause
        with stack.halted():
            stack.start("plant")
        seen.until_ready()
        assert seen.station.restarts(Role.PLANT) == 1


def test_another_operators_lease_is_a_loss_until_it_is_given_back() -> None:
    with Lively() as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        asked(stack, LeaseAction.TAKE)
        seen.until_lost(LossKind.OTHER_OPERATOR)
        assert seen.station.lease.name == "ben"
        asked(stack, LeaseAction.RELEASE)
        seen.until_ready()
        assert seen.kinds() == ["OTHER OPERATOR"]


def asked(stack: Lively, action: LeaseAction) -> None:
    """Let another operator take the lease or give it back."""
    request = LeaseRequest(request_id=action + 1, action=action, name="ben")
    answer = stack.ground.ask(LEASE_SERVICE, request, PATIENCE_S)
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.ACCEPTED


def test_lost_router_is_reported_and_reconnected() -> None:
    with Lively(router=True) as stack, stack.going(), watching(stack) as seen:
        seen.until_ready()
        endpoint = stack._hub
        with stack.halted():
            stack._scopes["router"].close()
        seen.until_lost(LossKind.ROUTER_GONE)
        with stack.halted():
            stack._hub = endpoint
            stack._open("router", None)
        seen.until_ready()
        assert seen.kinds() == ["ROUTER GONE"]


@pytest.mark.parametrize("router", [False, True], ids=["hub", "router"])
def test_a_cut_cable_is_a_lost_link_and_nothing_else(router: bool) -> None:
    with (
        Lively(router=router) as stack,
        stack.going(),
        TcpProxy(stack._hub) as cable,
        watching(stack, cable.endpoint) as seen,
    ):
        seen.until_ready()
        cable.cut()
        seen.until_lost(LossKind.TRANSPORT)
        cable.restore()
        seen.until_ready()
        assert seen.kinds() == ["LINK LOST"]
        assert seen.station.restarts(Role.ROBOT) == 0
