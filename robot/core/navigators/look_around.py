"""Prove by turning on the spot that there is no way out of a place.

In a cell that is hardly larger than the robot a lap along the boundary is too short for a chain of
echoes (`proof`). But there each cone sees a surface close by, whatever its direction. An echo shows
that a surface touches the arc of its cone at that distance, but not where. If every point of one
arc is nearer to every point of the next one than the robot is wide, the robot does not fit between
the two surfaces. If that holds all the way round, the surfaces shut the robot in. Where a surface
is too far away for that, the robot drives to the middle of the place, and turns there once more.

While the robot looks around it has no path and no proof. So their memory is used: the points of
the path hold the distances, and the place of the mark is where the turn began.

Bearings are brads: integers, 4096 to the circle.
"""

from math import sqrt
from typing import Final

from robot.core.navigators.loops import CRUMBS, Loops
from robot.core.navigators.proof import (
    SIGMAS,
    Proof,
    chain_width_mm,
    position_sigma_m,
    turn,
    void,
)
from robot.core.perception.echoes import BRADS, CIRCLE, NOTHING
from robot.core.ring import CONE, SONARS
from robot.core.values import EVERY, Pose, whole_cos_sin
from runtime.elementary import coarse_atan2, cos

EACH: Final = 3  # distances in the place of a point
BINS: Final = EACH * CRUMBS
ROUNDS: Final = 2  # so that nobody who passes by is taken for a wall
MOVED_MM: Final = 30  # farther from where the turn began, it begins again
MAX_GAP: Final = 4  # bins from an echo to the next one
UNIT_MM: Final = 4  # of the distances; they are rounded up
MAX_AWAY: Final = 130  # no echo that counts is farther away; also where there was none
FIRST: Final = int(BRADS * -0.5 * (SONARS - 1) * CONE)
NEXT: Final = int(BRADS * CONE)
COSINES: Final = tuple(
    [int(1024 * cos(CONE + (gap + 1) * CIRCLE / BINS / BRADS)) for gap in range(MAX_GAP + 1)]
)
"""Cosines, scaled to 1024, of the largest angle between points of two cones so many bins apart."""


def begin(proof: Proof, path: Loops, pose: Pose) -> None:
    """Begin to turn here; the proof is void, and the path forgotten."""
    void(proof)
    proof.closed = 0
    proof.mark_x_mm, proof.mark_y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    proof.heading = int(BRADS * pose.heading_rad)
    new_round(proof, path)


def new_round(proof: Proof, path: Loops) -> None:
    """Forget the echoes of the last round."""
    proof.turned = path.count = path.matches = 0
    for k in range(CRUMBS):
        path.place[k] = 0


def away(path: Loops, k: int) -> int:
    """Return the distance of the last echo in a bin; 0 if there was none."""
    return path.place[k // EACH] >> 8 * (k % EACH) & 255


def watch(proof: Proof, path: Loops, pose: Pose, radius_mm: int) -> None:
    """Store the echoes of a scan by direction; begin again where the robot has moved."""
    proof.radius_mm = radius_mm
    if moved_mm(proof, pose) > MOVED_MM:
        begin(proof, path, pose)
        return
    heading = int(BRADS * pose.heading_rad)
    step = turn(proof.heading, heading)
    halfway = heading - step // 2
    proof.heading = heading
    proof.turned += step
    chain, place = proof.chain, path.place
    for i in EVERY:
        if chain.seen >> i & 1:
            bearing = (heading if i & 1 else halfway) + FIRST + i * NEXT
            k = bearing % CIRCLE * BINS // CIRCLE
            shift = 8 * (k % EACH)
            here = (chain.range_mm[i + 1] + radius_mm + UNIT_MM - 1) // UNIT_MM
            k = k // EACH
            place[k] = place[k] & ~(255 << shift) | here << shift


def moved_mm(proof: Proof, pose: Pose) -> int:
    """Return the distance from where the robot began to turn, or to drive to the middle."""
    dx_mm = int(1000.0 * pose.x_m) - proof.mark_x_mm
    dy_mm = int(1000.0 * pose.y_m) - proof.mark_y_mm
    return int(sqrt(dx_mm * dx_mm + dy_mm * dy_mm))


def is_round(proof: Proof) -> bool:
    """Return whether the robot has turned once round."""
    return not -CIRCLE < proof.turned < CIRCLE


def is_shut(proof: Proof, path: Loops) -> bool:
    """Return whether the robot fits between no two of the surfaces around it, in any round."""
    width = chain_width_mm(proof.radius_mm) // UNIT_MM
    last, there = NOTHING, 0
    for k in range(BINS + MAX_GAP):
        here = away(path, k % BINS)
        if here == 0:
            continue
        if last != NOTHING:
            gap = k - last
            if gap > MAX_GAP:
                return False
            if here * here + there * there - (here * there * COSINES[gap] >> 9) >= width * width:
                return False
        last, there = k, here
    return last >= BINS


def is_outside(proof: Proof, distance_m: float) -> bool:
    """Return whether the true goal is farther away than any surface that shuts the robot in."""
    nearest_m = distance_m - SIGMAS * position_sigma_m(proof.odometry)
    return nearest_m > 0.001 * UNIT_MM * MAX_AWAY


def to_middle(proof: Proof, path: Loops) -> None:
    """Note in `goal_angle` and `way_mm` the bearing and distance of the middle of the place.

    A round place with the robot `e` beside its middle has its surfaces at R + e cos(bearing).
    """
    x = y = 0
    for k in range(BINS):
        cosine, sine = whole_cos_sin((k + 0.5) * CIRCLE / BINS / BRADS)
        here = away(path, k) or MAX_AWAY
        x += here * cosine
        y += here * sine
    proof.way_mm = 2 * UNIT_MM * int(sqrt(x * x + y * y)) // (BINS << 10)
    proof.goal_angle = int(BRADS * coarse_atan2(y, x))
