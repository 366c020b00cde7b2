"""Ticks and touched places for tests of the page of contacts."""

from typing import Any

from protocol.world import Circle, Point
from robot.core.states import TO_GOAL
from robot.core.values import Pose
from study.report.contact_kinds import RecordedTick, StoredPoint, Touched

RADIUS_M = 0.12
ORIGIN = Pose(0.0, 0.0, 0.0)
NO_ECHO = (None,) * 8
AHEAD = Touched("wall of 2 mm", (RADIUS_M, 0.0), is_edge=True)


def tick(time_s: float, **changes: Any) -> RecordedTick:
    """Return a tick of a robot at the origin that has measured and remembered nothing."""
    usual: dict[str, Any] = {
        "true": ORIGIN,
        "estimated": ORIGIN,
        "clearance_m": 0.1,
        "branch": TO_GOAL,
        "guard": 0,
        "speed_m_s": 0.3,
        "yaw_rate_rad_s": 0.0,
        "range_m": NO_ECHO,
        "points": (),
    }
    return RecordedTick(time_s=time_s, **{**usual, **changes})


def stored(x_m: float, y_m: float = 0.0, counts: bool = True) -> dict[str, Any]:
    """Return the change of a tick that remembers one point."""
    return {"points": (StoredPoint(x_m, y_m, counts),)}


def echo(sonar: int, range_m: float) -> dict[str, Any]:
    """Return the change of a tick in which one sonar has an echo."""
    ranges: list[float | None] = [None] * 8
    ranges[sonar] = range_m
    return {"range_m": tuple(ranges)}


def person(start: Point, end: Point) -> Circle:
    """Return a person who walks at 0.1 m/s."""
    return Circle(x_m=start[0], y_m=start[1], radius_m=0.2, path_m=(start, end), speed_m_s=0.1)
