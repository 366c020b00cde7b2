"""Prove by a lap along a boundary that it separates robot and goal.

A proof needs three facts about the way since a mark on the boundary:

- A chain of echoes through which the robot cannot pass (`chain`) leads along the boundary and back
  to its beginning: the robot is at the mark again, within the doubt that its odometry has collected
  since the mark, and has turned once round.
- The closed chain winds round the goal otherwise than round the mark, so it separates them.
- There is room for the doubt: at no place of the lap could the true goal lie on the robot's side.

Integers: millimetres, and brads (4096 to the circle).
"""

from math import inf, sqrt
from typing import Final

from robot.core.navigators.memory import chain as chains
from robot.core.navigators.memory.chain import TAIL, Chain
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE
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

LAG_MM: Final = 500  # the chain is broken if its end is farther away
LEAST_MM: Final = 500  # length of the shortest lap
MAX_WITHIN_MM: Final = 500  # with more doubt another place may be taken for the mark
SIGMAS: Final = 4.0
BOUNDARY_M: Final = 0.12  # from the rim to the boundary, at most
ONCE: Final = 340  # brads, 30 degrees: tolerance of a full turn
SAME_SIDE: Final = 800  # brads, 70 degrees: the chain ends on the same side of the mark as it began
PAST_MM: Final = 250  # the chain must continue this far past the mark
CLEAR_MM: Final = 100  # with less drift, the chain must reach its first arc


class Proof:
    """A lap along a boundary since the mark.

    `whole` is set while the chain has no gap, `sealed` while it reaches the newest scan. `way_mm`
    is the length of the lap, `turned` its net turn. `wound` and `ringed` are the net turns of the
    lines from the goal and from the mark to the end of the chain. `closed` is set at the mark
    again, where the chain ended at `closed_*`; `separates` is set if the chain closed there
    separates mark and goal, `met` once the chain reaches its first arc. `room_m` is the least
    distance that the goal keeps from the robot's side of the boundary. `mark_*` are the pose at the
    mark and the variance of its position. `odometry` is the estimate with its covariance. Parallel
    ways along a boundary are farther apart than `radius_mm`, the robot's radius.
    """

    __slots__ = (
        "at_goal",
        "at_mark",
        "chain",
        "closed",
        "closed_x_mm",
        "closed_y_mm",
        "heading",
        "mark_m2",
        "mark_x_mm",
        "mark_y_mm",
        "met",
        "odometry",
        "radius_mm",
        "ringed",
        "room_m",
        "sealed",
        "separates",
        "turned",
        "way_mm",
        "whole",
        "wound",
        "x_mm",
        "y_mm",
    )

    def __init__(self) -> None:
        self.odometry = Odometry()
        self.chain = Chain()
        self.whole = self.sealed = self.closed = self.met = self.separates = False
        self.x_mm = self.y_mm = self.heading = self.at_goal = self.at_mark = 0
        self.mark_x_mm = self.mark_y_mm = 0
        self.way_mm = self.turned = self.wound = self.ringed = 0
        self.closed_x_mm = self.closed_y_mm = 0
        self.mark_m2 = 0.0
        self.radius_mm = 0
        self.room_m = inf


def void(proof: Proof) -> None:
    """Drop the lap: the robot does not follow a boundary, or another one."""
    proof.whole = False


def mark(proof: Proof, pose: Pose, side: int, goal_x_m: float, goal_y_m: float) -> None:
    """Begin a lap here, if there is an echo at which its chain can begin."""
    odometry = proof.odometry
    proof.whole = chains.begin(proof.chain, side)
    proof.mark_x_mm = proof.x_mm = int(1000.0 * pose.x_m)
    proof.mark_y_mm = proof.y_mm = int(1000.0 * pose.y_m)
    proof.heading = int(BRADS * pose.heading_rad)
    proof.mark_m2 = odometry.pxx + odometry.pyy
    proof.closed = proof.met = False
    proof.room_m = inf
    wind(proof, goal_x_m, goal_y_m)
    proof.way_mm = proof.turned = proof.wound = proof.ringed = 0


def advance(proof: Proof, pose: Pose, goal_x_m: float, goal_y_m: float) -> None:
    """Add the way since the last call: its length, its turn, and the room for the doubt."""
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    heading = int(BRADS * pose.heading_rad)
    dx_mm, dy_mm = x_mm - proof.x_mm, y_mm - proof.y_mm
    proof.turned += turn(proof.heading, heading)
    proof.way_mm += int(sqrt(dx_mm * dx_mm + dy_mm * dy_mm))
    proof.x_mm, proof.y_mm, proof.heading = x_mm, y_mm, heading
    away_x_m, away_y_m = pose.x_m - goal_x_m, pose.y_m - goal_y_m
    room_m = sqrt(away_x_m * away_x_m + away_y_m * away_y_m) - BOUNDARY_M
    room_m -= SIGMAS * doubt_m(proof.odometry)
    if room_m < proof.room_m:
        proof.room_m = room_m


def wind(proof: Proof, goal_x_m: float, goal_y_m: float) -> None:
    """Add the turns of the lines from the goal and from the mark to the end of the chain."""
    x_mm, y_mm = chains.middle(proof.chain)
    at_goal = int(BRADS * coarse_atan2(y_mm - 1000.0 * goal_y_m, x_mm - 1000.0 * goal_x_m))
    at_mark = int(BRADS * coarse_atan2(y_mm - proof.mark_y_mm, x_mm - proof.mark_x_mm))
    proof.wound += turn(proof.at_goal, at_goal)
    proof.ringed += turn(proof.at_mark, at_mark)
    proof.at_goal, proof.at_mark = at_goal, at_mark


def turn(before: int, now: int) -> int:
    """Return the turn between two directions in brads, by the shorter way."""
    return (now - before + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE


def doubt_m(odometry: Odometry) -> float:
    """Return the standard deviation of the position in its most uncertain direction."""
    half_m2 = 0.5 * (odometry.pxx - odometry.pyy)
    mean_m2, across_m2 = 0.5 * (odometry.pxx + odometry.pyy), odometry.pxy
    return sqrt(mean_m2 + sqrt(half_m2 * half_m2 + across_m2 * across_m2))


def seal(proof: Proof, side: int, radius_mm: int, goal_x_m: float, goal_y_m: float) -> None:
    """Continue the chain by the newest scan; the proof is void if the chain stays behind."""
    chain = proof.chain
    proof.radius_mm = radius_mm
    proof.sealed = chains.extend(chain, proof.x_mm, proof.y_mm, side, radius_mm)
    if proof.sealed:
        wind(proof, goal_x_m, goal_y_m)
        return
    dx_mm, dy_mm = proof.x_mm - chain.x_mm[TAIL], proof.y_mm - chain.y_mm[TAIL]
    if dx_mm * dx_mm + dy_mm * dy_mm > LAG_MM * LAG_MM:
        void(proof)


def verdict(proof: Proof) -> int:
    """Return what the lap proves; OPEN until it is closed.

    The chain must reach its first arc again. Where the odometry has drifted that cannot be seen, so
    the chain must go on past the mark for longer than the drift.
    """
    if not (proof.whole and proof.sealed) or proof.way_mm < LEAST_MM:
        return OPEN
    drift_mm = int(1000.0 * SIGMAS * gained_m(proof))
    if not proof.closed:
        if is_at_mark(proof, drift_mm):
            proof.closed = True
            proof.separates = rounds(proof.wound) != rounds(proof.ringed)
            proof.closed_x_mm, proof.closed_y_mm = chains.middle(proof.chain)
        return OPEN
    proof.met = proof.met or chains.meets_start(proof.chain, proof.radius_mm)
    if drift_mm < CLEAR_MM and not proof.met:
        return OPEN
    x_mm, y_mm = chains.middle(proof.chain)
    past_mm = PAST_MM + drift_mm
    dx_mm, dy_mm = x_mm - proof.closed_x_mm, y_mm - proof.closed_y_mm
    if dx_mm * dx_mm + dy_mm * dy_mm < past_mm * past_mm:
        return OPEN
    if not proof.separates:
        return AROUND
    return SEPARATED if proof.room_m > 0.0 else DOUBTED


def rounds(turned: int) -> int:
    """Return the number of whole turns nearest to a turn in brads."""
    return (turned + HALF_CIRCLE) // CIRCLE


def is_at_mark(proof: Proof, drift_mm: int) -> bool:
    """Return whether the robot has turned once round, and robot and chain may be at the mark."""
    once = proof.turned if proof.turned > 0 else -proof.turned
    if not CIRCLE - ONCE < once < CIRCLE + ONCE:
        return False
    off, goal_off = turn(0, proof.ringed), turn(0, proof.wound)
    if not (-SAME_SIDE < off < SAME_SIDE and -SAME_SIDE < goal_off < SAME_SIDE):
        return False
    dx_mm, dy_mm = proof.x_mm - proof.mark_x_mm, proof.y_mm - proof.mark_y_mm
    within_mm = proof.radius_mm + drift_mm
    return within_mm < MAX_WITHIN_MM and dx_mm * dx_mm + dy_mm * dy_mm < within_mm * within_mm


def gained_m(proof: Proof) -> float:
    """Return the standard deviation that the position has gained since the mark."""
    gained_m2 = proof.odometry.pxx + proof.odometry.pyy - proof.mark_m2
    return sqrt(gained_m2) if gained_m2 > 0.0 else 0.0
