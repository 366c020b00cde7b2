"""Clients of a robot whose bus answers from a script, on a manual clock."""

from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from io import StringIO
from typing import Any, TypeVar
from unittest.mock import patch
from weakref import finalize

from checks.harness.loop import PlayedLoop
from checks.harness.messages import make
from ground.client import robot_link
from ground.client.connection import Common
from ground.client.floor import Floor
from ground.client.leases import Leasing
from ground.client.requests import NO_COMMAND, Request, command_of
from ground.robot import Robot
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
from tests.support.ground.station import ThreadAtOnce, end
from tests.support.played_bus import PlayedBus, PlayedQuery

T = TypeVar("T")
AT = Network(mode="client", connect=("tcp/127.0.0.1:1",))

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
    """The client of a robot over a scripted bus; what waits or blocks takes no real time.

    It takes the lease for the drives that it follows, or another part does, if it is `attended`.
    """

    def __init__(self, *script: Reply, attended: bool = False) -> None:
        self.clock = ManualClock(1_000 * MS)
        self.bus = ScriptedBus(self.clock, script)
        self.common = Common(network=AT, robot="r1")
        self.notes = Notes()
        self.floor: Floor | None = None
        self.robot = Robot(
            self.bus,
            self.common,
            clock=self.clock,
            leasing=Leasing.NEVER if attended else Leasing.DRIVES,
            follows=not attended,
            progress=self.notes,
            floor=lambda: self.floor,
        )
        self._loop = PlayedLoop(self.clock)
        finalize(self, end, self._loop)

    def run(self, work: Coroutine[Any, Any, T]) -> T:
        """Run a coroutine to its end."""
        return run_on(self._loop, work)


def run_on(loop: PlayedLoop, work: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine to its end; what it would do in a thread is done at once."""
    with patch.object(robot_link, "Thread", ThreadAtOnce):
        return loop.run(work)


def perform(command: Any, stage: Stage) -> Any:
    """Carry out a command on the robot of a stage."""
    return stage.run(command.perform(stage.robot))


def ack(request: Message | None, reason: Reason) -> CommandAck:
    """Return a robot's acknowledgement of a command, a goal or a lease request."""
    command = command_of(request) if isinstance(request, Request) else NO_COMMAND
    result = AckResult.DENIED if reason else AckResult.ACCEPTED
    return CommandAck(command=command, result=result, result_param2=reason)


def lease_of(name: str) -> LeaseStatus:
    return LeaseStatus(time_ns=1, lapses_ms=2000, held=1, holder=f"{name}/1", name=name)


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
