"""Long ways: combs, hairpins, detours, lattices of posts, and mazes longer than odometry lasts."""

from typing import Final

from plant.corpus.adversarial.axes import (
    EXCESS,
    HEADING,
    ROOM,
    THICKNESS,
    TURN,
    Adversary,
    Axis,
    Values,
    fitted,
    frame_of,
    whole,
)
from plant.corpus.buildings import Cell, Doors, Plan, carved, neighbours, wall_lines
from plant.corpus.draft import Draft
from plant.model.draws import Draws
from plant.model.types import Obstacle, Point

COMMON: Final = (THICKNESS, TURN, HEADING, ROOM)
LAYOUT: Final = Axis("layout", 0, 999, whole=True)
"""Number of a random layout."""


def comb(values: Values, radius_m: float) -> Draft | None:
    """Make a wall with teeth towards the robot, the goal behind its back or between two teeth."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    teeth, deep_m = whole(values, "teeth"), values["deep_m"]
    pitch_m = 2.0 * radius_m + values["excess_m"] + thick_m
    back_m = pitch_m * (teeth - 1)
    walls: list[Obstacle] = [frame.wall(thick_m, (0.0, 0.0), (0.0, back_m))]
    for tooth in range(teeth):
        at_m = tooth * pitch_m
        longer_m = values["uneven_m"] * (tooth % 2)
        walls.append(frame.wall(thick_m, (0.0, at_m), (-deep_m - longer_m, at_m)))
    behind = whole(values, "behind")
    slot_m = (whole(values, "slot") % max(1, teeth - 1) + 0.5) * pitch_m
    depth_m = radius_m + thick_m + 0.05
    goal = (depth_m + values["away_m"], values["across"] * back_m) if behind else (-depth_m, slot_m)
    start_m = -deep_m - values["uneven_m"] - radius_m - 0.1 - values["before_m"]
    start = (start_m, values["from"] * back_m)
    ends = [frame.point(*start), frame.point(*goal)]
    if whole(values, "swapped") == 0:
        ends.reverse()
    return fitted(values, ends[0], ends[1], walls, radius_m)


def hairpin(values: Values, radius_m: float) -> Draft | None:
    """Make a lane that runs to and fro between baffles in a closed shell."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    lanes, long_m = whole(values, "lanes"), values["long_m"]
    lane_m = 2.0 * radius_m + values["excess_m"] + thick_m
    mouth_m = 2.0 * radius_m + values["mouth_m"] + thick_m
    if long_m < 2.0 * mouth_m:
        return None
    wide_m = lanes * lane_m
    shell = [(0.0, 0.0), (long_m, 0.0), (long_m, wide_m), (0.0, wide_m), (0.0, 0.0)]
    first = whole(values, "mirror")
    walls: list[Obstacle] = []
    for lane in range(1, lanes):
        low_m, high_m = (0.0, long_m - mouth_m) if (lane + first) % 2 else (mouth_m, long_m)
        walls.append(frame.wall(thick_m, (low_m, lane * lane_m), (high_m, lane * lane_m)))
    start = frame.point(_in_lane(values["start"], long_m, lane_m), lane_m / 2.0)
    if whole(values, "outside") == 0:
        shell = shell[1:]  # without the side at the first lane, where the robot is outside
        start = frame.point(values["start"] * long_m, -values["away_m"] - radius_m - thick_m)
    walls.append(frame.wall(thick_m, *shell))
    goal = frame.point(_in_lane(values["end"], long_m, lane_m), wide_m - lane_m / 2.0)
    return fitted(values, start, goal, walls, radius_m)


def _in_lane(share: float, long_m: float, lane_m: float) -> float:
    return lane_m / 2.0 + share * (long_m - lane_m)


def long_detour(values: Values, radius_m: float) -> Draft | None:
    """Make a long wall close to robot and goal, so that the path around it is long."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    near_m = radius_m + thick_m / 2.0 + values["near_m"]
    up_m, down_m, arm_m = values["up_m"], values["down_m"], values["arm_m"]
    line: list[Point] = [(0.0, -down_m), (0.0, up_m)]
    if whole(values, "hook") > 0:
        line.append((-arm_m, up_m))
    if whole(values, "hook") > 1:
        line.insert(0, (-arm_m * values["other"], -down_m))
    if whole(values, "hook") > 2:
        line.append((-arm_m, up_m - values["return"] * (up_m + down_m)))
    walls = [frame.wall(thick_m, *line)]
    ends = [frame.point(-near_m, 0.0), frame.point(near_m, 0.0)]
    if whole(values, "swapped"):
        ends.reverse()
    return fitted(values, ends[0], ends[1], walls, radius_m)


def post_lattice(values: Values, radius_m: float) -> Draft | None:
    """Make rows of posts with gaps about as wide as the robot, some gaps closed."""
    frame, random = frame_of(values), Draws(f"lattice/{whole(values, 'layout')}")
    rows, columns = whole(values, "rows"), whole(values, "columns")
    post_m = values["post_m"]
    pitch_m = 2.0 * (radius_m + post_m) + values["gap_m"]
    jitter_m = values["jitter"] * values["gap_m"] / 2.0
    walls: list[Obstacle] = []
    for row in range(rows):
        for column in range(columns):
            dx_m, dy_m = (random.uniform(-jitter_m, jitter_m) for _ in range(2))
            stagger = values["stagger"] * (row % 2)
            at = row * pitch_m + dx_m, (column + stagger - columns / 2.0) * pitch_m + dy_m
            if random.random() >= values["missing"]:
                walls.append(frame.disc(*at, post_m))
    before_m = radius_m + post_m + jitter_m + 0.1
    start = frame.point(-before_m - values["before_m"], values["from_m"])
    goal = frame.point((rows - 1) * pitch_m + before_m + values["after_m"], 0.0)
    return fitted(values, start, goal, walls, radius_m)


def long_maze(values: Values, radius_m: float) -> Draft | None:
    """Make a maze with few loops whose goal is among the cells farthest from the start by path."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    columns, rows = whole(values, "columns"), whole(values, "rows")
    cell_m = 2.0 * radius_m + values["excess_m"] + thick_m
    doors = carved(Draws(f"maze/{whole(values, 'layout')}"), columns, rows, values["loops"])
    plan = Plan(columns, rows, (1.0, 1.0), doors)
    shell: list[Point] = [(0, 0), (columns, 0), (columns, rows), (0, rows), (0, 0)]
    walls = [
        frame.wall(thick_m, *((cell_m * x, cell_m * y) for x, y in line))
        for line in (*wall_lines(plan), shell)
    ]
    start = (int(values["start_x"] * 0.999 * columns), int(values["start_y"] * 0.999 * rows))
    cells = nearest_first(start, columns, rows, doors)
    goal = cells[int(values["far"] * 0.999 * len(cells))]
    ends = [frame.point(cell_m * x, cell_m * y) for x, y in (plan.centre(start), plan.centre(goal))]
    return fitted(values, ends[0], ends[1], walls, radius_m)


def nearest_first(start: Cell, columns: int, rows: int, doors: Doors) -> list[Cell]:
    """Return all cells of a maze in the order of their paths' lengths from a cell."""
    found = [start]
    for cell in found:
        for other in neighbours(cell, columns, rows):
            if frozenset((cell, other)) in doors and other not in found:
                found.append(other)
    return found


AWAY: Final = Axis("away_m", 0.0, 2.0)
SWAPPED: Final = Axis("swapped", 0, 1, whole=True)
MIRROR: Final = Axis("mirror", 0, 1, whole=True)

COMB: Final = Adversary(
    (
        *(Axis("teeth", 2, 7, whole=True), Axis("deep_m", 0.3, 2.5), Axis("uneven_m", 0.0, 0.6)),
        *(Axis("behind", 0, 1, whole=True), Axis("slot", 0, 5, whole=True), AWAY),
        *(Axis("across", 0.0, 1.0), Axis("from", 0.0, 1.0), Axis("before_m", 0.0, 2.0)),
        *(SWAPPED, EXCESS, *COMMON),
    ),
    comb,
)
HAIRPIN: Final = Adversary(
    (
        *(Axis("lanes", 2, 6, whole=True), Axis("long_m", 1.2, 5.0), Axis("mouth_m", 0.02, 0.6)),
        *(MIRROR, Axis("outside", 0, 2, whole=True), Axis("start", 0.0, 1.0)),
        *(Axis("end", 0.0, 1.0), AWAY, EXCESS, *COMMON),
    ),
    hairpin,
)
LONG_DETOUR: Final = Adversary(
    (
        *(Axis("near_m", 0.05, 0.4), Axis("up_m", 2.0, 8.0), Axis("down_m", 2.0, 8.0)),
        *(Axis("arm_m", 0.5, 5.0), Axis("other", 0.3, 1.5), Axis("return", 0.0, 0.95)),
        *(Axis("hook", 0, 3, whole=True), SWAPPED, *COMMON),
    ),
    long_detour,
    detour=10.0,
)
POST_LATTICE: Final = Adversary(
    (
        *(Axis("rows", 1, 6, whole=True), Axis("columns", 2, 9, whole=True), LAYOUT),
        *(Axis("post_m", 0.02, 0.15), Axis("gap_m", -0.08, 0.20), Axis("jitter", 0.0, 1.0)),
        *(Axis("stagger", 0.0, 0.5), Axis("missing", 0.0, 0.3), Axis("before_m", 0.0, 1.0)),
        *(Axis("after_m", 0.0, 1.0), Axis("from_m", -1.0, 1.0), TURN, HEADING, ROOM),
    ),
    post_lattice,
)
LONG_MAZE: Final = Adversary(
    (
        *(Axis("columns", 6, 14, whole=True), Axis("rows", 6, 14, whole=True), LAYOUT),
        *(Axis("loops", 0.0, 0.05), Axis("start_x", 0.0, 1.0), Axis("start_y", 0.0, 1.0)),
        *(Axis("far", 0.7, 1.0), EXCESS, *COMMON),
    ),
    long_maze,
)
