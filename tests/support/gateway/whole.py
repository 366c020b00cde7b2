"""A whole gateway on a pipe and a clock of its own; the peers and the robot are the test."""

import os
from typing import Any, cast

from gateways.mavlink.bus_port import BusPort
from gateways.mavlink.clients import NoFile
from gateways.mavlink.endpoints import Endpoint, ReceivedBytes
from gateways.mavlink.gateway import Gateway, WakeUp
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.robot_port import Done
from gateways.mavlink.services import face_of
from gateways.mavlink.signing import SigningGuard
from gateways.mavlink.traffic_recorder import TrafficRecorder
from ground.client.session import Operation
from ground.commands.fence import ShowFence
from ground.commands.mission import FetchMission
from ground.commands.param import ShowParameters
from protocol.wire.messages import GatewayStatus
from runtime.clock import Clock
from tests.support.gateway.fake_port import ORIGIN, FakePort


class StepClock:
    """A clock that the test moves."""

    def __init__(self) -> None:
        self.time_ns = 1

    def now_ns(self) -> int:
        return self.time_ns


class PipeEndpoint:
    """An endpoint whose peers are the test."""

    text = "test"
    line_bytes_s = None
    is_reliable = False

    def __init__(self) -> None:
        self._reader, self._writer = os.pipe()
        self._arrived: list[ReceivedBytes] = []
        self.is_loopback = True
        self.sent: list[tuple[str, bytes]] = []

    def deliver(self, peer: str, frame: bytes) -> None:
        self._arrived.append(ReceivedBytes(peer, frame, self.is_loopback))
        os.write(self._writer, b"x")

    def filenos(self) -> list[int]:
        return [self._reader]

    def receive(self) -> list[ReceivedBytes]:
        os.read(self._reader, 1)
        arrived, self._arrived = self._arrived, []
        return arrived

    def send(self, peer: str, data: bytes, *, is_stream: bool) -> None:
        self.sent.append((peer, data))

    def lasting(self) -> list[str]:
        return []

    def gone(self) -> list[str]:
        return []

    def flush(self, now_ns: int) -> None:
        """Keep nothing."""

    def forget(self, peer: str) -> None:
        """Keep nothing."""

    def close(self) -> None:
        os.close(self._reader)
        os.close(self._writer)


class SilentPort(FakePort):
    """A robot that ends requests only when the test says so."""

    @property
    def is_busy(self) -> bool:
        """Whether an answer is still to be delivered: never, as the test delivers them."""
        return False

    def deliver(self) -> None:
        """End no request."""

    def report(self, status: GatewayStatus) -> None:
        """Publish nothing."""


class CommandedPort(SilentPort):
    """A robot that never answers what is only read, so that the rest stands alone."""

    def perform(self, operation: Operation[Any], done: Done) -> None:
        """Keep the operation unless it only reads."""
        if not isinstance(operation, (ShowParameters, FetchMission, ShowFence)):
            super().perform(operation, done)


class WholeGateway:
    """One robot behind one endpoint, which the test plays unless a `real` one is given."""

    def __init__(
        self,
        port: SilentPort | None = None,
        recorder: TrafficRecorder | None = None,
        guard: SigningGuard | None = None,
        real: Endpoint | None = None,
    ) -> None:
        self.endpoint, self.clock, self.port = PipeEndpoint(), StepClock(), port or SilentPort()
        self.face = face_of(MavVehicle(1, self.port, ORIGIN, 0), None, guard)
        self._encoder = mavlink.MAVLink(NoFile(), 255, 190)
        self._wake_up = WakeUp()
        self.gateway = Gateway(
            [self.endpoint if real is None else real],
            [self.face],
            [cast("BusPort", self.port)],
            cast("Clock", self.clock),
            self._wake_up,
            recorder,
            guard,
        )

    def send(
        self, message: MavMessage, peer: str = "a", system: int = 255, *, is_mavlink1: bool = False
    ) -> None:
        self._encoder.srcSystem = system
        self.endpoint.deliver(peer, message.pack(self._encoder, force_mavlink1=is_mavlink1))
        self._encoder.seq = (self._encoder.seq + 1) & 0xFF

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 50)):
            self.clock.time_ns += 20_000_000
            self.gateway.round(longest_s=0.0)

    def sent_to(self, peer: str, kind: str) -> list[MavMessage]:
        """Return the messages of a kind that a peer has got."""
        parser = mavlink.MAVLink(NoFile())
        parser.robust_parsing = True
        data = b"".join(frame for other, frame in self.endpoint.sent if other == peer)
        return [one for one in parser.parse_buffer(data) or () if one.get_type() == kind]

    def close(self) -> None:
        self.gateway.close()
        self._wake_up.close()
