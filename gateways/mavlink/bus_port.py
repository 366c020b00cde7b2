"""The port to one robot over the bus: mailboxes for telemetry, and requests one after another."""

import asyncio
from collections.abc import Awaitable, Callable
from contextlib import AbstractAsyncContextManager, nullcontext, suppress
from contextvars import ContextVar
from functools import partial
from queue import SimpleQueue
from typing import Any, Final, Generic, TypeVar

from msgspec.structs import replace

from gateways.mavlink.robot_port import (
    NO_TELEMETRY,
    OVERTAKEN,
    STOPS,
    Answered,
    Refusal,
    Snapshot,
    StopPress,
    permitted,
)
from ground.client import stop_ways
from ground.client.emergency_stop import EmergencyStop
from ground.client.lease_holder import holder_name, is_ours
from ground.client.leases import ALIVE, Leases, Leasing
from ground.client.outcomes import Operation, Outcome, Stopped
from ground.client.robot_link import RobotLink, in_own_thread
from ground.client.telemetry import Telemetry
from ground.client.teleop_sender import TeleopSender
from ground.robot import STOP_S, Robot
from protocol.bus.mailbox import Mailbox
from protocol.bus.publisher import Publisher
from protocol.topics import (
    CYCLE,
    GATEWAY,
    HEARTBEAT,
    LEASE,
    MISSION,
    ODOMETRY,
    OPERATOR,
    SONAR,
    STATUS,
    STOP,
    TEXT,
    WHEELS,
    Topic,
)
from protocol.wire.codec import decode
from protocol.wire.enums import LeaseAction
from protocol.wire.message import Message
from protocol.wire.messages import GatewayStatus, Heartbeat, Statustext
from protocol.wire.reasons import Reason
from runtime.errors import LocalError, RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

M = TypeVar("M", bound=Message)
READY_S: Final = 0.5
SILENT_NS: Final = 1500 * NS_PER_MS
"""A robot that has been silent for so long is asked nothing, but to stop."""
MAX_WAITING: Final = 64
"""Requests that wait for the robot; more are refused."""
MAX_HALTS: Final = 64
"""Requests to stop that wait beside them."""
LATE_NS: Final = 3 * NS_PER_S
"""A request that moves the robot is refused after this wait: its client has given it up."""
BUSY: Final = "too many requests wait for the robot"
TOPICS: Final = (STATUS, ODOMETRY, SONAR, LEASE, MISSION, HEARTBEAT)
WHEELS_NS: Final = NS_PER_S
"""Time between two looks at the encoders, which tell whether the robot can be armed."""
NEEDED_NS: Final = 2 * NS_PER_S
LOAD_NS: Final = 10 * NS_PER_S
"""Time between two looks at the load of the robot, which changes slowly and costs 20 samples/s."""
MAX_ASKING: Final = 256
"""Presses of the stop that wait for an acknowledgement; more are sent, and get none."""
Job = Callable[[], Awaitable[Outcome]]
ASKING: ContextVar[str] = ContextVar("ASKING", default="")
"""The name of the client for which the task under way asks the robot."""


async def answered_by(job: Job, turn: AbstractAsyncContextManager[object]) -> Answered:
    """Return the end of a request when it has its turn; an error is an answer, too."""
    async with turn:
        try:
            return Answered(await job())
        except (LocalError, RemoteError) as error:
            return Answered(None, str(error))
        except Exception as error:  # such as one of the bus: without an answer, clients hang
            return Answered(None, f"{type(error).__name__}: {error}")


class StopLine:
    """Presses the stop; under a flood of presses, the newest one is repeated for all.

    `repeat` repeats a stop in another thread.
    """

    def __init__(
        self,
        new: Callable[[], EmergencyStop],
        repeat: Callable[[EmergencyStop], Awaitable[Outcome]],
    ) -> None:
        self.repeating: asyncio.Task[None] | None = None
        self._new = new
        self._repeat = repeat
        self._newest: EmergencyStop | None = None
        self._asking: list[asyncio.Future[Answered]] = []

    @property
    def is_repeating(self) -> bool:
        """True while a stop is repeated."""
        return self.repeating is not None and not self.repeating.done()

    def press(self) -> StopPress:
        """Send a stop at once, whatever else waits, and repeat it."""
        stop = self._new()
        stop.press()
        self._newest = stop
        loop, ended = asyncio.get_running_loop(), None
        if len(self._asking) < MAX_ASKING:
            ended = loop.create_future()
            self._asking.append(ended)
        if not self.is_repeating:
            self.repeating = loop.create_task(self._repeat_newest())
        return StopPress(stop.request_id, ended)

    async def _repeat_newest(self) -> None:
        """Repeat the newest stop for all that have pressed since the last repetition began."""
        while (stop := self._newest) is not None:
            asking, self._newest, self._asking = self._asking, None, []
            answered = await answered_by(partial(self._repeat, stop), nullcontext())
            for ended in asking:
                if not ended.done():
                    ended.set_result(answered)


class PortLeases(Leases):
    """Sends the heartbeat when it is told to: the gateway decides when its client is there."""

    def __init__(self, robot: Robot, heartbeat: Publisher[Heartbeat]) -> None:
        super().__init__(robot, Leasing.NEVER)
        self._publisher = heartbeat

    def beat(self) -> None:
        """Send the heartbeat once."""
        self._publisher.put(ALIVE)


class PortRobot(Robot):
    """The robot of a port, which knows who holds the lease."""

    def __init__(
        self, link: RobotLink, heartbeat: Publisher[Heartbeat], telemetry: Telemetry
    ) -> None:
        super().__init__(
            link.bus, link.common, clock=link.clock, leasing=Leasing.NEVER, follows=False
        )
        self.lease: PortLeases = PortLeases(self, heartbeat)
        self._telemetry = telemetry

    @property
    def sender(self) -> str:
        """The name of the client for which it asks."""
        return ASKING.get()

    async def refusing_holder(self, reason: int) -> str:
        """Return the name of the lease holder who is the reason of a refusal, "" for another one.

        To wait for the next lease status would hold up the requests behind this one.
        """
        newest = self._telemetry.fresh(LEASE, self.clock.now_ns())
        if reason != Reason.LEASE_HELD or newest is None or not newest.held:
            return ""
        return "" if is_ours(newest, self.bus.operator) else holder_name(newest)


class Sampler(Generic[M]):
    """Subscribes to a topic for one message, and again some time later; all the time while needed.

    Each sample that arrives costs processor time in a thread of the bus.
    """

    def __init__(self, link: RobotLink, topic: Topic[M], period_ns: int) -> None:
        self._bus, self._robot = link.bus, link.name
        self._topic, self._period_ns = topic, period_ns
        self._box: Mailbox[M] | None = None
        self._newest: M | None = None
        self._due_ns = self._needed_ns = self._seen_ns = link.clock.now_ns()

    def need(self, now_ns: int) -> None:
        """Receive each message for the next seconds."""
        self._needed_ns = now_ns + NEEDED_NS

    def fresh(self, now_ns: int) -> M | None:
        """Return the newest message; None if the robot sends none when it is due."""
        is_needed = now_ns < self._needed_ns
        if self._box is None and (is_needed or now_ns >= self._due_ns):
            self._box = self._bus.mailbox(self._topic, self._robot)
        elif self._box is not None:
            found = self._box.fresh(now_ns)
            if found is not None:
                self._newest, self._seen_ns = found, now_ns
                self._due_ns = now_ns + self._period_ns
                if not is_needed:
                    self._bus.unsubscribe(self._box)
                    self._box = None
            elif now_ns - self._seen_ns >= SILENT_NS + (0 if is_needed else self._period_ns):
                self._newest = None
        return self._newest


class BusPort:
    """One robot on the bus.

    `was_there` is True if the robot was found at the start.
    """

    def __init__(self, link: RobotLink) -> None:
        self.name = link.name
        self.identity = link.bus.operator or ""
        self._link = link
        self._telemetry = Telemetry(link.bus, link.name, TOPICS)
        self._load = Sampler(link, CYCLE, LOAD_NS)
        self._wheels = Sampler(link, WHEELS, WHEELS_NS)
        heartbeats: Publisher[Heartbeat] = link.bus.publisher(OPERATOR, link.name)
        self._stops = link.bus.publisher(STOP, link.name)
        self._ways = stop_ways.ways_of(link.bus, link.name)
        self._reports: Publisher[GatewayStatus] = link.bus.publisher(GATEWAY, link.name)
        self._stick = TeleopSender(link.bus, link.name, link.clock)
        self._texts: SimpleQueue[tuple[bytes, int]] = SimpleQueue()
        self._robot = PortRobot(link, heartbeats, self._telemetry)
        self._requesting, self._halting = asyncio.Lock(), asyncio.Lock()
        self._is_closed = False
        self._tasks: set[asyncio.Task[Answered]] = set()
        self._halt: Job | None = None
        self._halts = self._halting_now = 0
        self._after_halts: list[tuple[Job, asyncio.Future[asyncio.Task[Answered]]]] = []
        self._stop_line = StopLine(self._new_stop, self._repeat_stop)
        self._started_ns = link.clock.now_ns()
        link.bus.stream(TEXT, lambda _, frame, at_ns: self._texts.put((frame, at_ns)), link.name)
        link.bus.announce(link.name)
        missing = link.bus.await_matched([heartbeats, self._stops], timeout_s=READY_S)
        self.was_there = not missing

    def snapshot(self, now_ns: int) -> Snapshot:
        """Return the newest telemetry."""
        fresh = self._telemetry.fresh
        return Snapshot(
            now_ns,
            status=fresh(STATUS, now_ns),
            odometry=fresh(ODOMETRY, now_ns),
            scan=fresh(SONAR, now_ns),
            wheels=self._wheels.fresh(now_ns),
            lease=fresh(LEASE, now_ns),
            mission=fresh(MISSION, now_ns),
            cycle=self._load.fresh(now_ns),
        )

    def need_wheels(self, now_ns: int) -> None:
        """Receive each message of the encoders for some time, not one a second."""
        self._wheels.need(now_ns)

    def new_texts(self) -> list[Statustext]:
        """Return the robot's texts; those from before the start of the gateway are left out."""
        found = []
        while not self._texts.empty():
            frame, published_ns = self._texts.get()
            with suppress(RemoteError):
                message = decode(frame).message
                if isinstance(message, Statustext) and published_ns >= self._started_ns:
                    found.append(message)
        return found

    async def perform(
        self, operation: Operation[Any], name: str = "", refusal: Refusal = permitted
    ) -> Answered:
        """Perform an operation, unless there is a refusal at its turn.

        Operations of one robot run one after another. One that only stops the robot runs at once.
        What was asked before it and has not begun does not move the robot any more; if something
        has, the stop is repeated after it. What is asked after it waits for its answer.
        """
        job, moves = partial(operation.perform, self._robot), operation.moves
        if not isinstance(operation, STOPS):
            return await self._request(job, name, expires=moves, moves=moves, refusal=refusal)
        if len(self._tasks) >= MAX_WAITING + MAX_HALTS:
            return Answered(None, BUSY)

        async def halt() -> Outcome:
            ASKING.set(name)
            outcome: Outcome = await job()
            return outcome

        self._halt = halt
        self._halts += 1
        self._halting_now += 1
        halted = self._begin(self._halting, halt)
        halted.add_done_callback(self._end_halt)
        return await halted

    async def change_lease(self, action: LeaseAction, name: str) -> Answered:
        """Take, seize or release the lease for a client with this name."""
        takes = action is not LeaseAction.RELEASE
        ask = partial(self._robot.lease.change, action, name)
        return await self._request(ask, name, is_tried=not takes, expires=takes)

    def stop(self) -> StopPress:
        """Send the emergency stop at once, and repeat it in a separate thread."""
        return self._stop_line.press()

    def heartbeat(self) -> None:
        """Send one operator's heartbeat."""
        self._robot.lease.beat()

    def report(self, status: GatewayStatus) -> None:
        """Publish the state of the gateway, stamped with the robot's time."""
        newest = self._telemetry.latest(STATUS)
        stamp_ns = 0 if newest is None else newest[0].time_ns
        self._reports.put(replace(status, time_ns=stamp_ns))

    def drive(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Send speeds for MANUAL once."""
        self._stick.drive(speed_m_s, yaw_rate_rad_s)

    @property
    def is_busy(self) -> bool:
        """Whether a request or a stop has not ended."""
        return bool(self._tasks or self._after_halts or self._stop_line.is_repeating)

    async def close(self) -> None:
        """Wait for the requests and the stop that have begun."""
        self._is_closed = True
        repeating = self._stop_line.repeating
        await asyncio.gather(*self._tasks, *([repeating] if repeating else ()))
        self._ways.close()

    def _new_stop(self) -> EmergencyStop:
        newest, link = (lambda: self._telemetry.latest(STATUS)), self._link
        return EmergencyStop(link.bus, self._stops, self.name, link.clock, newest, self._ways)

    def _repeat_stop(self, stop: EmergencyStop) -> Awaitable[Outcome]:
        give_up_ns = round(STOP_S * NS_PER_S)
        return in_own_thread(
            lambda: Stopped(stop.run(give_up_ns=give_up_ns), self.name), f"stop {self.name}"
        )

    def _is_silent(self) -> bool:
        """Return whether the robot was heard once, but not any more."""
        newest = (self._telemetry.latest(topic) for topic in (STATUS, HEARTBEAT))
        arrived_ns = [one[1] for one in newest if one is not None]
        now_ns = self._link.bus.now_ns()
        return bool(arrived_ns) and now_ns - max(arrived_ns) >= SILENT_NS

    async def _request(
        self,
        job: Job,
        name: str,
        *,
        is_tried: bool = False,
        expires: bool,
        moves: bool = False,
        refusal: Refusal = permitted,
    ) -> Answered:
        """Carry out a request of the client with this name when it is its turn.

        `is_tried`: also to a silent robot; `expires`: only for a short time; `moves`: only if no
        stop overtakes it; `refusal` is asked then.
        """
        asked_ns, halts = self._link.bus.now_ns(), self._halts

        async def checked() -> Outcome:
            ASKING.set(name)
            if self._is_closed or (self._is_silent() and not is_tried):
                raise RemoteError(NO_TELEMETRY)
            if expires and self._link.bus.now_ns() - asked_ns >= LATE_NS:
                raise RemoteError(BUSY)
            refused = refusal()
            if refused is not None:
                return refused
            if not moves:
                return await job()
            if self._halts != halts:
                raise RemoteError(OVERTAKEN)
            try:
                return await job()
            finally:
                if self._halts != halts and self._halt is not None:
                    with suppress(RemoteError):
                        await self._halt()

        if self._is_silent() and not is_tried:
            return Answered(None, NO_TELEMETRY)
        if len(self._tasks) + len(self._after_halts) >= MAX_WAITING:
            return Answered(None, BUSY)
        if not (moves and self._halting_now):
            return await self._begin(self._requesting, checked)
        begun: asyncio.Future[asyncio.Task[Answered]] = asyncio.get_running_loop().create_future()
        self._after_halts.append((checked, begun))
        return await (await begun)

    def _end_halt(self, _: object) -> None:
        """Begin, in their order, the requests that waited for the answer to the last halt."""
        self._halting_now -= 1
        if not self._halting_now:
            waiting, self._after_halts = self._after_halts, []
            for checked, begun in waiting:
                begun.set_result(self._begin(self._requesting, checked))

    def _begin(self, turn: asyncio.Lock, job: Job) -> asyncio.Task[Answered]:
        """Begin a job once those before it have ended."""
        task = asyncio.get_running_loop().create_task(answered_by(job, turn))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)
        return task
