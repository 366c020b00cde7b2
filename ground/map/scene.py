"""Define everything that a map can show: plain values in metres and radians, None where unknown."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import Final, TypeAlias

from ground.map.view import Box, Point

LAYERS: Final = (
    "walls",
    "seen",
    "fence",
    "ghosts",
    "trail",
    "ellipse",
    "zone",
    "sonars",
    "marks",
    "draft",
    "mission",
    "virtual",
    "goal",
    "others",
    "truth",
    "robot",
    "cursor",
    "legend",
)
"""Layers that can be hidden by name; `marks` are hit and leave points, `others` all that moves,
`truth` the robot in the simulation."""

MARGIN_M: Final = 0.12
"""Least space around a robot or a goal at the edge of the map."""


@dataclass(frozen=True, slots=True)
class Outline:
    """The edge of a solid obstacle when `closed`, else a wall as a line."""

    points_m: tuple[Point, ...]
    closed: bool = True


@dataclass(frozen=True, slots=True)
class Disc:
    """A circle: a pillar, a pedestrian, a fence."""

    x_m: float
    y_m: float
    radius_m: float


Shape: TypeAlias = Outline | Disc


@dataclass(frozen=True, slots=True)
class RobotMark:
    """The pose of a robot; the name is shown when there are several.

    `radius_m` is None while it is unknown: then there is no outline, and no zone or sonar, which
    begin at it. `trail` and `live` describe robots other than the selected one.
    """

    x_m: float
    y_m: float
    heading_rad: float
    radius_m: float | None = None
    name: str = ""
    live: bool = True
    trail: Sequence[Point] = ()


@dataclass(frozen=True, slots=True)
class MapTarget:
    """A goal or an item of a mission; a heading of None means that any heading will do."""

    x_m: float
    y_m: float
    heading_rad: float | None = None
    tolerance_m: float = 0.0


@dataclass(frozen=True, slots=True)
class GhostTrail:
    """The path of another run, and its outcome from `protocol.outcome`, or "" while it drives."""

    label: str
    path_m: Sequence[Point]
    outcome: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapScene:
    """All that is to be drawn now.

    `size_m` is the size of the floor, from 0 0; walls around the floor are ordinary obstacles.
    `truth`: the obstacles come from the simulation, not from the robot. `live` is False when the
    robot is late; its mark is then a question mark. `placed` is False when the robot does not know
    its place; it has no mark then. `seen` are echoes of the last seconds, `seen_late` and
    `seen_old` those before. `true_robot` is the pose in the simulation. `ranges_m` are the ranges
    of the sonars from right to left, measured from the robot's rim: inf for no echo, None for a
    missing sonar. `zone_m` is measured from the rim, too. `covariance` is xx, xy, yy in m2.
    `current` is the index of the mission item under way, `draft` a mission that the robot has not
    received, `note` a text for the legend.
    """

    size_m: Point | None = None
    obstacles: tuple[Shape, ...] = ()
    truth: bool = True
    seen: Sequence[Point] = ()
    seen_late: Sequence[Point] = ()
    seen_old: Sequence[Point] = ()
    trail: Sequence[Point] = ()
    robot: RobotMark | None = None
    true_robot: RobotMark | None = None
    live: bool = True
    placed: bool = True
    covariance: tuple[float, float, float] | None = None
    ranges_m: Sequence[float | None] = ()
    zone_m: float | None = None
    goal: MapTarget | None = None
    virtual_goal: Point | None = None
    hits: Sequence[Point] = ()
    leaves: Sequence[Point] = ()
    fence: Shape | None = None
    mission: Sequence[MapTarget] = ()
    current: int | None = None
    draft: Sequence[MapTarget] = ()
    movers: Sequence[Disc] = ()
    others: Sequence[RobotMark] = ()
    ghosts: Sequence[GhostTrail] = ()
    cursor: Point | None = None
    note: str = ""

    @property
    def shows_sonars(self) -> bool:
        """True while the sonars are drawn; echoes of a robot with late telemetry may be wrong."""
        robot = self.robot
        known = robot is not None and robot.radius_m is not None and isfinite(robot.heading_rad)
        return known and self.live

    @property
    def has_dead_sonar(self) -> bool:
        """True if a sonar that is drawn gives no reading."""
        return self.shows_sonars and None in self.ranges_m

    def box(self) -> Box | None:
        """Return the box of everything that a whole map must show; None when that is nothing."""
        least_x, least_y, most_x, most_y = inf, inf, -inf, -inf
        for x_m, y_m in self._corners():
            if isfinite(x_m) and isfinite(y_m):
                least_x, most_x = min(least_x, x_m), max(most_x, x_m)
                least_y, most_y = min(least_y, y_m), max(most_y, y_m)
        return (least_x, least_y, most_x, most_y) if least_x <= most_x else None

    def _corners(self) -> Iterator[Point]:
        if self.size_m is not None:
            yield from ((0.0, 0.0), self.size_m)
        else:
            shapes = (*self.obstacles, *((self.fence,) if self.fence else ()))
            for shape in shapes:
                yield from _corners(shape)
            yield from (*self.seen, *self.seen_late, *self.seen_old, *self.trail)
        targets = (self.robot, self.goal, *self.others, *self.mission, *self.draft)
        for place in (place for place in targets if place is not None):
            radius_m = place.radius_m if isinstance(place, RobotMark) else None
            yield from _corners(Disc(place.x_m, place.y_m, max(MARGIN_M, radius_m or 0.0)))


def floor(size_m: Point) -> tuple[Point, ...]:
    """Return the corners of a floor of this size."""
    width_m, height_m = size_m
    return (0.0, 0.0), (width_m, 0.0), (width_m, height_m), (0.0, height_m)


def _corners(shape: Shape) -> Sequence[Point]:
    if isinstance(shape, Outline):
        return shape.points_m
    reach_m = shape.radius_m
    low = shape.x_m - reach_m, shape.y_m - reach_m
    return low, (shape.x_m + reach_m, shape.y_m + reach_m)
