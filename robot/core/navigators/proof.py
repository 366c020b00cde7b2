"""Prove by a lap along a boundary that it separates robot and goal.

A proof has four parts, all about the time since a mark on the boundary:

- Chain: echoes between which the robot does not fit lead along the boundary and back to their
  beginning.
- Closed lap: the robot is at the mark again, within the drift of its odometry since the mark, and
  has turned once round.
- Separation: the winding number of the closed chain about the goal differs from that about the
  mark.
- Room: at no place of the lap could the true goal lie on the robot's side of the boundary.

An echo at some range shows that a surface touches the arc of its cone at that distance, but not
where. Two arcs are linked if every point of one is nearer to every point of the other than the
robot is wide: wherever the two surfaces touch their arcs, the robot does not fit between them. An
arc is stored by its two ends. The ends are enough for the comparison: an arc of one cone is short
against its radius, so the two points that are farthest apart are ends.

At a gap that the robot neither passes nor proves, the chain waits, while the robot follows another
surface. It goes on where the robot meets the same surface beyond the gap: then the surface of the
chain's end and the new one are linked, with room for the drift in between.

The drift since a place is SIGMAS times the root of the variance that the position, x and y
together, has gained since. It is not the doubt that `lost` reports, which is the half axis of the
95 % ellipse.

Integers: millimetres in the odometry frame, and brads (4096 to the circle).
"""

from math import inf, sqrt
from typing import Final, NamedTuple

from robot.core import states
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE, NOTHING
from robot.core.perception.odometry import Odometry
from robot.core.perception.sonar_ring import Ring
from robot.core.ring import CONE, SONARS
from robot.core.values import EVERY, Pose, whole_cos_sin, wrap
from runtime.elementary import coarse_atan2, cos, sin

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
        for b in [(k - 0.5 * SONARS) * CONE for k in range(SONARS + 1)]
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
    x_m, y_m, heading_rad = pose
    before_x_m, before_y_m, before_rad = before
    halfway_rad = heading_rad - 0.5 * wrap(heading_rad - before_rad)
    halfway = 0.5 * (x_m + before_x_m), 0.5 * (y_m + before_y_m), halfway_rad
    look_from(chain, 0, ring, halfway, radius_mm)


def look_from(
    chain: Chain, first: int, ring: Ring, pose: "tuple[float, float, float]", radius_mm: int
) -> None:
    """Compute the arcs of every second sonar, pinged at this pose.

    An echo counts if this sonar or one beside it had a similar one in the last scan, so that no
    single false echo makes a link.
    """
    x_m, y_m, heading_rad = pose
    cosine, sine = whole_cos_sin(heading_rad)
    x_mm, y_mm = int(1000.0 * x_m), int(1000.0 * y_m)
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


def chain_width_mm(radius_mm: int) -> int:
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
    least_mm = chain_width_mm(radius_mm)
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


OPEN: Final = 0
"""The lap is not closed."""
SEPARATED: Final = 1
"""Proved: the boundary separates robot and goal."""
DOUBTED: Final = 2
"""The boundary separates robot and the estimated goal; the true goal may be on this side."""
AROUND: Final = 3
"""The lap is closed, and does not separate robot and goal."""

OPEN_LAP, CLOSED, MET = 0, 1, 2
"""States of a lap."""
NO_GAP, WAITING, HOPPED, SPENT = 0, 1, 2, 3
"""States of the chain at gaps; a SPENT one has proved nothing, and ends at the next gap."""

LAG_MM: Final = 500  # the chain waits at a gap once the robot is farther from its end
MIN_LAP_MM: Final = 500  # length of the shortest lap
MAX_WITHIN_MM: Final = 500  # with more drift another place may be taken for the mark
SIGMAS: Final = 4.0
BOUNDARY_M: Final = 0.12
"""Assumed limit of the distance from the robot's rim to the boundary.

On its side of the boundary the robot's centre can come nearer to the goal by this much.
"""
ONCE: Final = 340  # brads, 30 degrees: tolerance of a full turn
SAME_SIDE: Final = 800  # brads, 70 degrees: the chain ends on the same side of the mark as it began
PAST_MM: Final = 250  # the chain must continue this far past the mark


class Proof:
    """A lap along a boundary since the mark.

    `is_valid` is set while the lap may prove something, `is_attached` while its chain reaches the
    newest scan. `gap` is the state of the chain at gaps, and `broke_mm2` the variance of the
    position when it last began to wait. `way_mm` is the distance driven, `turned` the net turn of
    the robot. `x_mm` and `y_mm` are the last place, `heading` is the heading up to which `turned`
    counts.

    `goal_angle` and `mark_angle` are the directions from the goal and from the mark to TAIL,
    `lead_*` those to LEAD, `start_*` those to the first arc; they count whole turns. `closed` is
    CLOSED at the mark again, where the chain ended at `closed_*`, and MET once the chain reaches
    its first arc; `separates` is set if the chain closed there separates mark and goal. `room_m` is
    the least distance that the goal keeps from the robot's side of the boundary. `mark_*_mm` are
    the place of the mark, `mark_mm2` the variance of the position there. `odometry` is the estimate
    with its covariance. `radius_mm` is the robot's radius: without drift a place counts as the mark
    within it, because two passes along the two sides of a wall are farther apart.
    """

    __slots__ = (
        "broke_mm2",
        "chain",
        "closed",
        "closed_x_mm",
        "closed_y_mm",
        "gap",
        "goal_angle",
        "heading",
        "is_attached",
        "is_valid",
        "lead_goal_angle",
        "lead_mark_angle",
        "mark_angle",
        "mark_mm2",
        "mark_x_mm",
        "mark_y_mm",
        "odometry",
        "radius_mm",
        "room_m",
        "separates",
        "start_goal_angle",
        "start_mark_angle",
        "turned",
        "way_mm",
        "x_mm",
        "y_mm",
    )

    def __init__(self) -> None:
        self.odometry = Odometry()
        self.chain = Chain()
        self.is_valid = self.is_attached = self.separates = False
        self.x_mm = self.y_mm = self.heading = 0
        self.goal_angle = self.mark_angle = self.lead_goal_angle = self.lead_mark_angle = 0
        self.start_goal_angle = self.start_mark_angle = 0
        self.mark_x_mm = self.mark_y_mm = 0
        self.way_mm = self.turned = 0
        self.closed_x_mm = self.closed_y_mm = 0
        self.mark_mm2 = self.broke_mm2 = 0
        self.closed = OPEN_LAP
        self.gap = NO_GAP
        self.radius_mm = 0
        self.room_m = inf


def void(proof: Proof) -> None:
    """Drop the lap: the robot follows no boundary now, or another one."""
    proof.is_valid = False


def mark(proof: Proof, pose: Pose, side: int, goal_x_m: float, goal_y_m: float) -> None:
    """Begin a lap here, if there is an echo at which its chain can begin."""
    proof.is_valid = begin(proof.chain, side)
    proof.mark_x_mm = proof.x_mm = int(1000.0 * pose.x_m)
    proof.mark_y_mm = proof.y_mm = int(1000.0 * pose.y_m)
    proof.heading = int(BRADS * pose.heading_rad)
    proof.mark_mm2 = variance_mm2(proof)
    proof.closed, proof.gap = OPEN_LAP, NO_GAP
    proof.room_m = inf
    proof.way_mm = proof.turned = proof.goal_angle = proof.mark_angle = 0
    step(proof, START, goal_x_m, goal_y_m)
    proof.start_goal_angle = proof.lead_goal_angle = proof.goal_angle
    proof.start_mark_angle = proof.lead_mark_angle = proof.mark_angle


def advance(proof: Proof, pose: Pose, goal_x_m: float, goal_y_m: float) -> None:
    """Add the motion since the last call to the lap: distance driven, turn, and least room.

    A turn made while the chain waits at a gap is added after the gap, modulo a full turn.
    """
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    heading = int(BRADS * pose.heading_rad)
    dx_mm, dy_mm = x_mm - proof.x_mm, y_mm - proof.y_mm
    proof.way_mm += int(sqrt(dx_mm * dx_mm + dy_mm * dy_mm))
    if proof.gap != WAITING:
        proof.turned += turn(proof.heading, heading)
        proof.heading = heading
    proof.x_mm, proof.y_mm = x_mm, y_mm
    away_x_m, away_y_m = pose.x_m - goal_x_m, pose.y_m - goal_y_m
    room_m = sqrt(away_x_m * away_x_m + away_y_m * away_y_m) - BOUNDARY_M
    room_m -= SIGMAS * position_sigma_m(proof.odometry)
    if room_m < proof.room_m:
        proof.room_m = room_m


def wind(proof: Proof, found: Found, goal_x_m: float, goal_y_m: float) -> None:
    """Turn the lines to both ends of the chain along the arcs that it has reached.

    The chain leads round the robot, so the shortest turn to an end may be the wrong one.
    """
    old_goal_angle, old_mark_angle = proof.lead_goal_angle, proof.lead_mark_angle
    arcs = found.beside
    if found.ahead >> found.tail & 1:
        arcs = found.ahead
        proof.goal_angle, proof.mark_angle = old_goal_angle, old_mark_angle
    step(proof, found.tail_joint, goal_x_m, goal_y_m)
    walk(proof, arcs, found.tail_joint, found.tail, goal_x_m, goal_y_m)
    if found.lead == NOTHING:
        return
    goal_angle, mark_angle = proof.goal_angle, proof.mark_angle
    arcs = found.beside
    if found.ahead >> found.lead & 1:
        arcs = found.ahead
        proof.goal_angle, proof.mark_angle = old_goal_angle, old_mark_angle
        step(proof, found.lead_joint, goal_x_m, goal_y_m)
    walk(proof, arcs, found.lead_joint, found.lead, goal_x_m, goal_y_m)
    proof.lead_goal_angle, proof.lead_mark_angle = proof.goal_angle, proof.mark_angle
    proof.goal_angle, proof.mark_angle = goal_angle, mark_angle


def walk(proof: Proof, arcs: int, begin: int, end: int, goal_x_m: float, goal_y_m: float) -> None:
    """Turn the lines over some arcs of the scan, at least every second one, from begin to end."""
    last = begin
    for i in range(begin + 1, end + 1) if begin < end else range(begin - 1, end - 1, -1):
        if arcs >> i & 1 and (i == end or not -2 < i - last < 2):
            step(proof, i, goal_x_m, goal_y_m)
            last = i


def step(proof: Proof, i: int, goal_x_m: float, goal_y_m: float) -> None:
    """Turn the lines from the goal and from the mark to the middle of an arc."""
    x_mm, y_mm = middle(proof.chain, i)
    at_goal = int(BRADS * coarse_atan2(y_mm - 1000.0 * goal_y_m, x_mm - 1000.0 * goal_x_m))
    at_mark = int(BRADS * coarse_atan2(y_mm - proof.mark_y_mm, x_mm - proof.mark_x_mm))
    proof.goal_angle += turn(proof.goal_angle, at_goal)
    proof.mark_angle += turn(proof.mark_angle, at_mark)


def turn(before: int, now: int) -> int:
    """Return the turn between two directions in brads, by the shorter way."""
    return (now - before + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE


def position_sigma_m(odometry: Odometry) -> float:
    """Return the standard deviation of the position in its most uncertain direction."""
    half_m2 = 0.5 * (odometry.pxx - odometry.pyy)
    mean_m2, across_m2 = 0.5 * (odometry.pxx + odometry.pyy), odometry.pxy
    return sqrt(mean_m2 + sqrt(half_m2 * half_m2 + across_m2 * across_m2))


def continue_chain(
    proof: Proof, side: int, radius_mm: int, goal_x_m: float, goal_y_m: float
) -> None:
    """Continue the chain by the newest scan; it waits at a gap if it stays behind.

    Where the robot meets the same surface again beyond the gap, the chain goes on. For this hop it
    needs room for the drift since it began to wait.
    """
    chain = proof.chain
    proof.radius_mm = radius_mm
    width_mm = chain_width_mm(radius_mm)
    if proof.gap == WAITING:
        width_mm -= int(SIGMAS * sigma_gained_mm(proof, proof.broke_mm2))
    found = None
    if width_mm > 0:
        found = extend(chain, proof.x_mm, proof.y_mm, side, width_mm)
    proof.is_attached = found is not None
    if found is not None:
        wind(proof, found, goal_x_m, goal_y_m)
        if proof.gap == WAITING:
            proof.gap = HOPPED
        return
    dx_mm, dy_mm = proof.x_mm - chain.x_mm[TAIL], proof.y_mm - chain.y_mm[TAIL]
    if proof.gap != WAITING and dx_mm * dx_mm + dy_mm * dy_mm > LAG_MM * LAG_MM:
        if proof.gap == SPENT:
            void(proof)  # the next lap begins on the surface beyond the gap
        proof.gap = WAITING
        if proof.closed == CLOSED:
            proof.closed = OPEN_LAP
        proof.broke_mm2 = variance_mm2(proof)


def verdict(proof: Proof, side: int) -> int:
    """Return what the lap on this side proves; OPEN until it is closed.

    The chain must reach its first arc again: at a gap its end may lead past the mark on the other
    side. As the odometry has drifted, it must also go on past the mark for longer than the drift.
    """
    if (
        not (proof.is_valid and proof.is_attached)
        or proof.gap == SPENT
        or proof.way_mm < MIN_LAP_MM
    ):
        return OPEN
    drift_mm = int(SIGMAS * sigma_gained_mm(proof, proof.mark_mm2))
    if proof.closed == OPEN_LAP:
        if is_at_mark(proof, drift_mm) and is_simple(proof, side):
            proof.closed, proof.separates = CLOSED, separates(proof)
            proof.closed_x_mm, proof.closed_y_mm = middle(proof.chain, TAIL)
        return OPEN
    if proof.closed == CLOSED and meets_start(proof.chain, proof.radius_mm):
        proof.closed, proof.separates = MET, separates(proof)
    x_mm, y_mm = middle(proof.chain, TAIL)
    past_mm = PAST_MM + drift_mm
    dx_mm, dy_mm = x_mm - proof.closed_x_mm, y_mm - proof.closed_y_mm
    if dx_mm * dx_mm + dy_mm * dy_mm < past_mm * past_mm:
        return OPEN
    if proof.closed != MET:
        proof.closed = OPEN_LAP  # it was another place
        return OPEN
    if not proof.separates:
        if proof.gap != HOPPED:
            return AROUND
        proof.gap = SPENT
        return OPEN
    return SEPARATED if proof.room_m > 0.0 else DOUBTED


def goal_winding(proof: Proof) -> int:
    """Return the net turn of the line from the goal to the end of the chain, in brads."""
    return proof.goal_angle - proof.start_goal_angle


def mark_winding(proof: Proof) -> int:
    """Return the net turn of the line from the mark to the end of the chain, in brads."""
    return proof.mark_angle - proof.start_mark_angle


def separates(proof: Proof) -> bool:
    """Return whether the chain, closed here, winds differently about mark and goal."""
    return winding_number(goal_winding(proof)) != winding_number(mark_winding(proof))


def may_close(proof: Proof) -> bool:
    """Return whether the lap may still prove something, and its chain does not wait at a gap."""
    return proof.is_valid and (proof.gap == NO_GAP or proof.gap == HOPPED)


def winding_number(turned: int) -> int:
    """Return the number of whole turns nearest to a net turn in brads."""
    return (turned + HALF_CIRCLE) // CIRCLE


def is_at_mark(proof: Proof, drift_mm: int) -> bool:
    """Return whether the robot has turned once round, and robot and chain may be at the mark."""
    once = proof.turned if proof.turned > 0 else -proof.turned
    if proof.gap == HOPPED:  # the turn at a gap is known modulo a full turn
        once = CIRCLE + turn(0, once)
    if not CIRCLE - ONCE < once < CIRCLE + ONCE:
        return False
    off, goal_off = turn(0, mark_winding(proof)), turn(0, goal_winding(proof))
    if not (-SAME_SIDE < off < SAME_SIDE and -SAME_SIDE < goal_off < SAME_SIDE):
        return False
    dx_mm, dy_mm = proof.x_mm - proof.mark_x_mm, proof.y_mm - proof.mark_y_mm
    within_mm2 = proof.radius_mm * proof.radius_mm + drift_mm * drift_mm
    most_mm2 = MAX_WITHIN_MM * MAX_WITHIN_MM
    return within_mm2 < most_mm2 and dx_mm * dx_mm + dy_mm * dy_mm < within_mm2


def is_simple(proof: Proof, side: int) -> bool:
    """Return whether turn and chain agree: the lap leads round within a room, or round an island.

    In a small room the sonars see the walls all round, and the chain may lead back to its beginning
    without going round the mark.
    """
    return proof.gap == HOPPED or (proof.turned * side > 0) == (
        winding_number(mark_winding(proof)) != 0
    )


def sigma_gained_mm(proof: Proof, since_mm2: int) -> float:
    """Return the standard deviation that the position has gained since a variance, in mm.

    Where walls have corrected the position, the variance has shrunk, and the estimate has moved by
    as much as that.
    """
    gained_mm2 = variance_mm2(proof) - since_mm2
    return sqrt(gained_mm2 if gained_mm2 > 0 else -gained_mm2)


def variance_mm2(proof: Proof) -> int:
    """Return the variance of the position, x and y together."""
    return int(1e6 * (proof.odometry.pxx + proof.odometry.pyy))
