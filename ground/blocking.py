"""A robot without an event loop, for the faces that still work in threads."""

from collections.abc import Callable, Coroutine
from inspect import iscoroutinefunction
from typing import Any, Protocol, TypeVar, overload

from ground.client.lease_holder import operator_name
from ground.client.outcomes import Outcome
from ground.client.session import Operation, Session
from ground.robot import Leasing, Robot
from protocol.topics import Service
from protocol.wire.message import Message

T = TypeVar("T")
Out = TypeVar("Out", bound=Outcome)
Out_co = TypeVar("Out_co", bound=Outcome, covariant=True)


class BlockingRobot(Robot):
    """Waits by blocking the thread that commands it, so that no coroutine of it ever suspends.

    In an attended session another part takes the lease and follows the goal.
    """

    def __init__(self, session: Session) -> None:
        link = session.link
        super().__init__(
            link.bus,
            link.common,
            operator_name(None),
            clock=link.clock,
            leasing=Leasing.NEVER if session.attended else Leasing.DRIVES,
            follows=not session.attended,
            progress=session.progress,
            floor=session.floor,
        )
        self._link = link

    def beat(self) -> None:
        """Send the operator's heartbeat once."""
        self._link.beat()

    _attend = beat

    def _lease_granted(self) -> None:
        """Send no heartbeat for a lease that is only taken."""

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

    async def _uninterrupted(
        self, _gate: object, work: Callable[[], Coroutine[Any, Any, T]], _started: object = None
    ) -> T:
        return await work()

    async def _finish(self, work: Coroutine[Any, Any, T]) -> T:
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
