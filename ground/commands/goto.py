"""Driving to a goal: arm the robot if needed, send the goal, follow it, abort it at a failure."""

from dataclasses import dataclass
from typing import ClassVar, Final

from ground.client.floor import world_goal
from ground.client.goal import Destination, from_robot, goal_request
from ground.client.link import Link
from ground.client.outcomes import Accepted, GoalEnded, Refused
from ground.client.requests import BEAT_NS, GoalEnd, GoalWatch
from ground.client.session import Session
from ground.client.status_line import goal_line, knows_place
from ground.client.telemetry import Telemetry
from ground.commands.lease import leased
from protocol.outcome import doubt_of
from protocol.topics import DECISION, LEASE, ODOMETRY, STATUS
from protocol.wire.enums import Command, Mode
from protocol.wire.messages import GoalRequest
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S

SHOW_NS: Final = 200_000_000
SHOW_PLAIN_NS: Final = 2_000_000_000
POSE_NS: Final = 1_000_000_000
NO_ANSWER: Final = (
    "no answer to the abort; without an operator's heartbeat the robot stops by itself"
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Goto:
    """Drive to a goal, by default that of the world. Without `wait` the mode is AUTO.

    AUTO needs no operator.
    `seen_by_robot`: the goal is given relative to the robot (ahead, left), not in the world frame.
    `timeout_s`: abort after this time; UserError if the operation does not wait for the end.
    `anyway`: send a goal outside of the known world, too. `arms`: arm a robot in standby.
    """

    verb: ClassVar[str] = "goto"
    moves: ClassVar[bool] = True
    goal: Destination | None = None
    seen_by_robot: bool = False
    wait: bool = True
    timeout_s: float | None = None
    anyway: bool = False
    arms: bool = True

    def perform(self, session: Session) -> Accepted | Refused | GoalEnded:
        """Send the goal; with `wait`, follow it to its end."""
        if self.timeout_s is not None and session.attended:
            raise UserError("--timeout cannot be used here: this command does not wait for the end")
        if self.timeout_s is not None and not self.wait:
            raise UserError("--timeout cannot be combined with --no-wait")
        goal = world_goal(session.link) if self.goal is None else self.goal
        if not self.seen_by_robot:
            self._refuse_outside(session, goal)
        with session.link.subscribed(STATUS, ODOMETRY, DECISION, LEASE) as telemetry:
            drive = _Drive(session, telemetry)
            if self.seen_by_robot:
                goal = drive.placed(goal)
                if drive.knows_place():
                    self._refuse_outside(session, goal)
            if not self.wait or session.attended:
                mode = Mode.GUIDED if self.wait else Mode.AUTO
                from_robot = self.seen_by_robot
                return send_goal(session, goal, mode, from_robot=from_robot, arms=self.arms)[0]
            timeout_ns = None if self.timeout_s is None else round(self.timeout_s * NS_PER_S)
            with leased(session):
                return drive.to_the_end(
                    goal, timeout_ns, from_robot=self.seen_by_robot, arms=self.arms
                )

    def _refuse_outside(self, session: Session, goal: Destination) -> None:
        """Raise UserError for a goal outside of the known world, unless it is sent anyway."""
        if not self.anyway:
            session.refuse_outside((f"goal {goal}", goal.x_m, goal.y_m))


class _Drive:
    """One goal of one robot, from arming to its end."""

    def __init__(self, session: Session, telemetry: Telemetry) -> None:
        self._session = session
        self._link = session.link
        self._progress = session.progress
        self._telemetry = telemetry

    def placed(self, seen: Destination) -> Destination:
        """Convert a goal relative to the robot to the world frame; RemoteError without a pose."""
        clock, telemetry = self._link.clock, self._telemetry
        self._link.wait(lambda: telemetry.fresh(ODOMETRY, clock.now_ns()) is not None, POSE_NS)
        pose = telemetry.fresh(ODOMETRY, clock.now_ns())
        if pose is None:
            raise RemoteError(f"the robot publishes no pose: {self._link.diagnosis()}")
        return from_robot(seen, pose.x_m, pose.y_m, pose.heading_rad)

    def knows_place(self) -> bool:
        """Return whether the robot knows its place, by its newest pose."""
        newest = self._telemetry.latest(ODOMETRY)
        return newest is not None and knows_place(newest[0])

    def to_the_end(
        self, goal: Destination, timeout_ns: int | None, *, from_robot: bool, arms: bool
    ) -> Accepted | Refused | GoalEnded:
        """Send the goal and follow it; abort it if an exception is raised."""
        self._link.beat()
        started_ns = self._link.clock.now_ns()
        try:
            answer, request = send_goal(
                self._session, goal, Mode.GUIDED, from_robot=from_robot, arms=arms
            )
            if not answer.ok:
                return answer
            self._progress.note(f"goal {goal} accepted")
            accepted_ns = self._link.clock.now_ns()
            watch = GoalWatch(request.request_id, accepted_ns, timeout_ns, asked_ns=started_ns)
            end = self._follow(watch)
        except BaseException:
            self._abort("interrupted")
            raise
        if end.abort:
            self._abort(end.reason)
            end = watch.outrun(self._telemetry.latest) or end
        return self._ended(end, started_ns)

    def _follow(self, watch: GoalWatch) -> GoalEnd:
        clock, last_shown_ns = self._link.clock, 0
        every_ns = SHOW_NS if self._progress.live else SHOW_PLAIN_NS
        while True:
            watch.look(self._telemetry.latest)
            now_ns = clock.now_ns()
            if watch.due(now_ns):
                self._link.beat()
            is_due = now_ns - last_shown_ns >= every_ns or (watch.end and self._progress.live)
            if watch.is_shown and is_due:
                last_shown_ns = now_ns
                self._progress.line(goal_line(self._telemetry, now_ns, watch.silent_ns(now_ns)))
            if watch.end is not None:
                return watch.end
            self._link.pulse.wait_until(now_ns + BEAT_NS // 2)

    def _abort(self, why: str) -> None:
        if done := abort(self._link, self._session.begun_id):
            self._progress.note(f"{why}: {done}")

    def _ended(self, end: GoalEnd, started_ns: int) -> GoalEnded:
        wall_s = (self._link.clock.now_ns() - started_ns) / NS_PER_S
        newest = self._telemetry.latest(STATUS)
        distance_m = None if newest is None else newest[0].goal_distance_m
        pose = self._telemetry.latest(ODOMETRY)
        doubt_m = None if pose is None else doubt_of(pose[0])
        return GoalEnded(end.outcome, end.reason, distance_m, wall_s, doubt_m)


def send_goal(
    session: Session,
    goal: Destination,
    mode: Mode,
    *,
    from_robot: bool = False,
    arms: bool = True,
) -> tuple[Accepted | Refused, GoalRequest]:
    """Send a goal until the robot accepts it; with `arms`, arm a robot in standby."""

    def request() -> GoalRequest:
        place, number = goal.on_the_wire(), session.link.ids.next()
        return goal_request(place, number, mode, from_robot=from_robot)

    return session.ask_until_accepted(request, beats=mode == Mode.GUIDED, arms=arms)


def abort(link: Link, goal_id: int, attempts: int = 1) -> str:
    """Abort this goal, and no other, and describe the result; empty if it is over already.

    Without an answer the robot stops by itself, because the heartbeat ends.
    """
    outcome = link.end(link.command(Command.SIDESTEP_ABORT_GOAL), goal_id, attempts)
    if isinstance(outcome, Accepted):
        return "goal aborted, the robot stops"
    if isinstance(outcome, Refused):
        return f"abort refused: {outcome.words}"
    return "" if outcome is None else NO_ANSWER
