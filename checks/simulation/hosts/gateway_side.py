"""The MAVLink gateway in the simulation: real clients' table, faces and bus port, no socket."""

from collections.abc import Callable
from typing import Any, Final

from checks.simulation.hosts.operators import SimulatedOperator
from checks.simulation.hosts.scheduler import Host
from checks.simulation.hosts.threads import SimulatedClock, SimulatedPipe, SimulatedTime
from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.endpoints import ReceivedBytes
from gateways.mavlink.gateway import Gateway
from gateways.mavlink.gateway_verb import GatewaySettings
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.services import face_of
from ground.client.connection import Common
from ground.client.link import Link
from protocol.bus.bus import open_bus
from protocol.topics import Role

GATEWAY: Final = "gateway"
SYSTEM: Final = 1
ORIGIN: Final = GatewaySettings().home


class DatagramEndpoint:
    """An endpoint whose peers are other hosts. They read no telemetry, so it is not sent."""

    text = "udpin:simulated"
    line_bytes_s = None
    is_reliable = False

    def __init__(self, send: Callable[[str, bytes], None]) -> None:
        self._send = send
        self._pipe = SimulatedPipe()
        self._arrived: list[ReceivedBytes] = []

    def deliver(self, peer: str, data: bytes, is_loopback: bool) -> None:
        """Receive a datagram."""
        self._arrived.append(ReceivedBytes(peer, data, is_loopback))
        self._pipe.wake()

    def filenos(self) -> list[Any]:
        """Return the descriptor to wait for."""
        return [self._pipe]

    def receive(self) -> list[ReceivedBytes]:
        """Return what has arrived."""
        self._pipe.clear()
        arrived, self._arrived = self._arrived, []
        return arrived

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        """Send a frame that is no telemetry."""
        if not is_stream:
            self._send(peer, data)

    def lasting(self) -> list[str]:
        """Return no connection."""
        return []

    gone = lasting

    def flush(self, now_ns: int) -> None:
        """Keep nothing."""

    def forget(self, peer: str) -> None:
        """Keep nothing."""

    def close(self) -> None:
        """Close nothing."""


class GatewaySide(SimulatedOperator):
    """The gateway's process, which can be killed and started like that of any other operator.

    `answer` carries a frame to a client; `arrived` is called with the source, the system and the
    kind of each frame of a client that has arrived.
    """

    endpoint: DatagramEndpoint | None = None
    answer: Callable[[Host, str, bytes], None]
    arrived: Callable[[int, str], None]

    def _main(self) -> None:
        bus = open_bus(self.dials, Role.GROUND, "r1", self.host.now_ns)
        clock, wake_up = SimulatedClock(), SimulatedPipe()
        link = self.link = Link(bus, Common(network=self.dials, robot="r1"), clock)
        host = self.host
        endpoint = DatagramEndpoint(lambda peer, data: self.answer(host, peer, data))
        port = BusPort(link, wake_up.wake)
        vehicle = MavVehicle(SYSTEM, port, ORIGIN, clock.now_ns())
        vehicle.unix_offset_ns = SimulatedTime.time_ns() - clock.now_ns()
        pipe: Any = wake_up
        gateway = Gateway([endpoint], [face_of(vehicle)], [port], clock, pipe)
        self.endpoint = endpoint
        gateway.run()

    def kill(self) -> None:
        """Kill the process, and what it has received with it."""
        super().kill()
        self.endpoint = None

    def deliver(
        self, peer: str, data: bytes, system: int, kind: str, is_loopback: bool = True
    ) -> None:
        """Receive a datagram of a client; before the endpoint is open, it is lost."""
        if self.endpoint is not None:
            if kind:
                self.arrived(system, kind)
            self.endpoint.deliver(peer, data, is_loopback)
