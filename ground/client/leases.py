"""The lease of a robot, and the heartbeat of the program that commands it."""

import asyncio
from collections.abc import Callable, Coroutine
from enum import Enum
from functools import partial
from typing import Any, Final, Protocol, TypeVar

from ground.client.lease_holder import is_ours
from ground.client.outcomes import Accepted, Answer, LeaseShown, Progress, Refused
from ground.client.requests import (
    BEAT_NS,
    CROSSING_NS,
    CommandExchange,
    Exchange,
    HeartbeatTimer,
    Request,
)
from ground.client.robot_link import LEASE_NS, RobotLink, finish, settled
from ground.client.vocabulary import Remedies
from protocol.bus.publisher import Publisher
from protocol.topics import LEASE, LEASE_SERVICE, OPERATOR, STATUS, Service, Topic
from protocol.wire.enums import AUTOPILOT_INVALID, TYPE_GCS, LeaseAction, SystemState
from protocol.wire.message import Message
from protocol.wire.messages import Heartbeat, LeaseRequest
from runtime.clock import Clock
from runtime.errors import RemoteError
from runtime.units import NS_PER_MS, NS_PER_S

T = TypeVar("T")
Out = TypeVar("Out")
M = TypeVar("M", bound=Message)
R = TypeVar("R", bound=Request)
ALIVE: Final = Heartbeat(
    type=TYPE_GCS,
    autopilot=AUTOPILOT_INVALID,
    base_mode=0,
    custom_mode=0,
    system_status=SystemState.ACTIVE,
    mavlink_version=3,
)
TICK_NS: Final = 50 * NS_PER_MS
READY_S: Final = 0.5
RELEASE_NS: Final = 200 * NS_PER_MS
AGAIN_NS: Final = 20 * NS_PER_S
"""After this time a kept lease is asked for again: heartbeats alone do not keep an idle one."""


class Leasing(Enum):
    """When a program takes the lease by itself."""

    ALWAYS = "before everything that moves the robot, and keeps it"
    DRIVES = "before a drive that it follows, and leaves it after that"
    NEVER = "another part of this process takes it"


class Leases:
    """The right of one person to command the robot."""

    def __init__(
        self,
        link: RobotLink,
        leasing: Leasing = Leasing.NEVER,
        is_driving: Callable[[], bool] = lambda: False,
    ) -> None:
        self.leasing = leasing
        self.is_ours = False
        """True while this program is the robot's operator; then it sends its heartbeat."""

        self._link, self._is_driving = link, is_driving
        self._taking, self._changing = asyncio.Lock(), asyncio.Lock()
        self._taken_ns = 0
        self._timer = HeartbeatTimer()
        self._heartbeat: Publisher[Heartbeat] | None = None
        self._beating: asyncio.Task[None] | None = None

    async def take(self) -> Answer:
        """Become the robot's operator; refused while another person holds the lease."""
        return await self.change(LeaseAction.TAKE)

    async def seize(self) -> Answer:
        """Become the robot's operator in place of another one."""
        return await self.change(LeaseAction.SEIZE)

    async def give_back(self) -> Answer:
        """Release the lease, for all programs of this person.

        A robot that one of them drives in GUIDED or MANUAL then stops by itself.
        """
        return await self.change(LeaseAction.RELEASE)

    async def show(self) -> LeaseShown:
        """Return the lease; RemoteError if the robot publishes no lease status."""
        link = self._link
        newest = await link.newest(LEASE, LEASE_NS)
        if newest is None:
            raise RemoteError(f"the robot publishes no lease status: {await link.diagnosis()}")
        return LeaseShown(newest, link.name, is_ours(newest, link.bus.operator))

    async def ensure(self, *, for_drive: bool = False) -> Refused | None:
        """Take the lease if this program does so by itself; return the refusal, if any.

        Not while it drives under it. Between two drives the robot may take it back at any moment.
        """
        if self.leasing is Leasing.NEVER or (self.leasing is Leasing.DRIVES and not for_drive):
            return None
        async with self._taking:
            if self.is_ours and self._is_driving():
                self._link.check_open()
                return None
            answer = await self.take()
        return answer if isinstance(answer, Refused) else None

    async def change(self, action: LeaseAction, name: str | None = None) -> Answer:
        """Take, seize or release the lease; the heartbeat follows it, also if this is cancelled.

        `name` is shown to other operators.
        """
        self._link.check_open()
        if action is LeaseAction.RELEASE:
            self.is_ours = False
        asking = partial(self._change, action, name or self._link.sender)
        return await self._link.uninterrupted(self._changing, asking)

    async def _change(self, action: LeaseAction, name: str) -> Answer:
        request = LeaseRequest(request_id=self._link.ids.next(), action=action, name=name)
        answer = await self._link.ask(request, service=LEASE_SERVICE)
        if isinstance(answer, Accepted) and action is not LeaseAction.RELEASE:
            self._taken_ns, self.is_ours = self._link.clock.now_ns(), True
            if self._heartbeat is not None:
                self.beat()
        return answer

    async def keep(self, for_s: float, name: str | None = None) -> Answer | None:
        """Keep the lease for this time, then leave it; return why it was lost, if it was.

        It is asked for again before it is idle for too long.
        """
        clock = self._link.clock
        asked_ns = clock.now_ns()
        until_ns = asked_ns + round(for_s * NS_PER_S)
        try:
            await self.open()
            while (now_ns := clock.now_ns()) < until_ns:
                self.attend()
                if now_ns - asked_ns >= AGAIN_NS:
                    asked_ns = now_ns
                    answer = await self.change(LeaseAction.TAKE, name)
                    if not answer.ok:
                        return answer
                await self._link.sleep_until(clock.now_ns() + BEAT_NS)
            return None
        finally:
            await finish(self.leave())

    async def leave(self) -> None:
        """Leave the lease to other programs of this person, else release it.

        A lost answer is ignored: the lease expires by itself.
        """
        self.is_ours = False
        link, action = self._link, LeaseAction.LEAVE
        request = LeaseRequest(request_id=link.ids.next(), action=action, name=link.sender)
        now_ns = link.clock.now_ns()
        leaving = CommandExchange(request, now_ns, attempts=1, patience_ns=RELEASE_NS)
        await self._link.carry(leaving, LEASE_SERVICE)

    # The heartbeat.

    async def open(self, *others: Publisher[Any]) -> None:
        """Begin to send the heartbeat while the lease is ours, once the robot subscribes to it.

        `others` are publishers whose subscribers are waited for as well.
        """
        if self._heartbeat is None:
            bus = self._link.bus
            publishers = [self.declare_heartbeat(), *others]
            self._link.streams.keep(STATUS, LEASE)
            await self._link.in_own_thread(lambda: bus.await_matched(publishers, timeout_s=READY_S))
            self._beating = asyncio.create_task(self._beat())

    def declare_heartbeat(self) -> Publisher[Heartbeat]:
        """Let `beat` send the heartbeat, when another part of the process finds it due."""
        self._heartbeat = self._link.bus.publisher(OPERATOR, self._link.name)
        return self._heartbeat

    async def end_heartbeat(self) -> None:
        """Send no heartbeat any more."""
        if self._beating is not None:
            self._beating.cancel()
            await settled(self._beating)

    async def close(self) -> None:
        """Leave the lease if it is ours, also if it has just been taken."""
        async with self._changing:
            if self.is_ours:
                await self.leave()

    def beat(self) -> None:
        """Send the heartbeat once."""
        if self._heartbeat is not None:
            self._heartbeat.put(ALIVE)

    def attend(self) -> None:
        """Send the heartbeat if it is due, while this program commands the robot."""
        newest = self._link.streams.latest(STATUS)
        stamp_ns = 0 if newest is None else newest[0].time_ns
        if self.is_ours and self._timer.due(self._link.clock.now_ns(), stamp_ns):
            self.beat()

    async def _beat(self) -> None:
        """Send the heartbeat from the event loop only, so that a blocked loop sends none."""
        while True:
            self._check()
            self.attend()
            await self._link.sleep_until(self._link.clock.now_ns() + TICK_NS)

    def _check(self) -> None:
        """Stop the heartbeat once the robot reports another person as operator, or nobody."""
        newest = self._link.streams.latest(LEASE)
        if newest is None or newest[1] < self._taken_ns + CROSSING_NS:
            return
        if not is_ours(newest[0], self._link.bus.operator):
            self.is_ours = False


class Asker(Protocol):
    """The client of one robot, as its parameters, missions and fence use it."""

    @property
    def name(self) -> str:
        """The robot."""

    @property
    def clock(self) -> Clock:
        """The clock of this process."""

    @property
    def remedies(self) -> Remedies:
        """What to do about refusals."""

    @property
    def progress(self) -> Progress:
        """Displays what happens before an outcome."""

    @property
    def lease(self) -> Leases:
        """The right to command the robot."""

    async def ask(self, request: Request, /) -> Answer:
        """Send a request until it is answered; a refusal for the lease names its holder."""

    async def exchange(self, exchange: Exchange[Out], service: Service, /) -> Out:
        """Send the requests of an exchange until it is over; return its outcome."""

    async def accepted(
        self, make: Callable[[], R], /, *, beats: bool, arms: bool = True
    ) -> tuple[Answer, R]:
        """Repeat a request after each remedy; return the last answer and its request."""

    async def in_turn(self, sending: Callable[[], Coroutine[Any, Any, T]], /) -> T:
        """Send what begins a drive after what began one before."""

    async def newest(self, topic: Topic[M], patience_ns: int, /) -> M | None:
        """Return the next message of a topic; None if none arrives in time."""

    async def refusing_holder(self, reason: int, /) -> str:
        """Return the name of the lease holder if `reason` is that another one holds it, else ""."""

    async def refuse_outside(self, *places: tuple[str, float, float]) -> None:
        """Raise UserError for a place (name, x, y) outside of the known world."""

    async def diagnosis(self) -> str:
        """Explain why the robot does not answer."""

    async def standstill(self) -> str:
        """Return why no simulated time passes for the robot, and what to do; "" while it does."""
