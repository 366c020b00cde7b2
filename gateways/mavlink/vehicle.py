"""One robot as a MAVLink system: the shared state, and the dispatch of messages."""

from collections.abc import Collection, Sequence
from typing import Any, Final

from gateways.mavlink.catalogue import Catalogue
from gateways.mavlink.control import OperatorControl
from gateways.mavlink.dialect import MavMessage
from gateways.mavlink.motion.modes import Modes
from gateways.mavlink.port import KEEPS_FENCE, Answered, Done, RobotPort, Snapshot
from gateways.mavlink.signing.policy import WATCHING
from gateways.mavlink.texts import Refusals
from gateways.mavlink.traffic import COMPONENT, MavService, Outbox, Sender
from ground.client.operations import ClearFence, Operation
from ground.missions.mission import Home
from protocol.wire.enums import Severity
from protocol.wire.enums import Vehicle as State
from runtime.units import NS_PER_MS, NS_PER_S, NS_PER_US

SILENT_NS: Final = NS_PER_S
"""A robot without telemetry for so long is shown as silent; shorter gaps are delays."""
DOUBT_NS: Final = NS_PER_S
"""Least time between two texts about stops whose time stamp is doubtful."""
ANY: Final = 0
"""The target that addresses every system, or every component."""


class Vehicle:
    """The state that the protocols of one robot share; `snapshot` is that of the present round.

    `origin` is the place on the globe of the robot's (0, 0), `origin_altitude_m` its height above
    the sea, and `home` the local x and y of the home position, perhaps chosen by a client.
    `clients` holds the capacity of each client's line in bytes per second, None if it has no limit.
    `lossy` are the clients whose line loses frames. `parameters` are the robot's values by their
    names, as far as they are known. `unix_offset_ns` is the time of day minus the time of this
    process; None without a clock. `commit` is that of this program. `is_armed` is what was seen
    last: a silent robot that was armed may still drive. `stop_id` names the newest emergency stop
    that was seen, None before the first status. `has_fence` is False once the robot is seen to have
    none. `shortest_ns` is the shortest time between two messages of a stream.
    """

    def __init__(self, system: int, port: RobotPort, origin: Home, now_ns: int) -> None:
        self.system = system
        self.port = port
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
        self.stop_id: int | None = None
        self.shortest_ns = NS_PER_S
        self.catalogue = Catalogue()
        self.outbox = Outbox()
        self.refusals = Refusals(self.outbox)
        self.modes = Modes()
        self.control = OperatorControl(port, self.outbox)
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
        return self.boot_ns(now_ns) // NS_PER_MS & 0xFFFFFFFF

    def answer(self, message: MavMessage, client: int) -> None:
        """Send an answer whose copy does no harm: twice on a lossy line."""
        for _ in range(2 if client in self.lossy else 1):
            self.outbox.send(message, client)

    def perform(self, sender: Sender, operation: Operation[Any], done: Done) -> None:
        """Start an operation for a client that has control or obtains it now.

        An armed robot keeps its fence, which may be replaced but not removed: no single message,
        perhaps a forged one, makes it drive on without.
        """
        if self.is_armed and self.has_fence and isinstance(operation, ClearFence):
            kept = Answered(None, KEEPS_FENCE)
            self.control.ensure(sender, lambda answered: done(kept if answered.ok else answered))
            return
        self.control.perform(sender, operation, done)


class Face:
    """The protocols of one vehicle."""

    def __init__(self, vehicle: Vehicle, services: Sequence[MavService]) -> None:
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
