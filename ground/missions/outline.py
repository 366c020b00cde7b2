"""Check the corners of a fence: at least three, distinct, without crossing sides."""

from collections.abc import Sequence
from itertools import combinations

Point = tuple[float, float]
CLOSEST_M = 0.001
MAX_CORNERS = 200
"""Limit, because each side is compared with each other one; robots accept fewer."""


def fault_of(corners: Sequence[Point]) -> str:
    """Return what is wrong with an outline, or an empty text."""
    if len(corners) < 3:
        return f"has {len(corners)} corners, a fence needs at least 3"
    if len(corners) > MAX_CORNERS:
        return f"has {len(corners)} corners, at most {MAX_CORNERS} are allowed"
    for index, (a, b) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        if abs(a[0] - b[0]) < CLOSEST_M and abs(a[1] - b[1]) < CLOSEST_M:
            return f"corner {index} and the next one are the same place"
    sides = [(corners[at], corners[(at + 1) % len(corners)]) for at in range(len(corners))]
    for (i, one), (j, other) in combinations(enumerate(sides), 2):
        neighbours = j - i in (1, len(sides) - 1)
        if not neighbours and _cross(*one, *other):
            return f"side {i} and side {j} cross"
    return "" if _area(corners) else "encloses nothing"


def _cross(a: Point, b: Point, c: Point, d: Point) -> bool:
    return _turn(a, b, c) != _turn(a, b, d) and _turn(c, d, a) != _turn(c, d, b)


def _turn(a: Point, b: Point, c: Point) -> int:
    """Return 1 when a, b, c turn left, -1 right, 0 when they are in line."""
    product = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return (product > 0) - (product < 0)


def _area(corners: Sequence[Point]) -> float:
    """Return twice the area."""
    shifted = [*corners[1:], corners[0]]
    return abs(sum(a[0] * b[1] - b[0] * a[1] for a, b in zip(corners, shifted, strict=True)))


def inside(corners: Sequence[Point], place: Point) -> bool:
    """Return whether a point lies in an outline; on a side, either result is possible."""
    x, y = place
    within = False
    for a, b in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (a[1] > y) != (b[1] > y) and x < a[0] + (y - a[1]) * (b[0] - a[0]) / (b[1] - a[1]):
            within = not within
    return within
