"""The Python API: an asyncio client of one robot.

    async with sidestep.connect() as robot:
        outcome = await robot.goto(5.4, 2.0)

Values are checked before anything is sent: UserError names what is out of range. A refusal is a
value (`Refused`), not an exception; `sidestep.agreed(outcome)` raises it. UnansweredError, a
RemoteError, says which process is missing.

The event loop sends the operator's heartbeat. A program that blocks its loop is no operator: after
1.5 s the robot stops by itself.
"""

import asyncio
from collections.abc import AsyncIterator, Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from math import radians
from pathlib import Path
from typing import Any, Final, TypeVar

from ground.client.api import threads
from ground.client.api.events import Telemetry
from ground.client.api.services import Fences, Leases, Missions, Parameters
from ground.client.api.streams import TopicStreams
from ground.client.connection import Common, common
from ground.client.emergency_stop import EmergencyStop
from ground.client.goal import HEADING_TOLERANCE_DEG, POSITION_TOLERANCE_M, destination
from ground.client.link import ALIVE, Link, open_link
from ground.client.operations import (
    Abort,
    Arm,
    ClearEmergencyStop,
    Disarm,
    DriveByHand,
    DriveEnded,
    GoalEnded,
    Hold,
    Mark,
    Marked,
    Operation,
    Resume,
    ReturnHome,
    Session,
    SetMode,
    SetNavigator,
    Stopped,
)
from ground.client.operations.commands import STOP_S
from ground.client.operations.goals import abort, send_goal
from ground.client.operations.leases import ask_lease, give_back, operator_name
from ground.client.operations.teleop import TeleopSender, hold, take_manual, taken_away
from ground.client.requests import GoalEnd, GoalWatch, HeartbeatTimer
from ground.client.results import Answer, Outcome, Refused
from protocol.bus.publisher import Publisher
from protocol.topics import LEASE, MISSION, OPERATOR, STATUS, STOP
from protocol.wire.enums import LeaseAction, Mode, Navigator
from runtime.clock import WallClock
from runtime.units import NS_PER_S

T = TypeVar("T")
Out = TypeVar("Out", bound=Outcome)
TICK_S: Final = 0.05
CROSSING_NS: Final = 300_000_000
"""A lease status sent just before a change of the lease may arrive after it."""
READY_S: Final = 0.5
REQUESTS: Final = 4
"""Requests at once; further ones wait. Emergency stops have threads of their own."""


@asynccontextmanager
async def connect(
    endpoint: str | None = None,
    *,
    robot: str | None = None,
    config: str | Path | None = None,
    name: str | None = None,
) -> AsyncIterator["Robot"]:
    """Connect to a robot, and give its lease back at the end.

    `endpoint` is where it or its router listens (tcp/127.0.0.1:7447), `robot` its name (r1),
    `config` a file as for `--config`, `name` what other operators are shown (the user's name).

    Raises UserError for values that cannot be used, UnansweredError when nothing listens there.
    """
    where, called = common(endpoint, robot, config), operator_name(name)
    async with AsyncExitStack() as stack:
        link_opened = open_link(where)
        link = await asyncio.to_thread(link_opened.__enter__)
        stack.push_async_callback(asyncio.to_thread, link_opened.__exit__, None, None, None)
        found = Robot(link, where, called)
        try:
            await found.open()
            yield found
        finally:
            await threads.finish(found.close())


class Robot(Telemetry):
    """One robot, and this program as its operator; made by `connect`.

    Operations that can move the robot take its lease first, which is kept until the context ends.
    When another operator holds it they return `Refused` with that operator's name.
    """

    def __init__(self, link: Link, common: Common, operator: str) -> None:
        super().__init__(TopicStreams(link.bus, link.robot), link.bus.operator or "")
        self.name = link.robot
        self.parameters = Parameters(self)
        self.mission = Missions(self)
        self.fence = Fences(self)
        self.lease = Leases(self)
        self.clock = WallClock()
        self._link = link
        self._common = common
        self._operator = operator
        self._pool = ThreadPoolExecutor(REQUESTS, thread_name_prefix="sidestep")
        self._heart = link.bus.publisher(OPERATOR, link.robot)
        self._stops = link.bus.publisher(STOP, link.robot)
        self._stopping: set[asyncio.Future[Any]] = set()
        self._taking = asyncio.Lock()
        self._holds_lease = False
        self._taken_ns = 0
        self._pace = HeartbeatTimer()
        self._beating: asyncio.Task[None] | None = None

    async def open(self) -> None:
        """Begin to listen and to beat; `connect` does it."""
        self.hub.keep(STATUS, LEASE, MISSION)
        bus = self._link.bus
        bus.announce(self.name)
        publishers: list[Publisher[Any]] = [self._heart, self._stops]
        await self.run(lambda: bus.await_matched(publishers, timeout_s=READY_S))
        self._beating = asyncio.create_task(self._beat())

    async def close(self) -> None:
        """Give the lease back and end all streams; `connect` does it."""
        if self._beating is not None:
            self._beating.cancel()
        self.hub.close()
        for stop in tuple(self._stopping):
            await threads.settled(stop)
        if self._holds_lease:
            self._holds_lease = False
            await self.run(lambda: give_back(self._link))
        await asyncio.to_thread(self._pool.shutdown)

    # Requests.

    def session(self) -> Session:
        """A session over a link of its own, so that no two requests share a wait."""
        return Session(Link(self._link.bus, self._common, self.clock), attended=True)

    def run(self, job: Callable[[], T]) -> "asyncio.Future[T]":
        """Do blocking work in one of the threads for requests."""
        return asyncio.get_running_loop().run_in_executor(self._pool, job)

    async def perform(self, operation: Operation[Out]) -> Out | Refused:
        """Do any operation of `sidestep.operations`; one that moves takes the lease first.

        Cancelling it does not take back a request that was sent.
        """
        if operation.moves and (refused := await self.lead()) is not None:
            return refused
        return await self.run(lambda: operation.perform(self.session()))

    # The lease and the heartbeat.

    @property
    def holds_lease(self) -> bool:
        """Whether this program is the robot's operator."""
        return self._holds_lease

    async def lead(self) -> Refused | None:
        """Take the lease unless it is held already; the refusal when another operator has it."""
        async with self._taking:
            if self._holds_lease:
                return None
            answer = await self.change_lease(LeaseAction.TAKE)
        return answer if isinstance(answer, Refused) else None

    async def change_lease(self, action: LeaseAction) -> Answer:
        """Take, seize or release the lease; the heartbeat follows it."""
        session, name = self.session(), self._operator
        if action is LeaseAction.RELEASE:
            self._holds_lease = False
        answer = await self.run(lambda: session.with_holder(ask_lease(session.link, action, name)))
        if answer.ok and action is not LeaseAction.RELEASE:
            self._taken_ns, self._holds_lease = self.clock.now_ns(), True
            self._heart.put(ALIVE)
        return answer

    async def _beat(self) -> None:
        """In the event loop and nowhere else: a loop that is blocked sends no heartbeat."""
        while True:
            self._judge_lease()
            status = self.hub.latest(STATUS)
            stamp_ns = 0 if status is None else status[0].time_ns
            if self._holds_lease and self._pace.due(self.clock.now_ns(), stamp_ns):
                self._heart.put(ALIVE)
            await asyncio.sleep(TICK_S)

    def _judge_lease(self) -> None:
        """Stop being the operator once the robot names another one, or none."""
        newest = self.hub.latest(LEASE)
        if newest is None or newest[1] < self._taken_ns + CROSSING_NS:
            return
        if not newest[0].held or newest[0].holder != self._link.bus.operator:
            self._holds_lease = False

    # What the robot does.

    async def goto(
        self,
        x_m: float,
        y_m: float,
        heading_deg: float | None = None,
        *,
        tolerance_m: float = POSITION_TOLERANCE_M,
        heading_tolerance_deg: float = HEADING_TOLERANCE_DEG,
        timeout_s: float | None = None,
    ) -> GoalEnded | Refused:
        """Drive to a place (metres, in the robot's own frame) and wait for the end.

        Without `heading_deg` (counter-clockwise from x) any heading will do. Arms a robot that
        stands by. Returns the end, which is `ok` when the goal is reached, or the refusal.
        Cancelling it, by a time limit for instance, aborts the goal: the robot stops.
        """
        numbers = [x_m, y_m] if heading_deg is None else [x_m, y_m, heading_deg]
        goal = destination(
            numbers, position_tolerance_m=tolerance_m, heading_tolerance_deg=heading_tolerance_deg
        )
        timeout_ns = None if timeout_s is None else round(timeout_s * NS_PER_S)
        if (refused := await self.lead()) is not None:
            return refused
        session, started_ns = self.session(), self.clock.now_ns()
        sending = self.run(lambda: send_goal(session, goal, Mode.GUIDED))
        try:
            answer, request = await asyncio.shield(sending)
            if isinstance(answer, Refused):
                return answer
            end = await self._follow(GoalWatch(request.request_id, started_ns, timeout_ns))
        except BaseException:
            await threads.finish(self._abort(sending))
            raise
        if end.abort:
            await threads.finish(self._abort(sending))
        newest = self.hub.latest(STATUS)
        distance_m = None if newest is None else newest[0].goal_distance_m
        wall_s = (self.clock.now_ns() - started_ns) / NS_PER_S
        return GoalEnded(end.outcome, end.reason, distance_m, wall_s)

    async def _follow(self, watch: GoalWatch) -> GoalEnd:
        while True:
            newest = self.hub.latest(STATUS)
            if newest is not None:
                watch.receive(*newest)
            watch.due(self.clock.now_ns())
            if watch.end is not None:
                return watch.end
            await asyncio.sleep(TICK_S)

    async def _abort(self, sending: "asyncio.Future[Any]") -> None:
        """Abort after the goal has been sent: the other way round it would drive."""
        await threads.settled(sending)
        link = self.session().link
        await self.run(lambda: abort(link))

    async def drive(
        self, speed_m_s: float, turn_deg_s: float, *, for_s: float | None = None
    ) -> DriveEnded | Refused:
        """Drive by hand in MANUAL at a speed (negative: backwards) and a turn (positive: left).

        Until `for_s` has passed or it is cancelled; then the robot stands and holds. Each speed is
        good for 250 ms, so a program that hangs or dies stops the robot, too.
        """
        asked = DriveByHand(speed_m_s=speed_m_s, turn_deg_s=turn_deg_s, for_s=for_s)
        if (refused := await self.lead()) is not None:
            return refused
        session = self.session()
        stick = TeleopSender(session.link)
        taking = self.run(partial(take_manual, session))
        try:
            answer = await asyncio.shield(taking)
            if isinstance(answer, Refused):
                return answer
            await asyncio.shield(self.run(stick.stop))
            why = await self._steer(asked, stick)
        except BaseException:
            await threads.finish(self._stand(taking, stick))
            raise
        await threads.finish(self._stand(taking, stick))
        return DriveEnded(why)

    async def _steer(self, asked: DriveByHand, stick: TeleopSender) -> str:
        """Return why it ended early; empty when the time was up."""
        began_ns, turn_rad_s = self.clock.now_ns(), radians(asked.turn_deg_s)
        while True:
            driven_ns = self.clock.now_ns() - began_ns
            if asked.for_s is not None and driven_ns >= asked.for_s * NS_PER_S:
                return ""
            newest = self.hub.latest(STATUS)
            if newest is not None and (why := taken_away(newest[0], driven_ns)):
                return why
            stick.drive(asked.speed_m_s, turn_rad_s)
            await asyncio.sleep(TICK_S)

    async def _stand(self, taking: "asyncio.Future[Any]", stick: TeleopSender) -> None:
        """After MANUAL was asked for: the other way round the robot would stay in it."""
        await threads.settled(taking)
        await self.run(stick.stop)
        link = self.session().link
        await self.run(lambda: hold(link))

    async def emergency_stop(self, *, timeout_s: float = STOP_S) -> Stopped:
        """Stop the robot at once: repeated every 50 ms until its status shows it.

        Sent before this awaits anything, and repeated in a thread of its own, cancelled or not. It
        needs no lease. `ok` only when the robot shows the stop within `timeout_s`.
        """
        stop = EmergencyStop(
            self._link.bus, self._stops, self.name, self.clock, lambda: self.hub.latest(STATUS)
        )
        stop.press()
        give_up_ns = round(timeout_s * NS_PER_S)
        repeating = threads.in_own_thread(lambda: stop.run(give_up_ns=give_up_ns), "emergency stop")
        self._stopping.add(repeating)
        repeating.add_done_callback(self._stopping.discard)
        return Stopped(await asyncio.shield(repeating), self.name)

    async def clear_emergency_stop(self) -> Answer:
        """Release the emergency stop; the robot stays disarmed."""
        return await self.perform(ClearEmergencyStop())

    async def arm(self) -> Answer:
        """Let the wheels turn."""
        return await self.perform(Arm())

    async def disarm(self) -> Answer:
        """Do not let the wheels turn; needs no lease."""
        return await self.perform(Disarm())

    async def hold(self) -> Answer:
        """Stand still and keep the goal; needs no lease."""
        return await self.perform(Hold())

    async def resume(self) -> Answer:
        """Go on to the goal."""
        return await self.perform(Resume())

    async def abort(self) -> Answer:
        """Drop the goal and stand still; needs no lease."""
        return await self.perform(Abort())

    async def return_home(self) -> Answer:
        """Drive back along the robot's own trail; returns when the robot has agreed."""
        return await self.perform(ReturnHome())

    async def set_mode(self, mode: Mode) -> Answer:
        """Choose the mode."""
        return await self.perform(SetMode(mode=mode))

    async def set_navigator(self, navigator: Navigator, side: int = 0) -> Answer:
        """Choose the navigator; obstacles are passed on the left (1), right (-1) or as before."""
        return await self.perform(SetNavigator(navigator=navigator, side=side))

    async def mark(self, remark: str) -> Marked | Refused:
        """Leave a remark in what is being recorded; `ok` when something records."""
        return await self.perform(Mark(remark=remark))
