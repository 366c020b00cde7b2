"""A goal as the integers the wire carries, and the start as the words the robot is told.

Made here and nowhere else, so that a run over the bus and one without it get the same goal and the
same start to the last bit. Both are places of the world: the robot is told where it starts.
"""

from math import degrees, isfinite, radians
from typing import NamedTuple

DEGREE_DIGITS = 9
"""Rounded, so that what was 45 degrees in a file is 45 again."""


class WireGoal(NamedTuple):
    """The fields of a GOAL_REQUEST that say where to go."""

    x_mm: int
    y_mm: int
    heading_urad: int
    heading_free: int
    position_tolerance_mm: int
    heading_tolerance_urad: int


def wire_goal(
    x_m: float,
    y_m: float,
    heading_rad: float | None,
    position_tolerance_m: float,
    heading_tolerance_rad: float,
) -> WireGoal:
    """Heading None: any will do. Raises ValueError when a value is not finite."""
    turn_rad = 0.0 if heading_rad is None else heading_rad
    values = (x_m, y_m, turn_rad, position_tolerance_m, heading_tolerance_rad)
    if not all(map(isfinite, values)):
        raise ValueError(f"a goal needs finite numbers, not {values}")
    return WireGoal(
        x_mm=round(x_m * 1000),
        y_mm=round(y_m * 1000),
        heading_urad=round(turn_rad * 1e6),
        heading_free=int(heading_rad is None),
        position_tolerance_mm=round(position_tolerance_m * 1000),
        heading_tolerance_urad=round(heading_tolerance_rad * 1e6),
    )


def start_words(x_m: float, y_m: float, heading_rad: float) -> tuple[str, str, str]:
    """X, Y and DEG for the robot's command line."""
    return repr(x_m), repr(y_m), repr(round(degrees(heading_rad), DEGREE_DIGITS))


def told_heading_rad(heading_rad: float) -> float:
    """The heading that arrives when it is told in degrees."""
    return radians(float(start_words(0.0, 0.0, heading_rad)[2]))
