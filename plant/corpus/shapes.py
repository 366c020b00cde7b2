"""Families with obstacles on an open floor: simple shapes, forests and pedestrians.

Pedestrians are discs of 0.2 m that walk back and forth across the path. None comes nearer to static
obstacles or to the outer walls than the robot needs between them, and none comes near start or
goal. In `moving`, no pedestrian comes near the path of another either, so a free path is always
left. In the other families the paths may cross.
"""

from functools import partial
from itertools import pairwise
from math import inf, pi
from typing import Final

from plant.corpus.draft import (
    DraftFloor,
    Family,
    ShapeFrame,
    WorldDraft,
    any_angle,
    on_floor,
    spot,
    stage,
    thickness,
    tilt,
)
from plant.model.draws import Draws
from plant.model.geometry import between_ends_m, clearance_m, distance_m, meet
from protocol.world import Obstacle, Point, WorldCircle, WorldPolygon

MAX_STRAY: Final = 3


def open_floor(random: Draws) -> WorldDraft:
    """Draw an empty floor."""
    return stage(random).draft()


def disc(random: Draws) -> WorldDraft:
    """Draw a disc in the way, and up to three more anywhere."""
    place = stage(random)
    middle = place.frame(random.uniform(0.3, 0.7), random.uniform(-0.3, 0.3))
    first = middle.disc(0.0, 0.0, random.uniform(0.1, 0.7))
    return place.draft(first, *(_stray_disc(random, place.size_m) for _ in _few(random)))


def box(random: Draws) -> WorldDraft:
    """Draw a rotated box in the way, and up to three more anywhere."""
    place = stage(random)
    middle = place.frame(random.uniform(0.3, 0.7), random.uniform(-0.4, 0.4), any_angle(random))
    return place.draft(
        box_at(random, middle), *(stray_box(random, place.size_m) for _ in _few(random))
    )


def wall(random: Draws) -> WorldDraft:
    """Draw a wall of 1 to 4 m across the way."""
    place = stage(random)
    middle = place.frame(random.uniform(0.3, 0.7), random.uniform(-0.6, 0.6), tilt(random, 40.0))
    half_m = random.uniform(0.5, 2.0)
    return place.draft(middle.wall(thickness(random), (0.0, -half_m), (0.0, half_m)))


def corner(random: Draws) -> WorldDraft:
    """Draw two arms that meet at 60 to 120 degrees, open towards the start."""
    place = stage(random)
    tip = place.frame(random.uniform(0.4, 0.75), random.uniform(-0.3, 0.3), tilt(random, 30.0))
    half_rad = random.uniform(pi / 6.0, pi / 3.0)
    arms = (
        ShapeFrame(tip.origin, tip.angle_rad + pi - half_rad),
        ShapeFrame(tip.origin, tip.angle_rad + pi + half_rad),
    )
    ends = [arm.point(random.uniform(0.6, 2.0), 0.0) for arm in arms]
    floor_frame = ShapeFrame((0.0, 0.0), 0.0)
    return place.draft(floor_frame.wall(thickness(random), ends[0], tip.origin, ends[1]))


def box_at(random: Draws, frame: ShapeFrame, most_m: float = 1.6) -> WorldPolygon:
    """Draw a box in a frame."""
    half_x_m, half_y_m = (random.uniform(0.1, most_m / 2.0) for _ in range(2))
    return frame.box(-half_x_m, -half_y_m, half_x_m, half_y_m)


def stray_box(random: Draws, size_m: tuple[float, float]) -> Obstacle:
    """Draw a box anywhere."""
    return box_at(random, ShapeFrame(spot(random, size_m), any_angle(random)), 1.0)


def _stray_disc(random: Draws, size_m: tuple[float, float]) -> WorldCircle:
    x_m, y_m = spot(random, size_m)
    return WorldCircle(x_m=x_m, y_m=y_m, radius_m=round(random.uniform(0.08, 0.4), 3))


def _few(random: Draws) -> range:
    return range(random.randrange(MAX_STRAY + 1))


MIN_THICKNESS_M: Final = 0.05
MAX_THICKNESS_M: Final = 0.15
MIN_PASSAGE_M: Final = 0.34
MAX_PASSAGE_M: Final = 0.42
CLEARING_M: Final = 0.30
MAX_THROWS: Final = 20_000


def forest(random: Draws, sparsest_m2: float, densest_m2: float) -> WorldDraft | None:
    """Draw a number of trunks per square metre, each a passage away from others and the rim."""
    place = stage(random, apart_m=4.0)
    passage_m = random.uniform(MIN_PASSAGE_M, MAX_PASSAGE_M)
    wide_m, high_m = place.size_m
    count = round(random.uniform(sparsest_m2, densest_m2) * wide_m * high_m)
    trunks: list[WorldCircle] = []
    for _ in range(MAX_THROWS):
        x_m, y_m = spot(random, place.size_m)
        radius_m = round(random.uniform(MIN_THICKNESS_M, MAX_THICKNESS_M), 3)
        trunk = WorldCircle(x_m=x_m, y_m=y_m, radius_m=radius_m)
        if _fits(trunk, trunks, passage_m, place.size_m, (place.start, place.goal)):
            trunks.append(trunk)
        if len(trunks) == count:
            return place.draft(*trunks)
    return None


sparse: Final[Family] = partial(forest, sparsest_m2=0.25, densest_m2=0.45)
medium: Final[Family] = partial(forest, sparsest_m2=0.6, densest_m2=0.85)
dense: Final[Family] = partial(forest, sparsest_m2=1.1, densest_m2=1.3)


def _fits(
    trunk: WorldCircle,
    trunks: list[WorldCircle],
    passage_m: float,
    size_m: Point,
    clear: tuple[Point, ...],
) -> bool:
    here, around_m = (trunk.x_m, trunk.y_m), trunk.radius_m + passage_m
    return (
        on_floor(here, size_m, around_m)
        and all(distance_m(here, point) >= trunk.radius_m + CLEARING_M for point in clear)
        and all(
            distance_m(here, (one.x_m, one.y_m)) >= around_m + one.radius_m
            for one in reversed(trunks)
        )
    )


PERSON_M: Final = 0.2
ROOM_M: Final = 0.5
STEP_M: Final = 0.05
"""Room for the robot, 0.24 m wide, beside a pedestrian."""

START_ROOM_M: Final = 0.6
SPEEDS_M_S: Final = (0.1, 0.2)
CROWD_M_S: Final = (0.05, 0.2)
HASTY_M_S: Final = (0.2, 0.4)
MAX_TRIES: Final = 30


def moving(random: Draws) -> WorldDraft | None:
    """Draw two to four pedestrians across the path, and up to three static discs and boxes."""
    return _people(random, 2, 4, SPEEDS_M_S, crossing=False)


def crowd(random: Draws) -> WorldDraft | None:
    """Draw one to six pedestrians of 0.05 to 0.2 m/s, whose paths may cross."""
    return _people(random, 1, 6, CROWD_M_S, crossing=True)


def hasty_crowd(random: Draws) -> WorldDraft | None:
    """Draw one to six pedestrians of 0.2 to 0.4 m/s, up to a third faster than the robot."""
    return _people(random, 1, 6, HASTY_M_S, crossing=True)


def _people(
    random: Draws, least: int, most: int, speeds_m_s: tuple[float, float], *, crossing: bool
) -> WorldDraft | None:
    place = stage(random, apart_m=4.0)
    still = [_still(random, place) for _ in range(random.randrange(4))]
    walkers: list[WorldCircle] = []
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
    return WorldCircle(x_m=x_m, y_m=y_m, radius_m=round(random.uniform(0.1, 0.4), 3))


def _walker(random: Draws, place: DraftFloor, speeds_m_s: tuple[float, float]) -> WorldCircle:
    """Draw a straight path across the way, or a bent one anywhere."""
    across = place.frame(random.uniform(0.2, 0.8), random.uniform(-0.5, 0.5), tilt(random, 40.0))
    path = [(0.0, random.uniform(0.6, 2.0)), (0.0, -random.uniform(0.6, 2.0))]
    if random.random() < 0.3:
        path.insert(1, (random.uniform(-0.6, 0.6), 0.0))
    if random.random() < 0.2:
        across = across._replace(angle_rad=any_angle(random))
    points = across.points(*path)
    return WorldCircle(
        x_m=points[0][0],
        y_m=points[0][1],
        radius_m=PERSON_M,
        path_m=points,
        speed_m_s=round(random.uniform(*speeds_m_s), 3),
    )


def _leaves_a_way(
    walker: WorldCircle, walkers: list[WorldCircle], still: list[Obstacle], place: DraftFloor
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


def _every(path: tuple[Point, ...]) -> list[Point]:
    """Return points along a path at equal distances."""
    points = [path[0]]
    for a, b in pairwise(path):
        steps = int(distance_m(a, b) / STEP_M) + 1
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
