"""`goto`: arm if need be, send the goal, be the operator while it lives, tell how it ended."""

import argparse
from typing import Final

from ground.cli.command.lease import leased
from ground.cli.command.simple_commands import tell
from ground.client.arming import insist
from ground.client.connection import add_common, common_of, seconds
from ground.client.goal import Destination, destination_of, from_robot, goal_request
from ground.client.goal import arguments as destination_arguments
from ground.client.link import Link, linked
from ground.client.requests import BEAT_NS, Answered, Asking, GoalEnd, GoalWatch
from ground.client.status_line import goal_line
from ground.client.telemetry import Telemetry
from ground.text.output import Says
from protocol.topics import COMMAND, DECISION, ODOMETRY, STATUS
from protocol.wire.enums import Command, Mode
from protocol.wire.messages import GoalRequest
from runtime.errors import RemoteError, UserError
from runtime.units import NS_PER_S

SHOW_NS: Final = 200_000_000
SHOW_PLAIN_NS: Final = 2_000_000_000
STOP_NS: Final = 300_000_000
POSE_NS: Final = 1_000_000_000


def arguments(parser: argparse.ArgumentParser) -> None:
    destination_arguments(parser)
    add_common(parser)
    parser.add_argument(
        "--no-wait", action="store_true", help="in AUTO, which needs no operator; do not wait"
    )
    parser.add_argument("--timeout", type=seconds, metavar="S", help="abort after this long")


def run(options: argparse.Namespace, says: Says) -> int:
    destination_of(options)  # what cannot be a goal is refused before anybody is dialled
    with linked(common_of(options)) as link:
        return act(options, link, says)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    """Waits for the end, unless the robot needs nobody or somebody else attends it."""
    where = destination_of(options)
    if options.timeout is not None and (options.no_wait or options.attended):
        raise UserError("--timeout is for whoever waits for the end; nobody does")
    with link.hearing(STATUS, ODOMETRY, DECISION) as telemetry:
        return Drive(link, says, telemetry).go(options, where)


class Drive:
    """One goal of one robot, from arming to its end."""

    def __init__(self, link: Link, says: Says, telemetry: Telemetry) -> None:
        self._link = link
        self._says = says
        self._telemetry = telemetry

    def go(self, options: argparse.Namespace, where: Destination) -> int:
        """The exit code: 0 when the robot is under way, or there if somebody waits for that."""
        if options.frame == "body":
            where = self.seen_by_robot(where)
        if options.no_wait or options.attended:
            mode = Mode.AUTO if options.no_wait else Mode.GUIDED
            return tell(self._says, "goto", self._link, self.send(where, mode)[0])
        timeout_ns = None if options.timeout is None else round(options.timeout * NS_PER_S)
        with leased(self._link):
            return self.wait_for(where, timeout_ns)

    def seen_by_robot(self, where: Destination) -> Destination:
        """What lies there for the robot, in the world; RemoteError when it is not heard."""
        clock, telemetry = self._link.clock, self._telemetry
        self._link.wait(lambda: telemetry.fresh(ODOMETRY, clock.now_ns()) is not None, POSE_NS)
        pose = telemetry.fresh(ODOMETRY, clock.now_ns())
        if pose is None:
            raise RemoteError(f"the robot does not say where it is: {self._link.diagnosis()}")
        return from_robot(where, pose.x_m, pose.y_m, pose.heading_rad)

    def wait_for(self, where: Destination, timeout_ns: int | None) -> int:
        """Exit code 0 when the robot gets there. Whatever interrupts us aborts the goal."""
        self._link.beat()
        started_ns = self._link.clock.now_ns()
        try:
            answered, request = self.send(where, Mode.GUIDED)
            if not answered.ok:
                return tell(self._says, "goto", self._link, answered)
            self._says.note(f"goal {where} accepted")
            watch = GoalWatch(request.request_id, started_ns, timeout_ns)
            end = self._follow(watch, request.request_id)
        except BaseException:
            self._abort("given up")
            raise
        if end.abort:
            self._abort(end.reason)
        return self._tell_end(end, started_ns)

    def send(self, where: Destination, mode: Mode) -> tuple[Answered, GoalRequest]:
        """Give the goal; arms a robot that stands by, waits for it to hear its operator."""

        def request() -> GoalRequest:
            return goal_request(where.on_the_wire(), self._link.ids.next(), mode)

        return insist(self._link, self._says, request, beats=mode == Mode.GUIDED)

    def _follow(self, watch: GoalWatch, goal_id: int) -> GoalEnd:
        clock, last_shown_ns = self._link.clock, 0
        every_ns = SHOW_NS if self._says.live else SHOW_PLAIN_NS
        while True:
            newest = self._telemetry.latest(STATUS)
            if newest is not None:
                watch.receive(*newest)
            now_ns = clock.now_ns()
            for _ in watch.due(now_ns):
                self._link.beat()
            over = watch.end is not None
            if now_ns - last_shown_ns >= every_ns or (over and self._says.live):
                last_shown_ns = now_ns
                self._says.line(
                    goal_line(self._telemetry, now_ns, watch.silent_ns(now_ns), goal_id)
                )
            if watch.end is not None:
                return watch.end
            self._link.pulse.wait_until(now_ns + BEAT_NS // 2)

    def _abort(self, why: str) -> None:
        """Tell the robot, once and briefly: it stops without us, too. Nobody asks who is gone."""
        request, now_ns = self._link.command(Command.SIDESTEP_ABORT_GOAL), self._link.clock.now_ns()
        asking = Asking(request, now_ns, attempts=1, patience_ns=STOP_NS)
        self._link.talk(asking, COMMAND)
        said = "the robot could not be told; without an operator it stops by itself"
        if isinstance(asking.outcome, Answered):
            said = "goal aborted, the robot stops" if asking.outcome.ok else asking.outcome.text
        self._says.note(f"{why}: {said}")

    def _tell_end(self, end: GoalEnd, started_ns: int) -> int:
        wall_s = (self._link.clock.now_ns() - started_ns) / NS_PER_S
        newest = self._telemetry.latest(STATUS)
        found: dict[str, object] = {
            "verb": "goto",
            "robot": self._link.robot,
            "ok": end.reached,
            "outcome": end.outcome,
            "reason": end.reason,
            "distance_m": None if newest is None else newest[0].goal_distance_m,
            "wall_s": round(wall_s, 3),
        }
        detail = "" if end.reason == end.outcome else f": {end.reason}"
        self._says.result(found, f"{end.outcome}{detail} after {wall_s:.1f} s")
        return 0 if end.reached else 1
