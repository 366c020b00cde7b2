"""Kinds of contacts, each by a rule on earlier measurements and stored points."""

from collections.abc import Iterator, Sequence
from math import atan2, cos, degrees, hypot, inf, isfinite, pi, remainder, sin, tau
from typing import Final, NamedTuple

from plant.model.types import Point
from robot.core.geometry import BEARINGS, HALF_CONE
from robot.core.perception.echoes import REACH_M
from robot.core.states import PASS_LEFT, PASS_RIGHT
from robot.core.values import Pose
from study.report.contacts.recorder import Tick
from study.report.contacts.touched import Touched

PERSON_AHEAD: Final = "a person ahead"
PERSON_BEHIND: Final = "a person where the robot has no sonars"
BEHIND: Final = "touched where the robot has no sonars"
NEARER: Final = "a stored place, closely passed"
BESIDE: Final = "a stored place, nearer than its point"
DROPPED: Final = "a stored place that was dropped"
LATE: Final = "a place that was stored too late"
SINGLE: Final = "an echo that did not count"
UNSEEN_AHEAD: Final = "an edge without an echo, on the way to the goal"
UNSEEN_FOLLOWING: Final = "an edge without an echo, while passing an obstacle"
FLAT: Final = "a surface without an echo, at a flat angle"

RULES: Final = {
    PERSON_AHEAD: "a moving obstacle, within 90° of the heading",
    PERSON_BEHIND: "a moving obstacle, more than 90° from the heading",
    BEHIND: "another obstacle, more than 90° from the heading",
    DROPPED: "stored in the ten seconds before, but not during all of the last half second",
    LATE: "stored for less than half a second",
    NEARER: "stored for longer, at most 2 cm from the rim",
    BESIDE: "stored for longer, more than 2 cm from the rim",
    SINGLE: "never stored, but an echo came from this place, from nearer than 0.75 m",
    UNSEEN_AHEAD: "no such echo; the end of a wall or a corner; the robot headed for its goal",
    UNSEEN_FOLLOWING: "no such echo; the end of a wall or a corner; the robot passed an obstacle",
    FLAT: "no such echo; not an edge",
}
"""The rule of each kind, applied in this order. Stored: a point that counts is within 10 cm."""

SENSED_RAD: Final = pi / 2.0
PLACE_M: Final = 0.10
"""A stored point this near to the touched place may be its echo."""

CLOSE_M: Final = 0.02
LATE_S: Final = 0.5
ECHO_M: Final = 0.05
"""An echo whose range differs by no more from the true one is from the touched place."""


class PlaceRecord(NamedTuple):
    """Measurements and stored points of the touched place; None without any.

    `bearing_rad` is that of the place at the contact. `stored_m` is the range of the nearest
    stored point that counts in the tick before, from the rim, `aside_m` its distance from the
    place. `first_s` and `last_s` tell how long before the contact such a point was there for the
    first and for the last time, `since_s` since when it was there without a gap. `echo_s` is the
    time of the last echo from there, `echo_m` its range.
    """

    bearing_rad: float
    stored_m: float | None = None
    aside_m: float | None = None
    first_s: float | None = None
    last_s: float | None = None
    since_s: float | None = None
    echo_s: float | None = None
    echo_m: float | None = None

    @property
    def bearing_deg(self) -> float:
        """The bearing in degrees, positive to the left."""
        return degrees(self.bearing_rad)


def knowledge_of(ticks: Sequence[Tick], place: Touched, radius_m: float) -> PlaceRecord:
    """Return the measurements of the touched place before the last tick."""
    end, before = ticks[-1], ticks[:-1]
    bearing_rad, _ = polar(seen_from(end.true, place.at(end.time_s, end.true[:2])))
    stored_m, aside_m = (before and nearest_stored(before[-1], place, radius_m)) or (None, None)
    first_s = last_s = since_s = echo_s = echo_m = None
    for tick in before:
        ago_s = end.time_s - tick.time_s
        if nearest_stored(tick, place, radius_m) is None:
            since_s = None
        else:
            first_s, last_s = ago_s if first_s is None else first_s, ago_s
            since_s = ago_s if since_s is None else since_s
        for range_m in echoes_of(tick, place, radius_m):
            echo_s, echo_m = ago_s, range_m
    return PlaceRecord(bearing_rad, stored_m, aside_m, first_s, last_s, since_s, echo_s, echo_m)


def kind_of(place: Touched, known: PlaceRecord, branch: int) -> str:
    """Return the kind of a contact; `branch` is that of the last decision."""
    sensed = abs(known.bearing_rad) <= SENSED_RAD
    if place.mover is not None:
        return PERSON_AHEAD if sensed else PERSON_BEHIND
    if not sensed:
        return BEHIND
    if known.first_s is not None and known.first_s > LATE_S:
        if known.since_s is None or known.since_s <= LATE_S or known.stored_m is None:
            return DROPPED
        return NEARER if known.stored_m <= CLOSE_M else BESIDE
    if known.first_s is not None:
        return LATE
    if known.echo_m is not None and known.echo_m < REACH_M:
        return SINGLE
    if not place.is_edge:
        return FLAT
    return UNSEEN_FOLLOWING if branch in (PASS_LEFT, PASS_RIGHT) else UNSEEN_AHEAD


def nearest_stored(tick: Tick, place: Touched, radius_m: float) -> tuple[float, float] | None:
    """Return the range from the rim of the stored point nearest to the place, and their distance.

    Both are compared in the robot's frame: the point by its estimate, the place by the true pose.
    """
    x_m, y_m = seen_from(tick.true, place.at(tick.time_s, tick.true[:2]))
    found = []
    for point in tick.points:
        if point.counts:
            px_m, py_m = seen_from(tick.estimated, (point.x_m, point.y_m))
            found.append((hypot(px_m - x_m, py_m - y_m), hypot(px_m, py_m) - radius_m))
    aside_m, range_m = min(found, default=(inf, inf))
    return (range_m, aside_m) if aside_m <= PLACE_M else None


def echoes_of(tick: Tick, place: Touched, radius_m: float) -> Iterator[float]:
    """Yield the ranges of a tick that agree with the touched place in bearing and distance."""
    bearing_rad, away_m = polar(seen_from(tick.true, place.at(tick.time_s, tick.true[:2])))
    for sonar_rad, range_m in zip(BEARINGS, tick.range_m, strict=True):
        if range_m is None or not isfinite(range_m):
            continue
        aside_rad = abs(remainder(bearing_rad - sonar_rad, tau))
        if aside_rad <= HALF_CONE and abs(range_m - (away_m - radius_m)) <= ECHO_M:
            yield range_m


def seen_from(pose: Pose, point: Point) -> Point:
    """Return a point in the frame of a pose, x ahead and y to the left."""
    dx, dy = point[0] - pose[0], point[1] - pose[1]
    ahead, left = cos(pose[2]), sin(pose[2])
    return ahead * dx + left * dy, ahead * dy - left * dx


def polar(point: Point) -> tuple[float, float]:
    """Return bearing and distance of a point in the robot's frame."""
    return atan2(point[1], point[0]), hypot(*point)
