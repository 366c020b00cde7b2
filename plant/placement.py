"""Starts and goals: whether the robot fits there, and the places of several robots.

Robots start side by side, then in ranks behind and ahead of the first. A goal is shifted as the
robot's start, or is the nearest free place.
"""

from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from math import ceil
from typing import Final, NamedTuple

from plant.model.configuration import Body
from plant.model.errors import WorldReport
from plant.model.geometry import TOUCHING_M, Pose, clearance_m, distance_m
from protocol.world import GoalPose, Obstacle, Point, Start, World, WorldCircle
from runtime.elementary import cos, sin


class ObstacleFloor(NamedTuple):
    """Size, obstacles and robot radius for the check."""

    size_m: Point
    walls: bool
    radius_m: float
    obstacles: Mapping[int, Obstacle]


def check_places(
    report: WorldReport, floor: ObstacleFloor, start: Start | None, goal: GoalPose | None
) -> None:
    """Report collisions of the robot's disc at start and goal; obstacles are named by index."""
    if start is not None:
        _check_on_floor(report, floor, "start", (start.x_m, start.y_m))
        _check_clear(report, floor, "start", (start.x_m, start.y_m))
    if goal is not None:
        _check_on_floor(report, floor, "goal", (goal.x_m, goal.y_m))
        _check_clear(report, floor, "goal", (goal.x_m, goal.y_m))


def _check_on_floor(report: WorldReport, floor: ObstacleFloor, what: str, point: Point) -> None:
    margin_m = floor.radius_m if floor.walls else 0.0
    for axis, value_m, size_m in zip(("x_m", "y_m"), point, floor.size_m, strict=True):
        low_m, high_m = margin_m, size_m - margin_m
        if low_m - TOUCHING_M <= value_m <= high_m + TOUCHING_M:
            continue
        if 0.0 <= value_m <= size_m:
            reason = f"{value_m:g} is nearer to the outer wall than the robot's radius"
            reason += f" of {floor.radius_m:g} m"
        else:
            reason = f"{value_m:g} is outside the floor of {floor.size_m[0]:g} x "
            reason += f"{floor.size_m[1]:g} m"
        report.add((what, axis), reason, f"choose {axis} within {low_m:g} to {high_m:g}")


def _check_clear(report: WorldReport, floor: ObstacleFloor, what: str, point: Point) -> None:
    for index, obstacle in floor.obstacles.items():
        if what == "goal" and isinstance(obstacle, WorldCircle) and obstacle.path_m:
            continue  # a moving obstacle leaves again
        gap_m = clearance_m(point, obstacle)
        if gap_m >= floor.radius_m - TOUCHING_M:
            continue
        name = f"obstacle#{index + 1} (line {report.line(('obstacle', index))})"
        if gap_m <= 0.0:
            reason = f"({point[0]:g}, {point[1]:g}) is inside {name}"
        else:
            reason = f"({point[0]:g}, {point[1]:g}) is {gap_m:.3g} m from {name}, less than"
            reason += f" the robot's radius of {floor.radius_m:g} m"
        report.add((what,), reason, f"keep {what} at least {floor.radius_m:g} m away from it")


ROOM_M: Final = 0.02
MAX_START_PLACE: Final = 50
RANKS: Final = (0, -1, 1, -2, 2, -3, 3)
"""Ranks are filled in this order; a negative one is behind the start of the world."""


def starts(world: World, body: Body, robots: int) -> list[Pose]:
    """Return the starts: the first at the world's start, the others alternately left and right.

    When their rank is full, further robots start in other ranks, behind it and ahead of it.

    Raises ValueError if there are fewer free places than robots.
    """
    if robots < 1:
        raise ValueError(f"robots: {robots} is less than one")
    found = list(islice(_free_places(world, body), robots))
    if len(found) < robots:
        raise ValueError(
            f"robots: {world.name} has room for {len(found)} beside its start, not for {robots}"
        )
    return found


def _free_places(world: World, body: Body) -> Iterator[Pose]:
    start = world.start
    yield (start.x_m, start.y_m, start.heading_rad)
    for rank, place in ((rank, place) for rank in RANKS for place in _from_the_middle()):
        if (rank, place) == (0, 0):
            continue
        ahead_m, left_m = (number * (2.0 * body.radius_m + start.gap_m) for number in (rank, place))
        along, across = cos(start.heading_rad), sin(start.heading_rad)
        x_m = start.x_m + ahead_m * along - left_m * across
        y_m = start.y_m + ahead_m * across + left_m * along
        if _free(world, x_m, y_m, body.radius_m + ROOM_M):
            yield (x_m, y_m, start.heading_rad)


def _from_the_middle() -> Iterator[int]:
    """Yield the places of a rank: 0, then alternately left (positive) and right."""
    yield 0
    for place in range(1, MAX_START_PLACE):
        yield from (place, -place)


def _free(world: World, x_m: float, y_m: float, needed_m: float) -> bool:
    width_m, height_m = world.size_m
    rim_m = min(x_m, y_m, width_m - x_m, height_m - y_m)
    if world.walls and rim_m < needed_m:
        return False
    return all(clearance_m((x_m, y_m), obstacle) >= needed_m for obstacle in world.obstacles)


STANDING_M: Final = 0.17
"""Smallest distance of the centres of start and goal from any obstacle, in new worlds."""
STEP_M: Final = 0.05
MAX_GOAL_PLACE: Final = 12


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
    pitch_m = 2.0 * body.radius_m + world.start.gap_m
    floor = _FleetFloor(world, body.radius_m + ROOM_M)
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
    places = range(-MAX_GOAL_PLACE, MAX_GOAL_PLACE + 1)
    for ahead in places:
        for left in places:
            x_m = goal[0] + ahead * along - left * across
            yield (x_m, goal[1] + ahead * across + left * along)


class _FleetFloor:
    """Free places for robots. Moving obstacles are ignored: they leave again."""

    def __init__(self, world: World, needed_m: float) -> None:
        self._size_m = world.size_m
        self._margin_m = needed_m if world.walls else 0.0
        self._needed_m = needed_m
        self._obstacles = [
            one for one in world.obstacles if not (isinstance(one, WorldCircle) and one.path_m)
        ]

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
