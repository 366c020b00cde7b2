"""The port on a played bus: a robot that is silent, slow or flooded, and the emergency stop."""

import asyncio
import sys
import threading
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextvars import ContextVar
from pathlib import Path
from types import FrameType
from typing import Any, Final, cast

import pytest

from checks.harness.loop import PlayedLoop
from checks.harness.played_gateway import PlayedWork
from checks.harness.until import until
from gateways.mavlink.bus_port import (
    BUSY,
    LATE_NS,
    LOAD_NS,
    MAX_ASKING,
    MAX_HALTS,
    MAX_WAITING,
    NEEDED_NS,
    SILENT_NS,
    WHEELS_NS,
    BusPort,
)
from gateways.mavlink.coordinates import DEFAULT_ORIGIN
from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import mavlink
from gateways.mavlink.robot_port import NO_TELEMETRY, OVERTAKEN, Answered, StopPress
from gateways.mavlink.services import face_of
from ground.client.connection import Common
from ground.client.outcomes import Outcome, Refused
from ground.client.robot_link import RobotLink
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.hold import Hold
from ground.commands.param import ShowParameters
from ground.commands.resume import Resume
from protocol.bus.network import Network
from protocol.topics import COMMAND, CYCLE, LEASE, LEASE_SERVICE, STATUS, STOP, WHEELS
from protocol.wire.enums import AckResult, Command, LeaseAction, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, CommandRequest
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from tests.support.gateway.fake_port import cycle, status, wheels
from tests.support.ground.client import ack, lease_of
from tests.support.played_bus import PlayedBus, PlayedQuery


class Gate:
    """Holds the robot's answers while it is closed."""

    def __init__(self) -> None:
        self._is_open = True
        self._held: list[Callable[[], object]] = []

    def give(self, answer: Callable[[], object]) -> None:
        """Let an answer pass, now or later."""
        self._held.append(answer)
        if self._is_open:
            self.set()

    def clear(self) -> None:
        """Close it."""
        self._is_open = False

    def set(self) -> None:
        """Open it."""
        self._is_open = True
        while self._held:
            self._held.pop(0)()


class GatedBus(PlayedBus):
    """A played bus whose robot answers once `gate` is open."""

    def __init__(self, clock: ManualClock, gate: Gate) -> None:
        super().__init__(clock)
        self.gate = gate

    def send(self, query: PlayedQuery, done: Callable[[object], object]) -> None:
        self.asked.append((self.robot, query.service.path, query.message))

        def answer() -> None:
            try:
                done(self.answers[query.service.path](query.message))
            except Exception as error:
                done(error)

        self.gate.give(answer)


class Room:
    """A port on a played bus; the robot answers once `gate` is set."""

    def __init__(self) -> None:
        self.clock = ManualClock(1)
        self.gate = Gate()
        self.bus = GatedBus(self.clock, self.gate)
        self.asked: list[int] = []
        self.bus.answers[COMMAND.path] = self._answer
        common = Common(network=Network(connect=("tcp/127.0.0.1:1",)), robot="r1")
        self.loop = PlayedLoop(self.clock)
        self.port = BusPort(RobotLink(cast("Any", self.bus), common, self.clock))
        self.answers: list[Answered] = []
        self.tasks: list[asyncio.Task[None]] = []
        self.stops = self.bus.publisher(STOP)

    def _answer(self, request: Message | None) -> Message:
        assert isinstance(request, CommandRequest)
        self.asked.append(request.command)
        return CommandAck(command=request.command, result=AckResult.ACCEPTED)

    def perform(self, operation: Any) -> None:
        self.start(self.port.perform(operation))

    def start(self, work: Coroutine[Any, Any, Answered]) -> None:
        """Begin a request; its end is one of the answers."""

        async def run() -> None:
            self.answers.append(await work)

        self.tasks.append(self.loop.create_task(run()))
        self.loop.advance()

    def press(self) -> StopPress:
        """Press the emergency stop; its end is one of the answers, if it has one."""

        async def pressed() -> StopPress:
            return self.port.stop()

        press = self.loop.run(pressed())
        if press.ended is not None:
            self.start(ended(press.ended))
        return press

    def wait(self, count: int) -> list[str]:
        def is_answered() -> bool:
            self.loop.advance()
            return len(self.answers) >= count

        until(is_answered)
        return [one.error for one in self.answers]

    def show_stop(self) -> None:
        newest = self.stops.said[-1]
        assert isinstance(newest, CommandRequest)
        shown = status(vehicle=Vehicle.EMERGENCY_STOP, stop_id=newest.request_id)
        self.bus.say(STATUS, shown)


async def ended(work: Awaitable[Answered]) -> Answered:
    return await work


@pytest.fixture
def room() -> Iterator[Room]:
    room = Room()
    yield room
    room.gate.set()
    room.loop.advance()
    for task in room.tasks:
        task.cancel()
    room.loop.advance()
    room.loop.close()


def test_silent_robot_refuses_at_once_but_is_asked_to_stop(room: Room) -> None:
    room.perform(Arm())
    room.wait(1)
    room.bus.say(STATUS, status())
    room.clock.advance(SILENT_NS - 1)
    room.perform(Arm())
    assert room.wait(2) == ["", ""]
    room.clock.advance(1)
    room.perform(Arm())
    room.start(room.port.change_lease(LeaseAction.TAKE, "MAVLink 255"))
    room.perform(ShowParameters())
    room.loop.advance()
    assert [one.error for one in room.answers][2:] == [NO_TELEMETRY] * 3
    assert LEASE_SERVICE.path not in [path for _, path, _ in room.bus.asked]
    room.perform(Hold())
    room.wait(6)
    assert room.asked[-1] == Command.DO_PAUSE_CONTINUE
    room.bus.say(STATUS, status())
    room.perform(Arm())
    assert room.wait(7)[6] == ""


def test_refused_lease_names_the_holder_at_once(room: Room) -> None:
    """The telemetry of the port has it: no request waits for the next lease status."""
    room.bus.answers[LEASE_SERVICE.path] = lambda request: ack(request, Reason.LEASE_HELD)
    room.bus.say(STATUS, status())
    room.bus.say(LEASE, lease_of("ada"))
    room.start(room.port.change_lease(LeaseAction.TAKE, "MAVLink 255"))
    room.wait(1)
    assert room.answers[0].text == "refused: another operator commands the robot: ada"


def test_requests_that_wait_are_limited(room: Room) -> None:
    room.gate.clear()
    for _ in range(MAX_WAITING + 10):
        room.perform(Arm())
    room.loop.advance()
    assert [one.error for one in room.answers] == [BUSY] * 10
    for _ in range(MAX_HALTS + 10):
        room.perform(Disarm())
    room.loop.advance()
    assert [one.error for one in room.answers] == [BUSY] * 20
    room.gate.set()
    room.wait(MAX_WAITING + MAX_HALTS + 20)
    assert len(room.asked) <= 2 + MAX_HALTS, "the first, its stop again, and all stops"


def test_request_that_its_client_gave_up_does_not_act(room: Room) -> None:
    room.gate.clear()
    room.perform(Resume())
    room.perform(Arm())
    room.clock.advance(LATE_NS)
    room.gate.set()
    assert room.wait(2) == ["", BUSY]
    assert set(room.asked) == {Command.DO_PAUSE_CONTINUE}


def test_request_that_is_no_longer_permitted_at_its_turn_does_not_act(room: Room) -> None:
    room.gate.clear()
    room.perform(Resume())
    refused: list[Outcome] = []
    room.start(room.port.perform(Arm(), "MAVLink 254", lambda: next(iter(refused), None)))
    room.perform(ShowParameters())
    refused.append(Refused(Reason.LEASE_HELD, 0, "MAVLink 255"))
    room.gate.set()
    room.wait(3)
    assert room.answers[1].outcome is refused[0]
    assert params(room) == [1.0]


def params(room: Room) -> list[float]:
    """Return parameter 1 of each command that was sent to the robot."""
    return [one.param1 for _, _, one in room.bus.asked if isinstance(one, CommandRequest)]


def waits(room: Room, count: int) -> bool:
    """Return whether so many requests have reached the robot, which answers none yet."""
    return len(room.bus.asked) >= count


def test_stop_overtakes_all_and_is_repeated_after_what_had_begun(room: Room) -> None:
    """The other one may reach the robot after the stop: its first frame may have been lost."""
    room.gate.clear()
    room.perform(Resume())
    until(lambda: waits(room, 1))
    room.perform(Arm())
    room.perform(Hold())
    until(lambda: waits(room, 2))
    room.gate.set()
    assert sorted(room.wait(3)) == ["", "", OVERTAKEN]
    assert params(room) == [1.0, 0.0, 0.0]


def test_what_is_asked_after_a_stop_begins_after_its_answer(room: Room) -> None:
    room.gate.clear()
    room.perform(Disarm())
    room.perform(Arm())
    room.perform(Resume())
    until(lambda: waits(room, 1))
    room.gate.set()
    assert room.wait(3) == ["", "", ""]
    assert params(room) == [0.0, 1.0, 1.0]


def test_defect_of_the_bus_is_an_answer(room: Room) -> None:
    def fails(_: Message | None) -> Message:
        raise OSError("session closed")

    room.bus.answers[COMMAND.path] = fails
    room.perform(Arm())
    assert room.wait(1) == ["OSError: session closed"]


def test_emergency_stop_is_sent_before_all_that_waits(room: Room) -> None:
    room.gate.clear()
    for _ in range(MAX_WAITING):
        room.perform(Disarm())
    room.stops.heard = lambda _: room.show_stop()
    room.press()
    assert room.stops.said
    room.wait(1)
    assert room.answers[0].ok
    assert room.asked == []


def test_flood_of_stops_is_sent_whole_in_bounded_memory(room: Room) -> None:
    for _ in range(1_000):
        room.press()
    assert len(room.stops.said) >= 1_000
    assert len(room.port._stop_line._asking) <= MAX_ASKING
    assert len([one for one in threading.enumerate() if one.name == "stop r1"]) <= 1

    def all_shown() -> bool:
        room.show_stop()
        room.loop.advance()
        return len(room.answers) > MAX_ASKING

    until(all_shown)


def test_load_is_sampled_now_and_then(room: Room) -> None:
    def load() -> int | None:
        found = room.port.snapshot(room.clock.now_ns()).cycle
        return None if found is None else found.tick

    assert load() is None
    room.bus.say(CYCLE, cycle(tick=1))
    assert load() == 1
    room.bus.say(CYCLE, cycle(tick=2))
    assert load() == 1
    room.clock.advance(LOAD_NS)
    load()
    room.bus.say(CYCLE, cycle(tick=3))
    assert load() == 3


def test_load_of_a_silent_robot_is_unknown(room: Room) -> None:
    room.port.snapshot(room.clock.now_ns())
    room.bus.say(CYCLE, cycle(tick=1))
    room.port.snapshot(room.clock.now_ns())
    room.clock.advance(LOAD_NS)
    assert room.port.snapshot(room.clock.now_ns()).cycle is not None
    room.clock.advance(SILENT_NS)
    assert room.port.snapshot(room.clock.now_ns()).cycle is None


def test_wheels_are_sampled_until_a_client_needs_each_message(room: Room) -> None:
    def left() -> int | None:
        found = room.port.snapshot(room.clock.now_ns()).wheels
        return None if found is None else found.left

    def seen_after(ns: int, ticks: int) -> int | None:
        room.clock.advance(ns)
        left()
        room.bus.say(WHEELS, wheels(ticks))
        return left()

    left()
    assert seen_after(0, 1) == 1
    assert seen_after(WHEELS_NS // 2, 2) == 1
    assert seen_after(WHEELS_NS // 2, 3) == 3
    room.port.need_wheels(room.clock.now_ns())
    for ticks in (4, 5, 6):
        assert seen_after(WHEELS_NS // 20, ticks) == ticks
    room.clock.advance(SILENT_NS)
    assert left() is None
    assert seen_after(NEEDED_NS, 7) == 7
    assert seen_after(WHEELS_NS // 2, 8) == 7


def test_port_is_busy_until_the_answer_is_delivered(room: Room) -> None:
    room.gate.clear()
    room.perform(Hold())
    assert room.port.is_busy
    room.gate.set()
    room.wait(1)
    assert not room.port.is_busy


ROOT: Final = Path(__file__).resolve().parents[4]
ROOMS: Final = ("gateways", "ground", "protocol")
MOST_CALLS: Final = 21
PASSED: ContextVar[tuple[str, ...]] = ContextVar("PASSED", default=())
"""The calls that led to the present task."""


def calls(frame: FrameType | None) -> list[str]:
    """Return the functions of the product on a stack, the outermost first."""
    found: list[str] = []
    while frame is not None:
        path = Path(frame.f_code.co_filename)
        if any(path.is_relative_to(ROOT / room) for room in ROOMS):
            found.insert(0, f"{path.stem}.{frame.f_code.co_name}")
        frame = frame.f_back
    return found


def test_a_command_long_reaches_the_bus_in_few_calls(
    room: Room, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Count them, through all tasks, from the message to the request on the bus."""
    to_bus: list[str] = []
    send, create_task = GatedBus.send, room.loop.create_task

    def begun(work: Any, **how: Any) -> Any:
        token = PASSED.set((*PASSED.get(), *calls(sys._getframe(1))))
        try:
            return create_task(work, **how)
        finally:
            PASSED.reset(token)

    def asked(self: GatedBus, query: PlayedQuery, done: Callable[[object], object]) -> None:
        if query.service is COMMAND:
            to_bus[:] = [*PASSED.get(), *calls(sys._getframe(1)), "send"]
        send(self, query, done)

    monkeypatch.setattr(GatedBus, "send", asked)
    monkeypatch.setattr(room.loop, "create_task", begun)
    room.bus.answers[LEASE_SERVICE.path] = lambda request: ack(request, Reason.NONE)
    room.bus.say(STATUS, status())
    vehicle = MavVehicle(1, room.port, DEFAULT_ORIGIN, room.clock.now_ns())
    face, work = face_of(vehicle), PlayedWork(vehicle, room.loop)
    face.due(room.clock.now_ns())
    arm = mavlink.MAVLink_command_long_message(
        *(1, 1, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    )
    work.within(face.receive, arm, Sender(1, 255, 190), room.clock.now_ns())
    work.settle()
    assert room.asked == [Command.COMPONENT_ARM_DISARM]
    assert to_bus[0] == "mav_vehicle.receive"
    assert len(to_bus) <= MOST_CALLS, to_bus
