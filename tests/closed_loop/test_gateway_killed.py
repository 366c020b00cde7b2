"""The gateway dies in a drive, or the robot falls silent: what robot and clients do then.

GUIDED ends as at the loss of any operator, and a mission goes on.
"""

import re
from collections.abc import Iterator
from contextlib import contextmanager

from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from gateways.mavlink.services import face_of
from ground.client.link import ALIVE
from protocol.topics import Role
from protocol.wire.enums import GoalState, MissionState
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.reasons import Reason
from robot.lease import LAPSE_S
from tests.closed_loop.test_gateway_mission import PLAN, link_of
from tests.support.gateway.fake_port import CLIENT, ORIGIN
from tests.support.gateway.messages import acks, command, words
from tests.support.gateway.mission_bench import messages_of, of_type
from tests.support.harness import Stack
from tests.support.until import until

ARM, SET_MODE, REPOSITION, START = 400, 176, 192, 300
GUIDED, AUTO = 15, 10
LOST_S = 1.5


class Gateway:
    """A gateway and its client, which live while the test lets them."""

    def __init__(self, stack: Stack) -> None:
        self._stack = stack
        self.port = BusPort(link_of(stack, Role.GROUND), lambda: None)
        beats = self.port._heartbeats
        self.port.heartbeat = lambda: stack.send(beats.key, lambda: beats.put(ALIVE))  # type: ignore[method-assign]
        self.face = face_of(MavVehicle(1, self.port, ORIGIN, stack.clock.now_ns()))
        self.face.join(CLIENT.client)
        self.sent: list[MavMessage] = []

    def round(self) -> None:
        self.face.vehicle.control.heard(CLIENT, self._stack.clock.now_ns())
        self.port.deliver()
        self.face.due(self._stack.clock.now_ns())
        self.sent += [one.message for one in self.face.vehicle.outbox.take()]

    def ask(self, message: MavMessage, answer: str = "COMMAND_ACK") -> MavMessage:
        """Send a message; return the first answer of this type."""
        self.sent.clear()
        self.face.receive(message, CLIENT, self._stack.clock.now_ns())

        def is_answered() -> bool:
            if self.port._waiting and self._stack.robot is not None:
                self._stack.robot.idle()  # simulated time waits for the threads of the port
            else:
                self._stack.cycle()
            self.round()
            return bool(of_type(self.sent, answer))

        until(is_answered)
        return of_type(self.sent, answer)[0]

    def command(self, number: int, *params: float) -> int:
        """Send a command; return its result a tick later, as the robot then knows its operator."""
        result = acks([self.ask(command(number, *params))])[0][1]
        self._stack.cycle()
        self.round()
        return result

    def lives(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds * 20)):
            self._stack.cycle()
            self.round()

    def is_live(self) -> bool:
        self.round()
        return self.face.vehicle.snapshot.is_live

    def drives(self) -> bool:
        self.round()
        return self._stack.driving()


@contextmanager
def stack_with_gateway() -> Iterator[tuple[Stack, Gateway]]:
    with Stack("open") as stack:
        stack.operator = False  # the gateway is the only one
        gateway = Gateway(stack)
        stack.until(gateway.is_live)
        yield stack, gateway
        gateway.port.close()


def goto(gateway: Gateway) -> int:
    place = (ORIGIN.latitude_deg + 0.00003, ORIGIN.longitude_deg + 0.00003)
    return gateway.command(REPOSITION, -1, 1, 0, 0, *place)


def test_guided_goal_ends_and_clients_of_a_new_gateway_go_on() -> None:
    with stack_with_gateway() as (stack, gateway):
        assert gateway.command(ARM, 1) == 0
        assert gateway.command(SET_MODE, 1, GUIDED) == 0
        assert goto(gateway) == 0
        stack.until(gateway.drives)
        gone_s = stack.until(lambda: stack.goal_state == GoalState.ABORTED, within_s=5.0)
        assert LOST_S - 0.3 <= gone_s <= LOST_S + 0.2
        assert stack.vehicle.state.machine.goal_reason == Reason.OPERATOR_LOST
        stack.until(stack.standing)

        newer = Gateway(stack)
        stack.forward(LAPSE_S + 0.5)
        newer.round()
        (heartbeat, *_) = of_type(newer.sent, "HEARTBEAT")
        assert heartbeat.system_status == mavlink.MAV_STATE_CRITICAL
        assert newer.command(ARM, 1) == 0
        assert stack.state == VehicleState.ACTIVE
        assert newer.command(SET_MODE, 1, GUIDED) == 0
        assert goto(newer) == 0
        stack.until(newer.drives)
        newer.port.close()


def test_clients_learn_of_a_silence_and_go_on_after_it() -> None:
    with stack_with_gateway() as (stack, gateway):
        assert gateway.command(ARM, 1) == 0
        assert gateway.command(SET_MODE, 1, GUIDED) == 0
        assert goto(gateway) == 0
        stack.until(gateway.drives)
        gateway.sent.clear()
        beat = gateway.port.heartbeat
        gateway.port.heartbeat = lambda: None  # type: ignore[method-assign]
        stack.cycle()  # the robot reads the last heartbeat; one read later would count as new
        stack.hanging = frozenset({"robot"})
        gateway.lives(5.0)
        (*_, heartbeat) = of_type(gateway.sent, "HEARTBEAT")
        assert heartbeat.system_status == mavlink.MAV_STATE_UNINIT
        assert heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
        assert "no telemetry arrives from the robot" in words(gateway.sent)
        began_ns = stack.clock.now_ns()
        assert gateway.command(ARM, 1) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        assert stack.clock.now_ns() - began_ns <= 200_000_000

        stack.hanging, gateway.port.heartbeat = frozenset(), beat  # type: ignore[method-assign]
        gateway.sent.clear()
        gateway.lives(3.0)
        # It counts from the last telemetry, which threads of the bus may have delivered late.
        assert re.search(r"telemetry arrives again, after [45] s", words(gateway.sent))
        (*_, heartbeat) = of_type(gateway.sent, "HEARTBEAT")
        assert heartbeat.system_status == mavlink.MAV_STATE_CRITICAL
        assert gateway.command(ARM, 1) == 0
        assert gateway.command(SET_MODE, 1, GUIDED) == 0
        assert goto(gateway) == 0
        stack.until(gateway.drives)


def test_mission_goes_on_to_its_end() -> None:
    with stack_with_gateway() as (stack, gateway):
        items = messages_of(PLAN)
        message = MissionCount(1, 1, len(items), 0)
        for item in items:
            assert gateway.ask(message, "MISSION_REQUEST").seq == item.seq
            message = item
        assert gateway.ask(message, "MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
        assert gateway.command(ARM, 1) == 0
        assert gateway.command(START, 0) == 0
        stack.until(gateway.drives)
        stack.until(lambda: stack.vehicle.mission.state == MissionState.DONE)
