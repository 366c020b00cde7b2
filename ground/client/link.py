"""The operator's connection to one robot: the thin I/O around `ground.client.requests`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final, TypeVar

from ground.client.connection import Common
from ground.client.emergency_stop import ServiceCaller
from ground.client.outcomes import Answer, Refused
from ground.client.presence import PresentProcesses, explain_silence, present_processes
from ground.client.requests import (
    ATTEMPTS,
    PATIENCE_NS,
    CommandExchange,
    Exchange,
    GaveUp,
    Request,
    RequestIds,
)
from ground.client.telemetry import Telemetry
from protocol.bus.bus import Bus, open_bus
from protocol.bus.publisher import Publisher
from protocol.bus.rights import denial
from protocol.topics import COMMAND, HEARTBEAT, LEASE_SERVICE, OPERATOR, Role, Service, Topic
from protocol.wire.enums import AUTOPILOT_INVALID, TYPE_GCS, Command, LeaseAction, SystemState
from protocol.wire.message import Message
from protocol.wire.messages import CommandRequest, Heartbeat, LeaseRequest
from runtime.clock import Clock, Pulse, WallClock
from runtime.errors import AccessDeniedError, NoPeerError, PeerHangsError, RemoteError
from runtime.units import NS_PER_S
from runtime.watchdog import Patience, load_words, slowdown_in

M = TypeVar("M", bound=Message)
LISTEN_NS: Final = 700_000_000
END_NS: Final = 300_000_000
ALIVE: Final = Heartbeat(
    type=TYPE_GCS,
    autopilot=AUTOPILOT_INVALID,
    base_mode=0,
    custom_mode=0,
    system_status=SystemState.ACTIVE,
    mavlink_version=3,
)


class UnansweredError(RemoteError):
    """A robot did not answer; the message names the process that is missing or hangs."""

    exit_code = 1


def run_exchange(
    bus: ServiceCaller, clock: Clock, robot: str, exchange: Exchange[Any], service: Service
) -> None:
    """Send the requests of an exchange to a robot's service until the exchange is over."""
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
    """Sends requests and the operator's heartbeat to one robot."""

    def __init__(self, bus: Bus, common: Common, clock: Clock) -> None:
        self.bus = bus
        self.common = common
        self.robot = common.robot
        self.clock = clock
        self.ids = RequestIds()
        self.pulse = Pulse()
        self.endpoint = common.endpoint
        self._slowdown = slowdown_in(clock)
        self._heartbeat: Publisher[Heartbeat] | None = None

    def to(self, robot: str) -> "Link":
        """Return a link to another robot on the same bus."""
        return Link(self.bus, replace(self.common, robot=robot), self.clock)

    def command(
        self, command: Command, param1: float = 0.0, param2: float = 0.0, param3: float = 0.0
    ) -> CommandRequest:
        """Return a command with an id of its own."""
        return CommandRequest(
            request_id=self.ids.next(),
            param1=param1,
            param2=param2,
            command=command,
            param3=param3,
        )

    def ask(
        self,
        request: Request,
        *,
        attempts: int = ATTEMPTS,
        patience_ns: int | None = None,
        service: Service = COMMAND,
    ) -> Answer:
        """Send a request until it is answered; return the answer.

        Without a time limit for each, there are more attempts while this machine is busy; the robot
        ignores each one that arrives later than its sender waits. Raises UnansweredError, which
        names the process that is missing or hangs.
        """
        if patience_ns is None:
            attempts, patience_ns = round(attempts * self._slowdown()), PATIENCE_NS
        asking = CommandExchange(
            request, self.clock.now_ns(), attempts=attempts, patience_ns=patience_ns
        )
        run_exchange(self.bus, self.clock, self.robot, asking, service)
        if asking.outcome is None or isinstance(asking.outcome, GaveUp):
            raise self.unanswered(asking.outcome)
        if isinstance(asking.outcome, Refused):
            return replace(asking.outcome, remedies=self.common.remedies)
        return asking.outcome

    def exchange(self, exchange: Exchange[Any], service: Service) -> None:
        """Send the requests of an exchange to a service until it is over."""
        run_exchange(self.bus, self.clock, self.robot, exchange, service)

    def unanswered(self, outcome: GaveUp | None) -> UnansweredError:
        """Return the error for an exchange without an outcome."""
        if why_not := denial(self.bus.holder, self.robot, COMMAND):
            return UnansweredError(f"{why_not}: {self.common.remedies.keys}")
        why = "no answer" if outcome is None else outcome.why
        return UnansweredError(f"{self.diagnosis()} ({why})")

    def beat(self) -> None:
        """Publish the operator's heartbeat once."""
        if self._heartbeat is None:
            self._heartbeat = self.bus.publisher(OPERATOR, self.robot)
            self.bus.await_matched([self._heartbeat], timeout_s=0.5)
        self._heartbeat.put(ALIVE)

    def processes(self) -> PresentProcesses:
        """Return the announced processes; a busy machine has more time to answer."""
        return present_processes(self.bus.present(self._slowdown()))

    def diagnosis(self) -> str:
        """Explain why the robot does not answer; listens for its heartbeat for up to 0.7 s.

        Listens longer while this machine is busy.
        """
        with self.subscribed(HEARTBEAT) as telemetry:
            box = telemetry.boxes()[HEARTBEAT.path]
            self.wait(lambda: box.latest() is not None or box.rejected > 0, LISTEN_NS)
            is_beating = box.latest() is not None
            if box.rejected and not is_beating:
                return f"robot {self.robot} runs, but its heartbeat {box.last_rejection}"
        present = self.processes()
        why = self.bus.lost() or explain_silence(
            present,
            self.robot,
            self.endpoint,
            is_beating=is_beating,
            other=self.common.remedies.robot,
        )
        return why + load_words(self._slowdown())

    @contextmanager
    def subscribed(self, *topics: Topic[Any]) -> Iterator[Telemetry]:
        """Subscribe to topics of the robot for the duration of the context."""
        telemetry = Telemetry(self.bus, self.robot, topics, notify=self.pulse.beat)
        try:
            yield telemetry
        finally:
            for box in telemetry.boxes().values():
                self.bus.unsubscribe(box)

    def newest(self, topic: Topic[M], patience_ns: int) -> M | None:
        """Return the next message of a topic; None if none arrives in time."""
        with self.subscribed(topic) as telemetry:
            self.wait(lambda: telemetry.latest(topic) is not None, patience_ns)
            found = telemetry.latest(topic)
            return None if found is None else found[0]

    def wait(self, condition: Callable[[], bool], patience_ns: int) -> bool:
        """Wait until the condition holds, checked at each arrival; return False when time is up.

        The time counts less while this machine is busy.
        """
        patience = Patience(patience_ns, self.clock.now_ns, self._slowdown)
        while not condition():
            left_ns = patience.left_ns()
            if not left_ns:
                return False
            self.pulse.wait_until(self.clock.now_ns() + left_ns)
        return True


def ask_lease(link: Link, action: LeaseAction, name: str) -> Answer:
    """Request the lease, or give it back, under an operator's name."""
    request = LeaseRequest(request_id=link.ids.next(), action=action, name=name)
    return link.ask(request, service=LEASE_SERVICE)


@contextmanager
def open_link(common: Common) -> Iterator[Link]:
    """Connect to the robot; UnansweredError if no process listens at the endpoint."""
    try:
        bus = open_bus(common.network, Role.GROUND, common.robot)
    except (PeerHangsError, AccessDeniedError) as error:
        raise UnansweredError(str(error)) from error
    except NoPeerError as error:
        raise UnansweredError(f"no robot and no router: {error}; {common.hint}") from error
    with bus:
        yield Link(bus, common, WallClock())
