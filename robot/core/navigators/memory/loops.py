"""Detect loops: hits are stored by place, the way by points along it.

A loop is the same places in the same order and direction; the place alone would confuse the two
sides of a corridor. Integers: centimetres, and brads (4096 to the circle).
"""

from typing import Final

from robot.core.perception.echoes import CIRCLE

HITS: Final = 16
HIT_CM: Final = 35
CRUMBS: Final = 96
SPACING_CM: Final = 25
LEAST_AWAY: Final = 5
"""Minimum number of points between a place and its second visit."""
STRAIGHT: Final = 97  # percent of the way that the ends of a straight one are apart
IN_A_ROW: Final = 3
STEPS: Final = 16
"""Headings of points are stored as bytes, 256 to the circle: this many brads each."""
SAME: Final = 35  # of 256: 50 degrees


class Loops:
    """A ring buffer of hits, and the points of the way since the last hit.

    A hit has a place and a side, a point a place and a heading. Every second point is removed when
    the memory is full. `first` is the start of the loop that closed.
    """

    __slots__ = (
        "count",
        "first",
        "heading",
        "hit_side",
        "hit_x_cm",
        "hit_y_cm",
        "hits",
        "matches",
        "spacing_cm",
        "x_cm",
        "y_cm",
    )

    def __init__(self) -> None:
        self.hit_x_cm = [0] * HITS
        self.hit_y_cm = [0] * HITS
        self.hit_side = [0] * HITS
        self.hits = 0
        self.x_cm = [0] * CRUMBS
        self.y_cm = [0] * CRUMBS
        self.heading = bytearray(CRUMBS)
        self.count = self.matches = self.first = 0
        self.spacing_cm = SPACING_CM


def restart(loops: Loops) -> None:
    """Forget the way."""
    loops.count = loops.matches = 0
    loops.spacing_cm = SPACING_CM


def walked_cm(loops: Loops) -> int:
    """Return the approximate length of the way since `restart`."""
    return loops.count * loops.spacing_cm


def is_straight(loops: Loops) -> bool:
    """Return whether the way since `restart` is a straight line."""
    last = loops.count - 1
    if last < 1:
        return False
    dx_cm, dy_cm = loops.x_cm[last] - loops.x_cm[0], loops.y_cm[last] - loops.y_cm[0]
    way_cm = last * loops.spacing_cm * STRAIGHT // 100
    return dx_cm * dx_cm + dy_cm * dy_cm >= way_cm * way_cm


def side_at(loops: Loops, x_cm: int, y_cm: int, side: int) -> int:
    """Return `side`, or the other one if the last hit at this place was passed there."""
    for k in range(loops.hits - 1, max(loops.hits - HITS, 0) - 1, -1):
        i = k % HITS
        if is_near(loops.hit_x_cm[i] - x_cm, loops.hit_y_cm[i] - y_cm, HIT_CM):
            return -loops.hit_side[i]
    return side


def remember(loops: Loops, x_cm: int, y_cm: int, side: int) -> None:
    """Store a hit passed on this side, and restart the way."""
    i = loops.hits % HITS
    loops.hit_x_cm[i], loops.hit_y_cm[i], loops.hit_side[i] = x_cm, y_cm, side
    loops.hits += 1
    restart(loops)


def is_near(dx_cm: int, dy_cm: int, least_cm: int) -> bool:
    """Return whether an offset is shorter than a distance."""
    return dx_cm * dx_cm + dy_cm * dy_cm < least_cm * least_cm


def drop(loops: Loops, x_cm: int, y_cm: int, heading: int) -> bool:
    """Store a point at each spacing; return whether the way has closed upon itself."""
    n = loops.count
    if n and is_near(loops.x_cm[n - 1] - x_cm, loops.y_cm[n - 1] - y_cm, loops.spacing_cm):
        return False
    heading = heading % CIRCLE // STEPS
    again = visited(loops, x_cm, y_cm, heading)
    loops.matches = loops.matches + 1 if again >= 0 else 0
    if again >= 0:
        loops.first = again
    if n == CRUMBS:
        thin(loops)
        n = loops.count
    loops.x_cm[n], loops.y_cm[n], loops.heading[n] = x_cm, y_cm, heading
    loops.count = n + 1
    return loops.matches >= IN_A_ROW


def visited(loops: Loops, x_cm: int, y_cm: int, heading: int) -> int:
    """Return the oldest point at this place and heading, without the newest few; -1 if none."""
    same_cm = loops.spacing_cm if loops.spacing_cm == SPACING_CM else loops.spacing_cm * 6 // 10 + 5
    xs, ys = loops.x_cm, loops.y_cm
    for k in range(loops.count - LEAST_AWAY):
        if -same_cm < xs[k] - x_cm < same_cm and -same_cm < ys[k] - y_cm < same_cm:
            off = (loops.heading[k] - heading + 128) % 256 - 128
            if -SAME < off < SAME and is_near(xs[k] - x_cm, ys[k] - y_cm, same_cm):
                return k
    return -1


def thin(loops: Loops) -> None:
    """Keep every second point, and double the spacing."""
    loops.count = CRUMBS // 2
    for k in range(loops.count):
        loops.x_cm[k] = loops.x_cm[2 * k]
        loops.y_cm[k] = loops.y_cm[2 * k]
        loops.heading[k] = loops.heading[2 * k]
    loops.first //= 2
    loops.matches = 0
    loops.spacing_cm *= 2


def turns_left(loops: Loops) -> bool:
    """Return whether the closed loop runs counter-clockwise, by the sign of its area."""
    xs, ys, n = loops.x_cm, loops.y_cm, loops.count
    x_cm, y_cm = xs[loops.first], ys[loops.first]
    twice = 0
    for k in range(loops.first, n):
        j = k + 1 if k + 1 < n else loops.first
        twice += (xs[k] - x_cm) * (ys[j] - y_cm) - (xs[j] - x_cm) * (ys[k] - y_cm)
    return twice > 0


def encloses(loops: Loops, x_cm: int, y_cm: int) -> bool:
    """Return whether a place lies within the closed loop.

    A ray in the direction of +x crosses such a loop an odd number of times.
    """
    xs, ys, n = loops.x_cm, loops.y_cm, loops.count
    inside = False
    for k in range(loops.first, n):
        j = k + 1 if k + 1 < n else loops.first
        y1, y2 = ys[k] - y_cm, ys[j] - y_cm
        if (y1 > 0) != (y2 > 0):
            x1, x2 = xs[k] - x_cm, xs[j] - x_cm
            if (x1 + (x2 - x1) * y1 // (y1 - y2)) > 0:
                inside = not inside
    return inside
