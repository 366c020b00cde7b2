"""A MAVLink client stops the robot of another operator, and moves it by no command."""

from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

from gateways.mavlink.mavlink_dialect import RESULT_NOT_IN_CONTROL, mavlink
from ground.client.connection import Common
from ground.client.goal import Destination
from ground.client.link import Link
from ground.client.operations.commands import Arm
from ground.client.operations.goals import Goto
from ground.client.operations.leases import ChangeLease
from ground.client.operations.session import Operation, Session
from protocol.bus.bus import open_bus
from protocol.topics import Role
from protocol.wire.enums import LeaseAction, Mode
from protocol.wire.enums import Vehicle as VehicleState
from runtime.clock import WallClock
from tests.closed_loop.test_gateway_killed import Gateway, goto, stack_with_gateway
from tests.closed_loop.test_gateway_mission import is_over
from tests.support.each import each
from tests.support.gateway.messages import words
from tests.support.harness import Stack
from tests.support.until import until

ARM, SET_MODE, PAUSE, START, RTL, CONTROL = 400, 176, 193, 300, 20, 32100
ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
FAR = Destination(x_m=6.0, y_m=2.0, heading_rad=None)
IN_TIME_NS = 100_000_000


@contextmanager
def app(stack: Stack, person: str) -> Iterator[Callable[[Operation[Any]], None]]:
    """Return what performs the operations of another person, who has the lease."""
    network = replace(stack.client_network, person=person)
    with open_bus(network, Role.GROUND, "r1") as bus, ThreadPoolExecutor(1) as pool:
        session = Session(
            Link(bus, Common(network=network, robot="r1"), WallClock()), attended=True
        )

        def perform(operation: Operation[Any]) -> None:
            answer = pool.submit(operation.perform, session)
            until(partial(is_over, stack, answer))
            assert answer.result().ok, answer.result().text

        perform(ChangeLease(action=LeaseAction.TAKE, name=person))
        yield perform


def is_at_rest(stack: Stack) -> bool:
    machine = stack.vehicle.state.machine
    return machine.mode == Mode.HOLD or machine.vehicle == VehicleState.STANDBY


@each("stop", [(SET_MODE, 1, Mode.HOLD), (PAUSE, 0), (ARM, 0), (ARM, 0, 21196)])
def test_client_without_control_stops_the_robot_in_time(stop: tuple[float, ...]) -> None:
    with stack_with_gateway() as (stack, gateway), app(stack, "ada") as ada:
        ada(Arm())
        ada(Goto(goal=FAR, wait=False))
        stack.until(gateway.drives)
        began_ns = stack.clock.now_ns()
        number, *params = stop
        assert gateway.command(int(number), *params) == ACCEPTED
        assert stack.clock.now_ns() - began_ns <= IN_TIME_NS
        stack.until(partial(is_at_rest, stack))
        stack.until(stack.standing)
        assert gateway.face.vehicle.control.owner is None, "it has stopped, and taken nothing"
        assert stack.vehicle.lease.holder is not None
        assert stack.vehicle.lease.holder.name == "ada"


def test_client_without_control_moves_nothing() -> None:
    with stack_with_gateway() as (stack, gateway), app(stack, "ada") as ada:
        ada(Arm())
        gateway.lives(0.2)
        moves = (ARM, 1), (SET_MODE, 1, Mode.MANUAL), (SET_MODE, 1, Mode.AUTO), (START,), (RTL,)
        for number, *params in (*moves, (PAUSE, 1), (178, 1, 0.5, -1)):
            assert gateway.command(number, *params) == RESULT_NOT_IN_CONTROL
            assert "another operator commands the robot" in words(gateway.sent)
            gateway.lives(1.1)
        assert goto(gateway) == RESULT_NOT_IN_CONTROL
        assert gateway.command(CONTROL, 1, 0, 10) == mavlink.MAV_RESULT_FAILED
        assert stack.standing()


def test_gateway_after_a_restart_commands_at_once() -> None:
    """It is the same person, so the lease of the one before is its own."""
    with stack_with_gateway() as (stack, gateway):
        assert gateway.command(ARM, 1) == ACCEPTED
        newer = Gateway(stack)
        stack.until(newer.is_live)
        assert newer.command(ARM, 1) == ACCEPTED
        assert newer.command(SET_MODE, 1, Mode.GUIDED) == ACCEPTED
        assert goto(newer) == ACCEPTED
        stack.until(newer.drives)
        newer.port.close()
