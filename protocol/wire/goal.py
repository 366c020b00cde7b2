"""Integers of a goal on the wire, and the start pose as arguments of the robot's command line.

All conversions are in this module, so that a run over the bus and a run without it get the same
goal and start to the last bit. Both are in world coordinates: the robot is given its start pose.
"""

from math import degrees, isfinite, radians
from typing import NamedTuple

DEGREE_DIGITS = 9
"""Digits that headings are rounded to, so that 45 degrees in a file become 45 again."""


class WireGoal(NamedTuple):
    """The fields of a GOAL_REQUEST that define the goal."""

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
    """Return a goal as integers; heading None: any heading. Raises ValueError unless finite."""
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


def start_arguments(x_m: float, y_m: float, heading_rad: float) -> tuple[str, str, str]:
    """Return x in m, y in m and heading in degrees for the robot's command line."""
    return repr(x_m), repr(y_m), repr(round(degrees(heading_rad), DEGREE_DIGITS))


def rounded_heading_rad(heading_rad: float) -> float:
    """Return a heading in rad as it arrives after the conversion to degrees on the command line."""
    return radians(float(start_arguments(0.0, 0.0, heading_rad)[2]))
