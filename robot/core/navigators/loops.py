"""Detect loops on the way to a goal, and end changes of side that repeat.

A loop is the same places in the same order and direction; the place alone would confuse the two
sides of a corridor. Hits are stored by place, the path by points along it, as integers:
centimetres, and brads (4096 to the circle).

Each change of side may cost the way along a boundary twice. An obstacle that is followed on one
side only is passed as well, so after MAX_CHANGES the last side is kept until the next goal. Small
detours keep theirs earlier, as they gain less by a change than a boundary does. One integer is the
whole state of this: 0 before the first obstacle, then 1 more than the number of changes, with the
sign of the side that was passed last.
"""

from typing import Final

from robot.core import states
from robot.core.perception.echoes import CIRCLE

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


HITS: Final = 8
HIT_CM: Final = 35
CRUMBS: Final = 52
SPACING_CM: Final = 25
MIN_AWAY: Final = 5
"""Minimum number of points between a place and its second visit."""
STRAIGHT: Final = 97  # percent of its length that the ends of a straight path are apart
IN_A_ROW: Final = 3
STEPS: Final = 16
"""Headings of points are stored as bytes, 256 to the circle: this many brads each."""
SAME: Final = 35  # of 256: 50 degrees
BIAS: Final = 16384
SHIFT: Final = 15
"""A place is one integer, which the board stores without a box: x and y in cm, plus BIAS."""
LOW: Final = 32767


class Loops:
    """A ring buffer of hits, and the points of the path since the last hit.

    A hit has a place and a side (1 left, 0 right), a point a place and a heading. Every second
    point is removed when the memory is full. `first` is the start of the loop that closed.
    """

    __slots__ = (
        "count",
        "first",
        "heading",
        "hit_place",
        "hit_side",
        "hits",
        "matches",
        "place",
        "spacing_cm",
    )

    def __init__(self) -> None:
        self.hit_place = [0] * HITS
        self.hit_side = bytearray(HITS)
        self.hits = 0
        self.place = [0] * CRUMBS
        self.heading = bytearray(CRUMBS)
        self.count = self.matches = self.first = 0
        self.spacing_cm = SPACING_CM


def packed(x_cm: int, y_cm: int) -> int:
    """Return a place as one integer; beyond 160 m it is that of the limit."""
    x_cm, y_cm = x_cm + BIAS, y_cm + BIAS
    x_cm = 0 if x_cm < 0 else LOW if x_cm > LOW else x_cm
    y_cm = 0 if y_cm < 0 else LOW if y_cm > LOW else y_cm
    return x_cm << SHIFT | y_cm


def x_of(place: int) -> int:
    """Return the x of a place in cm."""
    return (place >> SHIFT) - BIAS


def y_of(place: int) -> int:
    """Return the y of a place in cm."""
    return (place & LOW) - BIAS


def restart(loops: Loops) -> None:
    """Forget the path."""
    loops.count = loops.matches = 0
    loops.spacing_cm = SPACING_CM


def walked_cm(loops: Loops) -> int:
    """Return the approximate length of the path since `restart`."""
    return loops.count * loops.spacing_cm


def is_straight(loops: Loops) -> bool:
    """Return whether the path since `restart` is a straight line."""
    last = loops.count - 1
    if last < 1:
        return False
    first, here = loops.place[0], loops.place[last]
    dx_cm, dy_cm = x_of(here) - x_of(first), y_of(here) - y_of(first)
    way_cm = last * loops.spacing_cm * STRAIGHT // 100
    return dx_cm * dx_cm + dy_cm * dy_cm >= way_cm * way_cm


def side_at(loops: Loops, x_cm: int, y_cm: int, side: int) -> int:
    """Return `side`, or the other one if the last hit at this place was passed there."""
    for k in range(loops.hits - 1, max(loops.hits - HITS, 0) - 1, -1):
        i = k % HITS
        place = loops.hit_place[i]
        if is_near(x_of(place) - x_cm, y_of(place) - y_cm, HIT_CM):
            return states.RIGHT if loops.hit_side[i] else states.LEFT
    return side


def remember(loops: Loops, x_cm: int, y_cm: int, side: int) -> None:
    """Store a hit passed on this side, and restart the path."""
    i = loops.hits % HITS
    loops.hit_place[i], loops.hit_side[i] = packed(x_cm, y_cm), side == states.LEFT
    loops.hits += 1
    restart(loops)


def is_near(dx_cm: int, dy_cm: int, least_cm: int) -> bool:
    """Return whether an offset is shorter than a distance."""
    return dx_cm * dx_cm + dy_cm * dy_cm < least_cm * least_cm


def drop(loops: Loops, x_cm: int, y_cm: int, heading: int) -> bool:
    """Store a point at each spacing; return whether the path is a closed loop."""
    n = loops.count
    if n:
        last = loops.place[n - 1]
        if is_near(x_of(last) - x_cm, y_of(last) - y_cm, loops.spacing_cm):
            return False
    heading = heading % CIRCLE // STEPS
    again = visited(loops, x_cm, y_cm, heading)
    loops.matches = loops.matches + 1 if again >= 0 else 0
    if again >= 0:
        loops.first = again
    if n == CRUMBS:
        thin(loops)
        n = loops.count
    loops.place[n], loops.heading[n] = packed(x_cm, y_cm), heading
    loops.count = n + 1
    return loops.matches >= IN_A_ROW


def visited(loops: Loops, x_cm: int, y_cm: int, heading: int) -> int:
    """Return the oldest point at this place and heading, without the newest few; -1 if none."""
    same_cm = loops.spacing_cm if loops.spacing_cm == SPACING_CM else loops.spacing_cm * 6 // 10 + 5
    places, x_cm, y_cm = loops.place, x_cm + BIAS, y_cm + BIAS
    for k in range(loops.count - MIN_AWAY):
        dx_cm, dy_cm = (places[k] >> SHIFT) - x_cm, (places[k] & LOW) - y_cm
        if -same_cm < dx_cm < same_cm and -same_cm < dy_cm < same_cm:
            off = (loops.heading[k] - heading + 128) % 256 - 128
            if -SAME < off < SAME and is_near(dx_cm, dy_cm, same_cm):
                return k
    return -1


def thin(loops: Loops) -> None:
    """Keep every second point, and double the spacing."""
    loops.count = CRUMBS // 2
    for k in range(loops.count):
        loops.place[k] = loops.place[2 * k]
        loops.heading[k] = loops.heading[2 * k]
    loops.first //= 2
    loops.matches = 0
    loops.spacing_cm *= 2


def turns_left(loops: Loops) -> bool:
    """Return whether the closed loop runs counter-clockwise, by the sign of its area."""
    places, n = loops.place, loops.count
    x_cm, y_cm = x_of(places[loops.first]), y_of(places[loops.first])
    twice = 0
    for k in range(loops.first, n):
        here, there = places[k], places[k + 1 if k + 1 < n else loops.first]
        twice += (x_of(here) - x_cm) * (y_of(there) - y_cm)
        twice -= (x_of(there) - x_cm) * (y_of(here) - y_cm)
    return twice > 0


def encloses(loops: Loops, x_cm: int, y_cm: int) -> bool:
    """Return whether a place lies within the closed loop.

    A ray in the direction of +x crosses such a loop an odd number of times.
    """
    places, n = loops.place, loops.count
    inside = False
    for k in range(loops.first, n):
        here, there = places[k], places[k + 1 if k + 1 < n else loops.first]
        y1, y2 = y_of(here) - y_cm, y_of(there) - y_cm
        if (y1 > 0) != (y2 > 0):
            x1, x2 = x_of(here) - x_cm, x_of(there) - x_cm
            if (x1 + (x2 - x1) * y1 // (y1 - y2)) > 0:
                inside = not inside
    return inside
