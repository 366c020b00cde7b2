"""Pedestrians: discs of 0.2 m that walk back and forth across the path.

No pedestrian comes nearer to static obstacles or to the outer walls than the robot needs between
them, and none comes near start or goal. In `moving`, no pedestrian comes near the path of another
either, so a free path is always left. In the other families the paths may cross.
"""

from itertools import pairwise
from math import inf
from typing import Final

from plant.corpus.draft import Draft, DraftFloor, any_angle, on_floor, spot, stage, tilt
from plant.corpus.shapes import stray_box
from plant.model.draws import Draws
from plant.model.geometry import between_ends_m, clearance_m, distance_m, meet
from plant.model.types import Circle, Obstacle, Point

PERSON_M: Final = 0.2
ROOM_M: Final = 0.5
"""Room for the robot, 0.24 m wide, beside a pedestrian."""

START_ROOM_M: Final = 0.6
SPEEDS_M_S: Final = (0.1, 0.2)
CROWD_M_S: Final = (0.05, 0.2)
HASTY_M_S: Final = (0.2, 0.4)
MAX_TRIES: Final = 30


def moving(random: Draws) -> Draft | None:
    """Draw two to four pedestrians across the path, and up to three static discs and boxes."""
    return _people(random, 2, 4, SPEEDS_M_S, crossing=False)


def crowd(random: Draws) -> Draft | None:
    """Draw one to six pedestrians of 0.05 to 0.2 m/s, whose paths may cross."""
    return _people(random, 1, 6, CROWD_M_S, crossing=True)


def hasty_crowd(random: Draws) -> Draft | None:
    """Draw one to six pedestrians of 0.2 to 0.4 m/s, up to a third faster than the robot."""
    return _people(random, 1, 6, HASTY_M_S, crossing=True)


def _people(
    random: Draws, least: int, most: int, speeds_m_s: tuple[float, float], *, crossing: bool
) -> Draft | None:
    place = stage(random, apart_m=4.0)
    still = [_still(random, place) for _ in range(random.randrange(4))]
    walkers: list[Circle] = []
    wanted = random.randint(least, most)
    for _ in range(MAX_TRIES):
        walker = _walker(random, place, speeds_m_s)
        if _leaves_a_way(walker, [] if crossing else walkers, still, place):
            walkers.append(walker)
        if len(walkers) == wanted:
            return place.draft(*still, *walkers)
    return None


def _still(random: Draws, place: DraftFloor) -> Obstacle:
    if random.random() < 0.5:
        return stray_box(random, place.size_m)
    x_m, y_m = spot(random, place.size_m)
    return Circle(x_m=x_m, y_m=y_m, radius_m=round(random.uniform(0.1, 0.4), 3))


def _walker(random: Draws, place: DraftFloor, speeds_m_s: tuple[float, float]) -> Circle:
    """Draw a straight path across the way, or a bent one anywhere."""
    across = place.frame(random.uniform(0.2, 0.8), random.uniform(-0.5, 0.5), tilt(random, 40.0))
    path = [(0.0, random.uniform(0.6, 2.0)), (0.0, -random.uniform(0.6, 2.0))]
    if random.random() < 0.3:
        path.insert(1, (random.uniform(-0.6, 0.6), 0.0))
    if random.random() < 0.2:
        across = across._replace(angle_rad=any_angle(random))
    points = across.points(*path)
    return Circle(
        x_m=points[0][0],
        y_m=points[0][1],
        radius_m=PERSON_M,
        path_m=points,
        speed_m_s=round(random.uniform(*speeds_m_s), 3),
    )


def _leaves_a_way(
    walker: Circle, walkers: list[Circle], still: list[Obstacle], place: DraftFloor
) -> bool:
    along = _every(walker.path_m)
    return (
        all(on_floor(point, place.size_m, PERSON_M + ROOM_M) for point in along)
        and all(
            distance_m(point, place_m) >= PERSON_M + START_ROOM_M
            for point in along
            for place_m in (place.start, place.goal)
        )
        and all(clearance_m(point, one) >= PERSON_M + ROOM_M for point in along for one in still)
        and all(_gap_m(walker.path_m, other.path_m) >= 2.0 * PERSON_M + ROOM_M for other in walkers)
    )


def _every(path: tuple[Point, ...], step_m: float = 0.05) -> list[Point]:
    """Return points along a path at equal distances."""
    points = [path[0]]
    for a, b in pairwise(path):
        steps = int(distance_m(a, b) / step_m) + 1
        points += [
            (a[0] + (b[0] - a[0]) * i / steps, a[1] + (b[1] - a[1]) * i / steps)
            for i in range(1, steps + 1)
        ]
    return points


def _gap_m(one: tuple[Point, ...], other: tuple[Point, ...]) -> float:
    """Return the smallest distance between two paths."""
    least_m = inf
    for a, b in pairwise(one):
        for c, d in pairwise(other):
            if meet(a, b, c, d):
                return 0.0
            least_m = min(least_m, between_ends_m(a, b, c, d))
    return least_m
