"""A robot port for tests: they set the telemetry and answer the requests."""

from collections import deque
from collections.abc import Callable
from typing import Any

from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import Face, MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage
from gateways.mavlink.robot_port import Answered, Done, Snapshot
from ground.client.operations.session import Operation
from ground.client.results import Accepted, Outcome, Refused
from ground.missions.mission import Home
from protocol.wire.enums import LeaseAction
from protocol.wire.messages import Statustext
from protocol.wire.reasons import Reason
from tests.support.gateway.telemetry import READ

IDENTITY = "gateway/5"
ORIGIN = Home(latitude_deg=47.3769, longitude_deg=8.5417)
CLIENT = Sender(client=1, system=255, component=190)
OTHER = Sender(client=2, system=254, component=190)


class FakePort:
    """Stores operations until `answer` ends the oldest; grants the lease unless `holder` is set."""

    name = "r1"
    identity = IDENTITY
    accepted = Answered(Accepted(1))

    def __init__(self) -> None:
        self.telemetry: dict[str, Any] = {}
        self.waiting: deque[tuple[Operation[Any], Done]] = deque()
        self.performed: list[Operation[Any]] = []
        self.leases: list[tuple[LeaseAction, str]] = []
        self.holder = ""
        self.stops: list[Done] = []
        self.heartbeats = 0
        self.texts: list[Statustext] = []
        self.driven: list[tuple[float, float]] = []

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return the telemetry that the test has set."""
        return Snapshot(now_ns, **self.telemetry)

    def new_texts(self) -> list[Statustext]:
        """Return the texts that the test has set, once."""
        taken, self.texts = self.texts, []
        return taken

    def perform(self, operation: Operation[Any], done: Done) -> None:
        """Keep the operation for `answer`."""
        self.performed.append(operation)
        self.waiting.append((operation, done))

    def answer(self, outcome: Outcome | None = None, error: str = "") -> None:
        """End the oldest operation, by default with the robot's acceptance."""
        _, done = self.waiting.popleft()
        done(Answered(None, error) if error else Answered(outcome or Accepted(1)))

    def refuse(self, reason: Reason) -> None:
        """End the oldest operation with a refusal."""
        self.answer(Refused(reason, 1))

    def change_lease(self, action: LeaseAction, name: str, done: Done) -> None:
        """Grant the lease unless another operator holds it."""
        self.leases.append((action, name))
        is_refused = bool(self.holder) and action is LeaseAction.TAKE
        done(Answered(Refused(Reason.LEASE_HELD, 1, self.holder) if is_refused else Accepted(1)))

    def stop(self, done: Done) -> int:
        """Keep the stop; its id is 101, that of the next one 102."""
        self.stops.append(done)
        return 100 + len(self.stops)

    def heartbeat(self) -> None:
        """Count the heartbeat."""
        self.heartbeats += 1

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Keep the speeds."""
        self.driven.append((speed_m_s, yaw_rate_rad_s))


class Bench:
    """A face with some services, on a fake port; the test moves the time."""

    def __init__(self, *services: Callable[[MavVehicle], MavService], system: int = 1) -> None:
        self.port = FakePort()
        self.now_ns = 0
        self.vehicle = MavVehicle(system, self.port, ORIGIN, self.now_ns)
        self.vehicle.parameters |= READ
        self.face = Face(self.vehicle, [service(self.vehicle) for service in services])

    def send(self, message: MavMessage, sender: Sender = CLIENT) -> list[MavMessage]:
        """Give a message to the face; return what it sends at once."""
        self.face.receive(message, sender, self.now_ns)
        return self.sent()

    def sent(self, client: int | None = None) -> list[MavMessage]:
        """Return the messages that wait in the outbox, for everyone or this client."""
        taken = self.vehicle.outbox.take()
        return [one.message for one in taken if client is None or one.client in (None, client)]

    def after(self, seconds: float) -> list[MavMessage]:
        """Let time pass in rounds of 20 ms; return what is sent meanwhile."""
        found: list[MavMessage] = []
        end_ns = self.now_ns + round(seconds * 1e9)
        while self.now_ns < end_ns:
            self.now_ns += 20_000_000
            self.face.due(self.now_ns)
            found += self.sent()
        return found
