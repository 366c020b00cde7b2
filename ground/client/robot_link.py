"""The link to one robot on an event loop: its requests, its messages, and why it is silent.

What waits is a coroutine; what blocks runs in a thread of its own. No request that was sent is
withdrawn by a cancellation.
"""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from threading import Thread
from typing import Any, Final, NamedTuple, TypeVar

from msgspec import structs

from ground.client.connection import Common
from ground.client.events import EventStream
from ground.client.lease_holder import holder_name, is_ours
from ground.client.outcomes import Accepted, Answer
from ground.client.presence import PresentProcesses, explain_silence, present_processes
from ground.client.requests import (
    ATTEMPTS,
    PATIENCE_NS,
    CommandExchange,
    Exchange,
    GaveUp,
    R,
    Request,
    RequestIds,
)
from ground.client.streams import CLOSED, QUEUE, ClosedError, Stream, TopicStreams
from ground.client.telemetry import Telemetry
from protocol.bus.bus import Bus, open_bus
from protocol.bus.rights import denial
from protocol.topics import (
    COMMAND,
    DECISION,
    HEARTBEAT,
    LEASE,
    ODOMETRY,
    SONAR,
    STATUS,
    Role,
    Service,
    Topic,
)
from protocol.wire.enums import Command
from protocol.wire.message import Message
from protocol.wire.messages import (
    AvoidanceDecision,
    CommandRequest,
    GoalRequest,
    NavigatorStatus,
    PlanarOdometry,
    SonarScan,
)
from protocol.wire.reasons import Reason
from runtime.clock import Clock, WallClock
from runtime.errors import (
    AccessDeniedError,
    NoAnswerError,
    NoPeerError,
    PeerHangsError,
    RemoteError,
)
from runtime.units import NS_PER_MS, NS_PER_S
from runtime.watchdog import Patience, load_words, slowdown_in

T = TypeVar("T")
M = TypeVar("M", bound=Message)
Out = TypeVar("Out")
Reply = Message | bytes | Exception
"""The answer to a query, or why there is none."""

REQUESTS: Final = 4
"""Number of concurrent requests; further ones wait. Emergency stops do not."""
GRACE_S: Final = 1.0
"""Time after which a query that the bus has forgotten counts as unanswered."""
LISTEN_NS: Final = 700 * NS_PER_MS
"""Longest wait for what a robot that runs publishes at once."""
NEWEST_NS: Final = NS_PER_S
"""Longest wait for a stream of the robot."""
LEASE_NS: Final = 1_500 * NS_PER_MS
"""A robot publishes the status of its lease twice a second."""


class UnansweredError(RemoteError):
    """A robot did not answer; the message names the process that is missing or hangs."""

    exit_code = 1


class Drive:
    """A drive that this program begins, follows and ends."""

    def __init__(self) -> None:
        self.request_id = 0
        """That of the newest request that may have begun it; 0 before the first."""
        self.sending: asyncio.Future[Answer] | None = None
        self.ended = asyncio.Event()

    def sent_by(self, sending: "asyncio.Future[Answer]") -> None:
        """Note what sends its requests."""
        self.sending = sending

    def begun_by(self, request: R) -> R:
        """Note that a request which is now sent may begin the drive."""
        self.request_id = request.request_id
        return request


class Heard(NamedTuple):
    """What a robot sent within a short time; `rejection`: why its heartbeat could not be read."""

    is_beating: bool
    has_status: bool
    rejection: str

    @property
    def stands(self) -> bool:
        """True if no simulated time passes for it: its status comes with each control cycle."""
        return self.is_beating and not self.has_status


class RobotLink:
    """Asks one robot, and receives its messages."""

    def __init__(
        self, bus: Bus, common: Common, clock: Clock | None = None, sender: str = ""
    ) -> None:
        self.name = common.robot
        self._sender = sender
        self.bus = bus
        self.clock: Clock = WallClock() if clock is None else clock
        self.remedies = common.remedies
        self.streams = TopicStreams(bus, self.name)
        self.common = common
        self.ids = RequestIds()
        self._slowdown = slowdown_in(self.clock)
        self._loop: asyncio.AbstractEventLoop | None = None
        """The loop in which something waits for messages, once it has."""

        self._arrivals: set[asyncio.Future[None]] = set()
        """What waits for the next message."""

        self._has_arrived = False
        self._slots = asyncio.Semaphore(REQUESTS)
        self._under_way: set[asyncio.Future[Any]] = set()
        """What ends by itself; the event loop would forget it."""

        self._is_closed = False

    def to(self, robot: str) -> "RobotLink":
        """Return a link to another robot on the same bus."""
        return RobotLink(self.bus, replace(self.common, robot=robot), self.clock, self.sender)

    @property
    def sender(self) -> str:
        """The name under which this program asks, shown to other operators; empty for none."""
        return self._sender

    @property
    def endpoint(self) -> str:
        """The endpoints that were dialled, separated by commas."""
        return self.common.endpoint

    def check_open(self) -> None:
        """Raise ClosedError after the end of `connect`."""
        if self._is_closed:
            raise ClosedError(CLOSED)

    # Requests.

    def request(
        self, command: Command, param1: float = 0.0, param2: float = 0.0, param3: float = 0.0
    ) -> CommandRequest:
        """Return a request with an id of its own."""
        return CommandRequest(
            request_id=self.ids.next(),
            param1=param1,
            param2=param2,
            command=command,
            param3=param3,
        )

    async def ask(
        self,
        request: Request,
        *,
        attempts: int = ATTEMPTS,
        patience_ns: int | None = None,
        service: Service = COMMAND,
    ) -> Answer:
        """Send a request until it is answered; a refusal for the lease names its holder.

        Without a time limit for each, there are more attempts while this machine is busy; the robot
        ignores each one that arrives later than its sender waits.
        """
        if patience_ns is None:
            attempts, patience_ns = round(attempts * self._slowdown()), PATIENCE_NS
        asking = CommandExchange(
            request, self.clock.now_ns(), attempts=attempts, patience_ns=patience_ns
        )
        answer = await self.exchange(asking, service)
        if isinstance(answer, Accepted):
            return answer
        holder = await self.refusing_holder(answer.reason)
        return replace(answer, holder=holder, remedies=self.remedies)

    async def exchange(self, exchange: Exchange[Out], service: Service) -> Out:
        """Send the requests of an exchange until it is over; return its outcome.

        To cancel this does not withdraw a request that was sent, nor end its repetition. Raises
        UnansweredError, which names the process that is missing or hangs.
        """
        self.check_open()
        outcome = await self.uninterrupted(self._slots, partial(self.carry, exchange, service))
        if outcome is None or isinstance(outcome, GaveUp):
            raise await self.unanswered(outcome, service)
        return outcome

    async def carry(self, exchange: Exchange[Out], service: Service) -> Out | GaveUp | None:
        """Send the requests of an exchange until it is over; its outcome may be that it gave up."""
        while not exchange.over:
            for send in exchange.due(self.clock.now_ns()):
                try:
                    answer = await self.answer(service, send.request, send.patience_ns / NS_PER_S)
                except RemoteError as error:
                    exchange.unanswered(str(error))
                else:
                    exchange.receive(answer, self.clock.now_ns())
            if not exchange.over:
                await self.sleep_until(exchange.next_ns)
        return exchange.outcome

    async def answer(
        self, service: Service, message: Message | None, timeout_s: float
    ) -> Message | bytes:
        """Return the answer of a service of the robot; NoAnswerError has the cause without one."""
        loop = asyncio.get_running_loop()
        if isinstance(message, CommandRequest | GoalRequest):
            message = structs.replace(message, sender=self.sender)
        steps = self.bus.requester.steps(service, message, timeout_s, self.name)
        answer: Reply
        try:
            query = next(steps)
            while True:
                replied: asyncio.Future[Reply] = loop.create_future()
                self.bus.requester.send(query, partial(call_soon, loop, settle, replied))
                try:
                    async with asyncio.timeout(query.timeout_s + GRACE_S):
                        answer = await replied
                except TimeoutError:
                    why = f"no answer within {query.patience_s:.2g} s"
                    answer = NoAnswerError(f"{query.service.path}: {why}")
                query = steps.throw(answer) if isinstance(answer, Exception) else steps.send(answer)
        except StopIteration as end:
            result: Message | bytes = end.value
            return result

    async def refusing_holder(self, reason: int) -> str:
        """Return the name of the lease holder if `reason` is that another one holds it, else "".

        The lease may have passed to this person since, who then is not the other one.
        """
        if reason != Reason.LEASE_HELD:
            return ""
        newest = await self.newest(LEASE, LEASE_NS)
        if newest is None or not newest.held or is_ours(newest, self.bus.operator):
            return ""
        return holder_name(newest)

    async def unanswered(self, outcome: GaveUp | None, service: Service) -> UnansweredError:
        """Return the error for an exchange without an outcome."""
        if why_not := denial(self.bus.holder, self.name, service):
            return UnansweredError(f"{why_not}: {self.remedies.keys}")
        why = "no answer" if outcome is None else outcome.why
        return UnansweredError(f"{await self.diagnosis()} ({why})")

    async def diagnosis(self) -> str:
        """Explain why the robot does not answer; listens to it for up to 0.7 s.

        Listens longer while this machine is busy.
        """
        heard = await self._hear()
        if heard.rejection and not heard.is_beating:
            return f"robot {self.name} runs, but its heartbeat {heard.rejection}"
        return await self.in_own_thread(lambda: self._silence(heard))

    async def standstill(self) -> str:
        """Return why no simulated time passes for the robot, and what to do; "" while it does."""
        heard = await self._hear(status_is_enough=True)
        return await self.in_own_thread(lambda: self._silence(heard)) if heard.stands else ""

    async def _hear(self, *, status_is_enough: bool = False) -> Heard:
        with self.subscribed(HEARTBEAT, STATUS) as telemetry:
            box = telemetry.boxes()[HEARTBEAT.path]

            def heard() -> Heard:
                is_beating = box.latest() is not None
                has_status = telemetry.live(STATUS, self.clock.now_ns()) is not None
                return Heard(is_beating, has_status, box.last_rejection if box.rejected else "")

            def is_clear() -> bool:
                is_beating, has_status, _ = heard()
                return (has_status and (status_is_enough or is_beating)) or box.rejected > 0

            await self.wait(is_clear, LISTEN_NS)
            return heard()

    def _silence(self, heard: Heard) -> str:
        """Explain it by what is linked; blocks."""
        present = self.processes()
        why = self.bus.lost() or explain_silence(
            present,
            self.name,
            self.endpoint,
            is_beating=heard.is_beating,
            has_status=heard.has_status,
            other=self.remedies.robot,
            keys=self.common.keys,
        )
        may_be_slow = present.has(self.name, Role.ROBOT) and not heard.stands
        return why + load_words(self._slowdown()) if may_be_slow else why

    def processes(self) -> PresentProcesses:
        """Return the announced processes; blocks, longer on a busy machine."""
        return present_processes(self.bus.present())

    # What arrives.

    @contextmanager
    def subscribed(self, *topics: Topic[Any]) -> Iterator[Telemetry]:
        """Subscribe to topics of the robot for the duration of the context."""
        telemetry = Telemetry(self.bus, self.name, topics, notify=self.note_arrival)
        try:
            yield telemetry
        finally:
            for box in telemetry.boxes().values():
                self.bus.unsubscribe(box)

    async def newest(self, topic: Topic[M], patience_ns: int) -> M | None:
        """Return the next message of a topic; None if none arrives in time."""
        with self.subscribed(topic) as telemetry:
            await self.wait(lambda: telemetry.latest(topic) is not None, patience_ns)
            newest = telemetry.latest(topic)
            return None if newest is None else newest[0]

    async def fresh(self, topic: Topic[M]) -> M | None:
        """Return a message that is not stale; None if none arrives in time."""
        with self.subscribed(topic) as telemetry:

            def newest() -> M | None:
                return telemetry.fresh(topic, self.clock.now_ns())

            await self.wait(lambda: newest() is not None, NEWEST_NS)
            return newest()

    async def wait(self, condition: Callable[[], bool], patience_ns: int) -> bool:
        """Wait until the condition holds, checked at each arrival; return False when time is up.

        The time counts less while this machine is busy.
        """
        patience = Patience(patience_ns, self.clock.now_ns, self._slowdown)
        while not condition():
            left_ns = patience.left_ns()
            if not left_ns:
                return False
            await self.arrival(self.clock.now_ns() + left_ns)
        return True

    # Streams; each call returns a separate one, which begins now.

    def stream(self, topic: Topic[M], *, size: int = QUEUE) -> Stream[M]:
        """Return every message of a topic; at most `size` wait, then the oldest are dropped."""
        return self.streams.stream(topic, size)

    def status(self, *, size: int = QUEUE) -> Stream[NavigatorStatus]:
        """Return vehicle state, mode and goal, 20 times a second."""
        return self.stream(STATUS, size=size)

    def odometry(self, *, size: int = QUEUE) -> Stream[PlanarOdometry]:
        """Return the estimated pose (m, rad), speed (m/s, rad/s) and covariance at 20 Hz."""
        return self.stream(ODOMETRY, size=size)

    def sonar(self, *, size: int = QUEUE) -> Stream[SonarScan]:
        """Return the ranges (mm) of the eight sonars, from right to left, 20 times a second."""
        return self.stream(SONAR, size=size)

    def decisions(self, *, size: int = QUEUE) -> Stream[AvoidanceDecision]:
        """Return the navigator's inputs and its decision, 20 times a second."""
        return self.stream(DECISION, size=size)

    def events(self, *, size: int = QUEUE) -> EventStream:
        """Return changes of vehicle, mode, goal, lease and mission, and the robot's texts.

        The present state comes first, as changes.
        """
        return EventStream(self.streams, self.bus.operator or "", size)

    # The event loop.

    async def sleep_until(self, deadline_ns: int) -> None:
        """Wait until the clock has reached the deadline."""
        await asyncio.sleep(max(0, deadline_ns - self.clock.now_ns()) / NS_PER_S)

    async def arrival(self, until_ns: int) -> None:
        """Wait for the next message that is noted, at most until the clock shows this."""
        loop = self._loop = asyncio.get_running_loop()
        arrival = loop.create_future()
        self._arrivals.add(arrival)
        left_s = max(0, until_ns - self.clock.now_ns()) / NS_PER_S
        timer = loop.call_later(left_s, settle, arrival, None)
        try:
            await arrival
        finally:
            timer.cancel()
            self._arrivals.discard(arrival)

    def note_arrival(self, _arrived_ns: int) -> None:
        """Wake what waits for messages; the `notify` of mailboxes, called in the bus's thread."""
        if not self._has_arrived and self._loop is not None:
            self._has_arrived = True
            call_soon(self._loop, self._wake)

    def _wake(self) -> None:
        self._has_arrived = False
        for arrival in self._arrivals:
            settle(arrival, None)

    async def in_own_thread(self, job: Callable[[], T]) -> T:
        """Run what blocks in a thread of its own, which outlives a cancellation."""
        return await in_own_thread(job, f"sidestep {self.name}")

    async def uninterrupted(
        self,
        gate: asyncio.Lock | asyncio.Semaphore,
        work: Callable[[], Coroutine[Any, Any, T]],
        started: Callable[[asyncio.Future[T]], object] = lambda _: None,
    ) -> T:
        """Begin work when the gate lets it pass, and carry it to its end, cancelled or not."""
        await gate.acquire()
        working = asyncio.ensure_future(work())
        self._under_way.add(working)

        def end(_: object) -> None:
            self._under_way.discard(working)
            gate.release()

        working.add_done_callback(end)
        started(working)
        return await asyncio.shield(working)


def settle(future: "asyncio.Future[T]", result: T) -> None:
    """End a wait, unless it has ended."""
    if not future.done():
        future.set_result(result)


def call_soon(
    loop: asyncio.AbstractEventLoop, call: Callable[..., object], *values: object
) -> None:
    """Call a function in the loop, from any thread; a loop that has ended calls nothing."""
    with suppress(RuntimeError):
        loop.call_soon_threadsafe(call, *values)


def in_own_thread(job: Callable[[], T], name: str) -> "asyncio.Future[T]":
    """Run a job in a thread of its own, which outlives a cancellation."""
    future: Future[T] = Future()
    future.set_running_or_notify_cancel()  # from now on no cancelled wait takes its result away

    def work() -> None:
        try:
            result = job()
        except BaseException as error:
            future.set_exception(error)
        else:
            future.set_result(result)

    try:
        Thread(target=work, name=name, daemon=True).start()
    except RuntimeError as error:  # this system can make no thread now
        future.set_exception(error)
    return asyncio.wrap_future(future)


async def finish(work: Coroutine[Any, Any, T]) -> T:
    """Await the work to its end, even if the caller is cancelled meanwhile."""
    task = asyncio.ensure_future(work)
    while not task.done():
        try:
            await asyncio.shield(task)
        except asyncio.CancelledError:
            continue
    return task.result()


async def settled(work: Awaitable[Any]) -> None:
    """Wait until the work has ended, by a result, an error or a cancellation."""
    await asyncio.gather(work, return_exceptions=True)


@contextmanager
def open_link(common: Common) -> Iterator[RobotLink]:
    """Connect to the robot; UnansweredError if no process listens at the endpoint."""
    try:
        bus = open_bus(common.network, Role.GROUND, common.robot)
    except (PeerHangsError, AccessDeniedError) as error:
        raise UnansweredError(str(error)) from error
    except NoPeerError as error:
        raise UnansweredError(f"no robot and no router: {error}; {common.hint}") from error
    with bus:
        yield RobotLink(bus, common)
