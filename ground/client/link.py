"""The operator's connection to one robot: the thin I/O around `ground.client.requests`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, Final, TypeVar

from ground.client.connection import Common
from ground.client.emergency_stop import Asks
from ground.client.presence import crew_of, why_silent
from ground.client.requests import (
    ATTEMPTS,
    PATIENCE_NS,
    Answered,
    Asking,
    Exchange,
    GaveUp,
    Request,
    RequestIds,
)
from ground.client.telemetry import Telemetry
from protocol.bus.bus import Bus, open_bus
from protocol.bus.publisher import Publisher
from protocol.bus.tls.access import barred
from protocol.topics import COMMAND, HEARTBEAT, OPERATOR, Role, Service, Topic
from protocol.wire.enums import AUTOPILOT_INVALID, TYPE_GCS, Command, SystemState
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, Heartbeat
from runtime.clock import Clock, Pulse, WallClock
from runtime.errors import NoPeer, NotLetIn, PeerHangs, RemoteError
from runtime.units import NS_PER_S

M = TypeVar("M", bound=Message)
LISTEN_NS: Final = 700_000_000
ALIVE: Final = Heartbeat(
    type=TYPE_GCS,
    autopilot=AUTOPILOT_INVALID,
    base_mode=0,
    custom_mode=0,
    system_status=SystemState.ACTIVE,
    mavlink_version=3,
)


class Unanswered(RemoteError):
    """Nobody answered, and who is missing."""

    exit_code = 1


def converse(
    bus: Asks, clock: Clock, robot: str, exchange: Exchange[Any], service: Service
) -> None:
    """Put the questions of an exchange to a robot's service until it is over."""
    while not exchange.over:
        for send in exchange.due(clock.now_ns()):
            try:
                patience_s = send.patience_ns / NS_PER_S
                answer = bus.ask(service, send.request, patience_s, robot=robot)
            except RemoteError as error:
                exchange.unanswered(str(error))
            else:
                exchange.receive(answer, clock.now_ns())
        if not exchange.over:
            clock.sleep_until(exchange.next_ns)


class Link:
    """Asks one robot, and beats for it."""

    def __init__(self, bus: Bus, common: Common, clock: Clock) -> None:
        self.bus = bus
        self.robot = common.robot
        self.clock = clock
        self.ids = RequestIds()
        self.pulse = Pulse()
        self.endpoint = common.endpoint
        self._heart: Publisher[Heartbeat] | None = None

    def command(self, command: Command, param1: float = 0.0, param2: float = 0.0) -> CommandRequest:
        """A command with an id of its own."""
        return CommandRequest(
            request_id=self.ids.next(), param1=param1, param2=param2, command=command
        )

    def ask(
        self,
        request: Request,
        *,
        attempts: int = ATTEMPTS,
        patience_ns: int = PATIENCE_NS,
        service: Service = COMMAND,
    ) -> Answered:
        """The robot's answer; Unanswered says who is missing when there is none."""
        asking = Asking(request, self.clock.now_ns(), attempts=attempts, patience_ns=patience_ns)
        converse(self.bus, self.clock, self.robot, asking, service)
        if isinstance(asking.outcome, Answered):
            return asking.outcome
        raise self.unanswered(asking.outcome)

    def talk(self, exchange: Exchange[Any], service: Service) -> None:
        """Put the questions of an exchange to a service until it is over."""
        converse(self.bus, self.clock, self.robot, exchange, service)

    def unanswered(self, outcome: GaveUp | None) -> Unanswered:
        """The error for a talk that has come to nothing."""
        if why_not := barred(self.bus.holder, self.robot, COMMAND):
            return Unanswered(f"{why_not}: use --config DIR/ground.toml")
        why = "no answer" if outcome is None else outcome.why
        return Unanswered(f"{self.diagnosis()} ({why})")

    def beat(self) -> None:
        """Let the robot hear that an operator is there."""
        if self._heart is None:
            self._heart = self.bus.publisher(OPERATOR, self.robot)
            self.bus.await_matched([self._heart], timeout_s=0.5)
        self._heart.put(ALIVE)

    def diagnosis(self) -> str:
        """Why the robot does not answer: listens for its heart before it judges."""
        with self.hearing(HEARTBEAT) as telemetry:
            box = telemetry.boxes()[HEARTBEAT.path]
            self.wait(lambda: box.latest() is not None or box.rejected > 0, LISTEN_NS)
            beats = box.latest() is not None
            if box.rejected and not beats:
                return f"robot {self.robot} is there, but its heartbeat {box.last_rejection}"
        crew = crew_of(self.bus.present())
        return self.bus.lost() or why_silent(crew, self.robot, self.endpoint, beats=beats)

    @contextmanager
    def hearing(self, *topics: Topic[Any]) -> Iterator[Telemetry]:
        """What the robot says of these, for as long as somebody wants to know."""
        telemetry = Telemetry(self.bus, self.robot, topics, notify=self.pulse.beat)
        try:
            yield telemetry
        finally:
            for box in telemetry.boxes().values():
                self.bus.forget(box)

    def newest(self, topic: Topic[M], patience_ns: int) -> M | None:
        """The next message of a topic; None when none comes in time."""
        with self.hearing(topic) as telemetry:
            self.wait(lambda: telemetry.latest(topic) is not None, patience_ns)
            found = telemetry.latest(topic)
            return None if found is None else found[0]

    def wait(self, condition: Callable[[], bool], patience_ns: int) -> bool:
        """Until the condition holds or patience ends; looks again at every arrival."""
        deadline_ns = self.clock.now_ns() + patience_ns
        while not condition():
            if self.clock.now_ns() >= deadline_ns:
                return False
            self.pulse.wait_until(deadline_ns)
        return True


@contextmanager
def linked(common: Common) -> Iterator[Link]:
    """Dial the robot; Unanswered when nobody listens at the endpoint."""
    try:
        bus = open_bus(common.network, Role.GROUND, common.robot)
    except (PeerHangs, NotLetIn) as error:
        raise Unanswered(str(error)) from error
    except NoPeer as error:
        raise Unanswered(f"no robot and no router: {error}") from error
    with bus:
        yield Link(bus, common, WallClock())
