"""Building blocks of families: a floor with start and goal, and frames for shapes."""

from collections.abc import Callable
from math import pi, radians
from typing import Final, NamedTuple, TypeAlias

from plant.model.draws import Draws
from plant.model.geometry import clearance_m, distance_m
from plant.model.types import Circle, Obstacle, Point, Polygon, Polyline
from runtime.elementary import atan2, cos, sin

MIN_FLOOR_M: Final = 5.0
MAX_FLOOR_M: Final = 10.0
RIM_M: Final = 0.4
STANDING_M: Final = 0.17
"""Smallest distance of the centres of start and goal from any obstacle."""

MIN_THICKNESS_M: Final = 0.02
MAX_THICKNESS_M: Final = 0.10


class Draft(NamedTuple):
    """A world before its check; `reachable` is the property its family guarantees."""

    size_m: Point
    start: Point
    goal: Point
    obstacles: tuple[Obstacle, ...] = ()
    reachable: bool = True


Family: TypeAlias = Callable[[Draws], Draft | None]
"""Draws a world from a stream of random numbers; None if the attempt failed."""


class Frame(NamedTuple):
    """A rotated frame on the floor; with `hand` -1 left and right are swapped."""

    origin: Point
    angle_rad: float
    hand: int = 1

    def point(self, along_m: float, left_m: float) -> Point:
        """Return a point on the floor, rounded to millimetres."""
        c, s, left_m = cos(self.angle_rad), sin(self.angle_rad), self.hand * left_m
        x_m = self.origin[0] + c * along_m - s * left_m
        y_m = self.origin[1] + s * along_m + c * left_m
        return round(x_m, 3), round(y_m, 3)

    def points(self, *local: Point) -> tuple[Point, ...]:
        """Return points on the floor."""
        return tuple(self.point(*one) for one in local)

    def box(self, x0_m: float, y0_m: float, x1_m: float, y1_m: float) -> Polygon:
        """Return a box."""
        return Polygon(self.points((x0_m, y0_m), (x1_m, y0_m), (x1_m, y1_m), (x0_m, y1_m)))

    def wall(self, thickness_m: float, *local: Point) -> Polyline:
        """Return a wall."""
        return Polyline(self.points(*local), thickness_m)

    def disc(self, along_m: float, left_m: float, radius_m: float) -> Circle:
        """Return a disc."""
        x_m, y_m = self.point(along_m, left_m)
        return Circle(x_m=x_m, y_m=y_m, radius_m=round(radius_m, 3))


class DraftFloor(NamedTuple):
    """A floor with start and goal."""

    size_m: Point
    start: Point
    goal: Point

    @property
    def length_m(self) -> float:
        """The distance from start to goal."""
        return distance_m(self.start, self.goal)

    def frame(self, share: float, left_m: float = 0.0, turn_rad: float = 0.0) -> Frame:
        """Return a frame at a share of the line to the goal, rotated from that direction."""
        (x0, y0), (x1, y1) = self.start, self.goal
        bearing_rad = atan2(y1 - y0, x1 - x0)
        way = Frame((x0 + share * (x1 - x0), y0 + share * (y1 - y0)), bearing_rad)
        return Frame(way.point(0.0, left_m), bearing_rad + turn_rad)

    def draft(self, *obstacles: Obstacle) -> Draft:
        """Return the draft with these obstacles."""
        return Draft(self.size_m, self.start, self.goal, obstacles)


def stage(random: Draws, apart_m: float = 3.0) -> DraftFloor:
    """Draw a floor of 5 to 10 m a side, with start and goal at least `apart_m` apart."""
    size_m = floor(random)
    while True:
        start, goal = spot(random, size_m), spot(random, size_m)
        if distance_m(start, goal) >= apart_m:
            return DraftFloor(size_m, start, goal)


def floor(random: Draws) -> Point:
    """Draw the size of a floor."""
    width_m, height_m = (random.uniform(MIN_FLOOR_M, MAX_FLOOR_M) for _ in range(2))
    return round(width_m, 2), round(height_m, 2)


def spot(random: Draws, size_m: Point, rim_m: float = RIM_M) -> Point:
    """Draw a point on the floor."""
    x_m, y_m = (random.uniform(rim_m, side_m - rim_m) for side_m in size_m)
    return round(x_m, 3), round(y_m, 3)


def tilt(random: Draws, most_deg: float) -> float:
    """Draw an angle of at most `most_deg`."""
    return radians(random.uniform(-most_deg, most_deg))


def any_angle(random: Draws) -> float:
    """Draw any angle."""
    return random.uniform(-pi, pi)


def hand(random: Draws) -> int:
    """Draw a side: 1 or -1."""
    return random.choice((-1, 1))


def thickness(random: Draws) -> float:
    """Draw the thickness of a wall."""
    return round(random.uniform(MIN_THICKNESS_M, MAX_THICKNESS_M), 3)


def on_floor(point: Point, size_m: Point, rim_m: float) -> bool:
    """Return whether a point is on the floor, clear of its rim."""
    return all(
        rim_m <= value_m <= side_m - rim_m for value_m, side_m in zip(point, size_m, strict=True)
    )


def standing_room(draft: Draft) -> bool:
    """Return whether start and goal are clear of everything static; families place movers."""
    return all(
        on_floor(point, draft.size_m, STANDING_M)
        and all(clearance_m(point, one) >= STANDING_M for one in draft.obstacles)
        for point in (draft.start, draft.goal)
    )
