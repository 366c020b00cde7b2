"""Kinds of contacts, each by a rule on earlier measurements and stored points.

A trial is run again to keep the seconds before its contact: poses, decisions, echoes, memory. The
touched obstacle, the place on its surface, and whether that is an edge, come from the world.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise, takewhile
from math import atan2, cos, degrees, hypot, inf, isfinite, pi, remainder, sin, tau
from typing import Final, NamedTuple

from plant.model.geometry import clearance_m, distance_m, nearest_share
from plant.sim.physics import MovingDisc
from plant.sim.simulation import Plant
from protocol.outcome import RunOutcome
from protocol.world import Obstacle, Point, Polyline, World, WorldCircle, WorldPolygon
from robot.core.perception.echoes import REACH_M, SURE, Echoes
from robot.core.ring import BEARINGS, HALF_CONE
from robot.core.states import PASS_LEFT, PASS_RIGHT
from robot.core.values import Outputs, Pose
from runtime.units import MM_PER_M, NS_PER_S
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

KEPT_TICKS: Final = 200
"""Ten seconds."""


class StoredPoint(NamedTuple):
    """A remembered echo in the odometry frame; `counts`: the navigator keeps clear of it."""

    x_m: float
    y_m: float
    counts: bool


class TracedTick(NamedTuple):
    """One tick: `clearance_m` is true, `range_m` are the sonars' ranges from the rim."""

    time_s: float
    true: Pose
    estimated: Pose
    clearance_m: float
    branch: int
    guard: int
    speed_m_s: float
    yaw_rate_rad_s: float
    range_m: tuple[float | None, ...]
    points: tuple[StoredPoint, ...]


@dataclass(slots=True)
class ContactRecorder:
    """Keep the last ticks of a trial."""

    ticks: deque[TracedTick] = field(default_factory=lambda: deque(maxlen=KEPT_TICKS))

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Keep one tick."""
        truth, state = plant.truth(), onboard.state
        self.ticks.append(
            TracedTick(
                time_s=plant.now_ns / NS_PER_S,
                true=Pose(truth.x_m, truth.y_m, truth.heading_rad),
                estimated=state.odometry.pose,
                clearance_m=plant.attitude()[1],
                branch=0 if outputs.decision is None else outputs.decision.branch,
                guard=outputs.guard,
                speed_m_s=outputs.twist.speed_m_s,
                yaw_rate_rad_s=outputs.twist.yaw_rate_rad_s,
                range_m=tuple(state.ring.range_m),
                points=points_of(getattr(state.memory, "echoes", None)),
            )
        )


def points_of(echoes: Echoes | None) -> tuple[StoredPoint, ...]:
    """Return the remembered echoes; none of a navigator without a memory."""
    if echoes is None:
        return ()
    return tuple(
        StoredPoint(
            echoes.x_mm[index] / MM_PER_M,
            echoes.y_mm[index] / MM_PER_M,
            echoes.weight[index] >= SURE,
        )
        for index in range(echoes.count)
    )


def before_contact(trial: Trial) -> tuple[list[TracedTick], RunOutcome]:
    """Return the last ticks of a trial, up to the one of its contact, and its outcome.

    A contact ends the drive. If no kept tick touches anything, the last one counts as the contact.
    """
    recorder = ContactRecorder()
    outcome = run_trial(trial, recorder)
    ticks = list(recorder.ticks)
    apart = len(list(takewhile(lambda tick: tick.clearance_m > 0.0, ticks)))
    return ticks[: apart + 1], outcome


EDGE_M: Final = 0.03
"""A place this near to the end of a wall or to a corner counts as that edge."""

BLOCK: Final = "block"


class Touched(NamedTuple):
    """The touched place, with a short name of its obstacle.

    `mover` is set if the place belongs to a person or another moving disc.
    """

    name: str
    point: Point
    is_edge: bool
    mover: WorldCircle | None = None

    def at(self, time_s: float, seen_from: Point) -> Point:
        """Return the place at a time: of a mover, the one of its surface that is the nearest."""
        if self.mover is None:
            return self.point
        return nearest_of(_placed(self.mover, time_s), seen_from)


def world_at(world: World, time_s: float) -> World:
    """Return the world with its moving obstacles at their places of that time."""
    obstacles = tuple(
        _placed(one, time_s) if isinstance(one, WorldCircle) and one.path_m else one
        for one in world.obstacles
    )
    return replace(world, obstacles=obstacles)


def _placed(circle: WorldCircle, time_s: float) -> WorldCircle:
    x_m, y_m = MovingDisc(circle).position_m(time_s)
    return replace(circle, x_m=x_m, y_m=y_m)


def touched(world: World, robot: Point, time_s: float) -> Touched:
    """Return the obstacle nearest to the robot at a time, and its nearest place."""
    found = [
        (distance_m(robot, one.point), index, one) for index, one in _places(world, robot, time_s)
    ]
    return min(found, key=lambda one: one[:2])[2]


def _places(world: World, robot: Point, time_s: float) -> Iterator[tuple[int, Touched]]:
    now = world_at(world, time_s)
    for index, (obstacle, usual) in enumerate(zip(now.obstacles, world.obstacles, strict=True)):
        point = nearest_of(obstacle, robot)
        mover = usual if isinstance(usual, WorldCircle) and usual.path_m else None
        others = [one for one in now.obstacles if one is not obstacle]
        edge = any(distance_m(point, one) <= EDGE_M for one in edges_of(obstacle, others))
        yield index, Touched(name_of(usual), point, edge, mover)
    if world.walls:
        (x_m, y_m), (width_m, height_m) = robot, world.size_m
        for point in ((0.0, y_m), (width_m, y_m), (x_m, 0.0), (x_m, height_m)):
            yield len(world.obstacles), Touched("outer wall", point, False)


def name_of(obstacle: Obstacle) -> str:
    """Return a short name of an obstacle."""
    if isinstance(obstacle, Polyline):
        return f"wall of {MM_PER_M * obstacle.thickness_m:g} mm"
    if isinstance(obstacle, WorldPolygon):
        return BLOCK
    return "person" if obstacle.path_m else "disc"


def nearest_of(obstacle: Obstacle, seen_from: Point) -> Point:
    """Return the nearest point of an obstacle's surface."""
    if isinstance(obstacle, WorldCircle):
        return _towards((obstacle.x_m, obstacle.y_m), seen_from, obstacle.radius_m)
    points = obstacle.points_m
    if isinstance(obstacle, WorldPolygon):
        points = (*points, points[0])
    sides = [_on_segment(seen_from, a, b) for a, b in pairwise(points)]
    best = min(sides, key=lambda point: distance_m(point, seen_from))
    half_m = obstacle.thickness_m / 2.0 if isinstance(obstacle, Polyline) else 0.0
    return _towards(best, seen_from, half_m)


def edges_of(obstacle: Obstacle, others: list[Obstacle]) -> list[Point]:
    """Return the free ends of a wall, which touch no other obstacle, or the corners of a block."""
    if isinstance(obstacle, WorldPolygon):
        return list(obstacle.points_m)
    if isinstance(obstacle, WorldCircle):
        return []
    ends = (obstacle.points_m[0], obstacle.points_m[-1])
    return [end for end in ends if all(clearance_m(end, one) > EDGE_M for one in others)]


def _on_segment(point: Point, a: Point, b: Point) -> Point:
    share = nearest_share(point, a, b)
    return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])


def _towards(start: Point, end: Point, way_m: float) -> Point:
    dx, dy = end[0] - start[0], end[1] - start[1]
    length_m = hypot(dx, dy)
    if length_m == 0.0:
        return start
    return start[0] + way_m * dx / length_m, start[1] + way_m * dy / length_m


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


def knowledge_of(ticks: Sequence[TracedTick], place: Touched, radius_m: float) -> PlaceRecord:
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


def nearest_stored(tick: TracedTick, place: Touched, radius_m: float) -> tuple[float, float] | None:
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


def echoes_of(tick: TracedTick, place: Touched, radius_m: float) -> Iterator[float]:
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
