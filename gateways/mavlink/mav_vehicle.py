"""One robot as a MAVLink system: the state that its protocols share, and the dispatch of messages.

A service adds the messages that it can build to the catalogue in its constructor. The scheduler
sends them, and REQUEST_MESSAGE builds one at once; both share those that were built in a round.
"""

import asyncio
from collections.abc import Awaitable, Callable, Collection, Coroutine, Iterator, Sequence
from contextlib import suppress
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from gateways.mavlink.mav_service import COMPONENT, MavService, Outbox, Sender
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.operator_control import OperatorControl
from gateways.mavlink.robot_port import RobotPort, Snapshot
from gateways.mavlink.signing import WATCHING
from ground.client.requests import CROSSING_NS
from ground.missions.mission import Home
from protocol.wire.enums import Mode, Severity
from protocol.wire.enums import Vehicle as State
from runtime.units import NS_PER_MS, NS_PER_S, NS_PER_US, UINT32

Build = Callable[[int], Sequence[MavMessage]]
"""Returns the messages of the present round, given its time; none if the values are missing."""
Prepare = Callable[[int], Awaitable[object]]
"""Asks the robot for missing values; RemoteError if it is silent."""
Work = Coroutine[Any, Any, None]
HEARTBEAT: Final = mavlink.MAVLINK_MSG_ID_HEARTBEAT
FRAME_BYTES: Final = 12 + 13
"""Header, checksum and signature."""


class MessageSource(NamedTuple):
    """One kind of message.

    `rate_hz` is the default rate, and `slow_hz` that on a line too slow for all defaults; at 0 it
    is sent only on request. `group` is the MAV_DATA_STREAM of REQUEST_DATA_STREAM to which it
    belongs. `copies` is the number of messages per build. `prepare` obtains missing values.
    """

    number: int
    build: Build
    rate_hz: float = 0.0
    slow_hz: float = 0.0
    group: int | None = None
    copies: int = 1
    prepare: Prepare | None = None

    @property
    def largest_bytes(self) -> int:
        """The size of the frames of one build, at most."""
        payload: int = mavlink.mavlink_map[self.number].unpacker.size
        return self.copies * (payload + FRAME_BYTES)


class Catalogue:
    """The sources of one vehicle by the id of their message."""

    def __init__(self) -> None:
        self._sources: dict[int, MessageSource] = {}
        self._built: dict[int, Sequence[MavMessage]] = {}
        self._built_ns = -1

    def add(self, source: MessageSource) -> None:
        """Add a source, or replace that of the same message."""
        self._sources[source.number] = source

    def find(self, number: int) -> MessageSource | None:
        """Return the source of a message."""
        return self._sources.get(number)

    def __iter__(self) -> Iterator[MessageSource]:
        return iter(self._sources.values())

    def build(self, number: int, now_ns: int) -> Sequence[MavMessage]:
        """Return the messages of this round; several clients share one build."""
        if now_ns != self._built_ns:
            self._built.clear()
            self._built_ns = now_ns
        found = self._built.get(number)
        if found is None:
            found = self._built[number] = self._sources[number].build(now_ns)
        return found


AGAIN_NS: Final = NS_PER_S
"""The same text is sent to a client again only after this time."""
MAX_RECENT: Final = 8
"""Different texts to one client within that time."""


class Refusals:
    """Sends texts of refusals; drops repetitions, and texts beyond a limit."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._recent: dict[int, dict[str, int]] = {}

    def say(
        self, words: str, client: int, now_ns: int, severity: Severity = Severity.WARNING
    ) -> None:
        """Send a text to a client unless the limit is reached."""
        recent = self._recent.setdefault(client, {})
        for old in [old for old, sent_ns in recent.items() if now_ns - sent_ns >= AGAIN_NS]:
            del recent[old]
        if words in recent or len(recent) >= MAX_RECENT:
            return
        recent[words] = now_ns
        self._outbox.text(severity, words, client)

    def forget(self, client: int) -> None:
        """Drop the state of a client that has disconnected."""
        self._recent.pop(client, None)


BY_NUMBER: Final = MappingProxyType({int(mode): mode for mode in Mode})


class ShownMode(NamedTuple):
    """The number that clients receive while the robot is in a mode."""

    mode: Mode
    number: int


class Modes:
    """Reads the robot's mode, and keeps the number that clients receive instead of it."""

    def __init__(self) -> None:
        self._now_ns = 0
        self._status: Mode | None = None
        self._commanded: Mode | None = None
        self._until_ns = 0
        self._shown: ShownMode | None = None
        self._next: ShownMode | None = None

    @property
    def mode(self) -> Mode | None:
        """The robot's mode, or the one that it has just accepted; None without telemetry."""
        return self._status if self._commanded is None else self._commanded

    @property
    def number(self) -> int | None:
        """The mode that clients receive; None without telemetry."""
        return self.number_of(self.mode)

    def number_of(self, mode: Mode | None) -> int | None:
        """Return the number that clients receive for a mode of the robot."""
        if mode is None:
            return None
        for shown in (self._shown, self._next):
            if shown is not None and shown.mode == mode:
                return shown.number
        return int(mode)

    def accepted(self, mode: Mode, number: int | None = None) -> None:
        """Store a mode that the robot has accepted, and the number that clients receive for it."""
        self._next = None if number is None else ShownMode(mode, number)
        if self._status == mode:
            self._shown = self._next
        if self._status != mode or self._commanded is not None:
            self._commanded, self._until_ns = mode, self._now_ns + CROSSING_NS

    def show(self, mode: Mode, number: int) -> None:
        """Send clients this number if the robot passes through a mode before the next one."""
        self._next = ShownMode(mode, number)

    def show_own(self) -> None:
        """Send clients the robot's own mode again."""
        self._shown = self._next = None

    def due(self, snapshot: Snapshot) -> None:
        """Read the robot's status."""
        self._now_ns = snapshot.now_ns
        status = snapshot.status
        self._status = None if status is None else BY_NUMBER.get(status.mode)
        if self._commanded is not None:
            if self._status != self._commanded and self._now_ns < self._until_ns:
                return
            self._commanded, self._shown, self._next = None, self._next, None
        if self._shown is not None and self._shown.mode != self._status:
            self._shown = None


SILENT_NS: Final = NS_PER_S
"""A robot without telemetry for so long is shown as silent; shorter gaps are delays."""
DOUBT_NS: Final = NS_PER_S
"""Least time between two texts about stops whose time stamp is doubtful."""
ANY: Final = 0
"""The target that addresses every system, or every component."""


def not_served(work: Work) -> None:
    """Refuse work before an event loop serves the vehicle."""
    work.close()
    raise RuntimeError("no event loop serves this vehicle")


async def rest_of(work: Work, waits_for: "asyncio.Future[Any]") -> None:
    """Go on with work that has begun, and waits for this."""
    with suppress(StopIteration):
        while True:
            await asyncio.wait((waits_for,))
            waits_for = work.send(None)


class MavVehicle:
    """The state that the protocols of one robot share; `snapshot` is that of the present round.

    `origin` is the place on the globe of the robot's (0, 0), `origin_altitude_m` its height above
    the sea, and `home` the local x and y of the home position, perhaps chosen by a client.
    `clients` holds the capacity of each client's line in bytes per second, None if it has no limit.
    `lossy` are the clients whose line loses frames. `parameters` are the robot's values by their
    names, as far as they are known. `unix_offset_ns` is the time of day minus the time of this
    process; None without a clock. `commit` is that of this program. `is_armed` is what was seen
    last: a silent robot that was armed may still drive. `stop_id` names the newest emergency stop
    that was seen, None before the first status. `has_fence` is False once the robot is seen to have
    none. `shortest_ns` is the shortest time between two messages of a stream. In GUIDED a speed is
    valid for `guided_timeout_s`. `go_on` runs the rest of work as a task of the event loop.
    """

    def __init__(self, system: int, port: RobotPort, origin: Home, now_ns: int) -> None:
        self.system = system
        self.port = port
        self.go_on: Callable[[Work], object] = not_served
        self.origin = origin
        self.origin_altitude_m = 0.0
        self.home = (0.0, 0.0)
        self.is_home_chosen = False
        self.clients: dict[int, int | None] = {}
        self.lossy: Collection[int] = ()
        self.parameters: dict[str, float] = {}
        self.unix_offset_ns: int | None = None
        self.commit = ""
        self.has_fence = True
        self.is_armed = False
        self.guided_timeout_s = 1.0
        self.stop_id: int | None = None
        self.shortest_ns = NS_PER_S
        self.catalogue = Catalogue()
        self.outbox = Outbox()
        self.refusals = Refusals(self.outbox)
        self.modes = Modes()
        self.control = OperatorControl(port, self.outbox, lambda: self.is_armed and self.has_fence)
        self.snapshot = Snapshot(now_ns)
        self._started_ns = now_ns

    def boot_ns(self, now_ns: int) -> int:
        """Return the time since the start of the gateway, the time of all messages."""
        return now_ns - self._started_ns

    def boot_us(self, now_ns: int) -> int:
        """Return that time as in the fields `time_usec`."""
        return self.boot_ns(now_ns) // NS_PER_US

    def boot_ms(self, now_ns: int) -> int:
        """Return that time as in the fields `time_boot_ms`."""
        return self.boot_ns(now_ns) // NS_PER_MS & UINT32

    def answer(self, message: MavMessage, client: int) -> None:
        """Send an answer whose copy does no harm: twice on a lossy line.

        A copy of an acknowledgement, or of a value, is taken for the answer to the next request.
        """
        for _ in range(self.copies(client)):
            self.outbox.send(message, client)

    def copies(self, client: int) -> int:
        """Return how often an answer to a client is sent whose copy does no harm."""
        return 2 if client in self.lossy else 1

    def start(self, work: Work) -> None:
        """Run work up to its first wait now, and the rest as a task.

        So does `eager_start` of Python 3.12: what is asked keeps its order, and what needs no wait
        is answered at once.
        """
        with suppress(StopIteration):
            self.go_on(rest_of(work, work.send(None)))


class Face:
    """The protocols of one vehicle."""

    def __init__(self, vehicle: MavVehicle, services: Sequence[MavService]) -> None:
        self.vehicle = vehicle
        self._services = tuple(services)
        self._doubted = 0
        self._doubt_told_ns: int | None = None
        self._by_id: dict[int, list[MavService]] = {}
        for service in self._services:
            for number in service.handles:
                self._by_id.setdefault(number, []).append(service)

    @property
    def handles(self) -> Collection[int]:
        """The ids of the messages that some protocol takes."""
        return self._by_id.keys()

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Process a message for this system if its sender has the right to send it.

        A sender with the ids of this vehicle is an echo of it, or a forger.
        """
        is_own = (sender.system, sender.component) == (self.vehicle.system, COMPONENT)
        if is_own:
            return
        if sender.may_command and not sender.doubt:
            self.vehicle.control.heard(sender, now_ns)
        if not self._is_target(message):
            return
        if sender.doubt:
            self._report(sender.doubt, now_ns)
        number = message.get_msgId()
        services = self._by_id.get(number, ())
        if services and not sender.may_command and number not in WATCHING:
            self.vehicle.refusals.say(sender.barred, sender.client, now_ns)
            return
        for service in services:
            service.receive(message, sender, now_ns)

    def _report(self, doubt: str, now_ns: int) -> None:
        """Tell all clients of a stop that may be one for nothing, once a second at most."""
        self._doubted += 1
        if self._doubt_told_ns is None or now_ns - self._doubt_told_ns >= DOUBT_NS:
            self._doubt_told_ns = now_ns
            words = f"signing: emergency stop obeyed, but its time stamp {doubt}"
            self.vehicle.outbox.text(Severity.WARNING, f"{words} ({self._doubted} so far)")

    def due(self, now_ns: int) -> None:
        """Take a new snapshot and process streams, retries and time-outs."""
        self.vehicle.snapshot = self.vehicle.port.snapshot(now_ns)
        status = self.vehicle.snapshot.status
        if status is not None:
            self.vehicle.is_armed = status.vehicle == State.ACTIVE
            self.vehicle.stop_id = status.stop_id
        self.vehicle.modes.due(self.vehicle.snapshot)
        self.vehicle.control.due(self.vehicle.snapshot, now_ns, self.vehicle.lossy)
        for service in self._services:
            service.due(now_ns)

    def join(self, client: int, line_bytes_s: int | None = None) -> None:
        """Start to send streams to a client; `line_bytes_s` is the capacity of its line."""
        self.vehicle.clients[client] = line_bytes_s

    def forget(self, client: int) -> None:
        """Drop the state of a client that has disconnected."""
        self.vehicle.clients.pop(client, None)
        self.vehicle.control.forget(client)
        self.vehicle.refusals.forget(client)
        for service in self._services:
            service.forget(client)

    def _is_target(self, message: MavMessage) -> bool:
        system = getattr(message, "target_system", ANY)
        component = getattr(message, "target_component", ANY)
        return system in (ANY, self.vehicle.system) and component in (ANY, COMPONENT)
