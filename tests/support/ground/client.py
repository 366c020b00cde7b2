"""Links whose bus answers from a script or a list, on a manual clock."""

from collections.abc import Callable, Sequence
from functools import partial
from io import StringIO
from typing import Any

from checks.harness.messages import make
from ground.client.connection import Common
from ground.client.link import Link
from ground.client.requests import NO_COMMAND, Request, command_of
from ground.client.session import Session
from ground.text.output import Output
from ground.text.wording import Part, in_words
from protocol.bus.network import Network
from protocol.topics import LEASE, STATUS, Service
from protocol.wire.enums import AckResult, Vehicle
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CycleReport,
    LeaseStatus,
    NavigatorStatus,
)
from protocol.wire.reasons import Reason
from runtime.clock import ManualClock
from runtime.errors import NoAnswerError
from runtime.units import NS_PER_MS as MS
from tests.support.played_bus import PlayedBus, PlayedQuery

ANSWER_NS = 14 * MS

Reply = Message | bytes | Reason | None
IN_PROGRESS = CommandAck(command=0, result=AckResult.IN_PROGRESS)
CYCLE = make(CycleReport, time_ns=1, tick=100, budget_us=1, stage_us=(1, 1, 1, 1, 1))


class ScriptedBus(PlayedBus):
    """Answers each request by the next item of `script`; None is a lost reply.

    Once the script is over, all commands are accepted.
    """

    operator = "open/0a"
    has_history = True

    def __init__(self, clock: ManualClock, script: Sequence[Reply]) -> None:
        super().__init__(clock)
        self.clock = clock
        self.script = list(script)
        self.held: list[Callable[[], None]] | None = None
        """What gives each answer, if the test holds them."""
        self.on_ask: Callable[[int], None] = lambda _number: None
        """Called with the number of each request, before it is answered."""

    def ask(
        self,
        service: Service,
        message: Message | None = None,
        timeout_s: float = 0.5,
        robot: str | None = None,
    ) -> Message | bytes:
        self.asked.append((robot or self.robot, service.path, message))
        self.on_ask(len(self.asked))
        reply = self.script.pop(0) if self.script else Reason.NONE
        if reply is None:
            self.clock.advance(round(timeout_s * 1e9))
            raise NoAnswerError("no answer within the time")
        self.clock.advance(ANSWER_NS)
        return ack(message, reply) if isinstance(reply, Reason) else reply

    def send(self, query: PlayedQuery, done: Callable[[object], object]) -> None:
        """Answer at once, or when the test does, if it holds the answers."""
        if self.held is not None:
            self.held.append(partial(super().send, query, done))
            return
        super().send(query, done)

    @property
    def requests(self) -> list[Any]:
        return [message for *_, message in self.asked]


class Pulse:
    """A pulse whose waiting advances the clock."""

    def __init__(self, clock: ManualClock) -> None:
        self._clock = clock

    def beat(self, now_ns: int) -> None:
        """Ignore it: nothing arrives by itself."""

    def wait_until(self, deadline_ns: int) -> None:
        self._clock.sleep_until(deadline_ns)


class Notes:
    """A progress display that records notes and lines."""

    live = False

    def __init__(self) -> None:
        self.notes: list[str] = []
        self.lines: list[str] = []

    def note(self, text: str) -> None:
        self.notes.append(text)

    def line(self, parts: Sequence[Part]) -> None:
        self.lines.append(in_words(parts))


class Stage:
    """A session over a scripted bus."""

    def __init__(self, *script: Reply, attended: bool = False) -> None:
        self.clock = ManualClock(1_000 * MS)
        self.bus = ScriptedBus(self.clock, script)
        network = Network(mode="client", connect=("tcp/127.0.0.1:1",))
        self.link = Link(self.bus, Common(network=network, robot="r1"), self.clock)
        self.link.pulse = Pulse(self.clock)  # type: ignore[assignment]
        self.notes = Notes()
        self.session = Session(self.link, self.notes, attended=attended)


def ack(request: Message | None, reason: Reason) -> CommandAck:
    """Return a robot's acknowledgement of a command, a goal or a lease request."""
    command = command_of(request) if isinstance(request, Request) else NO_COMMAND
    result = AckResult.DENIED if reason else AckResult.ACCEPTED
    return CommandAck(command=command, result=result, result_param2=reason)


def lease_of(name: str) -> LeaseStatus:
    return LeaseStatus(time_ns=1, lapses_ms=2000, held=1, holder="beef/1", name=name)


def status(vehicle: Vehicle = Vehicle.ACTIVE, **changes: Any) -> NavigatorStatus:
    return make(
        NavigatorStatus, **({"time_ns": 1, "vehicle": vehicle, "goal_distance_m": 1.5} | changes)
    )


HELD = (LEASE, lease_of("anna"))
STANDBY = (STATUS, status(Vehicle.STANDBY))


def captured_output() -> tuple[Output, Callable[[], tuple[str, str]]]:
    """Return an output that writes to memory, and a function that returns result and notes."""
    out, err = StringIO(), StringIO()
    return Output(as_json=False, out=out, err=err), lambda: (out.getvalue(), err.getvalue())
