"""Layouts made to fool a navigator: enclosures, long ways, and scenes of few walls.

Enclosures: rings and boxes with offset gates, spirals, islands in rooms. Long ways: combs,
hairpins, detours, lattices of posts, mazes longer than odometry lasts. Scenes: one to three walls,
wedges, symmetric traps, doors hardly wider than the robot.
"""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import pi
from typing import Final, TypeAlias

from plant.corpus.buildings import Cell, Doors, Plan, carved, neighbours, wall_lines
from plant.corpus.draft import (
    EXCESS,
    HEADING,
    ROOM,
    THICKNESS,
    TURN,
    Adversary,
    Axis,
    ShapeFrame,
    Values,
    WorldDraft,
    fitted,
    frame_of,
    whole,
)
from plant.model.draws import Draws
from plant.model.geometry import distance_m
from protocol.world import Obstacle, Point
from runtime.elementary import cos_sin

Outline: TypeAlias = Callable[[float], list[Point]]
"""The corners of a closed outline at a distance from the origin."""

MAX_RINGS: Final = 4
GATES: Final = tuple(Axis(f"gate_{ring}", 0.0, 1.0) for ring in range(MAX_RINGS))
"""Place of each ring's gate, as a share of the way around."""

SEALED: Final = Axis("sealed", 0, 3, whole=True)
"""0: the innermost wall has no gate, and the goal is unreachable."""

INWARD: Final = Axis("inward", 0, 2, whole=True)
"""0: the robot starts inside and the goal is outside."""

OUTSIDE: Final = (Axis("away_m", 0.4, 2.5), Axis("bearing", 0.0, 1.0))
"""Place of the outer end: distance from the outermost wall, and direction."""

ENCLOSURE_AXES: Final = (THICKNESS, TURN, HEADING, ROOM, EXCESS, INWARD, *OUTSIDE)
SPIRAL_STEPS: Final = 8
"""Straight walls of a round spiral per turn."""


def rings(values: Values, radius_m: float) -> WorldDraft | None:
    """Make rings of three to twelve sides around the goal, each with one gate."""
    sides = whole(values, "sides")

    def outline(ring_m: float) -> list[Point]:
        """Return the corners of a regular polygon."""
        return [_polar(ring_m, side / sides) for side in range(sides)]

    return _nested(values, radius_m, outline)


def boxes(values: Values, radius_m: float) -> WorldDraft | None:
    """Make boxes around the goal, each with one gate."""
    longer_m = values["longer_m"]

    def outline(half_m: float) -> list[Point]:
        """Return the corners of a box."""
        far_m = half_m + longer_m
        return [(-half_m, -half_m), (far_m, -half_m), (far_m, half_m), (-half_m, half_m)]

    return _nested(values, radius_m, outline)


def _nested(values: Values, radius_m: float, outline: Outline) -> WorldDraft | None:
    """Return outlines around the origin with a gate in each but a sealed one."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    gate_m = 2.0 * radius_m + values["excess_m"] + thick_m
    pitch_m = 2.0 * radius_m + values["aisle_m"] + thick_m
    lines: list[list[Point]] = []
    for ring in range(whole(values, "count")):
        corners = outline(2.0 * radius_m + values["core_m"] + ring * pitch_m)
        if ring == 0 and whole(values, "sealed") == 0:
            lines.append([*corners, corners[0]])
        else:
            lines.append(cut_outline(corners, values[f"gate_{ring}"], gate_m))
    if not all(len(line) > 1 for line in lines):
        return None
    return _with_ends(values, radius_m, frame, lines)


def double_spiral(values: Values, radius_m: float) -> WorldDraft | None:
    """Make two spirals side by side, the robot at the centre of one, the goal in the other."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    pitch_m = 2.0 * radius_m + values["excess_m"] + thick_m
    one = _spiral(pitch_m, values["turns"], values["begin"], 1)
    other = _spiral(pitch_m, values["turns_2"], values["begin_2"], 2 * whole(values, "mirror") - 1)
    apart_m = _far_m(one) + _far_m(other) + 2.0 * radius_m + thick_m + values["away_m"]
    x_m, y_m = _polar(apart_m, values["bearing"])
    moved = [(x + x_m, y + y_m) for x, y in other]
    walls = [frame.wall(thick_m, *line) for line in (one, moved)]
    return fitted(values, frame.point(0.0, 0.0), frame.point(x_m, y_m), walls, radius_m)


def interlocking_spirals(values: Values, radius_m: float) -> WorldDraft | None:
    """Make one to three arms of a spiral around one centre, one of them sealed off at times."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    arms = whole(values, "arms")
    pitch_m = arms * (2.0 * radius_m + values["excess_m"] + thick_m)
    core_m = 2.0 * radius_m + thick_m
    lines = [
        _spiral(pitch_m, values["turns"], values["begin"] + arm / arms, 1, core_m)
        for arm in range(arms)
    ]
    return _with_ends(values, radius_m, frame, lines)


def island_room(values: Values, radius_m: float) -> WorldDraft | None:
    """Make a room with one door, and a wall around the goal that is an island in it."""
    frame, thick_m = frame_of(values), values["thickness_m"]
    gate_m = 2.0 * radius_m + values["excess_m"] + thick_m
    inner_m = 2.0 * radius_m + values["core_m"]
    inner = [_polar(1.2 * inner_m, (side + 0.5) / 4) for side in range(4)]
    cut = cut_outline(inner, values["gate_0"], gate_m)
    lines = [cut if whole(values, "sealed") else [*inner, inner[0]]]
    if whole(values, "inner_room"):
        low_m = inner_m + thick_m + 2.0 * radius_m + values["aisle_m"]
        high_m = low_m + values["longer_m"]
        outer = [(-low_m, -high_m), (high_m, -high_m), (high_m, low_m), (-low_m, low_m)]
        lines.append(cut_outline(outer, values["gate_1"], gate_m))
    walls: list[Obstacle] = [frame.wall(thick_m, *line) for line in lines]
    post_m = _polar(inner_m + 2.0 * radius_m + values["aisle_m"], values["post"])
    if whole(values, "posts"):
        walls.append(frame.disc(*post_m, 0.08))
    far_m = max(map(_far_m, lines))
    return _ends_outside(values, radius_m, frame, walls, far_m)


def _with_ends(
    values: Values, radius_m: float, frame: ShapeFrame, lines: Sequence[Sequence[Point]]
) -> WorldDraft | None:
    """Return the draft with one end at the origin and the other outside."""
    walls = [frame.wall(values["thickness_m"], *line) for line in lines]
    return _ends_outside(values, radius_m, frame, walls, max(map(_far_m, lines)))


def _ends_outside(
    values: Values, radius_m: float, frame: ShapeFrame, walls: Sequence[Obstacle], far_m: float
) -> WorldDraft | None:
    outer = frame.point(*_polar(far_m + radius_m + values["away_m"], values["bearing"]))
    inner = frame.point(0.0, 0.0)
    start, goal = (outer, inner) if whole(values, "inward") else (inner, outer)
    return fitted(values, start, goal, walls, radius_m)


def cut_outline(corners: Sequence[Point], share: float, gap_m: float) -> list[Point]:
    """Return a closed outline as an open line that lacks a gap at a share of its length.

    Empty if the gap is longer than the outline.
    """
    closed = [*corners, corners[0]]
    lengths_m = [distance_m(a, b) for a, b in pairwise(closed)]
    total_m = 0.0
    for length_m in lengths_m:
        total_m += length_m
    if total_m <= gap_m:
        return []
    first_m = (share * total_m + gap_m / 2.0) % total_m
    last_m = first_m + total_m - gap_m
    line = [_along(closed, lengths_m, first_m)]
    at_m = 0.0
    for _ in range(2):
        for corner, length_m in zip(closed, lengths_m, strict=False):
            if first_m + 1e-3 < at_m < last_m - 1e-3:
                line.append(corner)
            at_m += length_m
    return [*line, _along(closed, lengths_m, last_m % total_m)]


def _along(closed: Sequence[Point], lengths_m: Sequence[float], at_m: float) -> Point:
    """Return the point at a distance along a line."""
    for (a, b), length_m in zip(pairwise(closed), lengths_m, strict=True):
        if at_m <= length_m:
            share = at_m / length_m
            return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
        at_m -= length_m
    return closed[-1]


def _spiral(
    pitch_m: float, turns: float, begin: float, hand: int, core_m: float = 0.0
) -> list[Point]:
    """Return a spiral around the origin that grows by a pitch per turn."""
    inner_m = core_m or pitch_m * 0.75
    steps = max(2, round(turns * SPIRAL_STEPS))
    return [
        _polar(inner_m + pitch_m * step / SPIRAL_STEPS, begin + hand * step / SPIRAL_STEPS)
        for step in range(steps + 1)
    ]


def _polar(away_m: float, share: float) -> Point:
    c, s = cos_sin(2.0 * pi * share)
    return away_m * c, away_m * s


def _far_m(line: Sequence[Point]) -> float:
    return max(distance_m((0.0, 0.0), point) for point in line)


CORE: Final = Axis("core_m", 0.05, 0.6)
AISLE: Final = Axis("aisle_m", 0.02, 0.6)
TURNS: Final = Axis("turns", 0.75, 3.5)

NESTED_RINGS: Final = Adversary(
    (
        *(Axis("count", 1, MAX_RINGS, whole=True), Axis("sides", 3, 12, whole=True)),
        *(CORE, AISLE, SEALED, *GATES, *ENCLOSURE_AXES),
    ),
    rings,
)
NESTED_BOXES: Final = Adversary(
    (
        *(Axis("count", 1, MAX_RINGS, whole=True), Axis("longer_m", 0.0, 2.0)),
        *(CORE, AISLE, SEALED, *GATES, *ENCLOSURE_AXES),
    ),
    boxes,
)
DOUBLE_SPIRAL: Final = Adversary(
    (
        *(TURNS, Axis("turns_2", 0.75, 3.5), Axis("begin", 0.0, 1.0), Axis("begin_2", 0.0, 1.0)),
        *(Axis("mirror", 0, 1, whole=True), *ENCLOSURE_AXES),
    ),
    double_spiral,
)
INTERLOCKING_SPIRALS: Final = Adversary(
    (TURNS, Axis("arms", 1, 3, whole=True), Axis("begin", 0.0, 1.0), *ENCLOSURE_AXES),
    interlocking_spirals,
)
ISLAND_ROOM: Final = Adversary(
    (
        *(CORE, AISLE, Axis("longer_m", 0.0, 1.5), SEALED, *GATES[:2]),
        *(Axis("posts", 0, 1, whole=True), Axis("inner_room", 0, 2, whole=True)),
        *(Axis("post", 0.0, 1.0), *ENCLOSURE_AXES),
    ),
    island_room,
)


PASSAGE_AXES: Final = (THICKNESS, TURN, HEADING, ROOM)
LAYOUT: Final = Axis("layout", 0, 999, whole=True)
"""Number of a random layout."""


def comb(values: Values, radius_m: float) -> WorldDraft | None:
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


def hairpin(values: Values, radius_m: float) -> WorldDraft | None:
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


def long_detour(values: Values, radius_m: float) -> WorldDraft | None:
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


def post_lattice(values: Values, radius_m: float) -> WorldDraft | None:
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


def long_maze(values: Values, radius_m: float) -> WorldDraft | None:
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
        *(SWAPPED, EXCESS, *PASSAGE_AXES),
    ),
    comb,
)
HAIRPIN: Final = Adversary(
    (
        *(Axis("lanes", 2, 6, whole=True), Axis("long_m", 1.2, 5.0), Axis("mouth_m", 0.02, 0.6)),
        *(MIRROR, Axis("outside", 0, 2, whole=True), Axis("start", 0.0, 1.0)),
        *(Axis("end", 0.0, 1.0), AWAY, EXCESS, *PASSAGE_AXES),
    ),
    hairpin,
)
LONG_DETOUR: Final = Adversary(
    (
        *(Axis("near_m", 0.05, 0.4), Axis("up_m", 2.0, 8.0), Axis("down_m", 2.0, 8.0)),
        *(Axis("arm_m", 0.5, 5.0), Axis("other", 0.3, 1.5), Axis("return", 0.0, 0.95)),
        *(Axis("hook", 0, 3, whole=True), SWAPPED, *PASSAGE_AXES),
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
        *(Axis("far", 0.7, 1.0), EXCESS, *PASSAGE_AXES),
    ),
    long_maze,
)


MAX_WALLS: Final = 3
LONG_M: Final = 6.0

SCENE_AXES: Final = (THICKNESS, TURN, HEADING, ROOM)
APART: Final = Axis("apart_m", 1.0, 5.0)


def three_walls(values: Values, radius_m: float) -> WorldDraft | None:
    """Make one to three straight walls anywhere between start and goal."""
    frame, apart_m = frame_of(values), values["apart_m"]
    walls: list[Obstacle] = []
    for wall in range(whole(values, "count")):
        along_m = values[f"along_{wall}"] * apart_m
        left_m, half_m = values[f"left_{wall}_m"], values[f"long_{wall}_m"] / 2.0
        tilted = ShapeFrame(
            frame.point(along_m, left_m), frame.angle_rad + values[f"tilt_{wall}_rad"]
        )
        walls.append(tilted.wall(values["thickness_m"], (-half_m, 0.0), (half_m, 0.0)))
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def wedge(values: Values, radius_m: float) -> WorldDraft | None:
    """Make two walls that meet, or nearly so, at an angle open towards the robot or the goal."""
    frame, apart_m = frame_of(values), values["apart_m"]
    tip = values["tip"] * apart_m, values["tip_left_m"]
    back = -1.0 if whole(values, "towards") else 1.0
    half_m, long_m = values["half_m"], values["long_m"]
    gap_m = (2.0 * radius_m + values["excess_m"]) / 2.0 if whole(values, "open") == 0 else 0.0
    left = [
        (tip[0], tip[1] + gap_m),
        (tip[0] + back * long_m, tip[1] + gap_m + half_m),
    ]
    right = [
        (tip[0], tip[1] - gap_m),
        (tip[0] + back * long_m * values["lopsided"], tip[1] - gap_m - half_m),
    ]
    walls = [frame.wall(values["thickness_m"], *line) for line in (left, right)]
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def symmetric_trap(values: Values, radius_m: float) -> WorldDraft | None:
    """Make a U of equal or unequal arms around the robot or in its way, with lips at its mouth."""
    frame, apart_m = frame_of(values), values["apart_m"]
    bottom_m, half_m = values["bottom"] * apart_m, 2.0 * radius_m + values["half_m"]
    left_m, right_m = values["left_m"], values["right_m"]
    lip_m = values["lip"] * max(0.0, half_m - radius_m - values["excess_m"] / 2.0)
    line: list[Point] = [
        (bottom_m - left_m, half_m - lip_m),
        (bottom_m - left_m, half_m),
        (bottom_m, half_m),
        (bottom_m, -half_m),
        (bottom_m - right_m, -half_m),
        (bottom_m - right_m, lip_m - half_m),
    ]
    if lip_m < 0.01:
        line = line[1:-1]
    walls: list[Obstacle] = [frame.wall(values["thickness_m"], *line)]
    if whole(values, "post"):
        walls.append(frame.disc(bottom_m + values["post_m"], values["post_left_m"], 0.1))
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def tight_door(values: Values, radius_m: float) -> WorldDraft | None:
    """Make one or two walls across the way with a door 2 to 5 cm wider than the robot."""
    frame, apart_m, thick_m = frame_of(values), values["apart_m"], values["thickness_m"]
    half_m = radius_m + values["tight_m"] / 2.0 + thick_m / 2.0
    walls: list[Obstacle] = []
    for door in range(whole(values, "doors")):
        along_m = (0.3, 0.7)[door] * apart_m if whole(values, "doors") == 2 else 0.5 * apart_m
        at = ShapeFrame(
            frame.point(along_m, values[f"left_{door}_m"]), frame.angle_rad + values["tilt_rad"]
        )
        for hand in (-1, 1):
            line = [(0.0, hand * half_m), (0.0, hand * (half_m + values["long_m"]))]
            if whole(values, "porch"):
                line.insert(0, (-hand * 0.0 - values["porch_m"], hand * half_m))
            walls.append(at.wall(thick_m, *line))
    return fitted(values, frame.point(0.0, 0.0), frame.point(apart_m, 0.0), walls, radius_m)


def _wall_axes() -> tuple[Axis, ...]:
    made: list[Axis] = []
    for wall in range(MAX_WALLS):
        made += [
            Axis(f"along_{wall}", -0.2, 1.2),
            Axis(f"left_{wall}_m", -1.0, 1.0),
            Axis(f"long_{wall}_m", 0.2, 4.0),
            Axis(f"tilt_{wall}_rad", -1.6, 1.6),
        ]
    return tuple(made)


THREE_WALLS: Final = Adversary(
    (Axis("count", 1, MAX_WALLS, whole=True), APART, *_wall_axes(), *SCENE_AXES), three_walls
)
WEDGE: Final = Adversary(
    (
        *(APART, Axis("tip", 0.1, 1.1), Axis("tip_left_m", -0.6, 0.6), Axis("half_m", 0.1, 1.5)),
        *(Axis("long_m", 0.3, 3.0), Axis("lopsided", 0.1, 1.5), Axis("open", 0, 1, whole=True)),
        *(Axis("towards", 0, 2, whole=True), EXCESS, *SCENE_AXES),
    ),
    wedge,
)
SYMMETRIC_TRAP: Final = Adversary(
    (
        *(APART, Axis("bottom", 0.1, 1.1), Axis("half_m", 0.0, 1.2), Axis("lip", 0.0, 1.0)),
        *(Axis("left_m", 0.2, 3.0), Axis("right_m", 0.2, 3.0), Axis("post", 0, 2, whole=True)),
        *(Axis("post_m", -1.0, 1.0), Axis("post_left_m", -1.0, 1.0), EXCESS, *SCENE_AXES),
    ),
    symmetric_trap,
)
TIGHT_DOOR: Final = Adversary(
    (
        *(APART, Axis("doors", 1, 2, whole=True), Axis("tight_m", 0.02, 0.05)),
        *(Axis("left_0_m", -1.5, 1.5), Axis("left_1_m", -1.5, 1.5), Axis("tilt_rad", -0.8, 0.8)),
        *(Axis("long_m", 0.5, LONG_M), Axis("porch", 0, 2, whole=True)),
        *(Axis("porch_m", 0.05, 0.8), *SCENE_AXES),
    ),
    tight_door,
)
