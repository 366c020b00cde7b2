"""`goto`: drive to a goal, and follow it to its end."""

from dataclasses import dataclass
from math import degrees
from typing import Any, ClassVar

from ground.client.floor import EXAMPLE, world_goal
from ground.client.goal import (
    FRAMES,
    HEADING_TOLERANCE_DEG,
    POSITION_TOLERANCE_M,
    Destination,
    destination,
    from_robot,
)
from ground.client.outcomes import Accepted, GoalEnded, Refused
from ground.client.status_line import knows_place
from ground.commands.command import (
    ANYWAY,
    DIGITS,
    OperatorCommand,
    choice,
    command,
    option,
    parsed,
    place,
    positive,
    seconds,
    switch,
    typed_words,
)
from ground.robot import Robot
from protocol.options import finite
from protocol.wire.enums import Mode
from runtime.cli.verb import DRIVE
from runtime.errors import UserError


@dataclass(frozen=True, slots=True, kw_only=True)
class TypedGoal:
    """A goal as it is typed, in metres and degrees."""

    x: float | None = place(
        "X", "metres; without X Y the goal of the simulated world", default=None, parse=finite
    )
    y: float | None = place("Y", "metres", default=None, parse=finite)
    heading: float | None = place(
        "DEG", "degrees: final heading; without it any", default=None, parse=finite
    )
    tolerance: float = option(
        "--tolerance",
        "--tol",
        "--position-tolerance",
        default=POSITION_TOLERANCE_M,
        parse=positive,
        metavar="M",
        help=f"arrived within this distance (default {POSITION_TOLERANCE_M:g})",
    )
    heading_tolerance: float = option(
        "--heading-tolerance",
        default=HEADING_TOLERANCE_DEG,
        parse=positive,
        metavar="DEG",
        help=f"aligned within this angle (default {HEADING_TOLERANCE_DEG:g})",
    )
    frame: str = choice(
        FRAMES,
        "--frame",
        default="world",
        parse=str,
        help="body: X ahead of the robot, Y to its left, DEG from its heading (default world)",
    )

    def destination(self) -> Destination | None:
        """Return the goal, or None without X Y; UserError if only a part of it is given."""
        if self.x is not None and self.y is not None:
            return destination(
                [self.x, self.y] + ([] if self.heading is None else [self.heading]),
                position_tolerance_m=self.tolerance,
                heading_tolerance_deg=self.heading_tolerance,
            )
        if self.x is not None:
            raise UserError(f"Y is missing; {EXAMPLE}")
        if self != TypedGoal():
            raise UserError(f"a tolerance and --frame body need X Y; {EXAMPLE}")
        return None


def typed_goal(goal: Destination, frame: str) -> TypedGoal:
    """Return a goal as it would be typed."""
    turned, within_rad = goal.heading_rad, goal.heading_tolerance_rad
    return TypedGoal(
        x=goal.x_m,
        y=goal.y_m,
        heading=None if turned is None else degrees(turned),
        tolerance=goal.position_tolerance_m,
        heading_tolerance=round(degrees(within_rad), DIGITS),
        frame=frame,
    )


@command(DRIVE, 40, "goto 5.4 2 90 --timeout 60", moves=True, begins=True, short="goal")
class Goto(OperatorCommand):
    """Drive to X Y [DEG] and wait for the outcome.

    Without a `goal` to that of the world. Without `wait` in AUTO, which needs no operator.
    `seen_by_robot`: the goal is given relative to the robot (ahead, left), not in the world frame.
    `timeout_s`: abort after this time; UserError if the operation does not wait for the end.
    `anyway`: send a goal outside of the known world, too. `arms`: arm a robot in standby.
    """

    typed: ClassVar[Any] = TypedGoal
    goal: Destination | None = None
    seen_by_robot: bool = False
    wait: bool = switch(
        "--no-wait",
        default=True,
        help="drive in AUTO, which needs no operator; do not wait",
        after="seize",
    )
    timeout_s: float | None = option(
        "--timeout",
        default=None,
        parse=seconds,
        metavar="S",
        help="abort after this time",
        after="seize",
    )
    anyway: bool = switch("--anyway", default=False, help=ANYWAY.format("a goal"), after="seize")
    arms: bool = True

    @classmethod
    def parsed(cls, found: Any) -> "OperatorCommand":
        """Return the command for parsed arguments; UserError for a value out of range."""
        typed = parsed(TypedGoal, found)
        return parsed(cls, found, goal=typed.destination(), seen_by_robot=typed.frame == "body")

    @property
    def line(self) -> str:
        """The line that would be typed for it in the app."""
        place = [] if self.goal is None else typed_words(typed_goal(self.goal, self.frame))
        return " ".join((self.facts.short, *place, *typed_words(self)))

    @property
    def frame(self) -> str:
        """The frame in which the goal is given."""
        return FRAMES[self.seen_by_robot]

    async def perform(self, robot: Robot) -> Accepted | Refused | GoalEnded:
        """Send the goal; follow it to its end if it waits, and no other part does."""
        follows = robot.follows and self.wait
        if self.timeout_s is not None and not robot.follows:
            raise UserError("--timeout cannot be used here: this command does not wait for the end")
        if self.timeout_s is not None and not self.wait:
            raise UserError("--timeout cannot be combined with --no-wait")
        goal = await self._placed(robot)
        if follows:
            return await robot.drive_to(
                goal, timeout_s=self.timeout_s, from_robot=self.seen_by_robot, arms=self.arms
            )
        mode = Mode.GUIDED if self.wait else Mode.AUTO
        answer, _ = await robot.send_goal(goal, mode, from_robot=self.seen_by_robot, arms=self.arms)
        return answer

    async def _placed(self, robot: Robot) -> Destination:
        """Return the goal in the world frame; UserError outside of the known world."""
        goal = self.goal
        if goal is None:
            goal = await robot.in_own_thread(lambda: world_goal(robot.bus, robot.name))
        is_comparable = True
        if self.seen_by_robot:
            pose = await robot.pose()
            goal = from_robot(goal, pose.x_m, pose.y_m, pose.heading_rad)
            is_comparable = knows_place(pose)
        if is_comparable and not self.anyway:
            await robot.refuse_outside((f"goal {goal}", goal.x_m, goal.y_m))
        return goal
