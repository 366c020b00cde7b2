"""Goals of several robots: the goal shifted as the robot's start, or the nearest free place."""

from collections.abc import Iterator, Sequence
from math import ceil
from typing import Final, NamedTuple

from plant.model.body import Body
from plant.model.geometry import clearance_m, distance_m
from plant.model.scene import Pose
from plant.model.types import Circle, Obstacle, Point, World
from plant.placement.start_positions import GAP_M, ROOM_M
from runtime.elementary import cos, sin

STEP_M: Final = 0.05
MAX_PLACE: Final = 12


class RobotGoal(NamedTuple):
    """A goal; `shifted` is False if it is another place because the shifted one is not free."""

    x_m: float
    y_m: float
    shifted: bool


def goals(world: World, body: Body, starts: Sequence[Pose], goal: Point) -> list[RobotGoal]:
    """Return the goals of all robots; that of the first robot is `goal` itself.

    The other goals are visible from it and apart from each other. Robots without a free place share
    `goal`.
    """
    pitch_m = 2.0 * body.radius_m + GAP_M
    floor = _Floor(world, body.radius_m + ROOM_M)
    first_x_m, first_y_m, heading_rad = starts[0]
    found = [RobotGoal(*goal, shifted=True)]
    for x_m, y_m, _ in starts[1:]:
        wish = (goal[0] + x_m - first_x_m, goal[1] + y_m - first_y_m)
        taken = [(one.x_m, one.y_m) for one in found]
        if floor.seen_from(goal, wish) and _apart(wish, taken, pitch_m):
            found.append(RobotGoal(*wish, shifted=True))
            continue
        places = sorted(
            _around(goal, heading_rad, pitch_m), key=lambda place: distance_m(place, wish)
        )
        free = (
            place
            for place in places
            if _apart(place, taken, pitch_m) and floor.seen_from(goal, place)
        )
        found.append(RobotGoal(*next(free, goal), shifted=False))
    return found


def _apart(place: Point, taken: list[Point], pitch_m: float) -> bool:
    return all(distance_m(place, other) > 0.99 * pitch_m for other in taken)


def _around(goal: Point, heading_rad: float, pitch_m: float) -> Iterator[Point]:
    """Yield a grid of places around the goal, rotated as the starts are."""
    along, across = cos(heading_rad) * pitch_m, sin(heading_rad) * pitch_m
    places = range(-MAX_PLACE, MAX_PLACE + 1)
    for ahead in places:
        for left in places:
            x_m = goal[0] + ahead * along - left * across
            yield (x_m, goal[1] + ahead * across + left * along)


class _Floor:
    """Free places for robots. Moving obstacles are ignored: they leave again."""

    def __init__(self, world: World, needed_m: float) -> None:
        self._size_m = world.size_m
        self._margin_m = needed_m if world.walls else 0.0
        self._needed_m = needed_m
        self._obstacles = [one for one in world.obstacles if not _moves(one)]

    def free(self, place: Point) -> bool:
        """Return whether a robot fits at a place."""
        low_m = self._margin_m
        if not all(
            low_m <= value_m <= size_m - low_m
            for value_m, size_m in zip(place, self._size_m, strict=True)
        ):
            return False
        return all(clearance_m(place, one) >= self._needed_m for one in self._obstacles)

    def seen_from(self, goal: Point, place: Point) -> bool:
        """Return whether a robot fits at a place and on the straight line to the goal."""
        steps = max(1, ceil(distance_m(goal, place) / STEP_M))
        return all(
            self.free(
                (
                    place[0] + (goal[0] - place[0]) * step / steps,
                    place[1] + (goal[1] - place[1]) * step / steps,
                )
            )
            for step in range(steps)
        )


def _moves(obstacle: Obstacle) -> bool:
    return isinstance(obstacle, Circle) and bool(obstacle.path_m)
