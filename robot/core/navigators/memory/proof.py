"""Prove by a lap along a boundary that it separates robot and goal.

A proof has four parts, all about the time since a mark on the boundary:

- Chain: echoes between which the robot does not fit (`chain`) lead along the boundary and back to
  their beginning.
- Closed lap: the robot is at the mark again, within the drift of its odometry since the mark, and
  has turned once round.
- Separation: the winding number of the closed chain about the goal differs from that about the
  mark.
- Room: at no place of the lap could the true goal lie on the robot's side of the boundary.

At a gap that the robot neither passes nor proves, the chain waits, while the robot follows another
surface. It goes on where the robot meets the same surface beyond the gap: then the surface of the
chain's end and the new one are linked, with room for the drift in between.

The drift since a place is SIGMAS times the root of the variance that the position, x and y
together, has gained since. It is not the doubt that `lost` reports, which is the half axis of the
95 % ellipse.

Integers: millimetres, and brads (4096 to the circle).
"""

from math import inf, sqrt
from typing import Final

from robot.core.navigators.memory import chain as chains
from robot.core.navigators.memory.chain import TAIL, Chain, Found
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE, NOTHING
from robot.core.perception.odometry import Odometry
from robot.core.values import Pose
from runtime.elementary import coarse_atan2

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
    proof.is_valid = chains.begin(proof.chain, side)
    proof.mark_x_mm = proof.x_mm = int(1000.0 * pose.x_m)
    proof.mark_y_mm = proof.y_mm = int(1000.0 * pose.y_m)
    proof.heading = int(BRADS * pose.heading_rad)
    proof.mark_mm2 = variance_mm2(proof)
    proof.closed, proof.gap = OPEN_LAP, NO_GAP
    proof.room_m = inf
    proof.way_mm = proof.turned = proof.goal_angle = proof.mark_angle = 0
    step(proof, chains.START, goal_x_m, goal_y_m)
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
    x_mm, y_mm = chains.middle(proof.chain, i)
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
    width_mm = chains.width_mm(radius_mm)
    if proof.gap == WAITING:
        width_mm -= int(SIGMAS * sigma_gained_mm(proof, proof.broke_mm2))
    found = None
    if width_mm > 0:
        found = chains.extend(chain, proof.x_mm, proof.y_mm, side, width_mm)
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
            proof.closed_x_mm, proof.closed_y_mm = chains.middle(proof.chain, TAIL)
        return OPEN
    if proof.closed == CLOSED and chains.meets_start(proof.chain, proof.radius_mm):
        proof.closed, proof.separates = MET, separates(proof)
    x_mm, y_mm = chains.middle(proof.chain, TAIL)
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
