"""A goal as typed by a person, checked and converted to the integers of the wire."""

from dataclasses import dataclass, replace
from math import cos, degrees, pi, radians, remainder, sin
from typing import Final

from ground.client.connection import within
from protocol.outcome import WireGoal, wire_goal
from protocol.wire.enums import Mode
from protocol.wire.messages import GoalRequest
from runtime.errors import UserError

FARTHEST_M: Final = 2_000_000.0  # the limit of the wire; the robot's own limit is lower
FRAMES: Final = ("world", "body")
POSITION_TOLERANCE_M: Final = 0.05
HEADING_TOLERANCE_DEG: Final = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Destination:
    """A place in the world, in metres and radians; without a heading any heading is accepted."""

    x_m: float
    y_m: float
    heading_rad: float | None
    position_tolerance_m: float = POSITION_TOLERANCE_M
    heading_tolerance_rad: float = radians(HEADING_TOLERANCE_DEG)

    def on_the_wire(self) -> WireGoal:
        """Convert the place to the integers of the wire."""
        return wire_goal(
            self.x_m,
            self.y_m,
            self.heading_rad,
            self.position_tolerance_m,
            self.heading_tolerance_rad,
        )

    def __str__(self) -> str:
        heading = "" if self.heading_rad is None else f" at {degrees(self.heading_rad):z.1f} deg"
        return f"({self.x_m:z.3f}, {self.y_m:z.3f}){heading}"


def destination(
    numbers: list[float],
    *,
    position_tolerance_m: float = POSITION_TOLERANCE_M,
    heading_tolerance_deg: float = HEADING_TOLERANCE_DEG,
) -> Destination:
    """Return the goal for the numbers X Y [DEG]; UserError names a number out of range."""
    if len(numbers) not in (2, 3):
        raise UserError(f"a goal is X Y or X Y DEG, not {len(numbers)} numbers")
    for name, value in zip(("x", "y"), numbers, strict=False):
        within(value, -FARTHEST_M, FARTHEST_M, name, "m")
    if len(numbers) == 3:
        within(numbers[2], -360.0, 360.0, "heading", "deg")
    within(position_tolerance_m, 0.005, 1.0, "tolerance", "m")
    within(heading_tolerance_deg, 0.2, 180.0, "heading tolerance", "deg")
    return Destination(
        x_m=numbers[0],
        y_m=numbers[1],
        heading_rad=radians(numbers[2]) if len(numbers) == 3 else None,
        position_tolerance_m=position_tolerance_m,
        heading_tolerance_rad=min(radians(heading_tolerance_deg), pi),
    )


def from_robot(where: Destination, x_m: float, y_m: float, heading_rad: float) -> Destination:
    """Convert a place seen from a robot at this pose (m, rad) to a place in the world."""
    turn, forward_m, left_m = where.heading_rad, where.x_m, where.y_m
    return replace(
        where,
        x_m=x_m + forward_m * cos(heading_rad) - left_m * sin(heading_rad),
        y_m=y_m + forward_m * sin(heading_rad) + left_m * cos(heading_rad),
        heading_rad=None if turn is None else remainder(heading_rad + turn, 2.0 * pi),
    )


def goal_request(
    goal: WireGoal, request_id: int, mode: Mode, *, from_robot: bool = False
) -> GoalRequest:
    """Build the request for a goal in a mode; `from_robot`: it was given relative to the robot."""
    return GoalRequest(
        request_id=request_id, mode=mode, from_robot=int(from_robot), **goal._asdict()
    )
