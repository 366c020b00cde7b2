"""The Python API: an asyncio client of one robot.

    async with sidestep.connect() as robot:
        outcome = await robot.goto(5.4, 2.0)

All values are checked before a request is sent: UserError names one that is out of range. A refusal
is a value (`Refused`), not an exception; `sidestep.agreed(outcome)` raises it as RefusedError.
UnansweredError, a RemoteError, names the process that is missing.

The event loop sends the operator's heartbeat. A program that blocks its event loop sends none, so
the robot stops by itself after its `op_lost_ms`, by default 1.5 s.
"""

import asyncio
from collections import deque
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AsyncExitStack, asynccontextmanager
from enum import IntEnum
from functools import partial
from math import radians
from pathlib import Path
from typing import Any, Final, TypeVar

from ground.api import threads
from ground.api.services import Fences, Leases, Missions, Parameters
from ground.blocking import perform
from ground.client import stop_ways
from ground.client.connection import LONGEST_S, Common, common, within
from ground.client.emergency_stop import EmergencyStop, new_press
from ground.client.events import Telemetry
from ground.client.goal import HEADING_TOLERANCE_DEG, POSITION_TOLERANCE_M, destination
from ground.client.lease_holder import is_ours, operator_name
from ground.client.link import ALIVE, Link, UnansweredError, open_link
from ground.client.outcomes import (
    AllAnswered,
    Answer,
    DriveEnded,
    GoalEnded,
    Marked,
    Outcome,
    Refused,
    Stopped,
)
from ground.client.requests import ATTEMPTS, CROSSING_NS, GaveUp, GoalEnd, GoalWatch, HeartbeatTimer
from ground.client.session import Operation, Session
from ground.client.status_line import reason_of, state_of
from ground.client.stopping import stop_all
from ground.client.streams import CLOSED, ClosedError, TopicStreams
from ground.client.teleop_sender import TeleopSender, lost_control
from ground.client.vocabulary import PYTHON, SIDES
from ground.commands.abort import Abort
from ground.commands.arm import Arm
from ground.commands.disarm import Disarm
from ground.commands.goto import Goto, send_goal
from ground.commands.hold import Hold
from ground.commands.lease import ask_lease, give_back
from ground.commands.mark import Mark
from ground.commands.mission import JumpTo, StartMission
from ground.commands.mode import SetMode
from ground.commands.navigator import SetNavigator
from ground.commands.pose import SetPose, SetTruePose
from ground.commands.resume import Resume
from ground.commands.rtl import ReturnHome
from ground.commands.stop import STOP_S, ClearEmergencyStop
from ground.commands.teleop import DriveByHand, set_mode, take_manual
from protocol.bus.publisher import Publisher
from protocol.topics import LEASE, MISSION, OPERATOR, STATUS, STOP
from protocol.wire.enums import Command, LeaseAction, Mode, Navigator
from protocol.wire.messages import CommandRequest
from runtime.clock import WallClock
from runtime.errors import UserError
from runtime.units import NS_PER_S

T = TypeVar("T")
Out = TypeVar("Out", bound=Outcome)
E = TypeVar("E", bound=IntEnum)
TICK_S: Final = 0.05
READY_S: Final = 0.5
REQUESTS: Final = 4
"""Number of concurrent requests; further ones wait. Emergency stops have their own threads."""
BEGINNINGS: Final = (Goto, JumpTo, Resume, ReturnHome, SetMode, StartMission)
"""Operations that begin a drive."""

OWN_STOPS: Final = 4
"""So many of its newest stops a program may release: several may be repeated at the same time."""


@asynccontextmanager
async def connect(
    endpoint: str | None = None,
    *,
    robot: str | None = None,
    config: str | Path | None = None,
    name: str | None = None,
) -> AsyncIterator["Robot"]:
    """Connect to a robot; give its lease back when the context ends.

    `endpoint` is where the robot or its router listens (that of the only `sidestep up` that runs
    here, else tcp/127.0.0.1:7447), `robot` its name (r1),
    `config` a file as for `--config`, `name` the name shown to other operators (user@host:tty).

    Raises UserError for an invalid value, UnansweredError if no process listens at the endpoint.
    """
    where, operator = common(endpoint, robot, config, remedies=PYTHON), operator_name(name)
    async with AsyncExitStack() as stack:
        link_opened = open_link(where)
        try:
            link = await asyncio.to_thread(link_opened.__enter__)
        except UnansweredError as error:  # its text says all: no traceback of threads and the bus
            raise error.with_traceback(None) from None
        stack.push_async_callback(asyncio.to_thread, link_opened.__exit__, None, None, None)
        client = Robot(link, where, operator)
        try:
            await client.open()
            yield client
        finally:
            await threads.finish(client.close())


class Robot(Telemetry):
    """One robot, with this program as its operator; created by `connect`.

    Operations that can move the robot take its lease first. If another person holds it they return
    `Refused` with that operator's name. All programs of one user on one computer share the lease;
    each sends its own heartbeat. The robot takes it back when nothing has been driven for 30 s, and
    the next operation takes it again.

    At the end of the context the drives of this program end: the robot stops. Then every method
    raises ClosedError.
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
        self._beginning = ThreadPoolExecutor(1, thread_name_prefix="sidestep drive")
        """Sends what begins a drive, in turn: an old one must not overtake a new one."""

        self._heartbeat = link.bus.publisher(OPERATOR, link.robot)
        self._stops = link.bus.publisher(STOP, link.robot)
        self._own_stops: deque[int] = deque(maxlen=OWN_STOPS)
        """The stops of this program, the newest first."""

        self._ways = stop_ways.ways_of(link.bus, link.robot)
        self._stopping: set[asyncio.Future[Any]] = set()
        self._drives: set[asyncio.Future[None]] = set()
        """The drives of this program that have not ended, clean-up included."""

        self._stick: TeleopSender | None = None
        self._is_closed = False
        self._lease_lock = asyncio.Lock()
        self._lease_requests: set[asyncio.Future[Answer]] = set()
        self._holds_lease = False
        self._taken_ns = 0
        self._heartbeat_timer = HeartbeatTimer()
        self._heartbeat_task: asyncio.Task[None] | None = None

    def __repr__(self) -> str:
        """Return the robot, where it is, and what its newest status shows."""
        where = f"robot {self.name} at {self._common.endpoint}"
        newest = self.streams.latest(STATUS)
        if self._is_closed or newest is None:
            return f"<{where}: {'closed' if self._is_closed else 'no status yet'}>"
        state = f"{state_of(newest[0])} {reason_of(newest[0])}".rstrip()
        return f"<{where}: {state}, {'with' if self._holds_lease else 'without'} its lease>"

    async def open(self) -> None:
        """Start the subscriptions and the heartbeat, for `connect`."""
        self.streams.keep(STATUS, LEASE, MISSION)
        bus = self._link.bus
        bus.announce(self.name)
        publishers: list[Publisher[Any]] = [self._heartbeat, self._stops]
        await self.run(lambda: bus.await_matched(publishers, timeout_s=READY_S))
        self._heartbeat_task = asyncio.create_task(self._beat())

    async def close(self) -> None:
        """End the drives of this program, leave the lease and end all streams, for `connect`."""
        self._is_closed = True
        while self._drives:
            await asyncio.wait(tuple(self._drives))
        if self._heartbeat_task is not None:
            self._heartbeat_task.cancel()
        self.streams.close()
        for stop in tuple(self._stopping):
            await threads.settled(stop)
        self._ways.close()
        for request in tuple(self._lease_requests):
            await threads.settled(request)
        if self._holds_lease:
            self._holds_lease = False
            await self._in_thread(lambda: give_back(self._link))
        await asyncio.to_thread(self._beginning.shutdown)
        await asyncio.to_thread(self._pool.shutdown)

    # Requests.

    def check_open(self) -> None:
        """Raise ClosedError after the end of `connect`."""
        if self._is_closed:
            raise ClosedError(CLOSED)

    def session(self) -> Session:
        """Return a session over a link of its own, so that no two requests share a wait."""
        return Session(Link(self._link.bus, self._common, self.clock), attended=True)

    def run(self, job: Callable[[], T]) -> "asyncio.Future[T]":
        """Run blocking work in one of the threads for requests; ClosedError after `connect`."""
        self.check_open()
        return self._in_thread(job)

    def _in_thread(self, job: Callable[[], T]) -> "asyncio.Future[T]":
        return asyncio.get_running_loop().run_in_executor(self._pool, job)

    async def perform(self, operation: Operation[Out]) -> Out | Refused:
        """Carry out any operation of `sidestep.operations`; take the lease first if it moves.

        Cancelling this does not withdraw a request that was sent.
        """
        if operation.moves and (refused := await self.ensure_lease()) is not None:
            return refused
        self.check_open()
        job = partial(perform, operation, self.session())
        if isinstance(operation, BEGINNINGS):
            return await asyncio.wrap_future(self._beginning.submit(job))
        return await self.run(job)

    async def drive_until(
        self,
        begin: Callable[[Session], Answer],
        follow: Callable[[int], Awaitable[T]],
        ending: Callable[[Link], CommandRequest],
    ) -> T | Refused:
        """Begin a drive and follow it; end it, and no other, if this is cancelled or raises.

        `begin` runs in a thread. `follow` gets the id of the request that began the drive. `ending`
        returns the hold or the abort that ends it.
        """
        if (refused := await self.ensure_lease()) is not None:
            return refused
        self.check_open()
        session, ended = self.session(), asyncio.get_running_loop().create_future()
        self._drives.add(ended)
        sending = self._beginning.submit(begin, session)
        try:
            answer = await asyncio.wrap_future(sending)
            return answer if isinstance(answer, Refused) else await follow(session.begun_id)
        except BaseException:
            if not sending.cancelled():
                await threads.finish(self._end_after(sending, ending, session))
            raise
        finally:
            self._drives.discard(ended)
            ended.set_result(None)

    async def _end_after(
        self,
        sending: Future[Answer],
        ending: Callable[[Link], CommandRequest],
        session: Session,
    ) -> None:
        """End a drive after what begins it was sent; the other order would let the robot drive."""
        await threads.settled(asyncio.wrap_future(sending))
        await self._end(ending, session.begun_id)

    async def _end(self, ending: Callable[[Link], CommandRequest], drive_id: int) -> None:
        """End this drive, and no other; without an answer the heartbeat ends, unless others drive.

        Then the robot stops by itself.
        """
        link = self.session().link
        outcome = await self._in_thread(lambda: link.end(ending(link), drive_id, ATTEMPTS))
        if isinstance(outcome, GaveUp) and len(self._drives) == 1:
            self._holds_lease = False

    # The lease and the heartbeat.

    @property
    def holds_lease(self) -> bool:
        """True if this program is the robot's operator."""
        return self._holds_lease

    async def ensure_lease(self) -> Refused | None:
        """Take the lease unless this program drives under it; return the refusal, if any.

        Between two drives the robot may take it back at any moment.
        """
        async with self._lease_lock:
            if self._holds_lease and self._drives:
                self.check_open()
                return None
            answer = await self.change_lease(LeaseAction.TAKE)
        return answer if isinstance(answer, Refused) else None

    async def change_lease(self, action: LeaseAction) -> Answer:
        """Take, seize or release the lease; the heartbeat follows it, also if this is cancelled."""
        session, name = self.session(), self._operator
        if action is LeaseAction.RELEASE:
            self._holds_lease = False
        asking = self.run(lambda: session.with_holder(ask_lease(session.link, action, name)))
        self._lease_requests.add(asking)
        asking.add_done_callback(partial(self._lease_changed, action))
        return await asyncio.shield(asking)

    def _lease_changed(self, action: LeaseAction, asking: "asyncio.Future[Answer]") -> None:
        self._lease_requests.discard(asking)
        if asking.cancelled() or asking.exception() is not None or not asking.result().ok:
            return
        if action is not LeaseAction.RELEASE:
            self._taken_ns, self._holds_lease = self.clock.now_ns(), True
            self._heartbeat.put(ALIVE)

    async def _beat(self) -> None:
        """Send the heartbeat from the event loop only, so that a blocked loop sends none."""
        while True:
            self._check_lease()
            status = self.streams.latest(STATUS)
            stamp_ns = 0 if status is None else status[0].time_ns
            if self._holds_lease and self._heartbeat_timer.due(self.clock.now_ns(), stamp_ns):
                self._heartbeat.put(ALIVE)
            await asyncio.sleep(TICK_S)

    def _check_lease(self) -> None:
        """Stop the heartbeat once the robot reports another person as operator, or nobody."""
        newest = self.streams.latest(LEASE)
        if newest is None or newest[1] < self._taken_ns + CROSSING_NS:
            return
        if not is_ours(newest[0], self._link.bus.operator):
            self._holds_lease = False

    # Commands to the robot.

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

        The goal is not compared with the world of a simulation: a goal in an obstacle ends STUCK.
        Without `heading_deg` (counter-clockwise from x) any heading is accepted. Arms a robot in
        standby. Returns the end, which is `ok` if the goal was reached, or the refusal. Cancelling
        this, for example by a time limit, aborts the goal: the robot stops. It aborts no other
        goal: the next one may be sent at once.
        """
        numbers = [x_m, y_m] if heading_deg is None else [x_m, y_m, heading_deg]
        goal = destination(
            numbers, position_tolerance_m=tolerance_m, heading_tolerance_deg=heading_tolerance_deg
        )
        timeout_ns = None
        if timeout_s is not None:
            timeout_ns = round(within(timeout_s, 0.0, LONGEST_S, "timeout", "s") * NS_PER_S)
        asked_ns = self.clock.now_ns()

        async def follow(goal_id: int) -> GoalEnded:
            watch = GoalWatch(goal_id, self.clock.now_ns(), timeout_ns, asked_ns=asked_ns)
            end = await self._follow(watch)
            if end.abort:
                await threads.finish(self._end(abort_of, goal_id))
                end = watch.outrun(self.streams.latest) or end
            return self._ended(end, asked_ns)

        def abort_of(link: Link) -> CommandRequest:
            return link.command(Command.SIDESTEP_ABORT_GOAL)

        return await self.drive_until(
            lambda session: send_goal(session, goal, Mode.GUIDED)[0], follow, abort_of
        )

    def _ended(self, end: GoalEnd, started_ns: int) -> GoalEnded:
        newest = self.streams.latest(STATUS)
        distance_m = None if newest is None else newest[0].goal_distance_m
        wall_s = (self.clock.now_ns() - started_ns) / NS_PER_S
        return GoalEnded(end.outcome, end.reason, distance_m, wall_s)

    async def _follow(self, watch: GoalWatch) -> GoalEnd:
        while True:
            self.check_open()
            watch.look(self.streams.latest)
            watch.due(self.clock.now_ns())
            if watch.end is not None:
                return watch.end
            await asyncio.sleep(TICK_S)

    async def drive(
        self, speed_m_s: float, turn_deg_s: float, *, for_s: float | None = None
    ) -> DriveEnded | Refused:
        """Drive by hand in MANUAL at a speed (negative: backwards) and a turn (positive: left).

        Ends after `for_s` or when cancelled; then the robot stops and holds, unless it drives for
        another request already. Each speed expires after 250 ms, so the robot also stops if the
        program hangs or exits.
        """
        asked = DriveByHand(speed_m_s=speed_m_s, turn_deg_s=turn_deg_s, for_s=for_s)
        stick = TeleopSender(self._link.bus, self.name, self.clock)

        async def follow(drive_id: int) -> DriveEnded:
            self._stick = stick
            await self._in_thread(stick.stop)
            why = await self._steer(asked, stick)
            await threads.finish(self._end(hold_of, drive_id))
            return DriveEnded(why)

        def hold_of(link: Link) -> CommandRequest:
            if self._stick is stick:  # those of a later drive go on
                stick.stop()
            return set_mode(link, Mode.HOLD)

        return await self.drive_until(take_manual, follow, hold_of)

    async def _steer(self, asked: DriveByHand, stick: TeleopSender) -> str:
        """Return why it ended early; empty if the time was up."""
        began_ns, turn_rad_s = self.clock.now_ns(), radians(asked.turn_deg_s)
        while True:
            self.check_open()
            driven_ns = self.clock.now_ns() - began_ns
            if asked.for_s is not None and driven_ns >= asked.for_s * NS_PER_S:
                return ""
            newest = self.streams.latest(STATUS)
            if newest is not None and (why := lost_control(newest[0], driven_ns)):
                return why
            stick.drive(asked.speed_m_s, turn_rad_s)
            await asyncio.sleep(TICK_S)

    async def emergency_stop(self, *, timeout_s: float = STOP_S) -> Stopped:
        """Stop the robot at once: repeat every 50 ms until its status shows the stop.

        The first stop is sent before this awaits anything. The repetition runs in a thread of its
        own, which a cancellation does not end. Needs no lease. `ok` only if the robot shows the
        stop within `timeout_s`.
        """
        self.check_open()
        stop = EmergencyStop(
            self._link.bus,
            self._stops,
            self.name,
            self.clock,
            lambda: self.streams.latest(STATUS),
            self._ways,
        )
        stop.press()
        self._own_stops.appendleft(stop.request_id)
        give_up_ns = round(timeout_s * NS_PER_S)
        return Stopped(await self._repeat(lambda: stop.run(give_up_ns=give_up_ns)), self.name)

    async def emergency_stop_all(self, *, timeout_s: float = STOP_S) -> AllAnswered:
        """Stop every robot that is present: all are sent the stop before any is awaited.

        A cancellation does not end the repetition. Needs no lease.

        Raises UnansweredError if no robot is present.
        """
        self.check_open()
        session, request_id = self.session(), new_press()
        self._own_stops.appendleft(request_id)
        give_up_ns = round(timeout_s * NS_PER_S)
        return await self._repeat(lambda: stop_all(session.link, give_up_ns, request_id))

    async def _repeat(self, stop: Callable[[], T]) -> T:
        """Repeat a stop in a thread of its own, which a cancellation does not end."""
        repeating = threads.in_own_thread(stop, "emergency stop")
        self._stopping.add(repeating)
        repeating.add_done_callback(self._stopping.discard)
        return await asyncio.shield(repeating)

    async def clear_emergency_stop(self) -> Answer:
        """Release the emergency stop in the newest status, or one of this program.

        A later one of somebody else stays. Waits until no stop of this program is repeated any
        more. The robot stays disarmed.
        """
        newest, own = self.streams.latest(STATUS), tuple(self._own_stops)
        seen = () if newest is None else (newest[0].stop_id,)
        if self._stopping:
            await asyncio.wait(tuple(self._stopping))
        return await self.perform(ClearEmergencyStop(stop_ids=(*seen, *own)))

    async def arm(self) -> Answer:
        """Allow the wheels to turn."""
        return await self.perform(Arm())

    async def disarm(self) -> Answer:
        """Block the wheels; needs no lease."""
        return await self.perform(Disarm())

    async def hold(self) -> Answer:
        """Stop and keep the goal; needs no lease."""
        return await self.perform(Hold())

    async def resume(self) -> Answer:
        """Continue to the goal."""
        return await self.perform(Resume())

    async def abort(self) -> Answer:
        """Cancel the goal and stop; needs no lease."""
        return await self.perform(Abort())

    async def return_home(self) -> Answer:
        """Drive back along the robot's own trail; return once the robot has accepted."""
        return await self.perform(ReturnHome())

    async def set_mode(self, mode: Mode | str) -> Answer:
        """Choose the mode, also by its name, such as "hold"."""
        return await self.perform(SetMode(mode=member_of(Mode, mode, "mode")))

    async def set_navigator(self, navigator: Navigator | str, side: int | str = 0) -> Answer:
        """Choose the navigator, also by its name, such as "bug".

        It passes obstacles "left" (1), "right" (-1) or as before (0).
        """
        chosen = member_of(Navigator, navigator, "navigator")
        sign = SIDES.get(side.lower()) if isinstance(side, str) else side
        if sign not in (-1, 0, 1):
            raise UserError(f"there is no side {side!r}: use left, right, or 0 for as before")
        return await self.perform(SetNavigator(navigator=chosen, side=sign))

    async def set_pose(self, x_m: float, y_m: float, heading_deg: float | None = None) -> Answer:
        """Set the pose of the robot; without a heading it keeps its own, if it knows its place."""
        return await self.perform(SetPose(x_m=x_m, y_m=y_m, heading_deg=heading_deg))

    async def set_true_pose(self) -> Answer:
        """Set the pose of a simulated robot to the true one; RemoteError without a simulation."""
        return await self.perform(SetTruePose())

    async def mark(self, remark: str) -> Marked | Refused:
        """Add a remark to what is being recorded; `ok` if a recorder received it."""
        return await self.perform(Mark(remark=remark))


def member_of(kind: type[E], given: E | str, what: str) -> E:
    """Return the member of an enumeration, also by its name or number; UserError if unknown."""
    name = given.upper() if isinstance(given, str) else ""
    for member in kind:
        if member.name == name or member == given:
            return member
    names = ", ".join(member.name.lower() for member in kind)
    raise UserError(f"there is no {what} {given!r}: use one of {names}")
