"""A chain of echoes along a boundary, through which the robot cannot pass.

An echo at some range shows that a surface touches the arc of its cone at that distance, but not
where. Two arcs are linked if every point of one is nearer to every point of the other than the
robot is wide: wherever the two surfaces touch their arcs, the robot does not fit between them. An
arc is stored by its two ends. The ends are enough for the comparison: an arc of one cone is short
against its radius, so the two points that are farthest apart are ends.

Integers: millimetres in the odometry frame.
"""

from math import pi
from typing import Final, NamedTuple

from robot.core import states
from robot.core.geometry import whole_cos_sin, wrap
from robot.core.perception.echoes import NOTHING
from robot.core.perception.sonar_ring import Ring
from robot.core.values import EVERY, SONARS, Pose
from runtime.elementary import cos, sin

TAIL: Final = SONARS
LEAD: Final = SONARS + 1
START: Final = SONARS + 2
"""Indices of the two ends of the chain and of its first arc, after the arcs of the newest scan.

Of the linked arcs of a scan, TAIL is the one nearest to the followed flank and LEAD the last one in
the direction of following. While the robot turns in a corner, LEAD is already past the corner.
"""
ARCS: Final = SONARS + 3
EACH: Final = tuple(range(ARCS))
REACH_M: Final = 0.40  # arcs of farther echoes are too long for a link
JUMP_MM: Final = 50
"""An echo counts if it agrees this well with one of the last scan.

A false one that differs by less cannot bridge a gap that the robot enters.
"""
BEHIND_MM: Final = 400  # LEAD is taken back to the scan once the robot has left it this far
SLACK_MM: Final = 10  # for errors of range and odometry
EDGES: Final = tuple(
    [
        (int(1024 * cos(b)), int(1024 * sin(b)))
        for b in [(k - 4) * pi / 8.0 for k in range(SONARS + 1)]
    ]
)
"""Directions of the edges of the cones in the robot's frame, scaled to 1024."""
NEIGHBOURS: Final = 0x1B
"""Bits of the neighbours of arc i, shifted so that i is bit 2."""
FROM_RIGHT: Final = EVERY
FROM_LEFT: Final = tuple(range(SONARS - 1, -1, -1))
FOLLOWED_RIGHT: Final = 0x1F
FOLLOWED_LEFT: Final = 0xF8
"""Bits of the sonars ahead and at the followed flank."""


Found = NamedTuple(
    "Found",
    [
        ("ahead", int),
        ("beside", int),
        ("tail_joint", int),
        ("tail", int),
        ("lead_joint", int),
        ("lead", int),
    ],
)
"""How the chain has reached arcs of a scan; `ahead` from LEAD, `beside` from TAIL, as bits.

`tail` is the arc that became TAIL. `lead` is the arc that became LEAD, or NOTHING if LEAD stays.
`tail_joint` and `lead_joint` are the arcs of the scan that are linked to the old end and from which
the chain leads on to `tail` and `lead`. If `lead` was reached only from TAIL, `lead_joint` is
`tail`.
"""


class Chain:
    """The ends of the arcs of the newest scan, of both ends of the chain, and of its first arc.

    `x_mm` and `y_mm` are the right end of each arc, seen from the robot, `left_*` the left one.
    `range_mm` and `before_mm` are the ranges of this and of the last scan, or NOTHING, with a
    NOTHING before and after them. `seen` has a bit for each usable arc.
    """

    __slots__ = ("before_mm", "left_x_mm", "left_y_mm", "range_mm", "seen", "x_mm", "y_mm")

    def __init__(self) -> None:
        self.x_mm, self.y_mm = [0] * ARCS, [0] * ARCS
        self.left_x_mm, self.left_y_mm = [0] * ARCS, [0] * ARCS
        self.range_mm, self.before_mm = [NOTHING] * (SONARS + 2), [NOTHING] * (SONARS + 2)
        self.seen = 0


def look(chain: Chain, ring: Ring, before: Pose, pose: Pose, radius_mm: int) -> None:
    """Compute the arcs of a scan.

    The odd sonars were pinged now, the even ones halfway from the pose `before`, one tick ago.
    """
    chain.before_mm, chain.range_mm = chain.range_mm, chain.before_mm
    chain.seen = 0
    look_from(chain, 1, ring, pose, radius_mm)
    turned_rad = wrap(pose.heading_rad - before.heading_rad)
    x_m, y_m = 0.5 * (pose.x_m + before.x_m), 0.5 * (pose.y_m + before.y_m)
    halfway = Pose(x_m, y_m, pose.heading_rad - 0.5 * turned_rad)
    look_from(chain, 0, ring, halfway, radius_mm)


def look_from(chain: Chain, first: int, ring: Ring, pose: Pose, radius_mm: int) -> None:
    """Compute the arcs of every second sonar, pinged at this pose.

    An echo counts if this sonar or one beside it had a similar one in the last scan, so that no
    single false echo makes a link.
    """
    cosine, sine = whole_cos_sin(pose.heading_rad)
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    ranges_m, before_mm, ranges_mm = ring.range_m, chain.before_mm, chain.range_mm
    for i in range(first, SONARS, 2):
        range_m = ranges_m[i]
        if range_m is None or range_m >= REACH_M:
            ranges_mm[i + 1] = NOTHING
            continue
        range_mm = int(1000.0 * range_m)
        ranges_mm[i + 1] = range_mm
        if not is_confirmed(before_mm, i, range_mm):
            continue
        chain.seen |= 1 << i
        away_mm = range_mm + radius_mm
        ahead, aside = EDGES[i]
        chain.x_mm[i] = x_mm + (away_mm * (cosine * ahead - sine * aside >> 10) >> 10)
        chain.y_mm[i] = y_mm + (away_mm * (sine * ahead + cosine * aside >> 10) >> 10)
        ahead, aside = EDGES[i + 1]
        chain.left_x_mm[i] = x_mm + (away_mm * (cosine * ahead - sine * aside >> 10) >> 10)
        chain.left_y_mm[i] = y_mm + (away_mm * (sine * ahead + cosine * aside >> 10) >> 10)


def is_confirmed(before_mm: "list[int]", sonar: int, range_mm: int) -> bool:
    """Return whether this sonar or one beside it had a similar range in the last scan."""
    least_mm, most_mm = range_mm - JUMP_MM, range_mm + JUMP_MM
    if least_mm < NOTHING:
        least_mm = NOTHING
    return (
        least_mm < before_mm[sonar + 1] < most_mm
        or least_mm < before_mm[sonar] < most_mm
        or least_mm < before_mm[sonar + 2] < most_mm
    )


def begin(chain: Chain, side: int) -> bool:
    """Begin the chain at the followed flank; return False if there is no echo."""
    for i in FROM_RIGHT if side == states.LEFT else FROM_LEFT:
        if chain.seen >> i & 1:
            take(chain, TAIL, i)
            take(chain, LEAD, i)
            take(chain, START, i)
            return True
    return False


def extend(chain: Chain, x_mm: int, y_mm: int, side: int, width_mm: int) -> Found | None:
    """Continue the chain over the linked arcs of the scan; return None if it stays where it is.

    It stays where no linked arc is ahead or at the followed flank: behind a gap, the other flank
    would lead back. LEAD stays while no arc is linked to it, unless the robot at `x_mm` and `y_mm`
    is farther from it than BEHIND_MM. `width_mm` is that of the robot, less the errors.
    """
    width_mm2 = width_mm * width_mm
    from_lead = linked(chain, LEAD, chain.seen, width_mm2)
    ahead = spread(chain, from_lead, chain.seen, width_mm2)
    rest = chain.seen & ~ahead
    from_tail = linked(chain, TAIL, rest, width_mm2)
    reached = ahead | spread(chain, from_tail, rest, width_mm2)
    if reached & (FOLLOWED_RIGHT if side == states.LEFT else FOLLOWED_LEFT) == 0:
        return None
    tail = lead = NOTHING
    for i in FROM_RIGHT if side == states.LEFT else FROM_LEFT:
        if reached >> i & 1:
            tail = i if tail == NOTHING else tail
            lead = i
    tail_joint = nearest(from_lead if ahead >> tail & 1 else from_tail, tail)
    lead_joint = nearest(from_lead, lead) if ahead >> lead & 1 else tail
    take(chain, TAIL, tail)
    dx_mm, dy_mm = chain.x_mm[LEAD] - x_mm, chain.y_mm[LEAD] - y_mm
    is_behind = dx_mm * dx_mm + dy_mm * dy_mm > BEHIND_MM * BEHIND_MM
    if is_behind or (ahead and is_ahead(chain, lead, x_mm, y_mm, side)):
        take(chain, LEAD, lead)
    else:
        lead = NOTHING
    return Found(ahead, reached & ~ahead, tail_joint, tail, lead_joint, lead)


def nearest(arcs: int, i: int) -> int:
    """Return the one of some arcs that is the fewest cones away from arc i."""
    for far in EVERY:
        if arcs << far >> i & 1:
            return i - far
        if arcs >> i + far & 1:
            return i + far
    return i


def width_mm(radius_mm: int) -> int:
    """Return the width of the robot, less the errors of range and odometry."""
    return 2 * radius_mm - SLACK_MM


def is_ahead(chain: Chain, i: int, x_mm: int, y_mm: int, side: int) -> bool:
    """Return whether the rear end of an arc is ahead of that of LEAD, seen from the robot."""
    xs_mm, ys_mm = chain.x_mm, chain.y_mm
    if side != states.LEFT:
        xs_mm, ys_mm = chain.left_x_mm, chain.left_y_mm
    across = (xs_mm[LEAD] - x_mm) * (ys_mm[i] - y_mm) - (ys_mm[LEAD] - y_mm) * (xs_mm[i] - x_mm)
    return across * side > 0


def meets_start(chain: Chain, radius_mm: int) -> bool:
    """Return whether an end of the chain is linked to its first arc."""
    least_mm = width_mm(radius_mm)
    width_mm2 = least_mm * least_mm
    return is_linked(chain, TAIL, START, width_mm2) or is_linked(chain, LEAD, START, width_mm2)


def is_linked(chain: Chain, i: int, k: int, width_mm2: int) -> bool:
    """Return whether the robot does not fit between the surfaces of two arcs."""
    return linked(chain, i, 1 << k, width_mm2) != 0


def linked(chain: Chain, i: int, arcs: int, width_mm2: int) -> int:
    """Return those of some arcs between whose surfaces and that of arc i the robot does not fit.

    A bit of `arcs` and of the result stands for an arc or an end of the chain.
    """
    found = 0
    if arcs == 0:
        return found
    xs, ys, left_xs, left_ys = chain.x_mm, chain.y_mm, chain.left_x_mm, chain.left_y_mm
    x1, y1, x2, y2 = xs[i], ys[i], left_xs[i], left_ys[i]
    for k in EACH:
        rest = arcs >> k
        if rest == 0:
            break
        if rest & 1 == 0:
            continue
        x3, y3 = xs[k], ys[k]
        dx_mm, dy_mm = x1 - x3, y1 - y3
        if dx_mm * dx_mm + dy_mm * dy_mm >= width_mm2:
            continue
        dx_mm, dy_mm = x2 - x3, y2 - y3
        if dx_mm * dx_mm + dy_mm * dy_mm >= width_mm2:
            continue
        x3, y3 = left_xs[k], left_ys[k]
        dx_mm, dy_mm = x1 - x3, y1 - y3
        if dx_mm * dx_mm + dy_mm * dy_mm >= width_mm2:
            continue
        dx_mm, dy_mm = x2 - x3, y2 - y3
        if dx_mm * dx_mm + dy_mm * dy_mm < width_mm2:
            found |= 1 << k
    return found


def spread(chain: Chain, reached: int, arcs: int, width_mm2: int) -> int:
    """Return the arcs that are reached from the given ones by links between neighbours.

    Only through some arcs; each one that is reached is compared once with its neighbours.
    """
    rest, todo = arcs & ~reached, reached
    for _ in EVERY:
        for i in EVERY:
            if rest == 0 or todo == 0:
                return reached
            if todo >> i & 1:
                found = linked(chain, i, rest & NEIGHBOURS << i >> 2, width_mm2)
                reached |= found
                rest &= ~found
                todo = todo & ~(1 << i) | found
    return reached


def take(chain: Chain, end: int, i: int) -> None:
    """Make an arc of the scan an end of the chain."""
    chain.x_mm[end], chain.y_mm[end] = chain.x_mm[i], chain.y_mm[i]
    chain.left_x_mm[end], chain.left_y_mm[end] = chain.left_x_mm[i], chain.left_y_mm[i]


def middle(chain: Chain, i: int) -> tuple[int, int]:
    """Return the middle of an arc."""
    return chain.x_mm[i] + chain.left_x_mm[i] >> 1, chain.y_mm[i] + chain.left_y_mm[i] >> 1
