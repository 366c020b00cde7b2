"""The fence: a circle or a simple polygon to stay inside, with others to stay out of."""

from typing import Final, NamedTuple

from robot.core import reasons

MIN_CORNERS: Final = 3
MAX_CORNERS: Final = 16
MIN_RADIUS_M: Final = 0.1
MAX_COORDINATE_M: Final = 100_000.0

Fence = NamedTuple(
    "Fence", [("xs_m", "tuple[float, ...]"), ("ys_m", "tuple[float, ...]"), ("radius_m", float)]
)
"""The corners of a polygon in order, or the centre of a circle with a radius above 0."""


def allows(fence: Fence, exclusions: "tuple[Fence, ...]", x_m: float, y_m: float) -> bool:
    """Return whether a point is inside the fence, and in or on the border of no exclusion."""
    for one in exclusions:
        if inside(one, x_m, y_m):
            return False
    return inside(fence, x_m, y_m)


def inside(fence: Fence, x_m: float, y_m: float) -> bool:
    """Return whether a point is inside or on the border; NaN and infinity are outside.

    A ray from the point to the right crosses the sides of a polygon an odd number of times.
    """
    if x_m - x_m != 0.0 or y_m - y_m != 0.0:
        return False
    xs_m, ys_m, radius_m = fence
    to_x_m, to_y_m = xs_m[-1], ys_m[-1]
    if radius_m > 0.0:
        to_x_m, to_y_m = to_x_m - x_m, to_y_m - y_m
        return to_x_m * to_x_m + to_y_m * to_y_m <= radius_m * radius_m
    within, below = False, to_y_m < y_m
    for i in range(len(xs_m)):
        from_x_m, from_y_m, was_below = to_x_m, to_y_m, below
        to_x_m, to_y_m = xs_m[i], ys_m[i]
        below = to_y_m < y_m
        if (below and was_below) or (to_y_m > y_m and from_y_m > y_m):
            continue
        if to_x_m < x_m and from_x_m < x_m:
            continue
        if to_x_m > x_m and from_x_m > x_m:
            if below != was_below:
                within = not within
            continue
        # above 0: the point is left of this side
        left = (from_x_m - x_m) * (to_y_m - y_m) - (to_x_m - x_m) * (from_y_m - y_m)
        if left == 0.0 and between(from_x_m, x_m, to_x_m) and between(from_y_m, y_m, to_y_m):
            return True
        if below != was_below and (left > 0.0) == was_below:
            within = not within
    return within


def refusal_of(fence: Fence) -> int:
    """Return why this is no valid fence, or 0; NaN fails every comparison."""
    corners = len(fence.xs_m)
    for k in range(corners):
        x_m, y_m = fence.xs_m[k], fence.ys_m[k]
        if not (
            -MAX_COORDINATE_M <= x_m <= MAX_COORDINATE_M
            and -MAX_COORDINATE_M <= y_m <= MAX_COORDINATE_M
        ):
            return reasons.FENCE_NOT_SIMPLE
    if fence.radius_m != 0.0:
        circle = corners == 1 and MIN_RADIUS_M <= fence.radius_m <= MAX_COORDINATE_M
        return reasons.OK if circle else reasons.FENCE_NOT_SIMPLE
    if not MIN_CORNERS <= corners <= MAX_CORNERS:
        return reasons.FENCE_NOT_SIMPLE
    for i in range(corners):
        if folds(fence, i):
            return reasons.FENCE_NOT_SIMPLE
        for j in range(i + 2, corners):
            if (i > 0 or j < corners - 1) and touch(fence, i, j):
                return reasons.FENCE_NOT_SIMPLE
    return reasons.OK


def folds(fence: Fence, i: int) -> bool:
    """Return whether the side from corner i reverses the one before, or either has no length."""
    xs_m, ys_m = fence.xs_m, fence.ys_m
    after = (i + 1) % len(xs_m)
    in_x_m, in_y_m = xs_m[i] - xs_m[i - 1], ys_m[i] - ys_m[i - 1]
    out_x_m, out_y_m = xs_m[after] - xs_m[i], ys_m[after] - ys_m[i]
    straight = in_x_m * out_y_m == in_y_m * out_x_m
    return straight and in_x_m * out_x_m + in_y_m * out_y_m <= 0.0


def touch(fence: Fence, i: int, j: int) -> bool:
    """Return whether the sides from corners i and j, with no common corner, cross or touch."""
    after_i, after_j = (i + 1) % len(fence.xs_m), (j + 1) % len(fence.xs_m)
    starts, ends = side(fence, j, after_j, i), side(fence, j, after_j, after_i)
    meets, parts = side(fence, i, after_i, j), side(fence, i, after_i, after_j)
    if (
        (starts == 0.0 and spans(fence, j, after_j, i))
        or (ends == 0.0 and spans(fence, j, after_j, after_i))
        or (meets == 0.0 and spans(fence, i, after_i, j))
        or (parts == 0.0 and spans(fence, i, after_i, after_j))
    ):
        return True
    return (starts > 0.0) != (ends > 0.0) and (meets > 0.0) != (parts > 0.0)


def side(fence: Fence, a: int, b: int, c: int) -> float:
    """Return a value above 0 if corner c is left of the line from a to b, and 0 on it."""
    xs_m, ys_m = fence.xs_m, fence.ys_m
    return (xs_m[b] - xs_m[a]) * (ys_m[c] - ys_m[a]) - (xs_m[c] - xs_m[a]) * (ys_m[b] - ys_m[a])


def spans(fence: Fence, a: int, b: int, c: int) -> bool:
    """Return whether corner c, on the line through a and b, lies between them."""
    xs_m, ys_m = fence.xs_m, fence.ys_m
    return between(xs_m[a], xs_m[c], xs_m[b]) and between(ys_m[a], ys_m[c], ys_m[b])


def between(one: float, value: float, other: float) -> bool:
    """Return whether a value lies between two others."""
    return one <= value <= other or other <= value <= one
