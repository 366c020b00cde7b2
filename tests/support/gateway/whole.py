"""A whole gateway on a played loop; the peers and the robot are the test."""

from collections.abc import Callable
from typing import Any

from checks.harness.played_gateway import PlayedEndpoint, PlayedGateway
from gateways.mavlink.clients import NoFile
from gateways.mavlink.endpoints import Endpoint
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
from runtime.clock import ManualClock
from tests.support.gateway.fake_port import ORIGIN, FakePort


class SilentPort(FakePort):
    """A robot that ends requests only when the test says so."""

    wake: Callable[[], object]

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


class WholeGateway(PlayedGateway):
    """One robot behind one endpoint, which the test plays unless a `real` one is given."""

    def __init__(
        self,
        port: SilentPort | None = None,
        recorder: TrafficRecorder | None = None,
        guard: SigningGuard | None = None,
        real: Endpoint | None = None,
    ) -> None:
        self.endpoint, self.port = PlayedEndpoint(), port or SilentPort()
        self.face = face_of(MavVehicle(1, self.port, ORIGIN, 0), None, guard)
        self._encoder = mavlink.MAVLink(NoFile(), 255, 190)
        endpoint = self.endpoint if real is None else real
        super().__init__(endpoint, [self.face], [self.port], ManualClock(1), recorder, guard)
        self.port.settle = self.advance

    def send(
        self, message: MavMessage, peer: str = "a", system: int = 255, *, is_mavlink1: bool = False
    ) -> None:
        self._encoder.srcSystem = system
        self.endpoint.deliver(peer, message.pack(self._encoder, force_mavlink1=is_mavlink1))
        self._encoder.seq = (self._encoder.seq + 1) & 0xFF

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 50)):
            self.advance(20_000_000)

    def sent_to(self, peer: str, kind: str) -> list[MavMessage]:
        """Return the messages of a kind that a peer has got."""
        parser = mavlink.MAVLink(NoFile())
        parser.robust_parsing = True
        data = b"".join(frame for other, frame in self.endpoint.sent if other == peer)
        return [one for one in parser.parse_buffer(data) or () if one.get_type() == kind]
