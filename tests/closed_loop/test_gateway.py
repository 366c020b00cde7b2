"""The gateway in closed loop: a plan is driven, the robot is stopped, the gateway dies."""

import asyncio
import json
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from checks.harness.in_process import InProcess
from checks.harness.loop import PlayedLoop
from checks.harness.played_gateway import PlayedWork
from checks.harness.until import until
from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import (
    RESULT_NOT_IN_CONTROL,
    MavMessage,
    MissionCount,
    mavlink,
)
from gateways.mavlink.services import face_of
from ground.client.connection import Common
from ground.client.goal import Destination
from ground.client.leases import ALIVE, Leasing
from ground.client.outcomes import Outcome
from ground.client.robot_link import RobotLink
from ground.commands.arm import Arm
from ground.commands.goto import Goto
from ground.commands.lease import ChangeLease
from ground.commands.mission import StartMission, UploadMission
from ground.missions import qgroundcontrol
from ground.missions.mission import Waypoint
from ground.robot import Robot
from protocol.bus.bus import Bus, open_bus
from protocol.bus.network import Network, gateway_here
from protocol.topics import Role
from protocol.wire.enums import GoalState, LeaseAction, MissionState, Mode
from protocol.wire.enums import Vehicle as VehicleState
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.lease import LAPSE_S
from runtime.clock import WallClock
from tests.support.each import each
from tests.support.gateway.benches import messages_of, of_type, planned
from tests.support.gateway.fake_port import CLIENT, ORIGIN, acks, command, words

PLAN = planned(
    Waypoint(x_m=1.0, y_m=2.0, hold_s=0.3),
    Waypoint(x_m=1.3, y_m=1.6, heading_deg=-33.3, position_tolerance_m=0.07),
)


def link_of(stack: InProcess, role: Role) -> RobotLink:
    return RobotLink(
        stack.join(role, gateway_here()),
        Common(network=stack.client_network, robot="r1"),
        WallClock(),
    )


def flown(stack: InProcess) -> str:
    """Drive the mission that has been started to its end, and return the digest."""
    stack.until(lambda: stack.vehicle.mission.state == MissionState.DONE)
    return stack.digest()


def is_over(stack: InProcess, answer: Future[Outcome]) -> bool:
    """Let the robot answer, without a tick; return whether the operation has ended."""
    assert stack.robot is not None
    stack.robot.idle()
    return answer.done()


def carry_out(operation: Any, bus: Bus) -> Outcome:
    """Carry out an operation as the app does, which attends it; without a heartbeat."""
    where = Common(network=Network(), robot="r1")
    robot = Robot(bus, where, leasing=Leasing.NEVER, follows=False)
    outcome: Outcome = asyncio.run(operation.perform(robot))
    return outcome


def flown_by_operations() -> str:
    """Read the plan, upload, arm and start as the app does."""
    with InProcess("open") as stack, ThreadPoolExecutor(1) as pool:
        bus = stack.join(Role.GROUND)
        mission = qgroundcontrol.read_plan(json.dumps(PLAN), "tour.plan").mission
        steps: list[Any] = [UploadMission(mission=mission), Arm()]
        for operation in (*steps, StartMission(item=0)):
            answer = pool.submit(carry_out, operation, bus)
            until(partial(is_over, stack, answer))
            assert answer.result().ok
        return flown(stack)


def close_port(stack: InProcess, port: BusPort, work: PlayedWork) -> None:
    """Close a port when its stop, which repeats in a real thread, has its answer."""

    def is_idle() -> bool:
        if stack.robot is not None:
            stack.robot.idle()
        work.settle()
        return not port.is_busy

    until(is_idle)
    work.loop.run(port.close())
    work.loop.close()


class Client:
    """A MAVLink client of a robot, without sockets between it and the gateway."""

    def __init__(self, stack: InProcess) -> None:
        self._stack = stack
        self._port = BusPort(link_of(stack, Role.GROUND))
        now_ns = stack.clock.now_ns()
        self._face = face_of(MavVehicle(1, self._port, ORIGIN, now_ns))
        self._work = PlayedWork(self._face.vehicle, PlayedLoop(stack.clock))
        self._work.within(self._face.due, now_ns)

    def send(self, message: MavMessage, answer: str) -> MavMessage:
        """Send a message; return the first answer of this type, without a tick of the robot."""
        found: list[MavMessage] = []
        self._work.within(self._face.receive, message, CLIENT, self._stack.clock.now_ns())

        def is_answered() -> bool:
            assert self._stack.robot is not None
            self._stack.robot.idle()
            self._work.settle()
            sent = [one.message for one in self._face.vehicle.outbox.take()]
            found.extend(of_type(sent, answer))
            return bool(found)

        until(is_answered)
        return found[0]

    def close(self) -> None:
        close_port(self._stack, self._port, self._work)


def flown_by_mavlink() -> str:
    """Upload the plan, arm and start as a ground station does."""
    with InProcess("open") as stack:
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


ARM = 400
SET_MODE = 176
REPOSITION = 192
START = 300
GUIDED, AUTO = 15, 10
LOST_S = 1.5


class Gateway:
    """A gateway and its client, which live while the test lets them."""

    def __init__(self, stack: InProcess, recordings: Path | None = None) -> None:
        self._stack = stack
        self.port = BusPort(link_of(stack, Role.GROUND))
        beats = self.port._robot.lease._publisher
        self.port.heartbeat = lambda: stack.send(beats.key, lambda: beats.put(ALIVE))  # type: ignore[method-assign]
        self.face = face_of(MavVehicle(1, self.port, ORIGIN, stack.clock.now_ns()), recordings)
        self._work = PlayedWork(self.face.vehicle, PlayedLoop(stack.clock))
        self.face.join(CLIENT.client)
        self._decoder = mavlink.MAVLink(None)
        self.sent: list[MavMessage] = []

    def close(self) -> None:
        close_port(self._stack, self.port, self._work)

    def round(self) -> None:
        self.face.vehicle.control.heard(CLIENT, self._stack.clock.now_ns())
        self._work.settle()
        self._work.within(self.face.due, self._stack.clock.now_ns())
        self.sent += [one.message for one in self.face.vehicle.outbox.take()]

    def ask(
        self, message: MavMessage, answer: str = "COMMAND_ACK", sender: Sender = CLIENT
    ) -> MavMessage:
        """Send a message; return the first answer of this type."""
        self.sent.clear()
        self._work.within(self.face.receive, message, sender, self._stack.clock.now_ns())

        def is_answered() -> bool:
            self._go_on()
            return bool(of_type(self.sent, answer))

        until(is_answered)
        return of_type(self.sent, answer)[0]

    def _go_on(self) -> None:
        if self.port.is_busy and self._stack.robot is not None:
            self._stack.robot.idle()  # simulated time waits for the robot's answers
        else:
            self._stack.cycle()
        self.round()

    def deliver(self, data: bytes) -> None:
        """Take the frames of the client."""
        for message in self._decoder.parse_buffer(data) or ():
            self._work.within(self.face.receive, message, CLIENT, self._stack.clock.now_ns())

    def tick(self) -> list[MavMessage]:
        """Go on by a tick, or to the robot's next answer; return what is sent meanwhile."""
        self.sent.clear()
        self._go_on()
        return list(self.sent)

    def command(self, number: int, *params: float, sender: Sender = CLIENT) -> int:
        """Send a command; return its result a tick later, as the robot then knows its operator."""
        result = acks([self.ask(command(number, *params), sender=sender)])[0][1]
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
def stack_with_gateway(recordings: Path | None = None) -> Iterator[tuple[InProcess, Gateway]]:
    with InProcess("open") as stack:
        stack.operator = False  # the gateway is the only one
        gateway = Gateway(stack, recordings)
        stack.until(gateway.is_live)
        yield stack, gateway
        gateway.close()


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

        def is_critical() -> bool:
            newer.round()
            (*_, heartbeat) = of_type(newer.sent, "HEARTBEAT")
            return bool(heartbeat.system_status == mavlink.MAV_STATE_CRITICAL)

        stack.until(is_critical)
        assert newer.command(ARM, 1) == 0
        assert stack.state == VehicleState.ACTIVE
        assert newer.command(SET_MODE, 1, GUIDED) == 0
        assert goto(newer) == 0
        stack.until(newer.drives)
        newer.close()


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


PAUSE = 193
RTL = 20
CONTROL = 32100
ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
FAR = Destination(x_m=6.0, y_m=2.0, heading_rad=None)
IN_TIME_NS = 100_000_000


@contextmanager
def app(stack: InProcess, person: str) -> Iterator[Callable[[Any], None]]:
    """Return what performs the operations of another person, who has the lease."""
    network = replace(stack.client_network, person=person)
    with open_bus(network, Role.GROUND, "r1") as bus, ThreadPoolExecutor(1) as pool:

        def perform(operation: Any) -> None:
            answer = pool.submit(carry_out, operation, bus)
            until(partial(is_over, stack, answer))
            assert answer.result().ok, answer.result().text

        perform(ChangeLease(action=LeaseAction.TAKE, name=person))
        yield perform


def is_at_rest(stack: InProcess) -> bool:
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


OTHER = Sender(CLIENT.client + 1, 77, CLIENT.component)
"""Another client of the same gateway, named MAVLink 77."""


def test_a_client_is_not_named_for_what_another_one_has_done() -> None:
    """255 has had control; 77, which never had it, stops what another person drives."""
    with stack_with_gateway() as (stack, gateway):
        gateway.face.join(OTHER.client)
        assert gateway.command(ARM, 1) == ACCEPTED
        assert gateway.command(CONTROL, 0, 0, 10) == ACCEPTED
        with app(stack, "ada") as ada:
            ada(Goto(goal=FAR, wait=False))
            stack.until(gateway.drives)
            assert gateway.command(SET_MODE, 1, Mode.HOLD, sender=OTHER) == ACCEPTED
            assert stack.vehicle.commands.stoppers.hold == "MAVLink 77"
            assert gateway.command(ARM, 0, sender=OTHER) == ACCEPTED
            assert stack.vehicle.commands.stoppers.goal == "MAVLink 77"


def test_clients_are_named_for_what_they_do_to_each_other() -> None:
    with stack_with_gateway() as (stack, gateway):
        gateway.face.join(OTHER.client)
        assert gateway.command(ARM, 1) == ACCEPTED
        assert gateway.command(SET_MODE, 1, GUIDED) == ACCEPTED
        assert goto(gateway) == ACCEPTED
        stack.until(gateway.drives)
        assert gateway.command(PAUSE, 0) == ACCEPTED
        assert stack.vehicle.commands.stoppers.hold == "", "its own client"
        assert gateway.command(PAUSE, 1) == ACCEPTED
        assert gateway.command(PAUSE, 0, sender=OTHER) == ACCEPTED
        assert stack.vehicle.commands.stoppers.hold == "MAVLink 77"


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
        newer.close()


def top_speed_m_s(gateway: Gateway) -> float:
    """Return the greatest speed of the next two seconds."""
    speeds = []
    for _ in range(40):
        gateway.lives(0.05)
        odometry = gateway.face.vehicle.snapshot.odometry
        speeds += [] if odometry is None else [abs(odometry.speed_m_s)]
    return max(speeds)


USUAL_M_S = DEFAULTS.v_max_m_s
SLOW_M_S = 0.1
SPEED = 178
AWAY = (ORIGIN.latitude_deg + 0.00003, ORIGIN.longitude_deg + 0.00003)


def test_ordered_speed_ends_with_the_drive_or_the_mode() -> None:
    with stack_with_gateway() as (stack, gateway):
        assert gateway.command(ARM, 1) == ACCEPTED
        assert gateway.command(SPEED, 1, SLOW_M_S, -1) == mavlink.MAV_RESULT_FAILED, "in HOLD"
        assert gateway.command(REPOSITION, SLOW_M_S, 1, 0, 0, *AWAY) == ACCEPTED
        gateway.lives(0.5)
        assert top_speed_m_s(gateway) <= SLOW_M_S + 0.02
        assert goto(gateway) == ACCEPTED, "the next goal"
        gateway.lives(0.5)
        assert top_speed_m_s(gateway) >= 2 * SLOW_M_S

        assert gateway.command(SPEED, 1, SLOW_M_S, -1) == ACCEPTED
        for _ in range(2):
            assert goto(gateway) == ACCEPTED
            gateway.lives(1.0)
            assert top_speed_m_s(gateway) <= SLOW_M_S + 0.02, "all goals of this mode"
        assert gateway.command(SET_MODE, 1, Mode.HOLD) == ACCEPTED
        assert gateway.command(PAUSE, 1) == ACCEPTED
        gateway.lives(0.5)
        assert top_speed_m_s(gateway) >= 2 * SLOW_M_S
        assert stack.vehicle.params.v_max_m_s == USUAL_M_S
        table = gateway.ask(
            mavlink.MAVLink_param_request_read_message(1, 1, b"V_MAX_M_S", -1), "PARAM_VALUE"
        )
        assert table.param_value == pytest.approx(USUAL_M_S)
