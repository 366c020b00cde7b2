"""The operator's connection to one robot: the thin I/O around `ground.operator`."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from ground.operator import (
    ATTEMPTS,
    PATIENCE_NS,
    Answered,
    Asking,
    GaveUp,
    Request,
    RequestIds,
    Send,
)
from ground.options import Common
from ground.presence import crew_of, why_silent
from protocol.bus import Bus, Publisher, open_bus
from protocol.clock import Clock, Pulse, WallClock
from protocol.enums import AUTOPILOT_INVALID, TYPE_GCS, Command, SystemState
from protocol.errors import NoPeer, PeerHangs, RemoteError
from protocol.messages import CommandAck, CommandRequest, Heartbeat
from protocol.topics import COMMAND, HEARTBEAT, OPERATOR, Role

NS_PER_S: Final = 1_000_000_000
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
        self, request: Request, *, attempts: int = ATTEMPTS, patience_ns: int = PATIENCE_NS
    ) -> Answered:
        """The robot's answer; Unanswered says who is missing when there is none."""
        asking = Asking(request, self.clock.now_ns(), attempts=attempts, patience_ns=patience_ns)
        while asking.outcome is None:
            for send in asking.due(self.clock.now_ns()):
                self._put(asking, send)
            if asking.outcome is None:
                self.clock.sleep_until(asking.next_ns)
        if isinstance(asking.outcome, GaveUp):
            raise Unanswered(f"{self.diagnosis()} ({asking.outcome.why})")
        return asking.outcome

    def _put(self, asking: Asking, send: Send) -> None:
        try:
            answer = self.bus.ask(
                COMMAND, send.request, send.patience_ns / NS_PER_S, robot=self.robot
            )
        except RemoteError as error:
            asking.unanswered(str(error))
            return
        if isinstance(answer, CommandAck):
            asking.receive(answer, self.clock.now_ns())
        else:
            asking.unanswered("the answer is no acknowledgement")

    def beat(self) -> None:
        """Let the robot hear that an operator is there."""
        if self._heart is None:
            self._heart = self.bus.publisher(OPERATOR, self.robot)
            self.bus.await_matched([self._heart], timeout_s=0.5)
        self._heart.put(ALIVE)

    def diagnosis(self) -> str:
        """Why the robot does not answer: listens for its heart before it judges."""
        box = self.bus.mailbox(HEARTBEAT, self.robot, self.pulse.beat)
        self.wait(lambda: box.latest() is not None or box.rejected > 0, LISTEN_NS)
        beats = box.latest() is not None
        if box.rejected and not beats:
            return f"robot {self.robot} is there, but its heartbeat {box.last_rejection}"
        crew = crew_of(self.bus.present())
        return self.bus.lost() or why_silent(crew, self.robot, self.endpoint, beats=beats)

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
    except PeerHangs as error:
        raise Unanswered(str(error)) from error
    except NoPeer as error:
        raise Unanswered(f"no robot and no router: {error}") from error
    with bus:
        yield Link(bus, common, WallClock())
