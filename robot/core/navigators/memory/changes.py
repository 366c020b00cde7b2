"""Count the changes of side on the way to a goal, and end them.

Each change of side may cost the way along a boundary twice. An obstacle that is followed on one
side only is passed as well, so after MAX_CHANGES the last side is kept until the next goal. Small
detours keep theirs earlier, as they gain less by a change than a boundary does.

One integer is the whole state: 0 before the first obstacle, then 1 more than the number of changes,
with the sign of the side that was passed last.
"""

from typing import Final

from robot.core import states

MAX_CHANGES: Final = 6
MAX_DETOUR_CHANGES: Final = 3


def counted(passed: int, side: int) -> int:
    """Return the state after an obstacle is passed on this side."""
    if passed * side > 0:
        return passed
    return side if passed == 0 else side * (1 + abs(passed))


def kept(passed: int, side: int, most: int) -> int:
    """Return the side to take if this one is wanted: the last one after `most` changes."""
    return side if abs(passed) <= most else last(passed)


def are_left(passed: int) -> bool:
    """Return whether the side may still change on the way to this goal."""
    return abs(passed) <= MAX_CHANGES


def last(passed: int) -> int:
    """Return the side that was passed last; the right one before the first obstacle."""
    return states.LEFT if passed > 0 else states.RIGHT
