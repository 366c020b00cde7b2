"""Enclosures in enclosures: rings and boxes with offset gates, spirals, and islands in rooms."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from math import pi
from typing import Final, TypeAlias

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
from plant.corpus.draft import Draft, Frame
from plant.model.geometry import distance_m
from plant.model.types import Obstacle, Point
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

COMMON: Final = (THICKNESS, TURN, HEADING, ROOM, EXCESS, INWARD, *OUTSIDE)
SPIRAL_STEPS: Final = 8
"""Straight walls of a round spiral per turn."""


def rings(values: Values, radius_m: float) -> Draft | None:
    """Make rings of three to twelve sides around the goal, each with one gate."""
    sides = whole(values, "sides")

    def outline(ring_m: float) -> list[Point]:
        """Return the corners of a regular polygon."""
        return [_polar(ring_m, side / sides) for side in range(sides)]

    return _nested(values, radius_m, outline)


def boxes(values: Values, radius_m: float) -> Draft | None:
    """Make boxes around the goal, each with one gate."""
    longer_m = values["longer_m"]

    def outline(half_m: float) -> list[Point]:
        """Return the corners of a box."""
        far_m = half_m + longer_m
        return [(-half_m, -half_m), (far_m, -half_m), (far_m, half_m), (-half_m, half_m)]

    return _nested(values, radius_m, outline)


def _nested(values: Values, radius_m: float, outline: Outline) -> Draft | None:
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


def double_spiral(values: Values, radius_m: float) -> Draft | None:
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


def interlocking_spirals(values: Values, radius_m: float) -> Draft | None:
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


def island_room(values: Values, radius_m: float) -> Draft | None:
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
    values: Values, radius_m: float, frame: Frame, lines: Sequence[Sequence[Point]]
) -> Draft | None:
    """Return the draft with one end at the origin and the other outside."""
    walls = [frame.wall(values["thickness_m"], *line) for line in lines]
    return _ends_outside(values, radius_m, frame, walls, max(map(_far_m, lines)))


def _ends_outside(
    values: Values, radius_m: float, frame: Frame, walls: Sequence[Obstacle], far_m: float
) -> Draft | None:
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
        *(CORE, AISLE, SEALED, *GATES, *COMMON),
    ),
    rings,
)
NESTED_BOXES: Final = Adversary(
    (
        *(Axis("count", 1, MAX_RINGS, whole=True), Axis("longer_m", 0.0, 2.0)),
        *(CORE, AISLE, SEALED, *GATES, *COMMON),
    ),
    boxes,
)
DOUBLE_SPIRAL: Final = Adversary(
    (
        *(TURNS, Axis("turns_2", 0.75, 3.5), Axis("begin", 0.0, 1.0), Axis("begin_2", 0.0, 1.0)),
        *(Axis("mirror", 0, 1, whole=True), *COMMON),
    ),
    double_spiral,
)
INTERLOCKING_SPIRALS: Final = Adversary(
    (TURNS, Axis("arms", 1, 3, whole=True), Axis("begin", 0.0, 1.0), *COMMON),
    interlocking_spirals,
)
ISLAND_ROOM: Final = Adversary(
    (
        *(CORE, AISLE, Axis("longer_m", 0.0, 1.5), SEALED, *GATES[:2]),
        *(Axis("posts", 0, 1, whole=True), Axis("inner_room", 0, 2, whole=True)),
        *(Axis("post", 0.0, 1.0), *COMMON),
    ),
    island_room,
)
