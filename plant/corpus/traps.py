"""Families with traps, with unreachable goals, and with thin walls.

A sonar whose echoes are lost at oblique incidence does not see a wall of 2 to 10 mm along its
length, and rarely its end.
"""

from dataclasses import replace
from math import pi
from typing import Final

from plant.corpus import buildings
from plant.corpus.buildings import Plan, apart, maze_draft, maze_plan, office_draft, office_plan
from plant.corpus.draft import (
    DraftFloor,
    Family,
    ShapeFrame,
    WorldDraft,
    any_angle,
    floor,
    hand,
    on_floor,
    spot,
    stage,
    thickness,
    tilt,
)
from plant.model.draws import Draws
from protocol.world import Obstacle, Point, Polyline
from runtime.elementary import hypot

BEYOND_M: Final = 20.0
"""Length of a wall that ends outside every floor."""


def u_trap(random: Draws) -> WorldDraft:
    """Draw a U open towards the start, 0.6 to 2 m wide and 0.6 to 1.6 m deep."""
    place = stage(random, apart_m=3.5)
    return _u(random, place, random.uniform(0.6, 2.0), random.uniform(0.6, 1.6))


def dead_end(random: Draws) -> WorldDraft:
    """Draw a narrow passage of 1.6 to 3.2 m towards the goal, closed at its end."""
    place = stage(random, apart_m=4.5)
    return _u(random, place, random.uniform(0.5, 1.0), random.uniform(1.6, 3.2))


def _u(random: Draws, place: DraftFloor, wide_m: float, deep_m: float) -> WorldDraft:
    """Return a U; in one of four cases the robot starts inside."""
    bottom = place.frame(random.uniform(0.55, 0.8), random.uniform(-0.3, 0.3), tilt(random, 25.0))
    half_m, thick_m = wide_m / 2.0, thickness(random)
    trap = bottom.wall(
        thick_m, (-deep_m, half_m), (0.0, half_m), (0.0, -half_m), (-deep_m, -half_m)
    )
    inside = random.random() < 0.25
    start = bottom.point(-random.uniform(0.3, deep_m), 0.0) if inside else place.start
    return WorldDraft(place.size_m, start, place.goal, (trap,))


def spiral(random: Draws) -> WorldDraft | None:
    """Draw a square spiral of 4 to 9 legs, 0.55 to 0.9 m apart, with start or goal inside."""
    size_m = floor(random)
    frame = ShapeFrame(spot(random, size_m, 1.0), any_angle(random), hand(random))
    gap_m = random.uniform(0.55, 0.9)
    corners = _spiral_corners(gap_m, random.randint(4, 9))
    walls = frame.wall(thickness(random), *corners)
    other = spot(random, size_m)
    most_m = max(max(abs(x), abs(y)) for x, y in corners)
    here = _local(frame, other)
    outside = max(abs(here[0]), abs(here[1])) > most_m + 0.3
    if not outside or not all(on_floor(point, size_m, 0.35) for point in walls.points_m):
        return None
    start, goal = random.choice(((frame.origin, other), (other, frame.origin)))
    return WorldDraft(size_m, start, goal, (walls,))


def _spiral_corners(gap_m: float, legs: int) -> list[Point]:
    """Return the corners of legs of 1, 1, 2, 2, 3, 3 ... gaps, each turning left."""
    x_m, y_m = gap_m / 2.0, -gap_m / 2.0
    step_x, step_y = 0, 1
    corners = [(x_m, y_m)]
    for leg in range(legs):
        length_m = gap_m * (leg // 2 + 1)
        x_m, y_m = x_m + step_x * length_m, y_m + step_y * length_m
        step_x, step_y = -step_y, step_x
        corners.append((x_m, y_m))
    return corners


def _local(frame: ShapeFrame, point: Point) -> Point:
    """Return the coordinates of a point in the frame."""
    unturned = ShapeFrame((0.0, 0.0), -frame.angle_rad)
    x_m, y_m = unturned.point(point[0] - frame.origin[0], point[1] - frame.origin[1])
    return x_m, frame.hand * y_m


def zigzag(random: Draws) -> WorldDraft:
    """Draw two to five baffles across the way, from alternate sides, mostly in a closed shell."""
    count, pitch_m = random.randint(2, 5), random.uniform(0.7, 1.2)
    place = stage(random, apart_m=3.0)
    way = place.frame(0.0)._replace(hand=hand(random))
    half_m, gap_m = random.uniform(0.7, 1.3), random.uniform(0.42, 0.7)
    first_m = (place.length_m - (count - 1) * pitch_m) / 2.0
    thick_m = thickness(random)
    walls: list[Obstacle] = []
    for baffle in range(count):
        side = 1.0 if baffle % 2 else -1.0
        at_m = first_m + baffle * pitch_m
        walls.append(way.wall(thick_m, (at_m, side * half_m), (at_m, side * (gap_m - half_m))))
    if random.random() < 0.7:
        ends_m = (min(-0.4, first_m - 0.6), max(0.0, -first_m) + place.length_m + 0.4)
        walls.append(_shell(way, ends_m, half_m, thick_m))
    return place.draft(*walls)


def _shell(way: ShapeFrame, ends_m: Point, half_m: float, thick_m: float) -> Polyline:
    low_m, high_m = ends_m
    corners = ((low_m, -half_m), (high_m, -half_m), (high_m, half_m), (low_m, half_m))
    return way.wall(thick_m, *corners, corners[0])


def corridor(random: Draws) -> WorldDraft:
    """Draw two walls 0.5 to 1.2 m apart with one to three bends; one end may be closed."""
    place = stage(random, apart_m=3.5)
    bends = random.randint(1, 3)
    way, length_m = place.frame(0.0), place.length_m
    first_m, last_m = random.uniform(-0.6, 0.4), length_m + random.uniform(-0.4, 0.6)
    middle = [(first_m, 0.0)]
    middle += [
        (length_m * bend / (bends + 1), random.uniform(-0.9, 0.9)) for bend in range(1, bends + 1)
    ]
    middle.append((last_m, 0.0))
    half_m, thick_m = random.uniform(0.25, 0.6), thickness(random)
    left, right = _beside(middle, half_m), _beside(middle, -half_m)
    walls = [way.wall(thick_m, *left), way.wall(thick_m, *right)]
    if first_m < -0.3 and random.random() < 0.5:
        walls.append(way.wall(thick_m, left[0], right[0]))
    return place.draft(*walls)


def _beside(middle: list[Point], left_m: float) -> list[Point]:
    """Return the line at a distance to the left of another, mitred at its bends."""
    beside = []
    for index, (x_m, y_m) in enumerate(middle):
        before = middle[max(0, index - 1)]
        after = middle[min(len(middle) - 1, index + 1)]
        here = (x_m, y_m)
        normals = [_normal(a, b) for a, b in ((before, here), (here, after)) if a != b]
        sum_x = sum_y = 0.0
        for normal_x, normal_y in normals:
            sum_x, sum_y = sum_x + normal_x, sum_y + normal_y
        scale = left_m * len(normals) / (sum_x * sum_x + sum_y * sum_y)
        beside.append((x_m + scale * sum_x, y_m + scale * sum_y))
    return beside


def _normal(a: Point, b: Point) -> Point:
    length_m = hypot(b[0] - a[0], b[1] - a[1])
    return (a[1] - b[1]) / length_m, (b[0] - a[0]) / length_m


def door(random: Draws) -> WorldDraft:
    """Draw one or two walls across the floor, each with one door of 0.40 to 0.60 m."""
    place = stage(random, apart_m=3.5)
    shares = (0.5,) if random.random() < 0.6 else (0.33, 0.67)
    walls: list[Obstacle] = []
    for share in shares:
        across = place.frame(share, 0.0, tilt(random, 30.0))
        thick_m = round(random.uniform(0.04, 0.15), 3)
        left_m = random.uniform(-1.5, 1.5)
        # The wall's ends are round and the door is between them.
        half_m = random.uniform(0.40, 0.60) / 2.0 + thick_m / 2.0
        walls.append(across.wall(thick_m, (0.0, left_m + half_m), (0.0, BEYOND_M)))
        walls.append(across.wall(thick_m, (0.0, left_m - half_m), (0.0, -BEYOND_M)))
    return place.draft(*walls)


def unreachable(random: Draws) -> WorldDraft:
    """Draw a world whose goal is unreachable."""
    kinds = (_goal_boxed_in, _start_boxed_in, _goal_cell_walled_off, _room_without_door)
    return random.choice(kinds)(random)._replace(reachable=False)


def _goal_boxed_in(random: Draws) -> WorldDraft:
    place = _stage(random)
    return place.draft(_ring(random, place.goal))


def _start_boxed_in(random: Draws) -> WorldDraft:
    place = _stage(random)
    return place.draft(_ring(random, place.start))


def _stage(random: Draws) -> DraftFloor:
    return stage(random, apart_m=2.5)


def _ring(random: Draws, centre: Point) -> Obstacle:
    """Return a closed wall of four to six sides around a place, 0.8 to 1.8 m across."""
    frame, sides = ShapeFrame(centre, any_angle(random)), random.randint(4, 6)
    if sides == 4:
        x_m, y_m = random.uniform(0.4, 0.9), random.uniform(0.4, 0.9)
        corners = [(x_m, y_m), (-x_m, y_m), (-x_m, -y_m), (x_m, -y_m)]
        return frame.wall(thickness(random), *corners, corners[0])
    far_m = random.uniform(0.5, 0.9)
    turns = [ShapeFrame(centre, frame.angle_rad + 2.0 * pi * turn / sides) for turn in range(sides)]
    corners = [turn.point(far_m, 0.0) for turn in turns]
    return ShapeFrame((0.0, 0.0), 0.0).wall(thickness(random), *corners, corners[0])


def _goal_cell_walled_off(random: Draws) -> WorldDraft:
    plan = maze_plan(random, random.randint(4, 6), random.randint(4, 6))
    start, goal = apart(random, plan)
    return maze_draft(random, _without_doors(plan, goal), start, goal)


def _room_without_door(random: Draws) -> WorldDraft:
    plan = office_plan(random)
    start, goal = apart(random, plan)
    return office_draft(random, _without_doors(plan, goal), start, goal)


def _without_doors(plan: Plan, cell: tuple[int, int]) -> Plan:
    return plan._replace(doors={door for door in plan.doors if cell not in door})


THICKNESSES_M: Final = (0.002, 0.005, 0.010)
KINDS: Final[tuple[Family, ...]] = (
    buildings.maze,
    buildings.office,
    u_trap,
    spiral,
)


def thin(random: Draws) -> WorldDraft | None:
    """Draw a maze, an office, a U-trap or a spiral with walls of 2, 5 or 10 mm."""
    thickness_m, kind = random.choice(THICKNESSES_M), random.choice(KINDS)
    draft = kind(random)
    return None if draft is None else with_walls(draft, thickness_m)


def with_walls(draft: WorldDraft, thickness_m: float) -> WorldDraft:
    """Return a draft whose walls all have this thickness; doors become wider by the difference."""
    obstacles = tuple(
        replace(obstacle, thickness_m=thickness_m) if isinstance(obstacle, Polyline) else obstacle
        for obstacle in draft.obstacles
    )
    return draft._replace(obstacles=obstacles)
