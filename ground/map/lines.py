"""Which dots of a straight line lie on a canvas, exactly as if all of them had been set."""

from typing import Final

NONE: Final = (0, 0, 0, 0, 0, 1)


def reach(
    a0: int, b0: int, a1: int, b1: int, a_size: int, b_size: int
) -> tuple[int, int, int, int, int, int]:
    """The visible stretch of the line from (a0, b0) to (a1, b1), a1 - a0 >= |b1 - b0|.

    Dot i of it is at a0 + i, b0 + floor((2 i rise + n) / 2 n) with n = a1 - a0. Returned are the
    first a and b that lie in 0 .. size - 1, the error there, how many dots follow on the canvas,
    and what the error grows by with each and is full at: b steps when it leaves 0 .. full - 1.
    """
    n, rise = a1 - a0, b1 - b0
    if n == 0:
        inside = 0 <= a0 < a_size and 0 <= b0 < b_size
        return (a0, b0, 0, 1, 0, 1) if inside else NONE
    low, high = max(0, -a0), min(n, a_size - 1 - a0)
    below, above = -(2 * b0 + 1) * n, (2 * (b_size - b0) - 1) * n - 1
    if rise > 0:
        low, high = max(low, -(-below // (2 * rise))), min(high, above // (2 * rise))
    elif rise < 0:
        low, high = max(low, -(above // (-2 * rise))), min(high, -below // (-2 * rise))
    elif not 0 <= b0 < b_size:
        return NONE
    if low > high:
        return NONE
    steps, error = divmod(2 * low * rise + n, 2 * n)
    return a0 + low, b0 + steps, error, high - low + 1, 2 * rise, 2 * n
