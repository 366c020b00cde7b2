"""One robot, with this program as its operator: the client that every face of the ground stands on.

    async with sidestep.connect() as robot:
        outcome = await robot.goto(5.4, 2.0)

It sends requests, takes the lease, follows goals and drives by hand. Each clean-up names the goal
or the drive that it ends, and touches no other. An emergency stop is sent before anything is
awaited.

All values are checked before a request is sent: UserError names one that is out of range. A refusal
is a value (`Refused`), not an exception; `sidestep.agreed(outcome)` raises it as RefusedError.
UnansweredError, a RemoteError, names the process that is missing.

The event loop sends the operator's heartbeat. A program that blocks its event loop sends none, so
the robot stops by itself after its `op_lost_ms`, by default 1.5 s.
"""

import asyncio
from collections import deque
from collections.abc import AsyncGenerator, AsyncIterator, Callable, Coroutine, Mapping
from contextlib import AsyncExitStack, aclosing, asynccontextmanager
from dataclasses import replace
from enum import IntEnum
from functools import partial
from html import escape
from math import degrees, isfinite, nan, radians
from pathlib import Path
from typing import Any, Final, TypeAlias, TypeVar

from msgspec import structs

from ground.client import stop_ways
from ground.client.connection import LONGEST_S, Common, common, within
from ground.client.emergency_stop import EmergencyStop, StopWays, new_press
from ground.client.floor import Floor
from ground.client.goal import (
    FARTHEST_M,
    HEADING_TOLERANCE_DEG,
    POSITION_TOLERANCE_M,
    Destination,
    destination,
    goal_request,
)
from ground.client.lease_holder import operator_name
from ground.client.leases import READY_S, TICK_NS, Leases, Leasing
from ground.client.lost_drive import (
    LostDrive,
    LostGoal,
    LostMission,
    NothingToResume,
    Resumed,
    has_failed,
    lost_drive,
)
from ground.client.missions import CURRENT, UNDER_WAY, Fences, Missions, fetch
from ground.client.outcomes import (
    DRIVE_REPLACED,
    UNCONFIRMED,
    Accepted,
    AllAnswered,
    Answer,
    DriveEnded,
    GoalEnded,
    Marked,
    NoProgress,
    Operation,
    Outcome,
    Progress,
    Refused,
    RefusedError,
    Stopped,
    Unanswered,
)
from ground.client.parameters import Parameters
from ground.client.requests import (
    ATTEMPTS,
    BEAT_NS,
    NAMED_NS,
    CommandExchange,
    GaveUp,
    GoalEnd,
    GoalWatch,
    HeartbeatTimer,
    Latest,
    Request,
)
from ground.client.robot_link import (
    NEWEST_NS,
    REQUESTS,
    Drive,
    RobotLink,
    UnansweredError,
    finish,
    in_own_thread,
    open_link,
    settled,
)
from ground.client.status_line import goal_line, reason_of, state_of
from ground.client.stopping import present_robots, stop_all
from ground.client.telemetry import Telemetry
from ground.client.teleop_sender import DriveWatch, TeleopSender
from ground.client.vocabulary import PYTHON, SIDES
from ground.missions.mission import Waypoint
from ground.missions.transfer import Downloaded, waypoints_of
from protocol.bus.bus import Bus
from protocol.bus.publisher import Publisher
from protocol.outcome import doubt_of
from protocol.topics import (
    COMMAND,
    DECISION,
    LEASE,
    MARK,
    MISSION,
    ODOMETRY,
    STATUS,
    STOP,
    TRUTH,
)
from protocol.wire.enums import (
    Command,
    MissionType,
    Mode,
    Navigator,
    Severity,
    Vehicle,
)
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandRequest,
    GoalRequest,
    NavigatorStatus,
    PlanarOdometry,
)
from protocol.wire.reasons import Reason
from protocol.wire.statustext import pieces_of
from runtime.clock import Clock
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_MS, NS_PER_S

T = TypeVar("T")
M = TypeVar("M", bound=Message)
R = TypeVar("R", bound=Request)
E = TypeVar("E", bound=IntEnum)
Out = TypeVar("Out", bound=Outcome)
Speeds: TypeAlias = AsyncGenerator[tuple[float, float], None]
"""Speeds of a drive by hand, in m/s and rad/s."""

RETRY_NS: Final = 2 * NS_PER_S
"""Time within which causes of a refusal are removed."""
END_NS: Final = 300 * NS_PER_MS
"""Longest wait for the answer to what ends a drive."""
MISSION_NS: Final = 700 * NS_PER_MS
"""A robot publishes the status of its mission twice a second."""
STOP_S: Final = 5.0
"""Duration for which an emergency stop without acknowledgement is repeated."""
SHOW_NS: Final = 200 * NS_PER_MS
SHOW_PLAIN_NS: Final = 2 * NS_PER_S
OWN_STOPS: Final = 16
"""So many of its newest stops a program may release: several may be repeated at the same time."""
FASTEST_M_S: Final = 5.0
FASTEST_DEG_S: Final = 720.0
NO_ANSWER: Final = (
    "no answer to the abort; without an operator's heartbeat the robot stops by itself"
)


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
    for what, text in {"endpoint": endpoint, "robot": robot, "name": name}.items():
        if not isinstance(text, str | None):
            raise UserError(f"{what} = {text!r}: give a text")
    if not isinstance(config, str | Path | None):
        raise UserError(f"config = {config!r}: give the path of a file")
    where, operator = common(endpoint, robot, config, remedies=PYTHON), operator_name(name)
    async with AsyncExitStack() as stack:
        link_opened = open_link(where)
        try:
            link = await asyncio.to_thread(link_opened.__enter__)
        except UnansweredError as error:  # its text says all: no traceback of threads and the bus
            raise error.with_traceback(None) from None
        stack.push_async_callback(asyncio.to_thread, link_opened.__exit__, None, None, None)
        client = Robot(link.bus, where, operator)
        try:
            await client.open()
            yield client
        finally:
            await finish(client.close())


class Robot(RobotLink):
    """One robot, with this program as its operator; created by `connect`.

    Operations that can move the robot take its lease first. If another person holds it they return
    `Refused` with that operator's name. All programs of one user on one computer share the lease;
    each sends its own heartbeat. The robot takes it back when nothing has been driven for 30 s, and
    the next operation takes it again.

    At the end of the context the drives of this program end: the robot stops. Then every method
    raises ClosedError.
    """

    def __init__(
        self,
        bus: Bus,
        common: Common,
        operator: str = "",
        *,
        clock: Clock | None = None,
        leasing: Leasing = Leasing.ALWAYS,
        follows: bool = True,
        progress: Progress | None = None,
        floor: Callable[[], Floor | None] = lambda: None,
    ) -> None:
        """Stand on an open bus.

        `leasing`: when it takes the lease by itself. `follows`: a command that begins a drive waits
        for its end; otherwise another part of the process follows it. `floor` returns the floor of
        the world, if it is known; it may block.
        """
        super().__init__(bus, common, clock, operator)
        self.follows = follows
        self.progress: Progress = progress or NoProgress()
        self._floor = floor
        self._turn = asyncio.Lock()
        """Held by what begins a drive, while it is sent: an old one must not overtake a new one."""

        self._drives: set[Drive] = set()
        """The drives of this program that have not ended, clean-up included."""

        self._stick: TeleopSender | None = None
        self._stopping: set[asyncio.Future[Any]] = set()
        self._own_stops: deque[int] = deque(maxlen=OWN_STOPS)
        """The stops of this program, the newest first."""

        self._stop_ways: tuple[Publisher[CommandRequest], StopWays] | None = None
        self.parameters = Parameters(self)
        self.mission = Missions(self)
        self.fence = Fences(self)
        self.lease = Leases(self, leasing, lambda: bool(self._drives))

    def __repr__(self) -> str:
        """Return the robot, where it is, and what its newest status shows."""
        where = f"robot {self.name} at {self.common.endpoint}"
        newest = self.streams.latest(STATUS)
        if self._is_closed or newest is None:
            return f"<{where}: {'closed' if self._is_closed else 'no status yet'}>"
        if (age_ns := self.clock.now_ns() - newest[1]) > NEWEST_NS:
            return f"<{where}: no status for {age_ns / NS_PER_S:.0f} s>"
        state = f"{state_of(newest[0])} {reason_of(newest[0])}".rstrip()
        return f"<{where}: {state}, {'with' if self.holds_lease else 'without'} its lease>"

    def _repr_html_(self) -> str:
        """Show the robot in a notebook: its state, its place and its goal."""
        rows = {"robot": self.name, "endpoint": str(self.common.endpoint)}
        status, pose = self.streams.latest(STATUS), self.streams.latest(ODOMETRY)
        if status is not None:
            newest = status[0]
            rows["state"] = f"{state_of(newest)} {reason_of(newest)}".rstrip()
            if isfinite(newest.goal_x_m):
                rows["goal"] = f"{newest.goal_x_m:.2f} {newest.goal_y_m:.2f} m"
        if pose is not None:
            x_m, y_m, heading_deg = pose[0].x_m, pose[0].y_m, degrees(pose[0].heading_rad)
            rows["place"] = f"{x_m:.2f} {y_m:.2f} m, {heading_deg:.0f}°"
        rows["lease"] = "this program's" if self.holds_lease else "not this program's"
        cells = (f"<tr><th>{name}</th><td>{escape(text)}</td></tr>" for name, text in rows.items())
        return f"<table>{''.join(cells)}</table>"

    def to(self, robot: str) -> "Robot":
        """Return another robot on the same bus, whose lease is not taken."""
        common = replace(self.common, robot=robot)
        return Robot(self.bus, common, self.sender, clock=self.clock, leasing=Leasing.NEVER)

    async def open(self) -> None:
        """Start the subscriptions and the heartbeat, for `connect`."""
        stops, _ = self._ways_to_stop()
        self.streams.keep(MISSION)
        self.bus.announce(self.name)
        await self.lease.open(stops)

    def _ways_to_stop(self) -> tuple[Publisher[CommandRequest], StopWays]:
        """Return the ways of the emergency stop, opened by the first call.

        So also a robot that nobody has opened, such as one of `to`, can be stopped.
        """
        if self._stop_ways is None:
            stops = self.bus.publisher(STOP, self.name)
            self._stop_ways = stops, stop_ways.ways_of(self.bus, self.name)
        return self._stop_ways

    @property
    def holds_lease(self) -> bool:
        """True if this program is the robot's operator."""
        return self.lease.is_ours

    async def close(self) -> None:
        """End the drives of this program, leave the lease and end all streams, for `connect`."""
        self._is_closed = True
        while self._drives:
            await next(iter(self._drives)).ended.wait()
        await self.lease.end_heartbeat()
        self.streams.close()
        for stop in tuple(self._stopping):
            await settled(stop)
        if self._stop_ways is not None:
            self._stop_ways[1].close()
        await self.lease.close()
        for _ in range(REQUESTS):  # those that have been sent end, too
            await self._slots.acquire()

    # Requests.

    async def accepted(
        self, make: Callable[[], R], *, beats: bool, arms: bool = True
    ) -> tuple[Answer, R]:
        """Repeat a request after each remedy; return the last answer and its request.

        With `arms`, arms a robot in standby, but never one in a failsafe or an emergency stop; if
        it cannot be armed, that is the answer. With `beats`, sends the operator's heartbeat if the
        robot misses it.
        """
        deadline_ns = self.clock.now_ns() + RETRY_NS
        while True:
            sent = make()
            answer = await self.ask(sent)
            if isinstance(answer, Accepted):
                return answer, sent
            remedy: Answer | None = None
            if self.clock.now_ns() <= deadline_ns:
                remedy = await self._remedy(answer.reason, beats=beats, arms=arms)
            if not isinstance(remedy, Accepted):
                return await self._explained(remedy or answer), sent

    async def _explained(self, answer: Answer) -> Answer:
        """Add to a refusal that no simulated time passes for the robot, if that is why."""
        if isinstance(answer, Refused) and answer.reason in (Reason.NO_OPERATOR, Reason.NO_SENSES):
            return replace(answer, cause=await self.standstill())
        return answer

    async def _acted_on(self, answer: Answer) -> Answer:
        """Add to an acceptance that no simulated time passes, so that the robot does nothing yet.

        Not for an app or a gateway, which show that by themselves.
        """
        if isinstance(answer, Accepted) and self.lease.leasing is not Leasing.NEVER:
            return replace(answer, cause=await self.standstill())
        return answer

    async def _remedy(self, reason: int, *, beats: bool, arms: bool) -> Answer | None:
        """Remove the cause of a refusal; return whether that was accepted, None if it cannot be."""
        if reason == Reason.NOT_ARMED and arms:
            return await self._arm_if_standing_by()
        if reason == Reason.NO_OPERATOR and beats:
            self.lease.beat()
            await self.sleep_until(self.clock.now_ns() + BEAT_NS // 4)
            return Accepted(0)
        return None

    async def _arm_if_standing_by(self, *, knows_stop: bool = True) -> Answer | None:
        """Arm a robot in STANDBY; return its answer, None if it was not asked.

        One that starts up or has no status may lack its sensors: its answer tells. Unless what is
        asked for `knows_stop`, a robot in an emergency stop is refused here.
        """
        newest = await self.newest(STATUS, NEWEST_NS)
        if newest is not None and newest.vehicle == Vehicle.EMERGENCY_STOP and not knows_stop:
            return Refused(Reason.EMERGENCY_STOPPED, 0, remedies=self.remedies)
        if newest is not None and newest.vehicle not in (Vehicle.STANDBY, Vehicle.BOOT):
            return None
        answer = await self.ask(self.request(Command.COMPONENT_ARM_DISARM, 1.0))
        if answer.ok:
            self.progress.note("armed")
        return answer

    async def end(
        self, request: CommandRequest, drive_id: int, attempts: int = ATTEMPTS
    ) -> Answer | GaveUp | None:
        """End a drive by a hold or an abort, and no other; None if it is over, or never began.

        `drive_id` is the request_id that began it. Waits a short time, because a robot without its
        operator's heartbeat stops by itself.
        """
        if not drive_id:
            return None
        ending = CommandExchange(
            structs.replace(request, ends_id=drive_id),
            self.clock.now_ns(),
            attempts=attempts,
            patience_ns=END_NS,
        )
        outcome = await self.carry(ending, COMMAND)
        is_over = isinstance(outcome, Refused) and outcome.reason == Reason.ALREADY_OVER
        return None if is_over else outcome

    async def pose(self) -> PlanarOdometry:
        """Return where the robot takes itself to be; RemoteError without a fresh pose."""
        pose = await self.fresh(ODOMETRY)
        if pose is None:
            raise RemoteError(f"the robot publishes no pose: {await self.diagnosis()}")
        return pose

    async def refuse_outside(self, *places: tuple[str, float, float]) -> None:
        """Raise UserError for a place (name, x, y) outside of the known world."""
        floor = await self.in_own_thread(self._floor)
        if floor is not None:
            for place in places:
                floor.refuse_outside(*place, "; --anyway sends it nevertheless")

    # Goals.

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
        if timeout_s is not None:
            within(timeout_s, 0.0, LONGEST_S, "timeout", "s")
        return await self.drive_to(goal, timeout_s=timeout_s)

    async def drive_to(
        self,
        goal: Destination,
        *,
        timeout_s: float | None = None,
        from_robot: bool = False,
        arms: bool = True,
    ) -> GoalEnded | Refused:
        """Drive to a goal in GUIDED and follow it to its end; abort it if this is cancelled.

        `from_robot`: it was given relative to the robot. `arms`: arm a robot in standby.
        """
        asked_ns = self.clock.now_ns()
        timeout_ns = None if timeout_s is None else round(timeout_s * NS_PER_S)

        place = goal.on_the_wire()

        async def begin(drive: Drive) -> Answer:
            def request() -> GoalRequest:
                return drive.begun_by(
                    goal_request(place, self.ids.next(), Mode.GUIDED, from_robot=from_robot)
                )

            answer, _ = await self.accepted(request, beats=True, arms=arms)
            return answer

        async def follow(drive: Drive) -> GoalEnded:
            self.progress.note(f"goal {goal} accepted")
            now_ns = self.clock.now_ns()
            watch = GoalWatch(drive.request_id, now_ns, timeout_ns, asked_ns=asked_ns)
            return await self._followed(drive, watch, asked_ns, abort)

        def abort() -> CommandRequest:
            return self.request(Command.SIDESTEP_ABORT_GOAL)

        return await self.drive_until(begin, follow, abort)

    async def _followed(
        self, drive: Drive, watch: GoalWatch, asked_ns: int, ending: Callable[[], CommandRequest]
    ) -> GoalEnded:
        """Follow a goal to its end; end it, and no other, by a request when its time is up."""
        with self.subscribed(STATUS, ODOMETRY, DECISION, LEASE) as telemetry:
            end = await self.follow(watch, telemetry)
            if end.abort:
                await finish(self._end(drive, ending, end.reason))
                end = watch.outrun(telemetry.latest) or await self._caused(end)
            return self._goal_ended(end, telemetry, asked_ns)

    async def send_goal(
        self, goal: Destination, mode: Mode, *, from_robot: bool = False, arms: bool = True
    ) -> tuple[Answer, int]:
        """Send a goal until the robot accepts it; return the answer and the id of its request."""
        if (refused := await self.lease.ensure()) is not None:
            return refused, 0
        place = goal.on_the_wire()

        def request() -> GoalRequest:
            return goal_request(place, self.ids.next(), mode, from_robot=from_robot)

        sending = partial(self.accepted, request, beats=mode == Mode.GUIDED, arms=arms)
        answer, sent = await self.uninterrupted(self._turn, sending)
        return answer, sent.request_id

    async def follow(self, watch: GoalWatch, telemetry: Telemetry) -> GoalEnd:
        """Follow a goal to its end, and show its progress."""
        shown_ns, every_ns = 0, SHOW_NS if self.progress.live else SHOW_PLAIN_NS
        while True:
            self.check_open()
            watch.look(telemetry.latest)
            now_ns = self.clock.now_ns()
            if watch.due(now_ns):
                self.lease.attend()
            is_due = now_ns - shown_ns >= every_ns or (watch.end and self.progress.live)
            if watch.is_shown and is_due:
                shown_ns = now_ns
                self.progress.line(goal_line(telemetry, now_ns, watch.silent_ns(now_ns)))
            if watch.end is not None:
                return watch.end
            await self.arrival(now_ns + BEAT_NS // 2)

    async def _caused(self, end: GoalEnd) -> GoalEnd:
        """Add why no simulated time passes for the robot to the end of a goal, if that is so."""
        cause = await self.standstill()
        return replace(end, reason=f"{end.reason}: {cause}") if cause else end

    def _goal_ended(self, end: GoalEnd, telemetry: Telemetry, asked_ns: int) -> GoalEnded:
        status, pose = telemetry.latest(STATUS), telemetry.latest(ODOMETRY)
        distance_m = None if status is None else status[0].goal_distance_m
        doubt_m = None if pose is None else doubt_of(pose[0])
        wall_s = (self.clock.now_ns() - asked_ns) / NS_PER_S
        return GoalEnded(end.outcome, end.reason, distance_m, wall_s, doubt_m)

    # Drives.

    async def drive(
        self, speed_m_s: float, turn_deg_s: float, *, for_s: float | None = None
    ) -> DriveEnded | Refused:
        """Drive by hand in MANUAL at a speed (negative: backwards) and a turn (positive: left).

        Ends after `for_s` or when cancelled; then the robot stops and holds, unless it drives for
        another request already. Each speed expires after 250 ms, so the robot also stops if the
        program hangs or exits.
        """
        within(speed_m_s, -FASTEST_M_S, FASTEST_M_S, "speed", "m/s")
        within(turn_deg_s, -FASTEST_DEG_S, FASTEST_DEG_S, "turn", "deg/s")
        if for_s is not None:
            within(for_s, 0.0, LONGEST_S, "time", "s")

        async def constant() -> Speeds:
            began_ns = self.clock.now_ns()
            while for_s is None or self.clock.now_ns() - began_ns < for_s * NS_PER_S:
                due_ns = self.clock.now_ns() + TICK_NS
                yield speed_m_s, radians(turn_deg_s)
                await self.sleep_until(due_ns)

        return await self.steer(constant())

    async def steer(self, speeds: Speeds) -> DriveEnded | Refused:
        """Drive by hand in MANUAL by speeds (m/s, rad/s) as they come, until there are no more.

        At least every 200 ms one must come. It ends as `drive` does.
        """
        stick = TeleopSender(self.bus, self.name, self.clock)

        async def follow(drive: Drive) -> DriveEnded:
            self._stick = stick
            await self.in_own_thread(stick.open)
            watch = DriveWatch(drive.request_id, self.bus.operator or "", self.clock.now_ns())
            with self.subscribed(STATUS, LEASE) as telemetry:
                async with aclosing(speeds):
                    why = await self._steer(stick, watch, speeds, telemetry.latest)
                if watch.is_seized:  # the drive is that of the other person now
                    return DriveEnded(why)
                answer = await finish(self._end(drive, hold))
                if why or isinstance(answer, Accepted):
                    return DriveEnded(why)

                # Another has held it or driven, or may have: the telemetry tells, a little later.
                def lost() -> str | None:
                    return watch.lost(telemetry.latest, self.clock.now_ns())

                await self.wait(lambda: bool(lost()), NAMED_NS)
                return DriveEnded(lost() or (DRIVE_REPLACED if answer is None else UNCONFIRMED))

        def hold() -> CommandRequest:
            if self._stick is stick:  # those of a later drive go on
                stick.stop()
            return self._mode_request(Mode.HOLD)

        return await self.drive_until(self._take_manual, follow, hold)

    async def _take_manual(self, drive: Drive) -> Answer:
        """Choose MANUAL, and arm a robot in standby; hold one that cannot be armed."""
        answer, _ = await self.accepted(
            lambda: drive.begun_by(self._mode_request(Mode.MANUAL)), beats=True
        )
        armed = await self._arm_if_standing_by(knows_stop=False) if answer.ok else None
        if not isinstance(armed, Refused):
            return answer
        await self._end(drive, partial(self._mode_request, Mode.HOLD))
        return armed

    async def _steer(
        self, stick: TeleopSender, watch: DriveWatch, speeds: Speeds, latest: Latest
    ) -> str:
        """Return why it ended early; empty if there were no more speeds.

        A drive that is lost sends nothing more.
        """
        heartbeat = HeartbeatTimer()
        async for speed_m_s, turn_rad_s in speeds:
            self.check_open()
            now_ns = self.clock.now_ns()
            if why := (lost := watch.lost(latest, now_ns)):
                return why
            newest = latest(STATUS)
            if heartbeat.due(now_ns, 0 if newest is None else newest[0].time_ns):
                self.lease.attend()
            if lost is None:
                stick.drive(speed_m_s, turn_rad_s)
        return ""

    async def drive_until(
        self,
        begin: Callable[[Drive], Coroutine[Any, Any, Answer]],
        follow: Callable[[Drive], Coroutine[Any, Any, T]],
        ending: Callable[[], CommandRequest],
    ) -> T | Refused:
        """Begin a drive and follow it; end it, and no other, if this is cancelled or raises.

        `begin` notes its requests in the drive. `ending` returns the hold or the abort that ends
        it.
        """
        if (refused := await self.lease.ensure(for_drive=True)) is not None:
            if self.lease.leasing is Leasing.DRIVES:
                raise RefusedError(refused.text)
            return refused
        self.check_open()
        drive = Drive()
        self._drives.add(drive)
        try:
            if self.lease.leasing is Leasing.DRIVES:
                await self.lease.open()
            self.lease.attend()
            answer = await self.uninterrupted(self._turn, partial(begin, drive), drive.sent_by)
            return answer if isinstance(answer, Refused) else await follow(drive)
        except BaseException:
            await finish(self._end_after(drive, ending))
            raise
        finally:
            if self.lease.leasing is Leasing.DRIVES:
                await finish(self.lease.leave())
            self._drives.discard(drive)
            drive.ended.set()

    async def _end_after(self, drive: Drive, ending: Callable[[], CommandRequest]) -> None:
        """End a drive after what begins it was sent; the other order would let the robot drive."""
        if drive.sending is not None:
            await settled(drive.sending)
        await self._end(drive, ending, "interrupted")

    async def _end(
        self, drive: Drive, ending: Callable[[], CommandRequest], why: str = ""
    ) -> Answer | GaveUp | None:
        """End this drive, and no other; without an answer the heartbeat ends, unless others drive.

        Then the robot stops by itself. The progress tells the end of a goal, and `why`. Return the
        answer; None if the drive was over.
        """
        attempts = 1 if self.lease.leasing is Leasing.DRIVES else ATTEMPTS
        request = ending()
        outcome = await self.end(request, drive.request_id, attempts)
        if isinstance(outcome, GaveUp) and len(self._drives) == 1:
            self.lease.is_ours = False
        if outcome is not None and request.command == Command.SIDESTEP_ABORT_GOAL:
            self.progress.note(f"{why}: {words_of_abort(outcome)}")
        elif why and isinstance(outcome, Accepted):
            self.progress.note(f"{why}: the robot holds")
        return outcome

    # Commands.

    async def perform(self, command: Operation[Out]) -> Out:
        """Carry out any command of `sidestep.operations`.

        Cancelling this does not withdraw a request that was sent.
        """
        self.check_open()
        return await command.perform(self)

    async def command(
        self,
        request: CommandRequest,
        *,
        moves: bool = True,
        begins: bool = False,
        timeout_s: float | None = None,
    ) -> Answer:
        """Send a command and return the robot's answer; give up after `timeout_s`.

        One that `moves` the robot takes the lease first; one that `begins` a drive waits for what
        began one before.
        """
        if moves and (refused := await self.lease.ensure()) is not None:
            return refused
        patience_ns = None if timeout_s is None else max(1, round(timeout_s * NS_PER_S / ATTEMPTS))
        asking = partial(self.ask, request, patience_ns=patience_ns)
        answer = await self._explained(await (self.in_turn(asking) if begins else asking()))
        return await self._acted_on(answer) if moves else answer

    async def hold(self, *, timeout_s: float | None = None) -> Answer:
        """Stop and keep the goal; needs no lease."""
        request = self.request(Command.DO_PAUSE_CONTINUE, 0.0)
        return await self.command(request, moves=False, timeout_s=timeout_s)

    async def abort(self, *, timeout_s: float | None = None) -> Answer:
        """Cancel the goal and stop; needs no lease."""
        request = self.request(Command.SIDESTEP_ABORT_GOAL)
        return await self.command(request, moves=False, timeout_s=timeout_s)

    async def arm(self, *, timeout_s: float | None = None) -> Answer:
        """Allow the wheels to turn."""
        return await self.command(
            self.request(Command.COMPONENT_ARM_DISARM, 1.0), timeout_s=timeout_s
        )

    async def disarm(self, *, timeout_s: float | None = None) -> Answer:
        """Block the wheels; needs no lease."""
        request = self.request(Command.COMPONENT_ARM_DISARM, 0.0)
        return await self.command(request, moves=False, timeout_s=timeout_s)

    async def restart(self, *, timeout_s: float | None = None) -> Answer:
        """End the robot's process, so that its supervisor starts it again; refused while armed."""
        request = self.request(Command.PREFLIGHT_REBOOT_SHUTDOWN, 1.0)
        return await self.command(request, timeout_s=timeout_s)

    async def return_home(self, *, timeout_s: float | None = None) -> Answer:
        """Drive back along the robot's own trail; return once the robot has accepted."""
        request = self.request(Command.NAV_RETURN_TO_LAUNCH)
        return await self.command(request, begins=True, timeout_s=timeout_s)

    async def set_mode(self, mode: Mode | str, *, timeout_s: float | None = None) -> Answer:
        """Choose the mode, also by its name, such as "hold", which needs no lease."""
        chosen = member_of(Mode, mode, "mode")
        answer = await self.command(
            self._mode_request(chosen),
            moves=chosen is not Mode.HOLD,
            begins=True,
            timeout_s=timeout_s,
        )
        if chosen is Mode.MANUAL and isinstance(answer, Refused):
            return replace(answer, remedies=answer.remedies.by_hand())
        return answer

    def _mode_request(self, mode: Mode) -> CommandRequest:
        return self.request(Command.DO_SET_MODE, 1.0, float(mode))

    async def set_navigator(
        self, navigator: Navigator | str, side: int | str = 0, *, timeout_s: float | None = None
    ) -> Answer:
        """Choose the navigator, also by its name, such as "bug".

        It passes obstacles "left" (1), "right" (-1) or as before (0).
        """
        chosen = member_of(Navigator, navigator, "navigator")
        sign = SIDES.get(side.lower()) if isinstance(side, str) else side
        if sign not in (-1, 0, 1):
            raise UserError(f"there is no side {side!r}: use left, right, or 0 for as before")
        request = self.request(Command.SIDESTEP_SET_NAVIGATOR, float(chosen), float(sign))
        return await self.command(request, timeout_s=timeout_s)

    async def set_pose(
        self,
        x_m: float,
        y_m: float,
        heading_deg: float | None = None,
        *,
        timeout_s: float | None = None,
    ) -> Answer:
        """Set the pose of the robot; without a heading it keeps its own, if it knows its place.

        In metres and degrees; refused while a goal is active.
        """
        within(x_m, -FARTHEST_M, FARTHEST_M, "x", "m")
        within(y_m, -FARTHEST_M, FARTHEST_M, "y", "m")
        if heading_deg is not None:
            within(heading_deg, -360.0, 360.0, "heading", "deg")
        heading_rad = nan if heading_deg is None else radians(heading_deg)
        return await self._set_pose(x_m, y_m, heading_rad, timeout_s)

    async def set_true_pose(self, *, timeout_s: float | None = None) -> Answer:
        """Set the pose of a simulated robot to the true one; RemoteError without a simulation."""
        truth = await self.fresh(TRUTH)
        if truth is None:
            fix = "in the real world, or without rights to it, use `pose set X Y DEG`"
            why = f"no simulation publishes the true place of {self.name}: {fix}"
            raise RemoteError(await self.standstill() or why)
        return await self._set_pose(truth.x_m, truth.y_m, truth.heading_rad, timeout_s)

    async def _set_pose(
        self, x_m: float, y_m: float, heading_rad: float, timeout_s: float | None
    ) -> Answer:
        request = self.request(Command.SIDESTEP_SET_POSE, x_m, y_m, heading_rad)
        return await self.command(request, timeout_s=timeout_s)

    async def mark(self, remark: str) -> Marked | Refused:
        """Add a remark to what is being recorded; `ok` if a recorder received it.

        Raises UserError for an empty one.
        """
        if not remark.strip():
            raise UserError("the remark is empty: say what is to be found in the recording")
        if (refused := await self.lease.ensure()) is not None:
            return refused
        publisher = self.bus.publisher(MARK, self.name)
        missing = await self.in_own_thread(
            lambda: self.bus.await_matched([publisher], timeout_s=READY_S)
        )
        if not missing:
            for piece in pieces_of(remark, self.ids.next() & 0xFFFF or 1, Severity.NOTICE):
                publisher.put(piece)
        return Marked(remark, not missing)

    # To go on.

    async def resume(self, *, timeout_s: float | None = None) -> Answer | GoalEnded:
        """Continue to the goal, also to one that a failsafe, a stop or an abort has ended.

        A program that takes the lease only for its drives follows a goal which needs an operator,
        as `drive_to` does, and returns its end; if this is cancelled, the robot holds.
        """
        if (refused := await self.lease.ensure()) is not None:
            return refused
        answer = await self.in_turn(partial(self._resume, timeout_s))
        is_alone = isinstance(answer, Refused) and answer.reason == Reason.NO_OPERATOR
        if not is_alone or self.lease.leasing is not Leasing.DRIVES:
            return await self._acted_on(answer)
        newest, mission = (
            await self.newest(STATUS, NEWEST_NS),
            await self.newest(MISSION, MISSION_NS),
        )
        on_mission = mission is not None and mission.state in UNDER_WAY
        return answer if newest is None or on_mission else await self._attend(newest.goal_id)

    async def _resume(self, timeout_s: float | None) -> Answer:
        """Continue a kept goal; else drive on to the one that the robot's status shows as lost."""
        request = self.request(Command.DO_PAUSE_CONTINUE, 1.0)
        answer = await self.command(request, moves=False, timeout_s=timeout_s)
        if isinstance(answer, Refused) and answer.reason == Reason.NO_GOAL:
            return await self._go_on(answer)
        return answer

    async def _attend(self, goal_id: int) -> GoalEnded | Refused:
        """Continue a kept goal with this program's heartbeat, and follow it to its end."""
        asked_ns = self.clock.now_ns()

        async def begin(drive: Drive) -> Answer:
            answer, _ = await self.accepted(
                lambda: self.request(Command.DO_PAUSE_CONTINUE, 1.0), beats=True, arms=False
            )
            drive.request_id = goal_id if answer.ok else 0
            return answer

        async def follow(drive: Drive) -> GoalEnded:
            self.progress.note("driving on")
            return await self._followed(drive, GoalWatch(goal_id, asked_ns, None), asked_ns, hold)

        def hold() -> CommandRequest:
            return self._mode_request(Mode.HOLD)

        return await self.drive_until(begin, follow, hold)

    async def _go_on(self, refusal: Refused) -> Answer:
        """Continue the lost drive of a robot that has no active goal, and so refused to resume.

        The robot must be armed: it is not armed here.
        """
        with self.subscribed(STATUS, MISSION) as telemetry:
            await self.wait(lambda: telemetry.latest(STATUS) is not None, NEWEST_NS)
            newest = telemetry.latest(STATUS)
            if newest is None:
                return replace(refusal, cause=await self.standstill())
            status = newest[0]
            lost = await self._lost_drive(telemetry, status)
            mission = telemetry.latest(MISSION)
        if lost is None:
            return NothingToResume(
                refusal.reason,
                refusal.took_ns,
                remedies=refusal.remedies,
                mission=None if mission is None else mission[0],
            )
        if status.vehicle != Vehicle.ACTIVE:
            stopped = status.vehicle == Vehicle.EMERGENCY_STOP
            reason = Reason.EMERGENCY_STOPPED if stopped else Reason.NOT_ARMED
            return replace(refusal, reason=reason)
        attends = self.lease.leasing is not Leasing.DRIVES
        is_attended = attends and isinstance(lost, LostGoal) and not lost.is_auto
        mode = Mode.GUIDED if is_attended else Mode.AUTO
        answer, _ = await self.accepted(
            partial(self._request_for, lost, mode), beats=is_attended, arms=False
        )
        return Resumed(answer.took_ns, lost) if isinstance(answer, Accepted) else answer

    async def _lost_drive(self, telemetry: Telemetry, status: NavigatorStatus) -> LostDrive | None:
        """Return the lost drive; download the mission only if the mission failed."""
        await self.wait(lambda: telemetry.latest(MISSION) is not None, MISSION_NS)
        newest = telemetry.latest(MISSION)
        if newest is None or not has_failed(newest[0]):
            return lost_drive(status, None, {})
        found = await fetch(self, MissionType.MISSION)
        steps = waypoints_of(found.items) if isinstance(found, Downloaded) else ()
        places = {at: step for at, step in enumerate(steps) if isinstance(step, Waypoint)}
        return lost_drive(status, newest[0], places)

    def _request_for(self, lost: LostDrive, mode: Mode) -> Request:
        """Return the request that continues a drive."""
        if isinstance(lost, LostMission):
            return self.request(Command.MISSION_START, float(CURRENT))
        if isinstance(lost, LostGoal):
            return goal_request(lost.goal.on_the_wire(), self.ids.next(), mode)
        return self.request(Command.NAV_RETURN_TO_LAUNCH)

    # The emergency stop.

    def press_stop(self, *, timeout_s: float = STOP_S) -> "asyncio.Future[Stopped]":
        """Stop the robot at once: the stop is sent when this returns.

        It is repeated every 50 ms, in a thread of its own, until the robot's status shows it. The
        future has the end, which is `ok` only if the status shows the stop within `timeout_s`.
        Needs no lease, waits for no other request, and the robot never refuses it.
        """
        self.check_open()
        stops, ways = self._ways_to_stop()
        stop = EmergencyStop(
            self.bus, stops, self.name, self.clock, lambda: self.streams.latest(STATUS), ways
        )
        stop.press()
        self.streams.keep(STATUS)  # which shows the stop; a robot that is open has it already
        self._own_stops.appendleft(stop.request_id)
        give_up_ns = round(timeout_s * NS_PER_S)
        return self._repeated(lambda: Stopped(stop.run(give_up_ns=give_up_ns), self.name))

    def _repeated(self, stop: Callable[[], T]) -> "asyncio.Future[T]":
        """Repeat a stop in a thread of its own, which a cancellation does not end."""
        repeating = in_own_thread(stop, "emergency stop")
        self._stopping.add(repeating)
        repeating.add_done_callback(self._stopping.discard)
        return repeating

    async def emergency_stop(self, *, timeout_s: float = STOP_S) -> Stopped:
        """Stop the robot at once: repeat every 50 ms until its status shows the stop.

        The first stop is sent before this awaits anything. A cancellation does not end the
        repetition. Needs no lease. `ok` only if the robot shows the stop within `timeout_s`.
        """
        return await asyncio.shield(self.press_stop(timeout_s=timeout_s))

    async def emergency_stop_all(self, *, timeout_s: float = STOP_S) -> AllAnswered:
        """Stop every robot that is present: all are sent the stop before any is awaited.

        A cancellation does not end the repetition. Needs no lease.

        Raises UnansweredError if no robot is present.
        """
        self.check_open()
        request_id = new_press()
        self._own_stops.appendleft(request_id)
        give_up_ns = round(timeout_s * NS_PER_S)
        return await asyncio.shield(self._repeated(lambda: stop_all(self, give_up_ns, request_id)))

    async def clear_emergency_stop(self, *stop_ids: int, timeout_s: float | None = None) -> Answer:
        """Release an emergency stop that is known, and no newer one of somebody else.

        `stop_ids` are those known when the release was asked for: the one that the status named,
        then own ones, which the status may not show yet. Without any they are those that this
        program knows, or that of the status of now. Waits until no stop of this program is repeated
        any more. The robot stays disarmed. Raises UnansweredError if no stop is known.
        """
        known = stop_ids or self.stops_known
        if self._stopping:
            await asyncio.wait(tuple(self._stopping))
        if (refused := await self.lease.ensure()) is not None:
            return refused
        first, *others = dict.fromkeys(known or (await self._stop_shown(),))
        answer = await self._release_stop(first, timeout_s)
        for stop_id in others:
            if isinstance(answer, Refused) and answer.reason == Reason.NEWER_STOP:
                answer = await self._release_stop(stop_id, timeout_s)
        return answer

    async def clear_emergency_stop_all(
        self, stop_ids: Mapping[str, tuple[int, ...]], *, timeout_s: float | None = None
    ) -> AllAnswered:
        """Release the emergency stop of every robot that is present; each is then disarmed.

        `stop_ids` are the stops that are known, by robot; of others it is that of the status of
        now. Raises UnansweredError if no robot is present.
        """
        if (refused := await self.lease.ensure()) is not None:
            return AllAnswered(((self.name, refused),))
        robots = await self.in_own_thread(lambda: present_robots(self))

        async def clear(robot: str) -> Answer | Unanswered:
            try:
                return await self.to(robot).clear_emergency_stop(
                    *stop_ids.get(robot, ()), timeout_s=timeout_s
                )
            except RemoteError as error:
                return Unanswered(str(error))

        answers = await asyncio.gather(*map(clear, robots))
        return AllAnswered(tuple(zip(robots, answers, strict=True)))

    @property
    def stops_known(self) -> tuple[int, ...]:
        """The stop in the newest status, then those of this program, the newest first."""
        newest = self.streams.latest(STATUS)
        shown = () if newest is None else (newest[0].stop_id,)
        return (*shown, *self._own_stops)

    async def _release_stop(self, stop_id: int, timeout_s: float | None) -> Answer:
        request = self.request(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)
        named = structs.replace(request, stop_id=stop_id)
        return await self.command(named, moves=False, timeout_s=timeout_s)

    async def _stop_shown(self) -> int:
        """Return the stop that the status of now names; UnansweredError without a status."""
        newest = await self.newest(STATUS, NEWEST_NS)
        if newest is None:
            why = GaveUp("no status names the emergency stop to clear")
            raise await self.unanswered(why, COMMAND)
        return newest.stop_id

    async def in_turn(self, sending: Callable[[], Coroutine[Any, Any, T]]) -> T:
        """Send what begins a drive after what began one before.

        Cancelled while it waits, it is not sent; cancelled later, it is sent nevertheless.
        """
        return await self.uninterrupted(self._turn, sending)


def words_of_abort(outcome: Answer | GaveUp) -> str:
    """Return what has become of an abort."""
    if isinstance(outcome, Accepted):
        return "goal aborted, the robot stops"
    return f"abort refused: {outcome.words}" if isinstance(outcome, Refused) else NO_ANSWER


def member_of(kind: type[E], given: E | str, what: str) -> E:
    """Return the member of an enumeration, also by its name or number; UserError if unknown."""
    name = given.upper() if isinstance(given, str) else ""
    for member in kind:
        if member.name == name or member == given:
            return member
    names = ", ".join(member.name.lower() for member in kind)
    raise UserError(f"there is no {what} {given!r}: use one of {names}")
