"""Define everything that a map can show: plain values in metres and radians, None where unknown.

Its view is the part of the plane that the map shows, and the scale.

The world is in metres, x to the right and y up; dots count from the top left corner, y down. Any
numbers, NaN included, give a usable view.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Final, TypeAlias

from ground.map.canvas import DOTS_HIGH, DOTS_WIDE

MIN_M_PER_DOT: Final = 1e-4
MAX_M_PER_DOT: Final = 1e6
MAX_CENTRE_M: Final = 1e9
MARGIN_DOTS: Final = 2
MIN_LEGEND_ROWS: Final = 6
FOLLOW_SHARE: Final = 0.25
OPEN_FLOOR_M: Final = 4.0
GROWTH_SHARE: Final = 0.3
SCALE_STEPS: Final = (1.0, 2.0, 5.0)

Point = tuple[float, float]
Box = tuple[float, float, float, float]
"""Least x and y, greatest x and y, in metres."""


@dataclass(frozen=True, slots=True)
class View:
    """A window of `columns` x `rows` cells around a centre; a dot is `m_per_dot` wide and high."""

    columns: int
    rows: int
    centre_x_m: float = 0.0
    centre_y_m: float = 0.0
    m_per_dot: float = 0.05

    @classmethod
    def fit(cls, box: Box | None, columns: int, rows: int, bounded: bool = True) -> "View":
        """Return the view that shows all of the box with a margin.

        There is a row for the legend where possible.

        A box that is not `bounded` may grow: it gets more room around it, and some open floor at
        least. So does a map without a box, or with an infinite one.
        """
        if box is None or not all(map(isfinite, box)):
            box, bounded = (0.0, 0.0, 0.0, 0.0), False
        across = max(1, DOTS_WIDE * columns - 2 * MARGIN_DOTS)
        below = DOTS_HIGH if rows >= MIN_LEGEND_ROWS else 0
        down = max(1, DOTS_HIGH * rows - 2 * MARGIN_DOTS - below)
        scale_m = max((box[2] - box[0]) / across, (box[3] - box[1]) / down)
        open_m = OPEN_FLOOR_M / min(across, down)
        if not bounded:
            scale_m = max(open_m, scale_m * (1.0 + GROWTH_SHARE))
        elif scale_m <= 0.0:
            scale_m = open_m
        centre = box[0] / 2.0 + box[2] / 2.0, box[1] / 2.0 + box[3] / 2.0
        return cls(columns, rows)._at(centre[0], centre[1] - below * scale_m / 2.0, scale_m)

    def resized(self, columns: int, rows: int) -> "View":
        """Return the same view with another number of cells."""
        return replace(self, columns=columns, rows=rows)

    def zoomed(self, factor: float, about: Point | None = None) -> "View":
        """Return the view enlarged by a factor about a point, or about the centre."""
        if not (isfinite(factor) and factor > 0.0):
            return self
        x_m, y_m = about or (self.centre_x_m, self.centre_y_m)
        scale_m = min(MAX_M_PER_DOT, max(MIN_M_PER_DOT, self.m_per_dot / factor))
        share = scale_m / self.m_per_dot
        centre_x_m = x_m + (self.centre_x_m - x_m) * share
        return self._at(centre_x_m, y_m + (self.centre_y_m - y_m) * share, scale_m)

    def centred(self, x_m: float, y_m: float) -> "View":
        """Return the view moved to a centre."""
        return self._at(x_m, y_m, self.m_per_dot)

    def following(self, x_m: float, y_m: float) -> "View":
        """Return the view moved to the point when that is near the edge, else the view unchanged.

        A map that moved with every step would be redrawn with every step, and hard to read.
        """
        x, y = self.to_dots(x_m, y_m)
        wide, high = DOTS_WIDE * self.columns, DOTS_HIGH * self.rows
        near = FOLLOW_SHARE * wide <= x <= (1.0 - FOLLOW_SHARE) * wide
        if near and FOLLOW_SHARE * high <= y <= (1.0 - FOLLOW_SHARE) * high:
            return self
        return self.centred(x_m, y_m)

    def to_dots(self, x_m: float, y_m: float) -> Point:
        """Return the position of a place on the canvas, in dots and fractions of them."""
        x = (x_m - self.centre_x_m) / self.m_per_dot + self.columns
        return x, (self.centre_y_m - y_m) / self.m_per_dot + 2.0 * self.rows

    def to_metres(self, x: float, y: float) -> Point:
        """Return the place under a point of the canvas, the inverse of `to_dots`."""
        x_m = self.centre_x_m + (x - self.columns) * self.m_per_dot
        return x_m, self.centre_y_m - (y - 2.0 * self.rows) * self.m_per_dot

    def cell_of(self, x_m: float, y_m: float) -> tuple[int, int] | None:
        """Return column and row of a place, which may be off the map; None if not finite."""
        x, y = self.to_dots(x_m, y_m)
        if not (isfinite(x) and isfinite(y)):
            return None
        return int(x // DOTS_WIDE), int(y // DOTS_HIGH)

    def middle(self) -> Point:
        """Return the centre in metres."""
        return self.centre_x_m, self.centre_y_m

    def middle_of(self, column: int, row: int) -> Point:
        """Return the place in the middle of a cell."""
        return self.to_metres(DOTS_WIDE * (column + 0.5), DOTS_HIGH * (row + 0.5))

    def box(self) -> Box:
        """Return the box that is shown."""
        left_m, top_m = self.to_metres(0.0, 0.0)
        right_m, low_m = self.to_metres(DOTS_WIDE * self.columns, DOTS_HIGH * self.rows)
        return left_m, low_m, right_m, top_m

    def shows(self, box: Box) -> bool:
        """Return whether all of the box is on the map."""
        left_m, low_m, right_m, top_m = self.box()
        wide = left_m <= box[0] and box[2] <= right_m
        return wide and low_m <= box[1] and box[3] <= top_m

    def scale_bar(self, most_cells: int) -> tuple[float, int]:
        """Return a round length in metres and its cells: the longest that fits, at least 1."""
        most_m = max(1, most_cells) * DOTS_WIDE * self.m_per_dot
        power = 10.0
        while power < most_m:
            power *= 10.0
        while power > most_m:
            power /= 10.0
        length_m = max(
            power * step for step in SCALE_STEPS if power * step <= most_m * (1.0 + 1e-9)
        )
        return length_m, max(1, round(length_m / (DOTS_WIDE * self.m_per_dot)))

    def _at(self, x_m: float, y_m: float, scale_m: float) -> "View":
        if not (isfinite(x_m) and isfinite(y_m) and isfinite(scale_m)):
            return self
        x_m, y_m = (max(-MAX_CENTRE_M, min(MAX_CENTRE_M, value_m)) for value_m in (x_m, y_m))
        scale_m = min(MAX_M_PER_DOT, max(MIN_M_PER_DOT, scale_m))
        return View(self.columns, self.rows, x_m, y_m, scale_m)


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
    begin at it. `trail`, `live` and `in_need` describe robots other than the selected one.
    """

    x_m: float
    y_m: float
    heading_rad: float
    radius_m: float | None = None
    name: str = ""
    live: bool = True
    trail: Sequence[Point] = ()
    in_need: bool = False


@dataclass(frozen=True, slots=True)
class MapTarget:
    """A goal, or an item of a mission by its number; a heading of None means any heading."""

    x_m: float
    y_m: float
    heading_rad: float | None = None
    tolerance_m: float = 0.0
    number: int = 0


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
    fence: Sequence[Shape] = ()
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
            shapes = (*self.obstacles, *self.fence)
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
