"""Evade people: choose a heading by its closest approach, and detect who walks alongside.

A person keeps its velocity, and the robot turns on the spot before it drives. The robot keeps its
heading if that stays clear of all people, else it takes the heading, or the wait, that costs least.

A static obstacle that only the last sonar of a flank detects is behind the robot after a short
straight drive. An echo that is still there after a longer one moves alongside, and following it
would follow a person. The robot then turns away and lets it go ahead.

Headings are brads: integers, 4096 to the circle.
"""

from math import inf, sqrt
from typing import Final

from robot.core.navigators import open_headings
from robot.core.navigators.open_headings import Sectors
from robot.core.parameters import Params
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE
from robot.core.perception.people import BODY_M, PROVEN, SLOTS, People
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Pose, wrap
from runtime.elementary import cos_sin

CHOICES: Final = open_headings.STEPS
STEP: Final = open_headings.STEP
NEAR_M: Final = 1.5
AHEAD_S: Final = 3.0
FROM_S: Final = 0.3  # what happens earlier is the same on all headings
MARGIN_M: Final = 0.15
MARGIN_M_S: Final = 0.03  # growth of the margin, as a velocity is uncertain
LATER: Final = 0.2  # share by which a miss counts less for each second until it
TURN_RAD_S: Final = 2.2
PASS_COST: Final = 4.0
TURN_COST: Final = 0.5  # of turning back
WAIT_COST: Final = 0.4
KEEP_COST: Final = 0.3
CLOSED_COST: Final = 3.0


class Evasion:
    """The last choice: `heading` in brads, `active` while it is not the navigator's own.

    `most_m_s` is the speed limit.
    """

    __slots__ = ("active", "heading", "most_m_s")

    def __init__(self) -> None:
        self.active = False
        self.heading = 0
        self.most_m_s = inf


def choose(
    e: Evasion, people: People, sectors: Sectors, wanted: int, pose: Pose, params: Params
) -> int:
    """Return the heading in brads: the wanted one if it is safe, else the best."""
    e.most_m_s = inf
    near = bits_of_near(people, pose) if people.any else 0
    danger = risk(people, near, wanted, pose, params.v_max_m_s, params) if near else 0.0
    if danger == 0.0:
        e.active = False
        return wanted
    least = PASS_COST * danger
    waits = PASS_COST * risk(people, near, wanted, pose, 0.0, params) + WAIT_COST
    if waits < least:
        least, e.most_m_s = waits, 0.0
    best = turn(e, people, near, sectors, wanted, least, pose, params)
    if best != wanted:
        e.most_m_s = inf
    e.active = best != wanted or e.most_m_s == 0.0
    e.heading = best
    return best


def turn(
    e: Evasion,
    people: People,
    near: int,
    sectors: Sectors,
    wanted: int,
    least: float,
    pose: Pose,
    params: Params,
) -> int:
    """Return the heading that costs less than `least` and all others, or the wanted one.

    The last choice is tried first and costs less, so that the robot does not turn to and fro.
    """
    best = wanted
    first = e.heading if e.active else wanted
    closed = open_headings.closed_steps(sectors, first, sectors.tight)
    for k in range(CHOICES):
        step = (k + 1) // 2 if k & 1 else -(k // 2)
        heading = first + step * STEP
        off = (heading - wanted + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
        cost = TURN_COST * (off if off >= 0 else -off) / HALF_CIRCLE
        if k == 0 and e.active:
            cost -= KEEP_COST
        if cost >= least:
            continue
        if closed >> (step & CHOICES - 1) & 1:
            cost += CLOSED_COST
            if cost >= least:
                continue
        cost += PASS_COST * risk(people, near, heading, pose, params.v_max_m_s, params, cost, least)
        if cost < least:
            best, least = heading, cost
    return best


def bits_of_near(people: People, pose: Pose) -> int:
    """Return a bit for each person who has proved to move and is near."""
    near = 0
    for k in SLOTS:
        if people.left[k] and people.proof[k] >= PROVEN:
            dx_m, dy_m = people.x_m[k] - pose.x_m, people.y_m[k] - pose.y_m
            if dx_m * dx_m + dy_m * dy_m < NEAR_M * NEAR_M:
                near |= 1 << k
    return near


def risk(
    people: People,
    near: int,
    heading: int,
    pose: Pose,
    speed_m_s: float,
    params: Params,
    cost: float = 0.0,
    least: float = inf,
) -> float:
    """Return how far the margins to people are missed, 0 if not; sooner counts more.

    The robot turns to the heading on the spot and then drives; at no speed it stands. The result
    may be too small where it raises `cost` to `least` at least.
    """
    touching_m = params.radius_m + BODY_M
    turn_s = turning_s(heading, pose) if speed_m_s > 0.0 else AHEAD_S
    total = ux_m_s = uy_m_s = 0.0
    for k in SLOTS:
        if not near >> k & 1:
            continue
        worst = 0.0
        x_m, y_m = people.x_m[k] - pose.x_m, people.y_m[k] - pose.y_m
        vx_m_s, vy_m_s = people.vx_m_s[k], people.vy_m_s[k]
        if turn_s > FROM_S:
            worst = miss(x_m, y_m, vx_m_s, vy_m_s, FROM_S, turn_s, touching_m)
            if cost + PASS_COST * (total + worst) >= least:
                return total + worst
        if turn_s < AHEAD_S:
            if ux_m_s == 0.0 and uy_m_s == 0.0:
                ux_m_s, uy_m_s = velocity(heading, speed_m_s)
            x_m, y_m = x_m + turn_s * ux_m_s, y_m + turn_s * uy_m_s
            vx_m_s, vy_m_s = vx_m_s - ux_m_s, vy_m_s - uy_m_s
            begin_s = turn_s if turn_s > FROM_S else FROM_S
            here = miss(x_m, y_m, vx_m_s, vy_m_s, begin_s, AHEAD_S, touching_m)
            worst = here if here > worst else worst
        total += worst
    return total


def turning_s(heading: int, pose: Pose) -> float:
    """Return the time to turn to a heading."""
    off = (heading - int(BRADS * pose.heading_rad) + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    return (off if off >= 0 else -off) / BRADS / TURN_RAD_S


def velocity(heading: int, speed_m_s: float) -> tuple[float, float]:
    """Return the velocity along a heading."""
    cosine, sine = cos_sin(wrap(heading / BRADS))
    return speed_m_s * cosine, speed_m_s * sine


def miss(
    x_m: float,
    y_m: float,
    vx_m_s: float,
    vy_m_s: float,
    begin_s: float,
    end_s: float,
    touching_m: float,
) -> float:
    """Return the missing share of the margin at the closest approach between two times."""
    square = vx_m_s * vx_m_s + vy_m_s * vy_m_s
    at_s = begin_s
    if square > 0.0:
        at_s = -(x_m * vx_m_s + y_m * vy_m_s) / square
        if at_s < begin_s:
            at_s = begin_s
        elif at_s > end_s:
            at_s = end_s
    x_m, y_m = x_m + vx_m_s * at_s, y_m + vy_m_s * at_s
    margin_m = MARGIN_M + MARGIN_M_S * at_s
    away_m = touching_m + margin_m
    apart_m2 = x_m * x_m + y_m * y_m
    if apart_m2 >= away_m * away_m:
        return 0.0
    gap_m = sqrt(apart_m2) - touching_m
    return (margin_m - gap_m) / margin_m * (1.0 - LATER * at_s)


WALKER_NEAR_M: Final = 0.20
BEFORE_M: Final = 0.25  # minimum difference to the range of the sonar before it
ALONG_MM: Final = 350
STRAIGHT: Final = 340  # brads, 30 degrees
GIVE_WAY_TICKS: Final = 60
DRIVE_TICKS: Final = 30
ASIDE: Final = 1080  # brads, 95 degrees


class FlankWalker:
    """Pose of the robot when an echo appeared at one flank only.

    `side` is 1 left, -1 right, 0 none. While `ticks` are left, the robot gives way along `heading`.
    """

    __slots__ = ("began", "heading", "side", "ticks", "x_mm", "y_mm")

    def __init__(self) -> None:
        self.x_mm = self.y_mm = self.began = self.heading = self.ticks = self.side = 0


def watch(flank_walker: FlankWalker, ring: Ring, pose: Pose) -> bool:
    """Update for one tick; return whether a pedestrian has just been detected."""
    side = flank(ring)
    if side == 0:
        flank_walker.side = 0
        return False
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    heading = int(BRADS * pose.heading_rad)
    turned = (heading - flank_walker.began + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    if side != flank_walker.side or not -STRAIGHT < turned < STRAIGHT:
        flank_walker.side = side
        flank_walker.x_mm, flank_walker.y_mm, flank_walker.began = x_mm, y_mm, heading
        return False
    dx_mm, dy_mm = x_mm - flank_walker.x_mm, y_mm - flank_walker.y_mm
    if dx_mm * dx_mm + dy_mm * dy_mm < ALONG_MM * ALONG_MM:
        return False
    flank_walker.heading = heading - side * ASIDE
    flank_walker.ticks = GIVE_WAY_TICKS
    flank_walker.side = 0
    return True


def flank(ring: Ring) -> int:
    """Return the flank at which only the last sonar has a near echo."""
    if ring.nearest_m >= WALKER_NEAR_M:
        return 0
    right_m, left_m = ring.range_m[0], ring.range_m[7]
    if right_m is not None and right_m < WALKER_NEAR_M and is_last(ring.range_m[1], right_m):
        return -1
    if left_m is not None and left_m < WALKER_NEAR_M and is_last(ring.range_m[6], left_m):
        return 1
    return 0


def is_last(before_m: float | None, range_m: float) -> bool:
    """Return whether the sonar before the last one does not detect the same object."""
    return before_m is not None and before_m > range_m + BEFORE_M
