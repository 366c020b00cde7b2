"""Where the robot is put, its odometry begins: a place in the world becomes a goal in that frame.

The goal is made of the integers the wire carries, here and nowhere else, so a run over the bus and
one without it get the same goal to the last bit.
"""

from math import cos, isfinite, pi, remainder, sin
from typing import NamedTuple


class Pose(NamedTuple):
    x_m: float
    y_m: float
    heading_rad: float


class WireGoal(NamedTuple):
    """The fields of a GOAL_REQUEST that say where to go."""

    x_mm: int
    y_mm: int
    heading_urad: int
    heading_free: int
    position_tolerance_mm: int
    heading_tolerance_urad: int


def goal_from(
    start: Pose,
    x_m: float,
    y_m: float,
    heading_rad: float | None,
    position_tolerance_m: float,
    heading_tolerance_rad: float,
) -> WireGoal:
    """A goal given in the world, for a robot put at `start`; heading None: any will do.

    Raises ValueError when a value is not finite.
    """
    if not all(map(isfinite, (x_m, y_m, heading_rad or 0.0, *start))):
        raise ValueError("a goal and a start need finite coordinates")
    dx_m, dy_m = x_m - start.x_m, y_m - start.y_m
    cosine, sine = cos(start.heading_rad), sin(start.heading_rad)
    free = heading_rad is None
    turn_rad = 0.0 if heading_rad is None else remainder(heading_rad - start.heading_rad, 2 * pi)
    return WireGoal(
        x_mm=round((cosine * dx_m + sine * dy_m) * 1000),
        y_mm=round((cosine * dy_m - sine * dx_m) * 1000),
        heading_urad=round(turn_rad * 1e6),
        heading_free=int(free),
        position_tolerance_mm=round(position_tolerance_m * 1000),
        heading_tolerance_urad=round(heading_tolerance_rad * 1e6),
    )


def in_world(start: Pose, x_m: float, y_m: float, heading_rad: float) -> Pose:
    """A pose of the odometry frame, seen from the world."""
    cosine, sine = cos(start.heading_rad), sin(start.heading_rad)
    return Pose(
        start.x_m + cosine * x_m - sine * y_m,
        start.y_m + sine * x_m + cosine * y_m,
        remainder(start.heading_rad + heading_rad, 2 * pi),
    )
