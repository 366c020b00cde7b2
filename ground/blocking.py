"""A robot without an event loop, for the faces that still work in threads."""

from collections.abc import Callable, Coroutine, Sequence
from contextlib import closing
from inspect import iscoroutinefunction
from typing import Any, Protocol, TypeVar, overload

from ground.client import stop_ways
from ground.client.emergency_stop import EmergencyStop
from ground.client.lease_holder import operator_name
from ground.client.leases import Leases, Leasing
from ground.client.link import Link
from ground.client.outcomes import AllAnswered, Operation, Outcome, Stopped
from ground.client.requests import GaveUp
from ground.client.session import Session
from ground.client.stopping import at_once, stop_all
from ground.robot import STOP_S, Robot
from protocol.topics import COMMAND, STATUS, STOP, Service
from protocol.wire.message import Message
from protocol.wire.messages import NavigatorStatus
from runtime.units import NS_PER_S

T = TypeVar("T")
Out = TypeVar("Out", bound=Outcome)
Out_co = TypeVar("Out_co", bound=Outcome, covariant=True)


class BlockingLeases(Leases):
    """Sends the heartbeat when it is asked to, because no task does."""

    def __init__(self, robot: Robot, link: Link) -> None:
        super().__init__(robot, operator_name(None), robot.lease.leasing)
        self._sender = link

    def beat(self) -> None:
        """Send the heartbeat once."""
        self._sender.beat()

    attend = beat

    async def open(self, *_: object) -> None:
        """Begin nothing: the heartbeat is sent when it is asked for."""


class BlockingRobot(Robot):
    """Waits by blocking the thread that commands it, so that no coroutine of it ever suspends.

    In an attended session another part takes the lease and follows the goal.
    """

    def __init__(self, session: Session) -> None:
        link = session.link
        super().__init__(
            link.bus,
            link.common,
            clock=link.clock,
            leasing=Leasing.NEVER if session.attended else Leasing.DRIVES,
            follows=not session.attended,
            progress=session.progress,
            floor=session.floor,
        )
        self._link = link
        self.lease = BlockingLeases(self, link)

    async def _answer(
        self, service: Service, message: Message | None, timeout_s: float
    ) -> Message | bytes:
        return self.bus.ask(service, message, timeout_s, robot=self.name)

    async def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until the clock has reached the deadline."""
        self.clock.sleep_until(deadline_ns)

    async def _arrival(self, until_ns: int) -> None:
        self._link.pulse.wait_until(until_ns)

    def _note_arrival(self, arrived_ns: int) -> None:
        self._link.pulse.beat(arrived_ns)

    async def in_own_thread(self, job: Callable[[], T]) -> T:
        """Run it in this thread."""
        return job()

    async def at_once(self, works: Sequence[Callable[[], Coroutine[Any, Any, T]]]) -> list[T]:
        """Run each in a thread of its own."""
        return at_once(lambda work: run_blocking(work()), works)

    def to(self, robot: str) -> Robot:
        """Return another robot on the same bus, whose lease is not taken."""
        return BlockingRobot(Session(self._link.to(robot), attended=True))

    async def emergency_stop(self, *, timeout_s: float = STOP_S) -> Stopped:
        """Repeat the stop by an open session and all other ways.

        Raises UnansweredError if no status arrives from the robot.
        """
        with (
            self.subscribed(STATUS) as telemetry,
            closing(stop_ways.ways_of(self.bus, self.name)) as ways,
        ):

            def newest() -> tuple[NavigatorStatus, int] | None:
                return telemetry.latest(STATUS)

            publisher = self.bus.publisher(STOP, self.name)
            stop = EmergencyStop(self.bus, publisher, self.name, self.clock, newest, ways)
            outcome = stop.run(give_up_ns=round(timeout_s * NS_PER_S))
            is_silent = newest() is None
        if is_silent and not outcome.acknowledged:
            raise await self.unanswered(GaveUp(outcome.why), COMMAND)
        return Stopped(outcome, self.name)

    async def emergency_stop_all(self, *, timeout_s: float = STOP_S) -> AllAnswered:
        """Stop the robots that are known by name at once, then all that are present."""
        return stop_all(self._link, round(timeout_s * NS_PER_S))

    async def uninterrupted(
        self, _gate: object, work: Callable[[], Coroutine[Any, Any, T]], _started: object = None
    ) -> T:
        """Do it at once."""
        return await work()

    async def finish(self, work: Coroutine[Any, Any, T]) -> T:
        """Do it at once."""
        return await work


def run_blocking(work: Coroutine[Any, Any, T]) -> T:
    """Run a coroutine of a blocking robot to its end."""
    try:
        work.send(None)
    except StopIteration as ended:
        result: T = ended.value
        return result
    work.close()
    raise RuntimeError("a coroutine of a blocking robot waits for an event loop")


class OnSession(Protocol[Out_co]):
    """An operation that has not moved to a robot yet."""

    def perform(self, session: Session, /) -> Out_co:
        """Carry it out."""


class OnRobot(Protocol[Out_co]):
    """A command that waits for its robot."""

    async def perform(self, robot: Robot, /) -> Out_co:
        """Carry it out."""


@overload
def perform(operation: OnSession[Out], session: Session) -> Out: ...
@overload
def perform(operation: OnRobot[Out], session: Session) -> Out: ...
@overload
def perform(operation: Operation[Out], session: Session) -> Out: ...
def perform(operation: Any, session: Session) -> Any:
    """Carry out an operation in this thread, on files, on a session or on a robot."""
    if getattr(operation, "is_offline", False):
        return operation.run(session.progress)
    if not iscoroutinefunction(operation.perform):
        return operation.perform(session)
    return run_blocking(operation.perform(BlockingRobot(session)))
