"""A plan flown through MAVLink and through our own operations: the same trajectory, bit by bit."""

import json
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Any

from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, MissionCount, mavlink
from gateways.mavlink.services import face_of
from ground.client.connection import Common
from ground.client.link import Link
from ground.client.operations.commands import Arm
from ground.client.operations.missions import StartMission, UploadMission
from ground.client.operations.session import Operation, Session
from ground.client.results import Outcome
from ground.missions import qgroundcontrol
from ground.missions.mission import Waypoint
from protocol.topics import Role
from protocol.wire.enums import MissionState
from runtime.clock import WallClock
from tests.support.gateway.fake_port import CLIENT, ORIGIN
from tests.support.gateway.messages import acks, command
from tests.support.gateway.mission_bench import messages_of, of_type, planned
from tests.support.harness import Stack
from tests.support.until import until

PLAN = planned(
    Waypoint(x_m=1.0, y_m=2.0, hold_s=0.3),
    Waypoint(x_m=1.3, y_m=1.6, heading_deg=-33.3, position_tolerance_m=0.07),
)


def link_of(stack: Stack, role: Role) -> Link:
    return Link(stack.join(role), Common(network=stack.client_network, robot="r1"), WallClock())


def flown(stack: Stack) -> str:
    """Drive the mission that has been started to its end, and return the digest."""
    stack.until(lambda: stack.vehicle.mission.state == MissionState.DONE)
    return stack.digest()


def is_over(stack: Stack, answer: Future[Outcome]) -> bool:
    """Let the robot answer, without a tick; return whether the operation has ended."""
    assert stack.robot is not None
    stack.robot.idle()
    return answer.done()


def flown_by_operations() -> str:
    """Read the plan, upload, arm and start as the app does."""
    with Stack("open") as stack, ThreadPoolExecutor(1) as pool:
        session = Session(link_of(stack, Role.GROUND), attended=True)
        mission = qgroundcontrol.read_plan(json.dumps(PLAN), "tour.plan").mission
        steps: list[Operation[Any]] = [UploadMission(mission=mission), Arm()]
        for operation in (*steps, StartMission(item=0)):
            answer = pool.submit(operation.perform, session)
            until(partial(is_over, stack, answer))
            assert answer.result().ok
        return flown(stack)


class Client:
    """A MAVLink client of a robot, without sockets between it and the gateway."""

    def __init__(self, stack: Stack) -> None:
        self._stack = stack
        self._port = BusPort(link_of(stack, Role.GROUND), lambda: None)
        now_ns = stack.clock.now_ns()
        self._face = face_of(MavVehicle(1, self._port, ORIGIN, now_ns))
        self._face.due(now_ns)

    def send(self, message: MavMessage, answer: str) -> MavMessage:
        """Send a message; return the first answer of this type, without a tick of the robot."""
        found: list[MavMessage] = []
        self._face.receive(message, CLIENT, self._stack.clock.now_ns())

        def is_answered() -> bool:
            assert self._stack.robot is not None
            self._stack.robot.idle()
            self._port.deliver()
            sent = [one.message for one in self._face.vehicle.outbox.take()]
            found.extend(of_type(sent, answer))
            return bool(found)

        until(is_answered)
        return found[0]

    def close(self) -> None:
        self._port.close()


def flown_by_mavlink() -> str:
    """Upload the plan, arm and start as a ground station does."""
    with Stack("open") as stack:
        client, items = Client(stack), messages_of(PLAN)
        message = MissionCount(1, 1, len(items), 0)
        for item in items:
            asked = client.send(message, "MISSION_REQUEST")
            assert asked.seq == item.seq
            message = item
        assert client.send(message, "MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
        for number in (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, mavlink.MAV_CMD_MISSION_START):
            param1 = 1 if number == mavlink.MAV_CMD_COMPONENT_ARM_DISARM else 0
            answer = client.send(command(number, param1), "COMMAND_ACK")
            assert acks([answer]) == [(number, mavlink.MAV_RESULT_ACCEPTED)]
        client.close()
        return flown(stack)


def test_mavlink_and_our_operations_give_the_same_trajectory() -> None:
    assert flown_by_mavlink() == flown_by_operations()
