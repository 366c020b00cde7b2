"""How fast and how far the sonars let the robot go: what lies ahead, at the flanks, goalwards."""

from math import cos, pi, sin

from robot.core.geometry import BEARINGS, HALF_CONE
from robot.core.parameters import Params
from robot.core.perception.sonar_ring import Ring
from robot.core.typing_shim import Final
from robot.core.values import EVERY, SONARS

# How fast. `_PER_S`: metres per second for each metre of room. Sonars 2 to 5 look ahead, the
# others at the flanks; "usual" is what the parameters say by default.
CLOSE_M: Final = 0.30
"""What is farther slows nobody down; nothing beyond 0.23 m takes any of the usual 0.3 m/s."""
STOP_M: Final = 0.004
"""Ahead and no farther than this above the guard's stop the robot only turns: of any speed, and of
the turn with it, the guard would take most away."""
KEEP_M: Final = 0.03
LEAST_M_S: Final = 0.03
"""Ahead, speed grows from LEAST_M_S at KEEP_M. That is nearer than the guard's usual stop of
0.04 m, so that wherever the guard lets the robot go, it goes."""
AHEAD_PER_S: Final = 1.4
"""Sonars 3 and 4: from 0.08 m on slower than the guard, as it usually is, would have it; so that it
seldom has to act, which slows the turn too."""
ASIDE_PER_S: Final = 2.0
"""Sonars 2 and 5: faster, as they look 34 degrees aside, at what may be passed."""
FREE_PER_S: Final = 0.9
"""The way that remembered echoes leave: slowest, and 0 at 0 m, as no guard watches over those."""
TOUCHING_M: Final = 0.08
"""What is nearer, ahead or at a flank, is closed in on no faster than would take a quarter of a
second to RIM_M; farther away, that takes nothing of the usual speed."""
RIM_M: Final = 0.025
CRAWL_M_S: Final = 0.04
CRAWL_M: Final = 0.015
NARROW_M: Final = 0.05
"""Past a flank the robot crawls also where that leaves nothing, or it would never get away from
there. Nearer than CRAWL_M it may be touching and only turns; ours measure from 0.02 m on.
With no more than NARROW_M left at both flanks together the robot does not go on: whether the gap
closes in further no sonar can tell."""

# How far aside.
FLANK_M: Final = 0.06
FLANK_RAD: Final = 40.0 * pi / 180.0
"""What is nearer than FLANK_M on one side turns the heading away, in proportion, by FLANK_RAD at
0 m; what is as near on the other side turns it back."""
FRONT_M: Final = 0.05
"""What is ahead and nearer than this counts as so much nearer still: before any flank."""

# How far it is free towards the goal.
BESIDE: Final = 0.5 * pi
"""Radians from the heading: here the outermost cones end."""
LOOK_M: Final = 0.25
"""So much before an echo what it comes from would be met; DistBug takes off as much."""
MARGIN_M: Final = 0.02
"""What leaves so much room beside the body is passed; it is the tight margin of the headings."""
INNER: Final = tuple([cos(max(abs(b) - HALF_CONE, 0.0)) for b in BEARINGS])
"""How much of its speed the robot closes in with on what is at the inner edge of a cone."""


def speed(ring: Ring, free_mm: int, error_rad: float, params: Params) -> float:
    """The most speed: slower the nearer something is, and while the heading is `error_rad` off."""
    most_m_s = params.v_max_m_s
    if ring.nearest_m < CLOSE_M:
        stop_m, ranges_m = params.guard_stop_m + STOP_M, ring.range_m
        if ring.nearest_m < NARROW_M and is_narrow(ring):
            return 0.0
        for i in EVERY:
            range_m = ranges_m[i]
            if range_m is None or range_m >= CLOSE_M:
                continue
            if 1 < i < 6:
                if range_m <= stop_m:
                    return 0.0
                rate = AHEAD_PER_S if 2 < i < 5 else ASIDE_PER_S
                may_m_s = LEAST_M_S
                if range_m > KEEP_M:
                    may_m_s = rate * (range_m - KEEP_M) + LEAST_M_S
                if may_m_s < most_m_s:
                    most_m_s = may_m_s
            if range_m < TOUCHING_M:
                least_m_s = 0.0 if 1 < i < 6 or range_m < CRAWL_M else CRAWL_M_S
                may_m_s = (range_m - RIM_M) * 4.0 / INNER[i]
                if may_m_s < least_m_s:
                    may_m_s = least_m_s
                if may_m_s < most_m_s:
                    most_m_s = may_m_s
    if free_mm < 400:  # more room takes nothing off the usual speed
        most_m_s = min(most_m_s, FREE_PER_S * 0.001 * free_mm)
    if error_rad != 0.0:
        cosine = max(cos(error_rad), 0.0)
        most_m_s *= cosine * cosine
    return most_m_s


def is_narrow(ring: Ring) -> bool:
    """Whether what is at both flanks leaves no room to tell whether the robot fits between."""
    ranges_m = ring.range_m
    right_m, left_m = ranges_m[0], ranges_m[7]
    if ranges_m[1] is not None and (right_m is None or ranges_m[1] < right_m):
        right_m = ranges_m[1]
    if ranges_m[6] is not None and (left_m is None or ranges_m[6] < left_m):
        left_m = ranges_m[6]
    return right_m is not None and left_m is not None and right_m + left_m < NARROW_M


def keep_off(ring: Ring) -> float:
    """How far to bias the heading away from a flank that is nearer than it should be."""
    if ring.nearest_m >= FLANK_M:
        return 0.0
    left_m = right_m = FLANK_M
    for i in EVERY:
        range_m = ring.range_m[i]
        if range_m is not None:
            if 1 < i < 6 and range_m < FRONT_M:
                # Until it is beside the robot, the guard will let nothing pass.
                range_m = range_m - FRONT_M
            if i < SONARS // 2:
                right_m = min(right_m, range_m)
            else:
                left_m = min(left_m, range_m)
    return FLANK_RAD * (left_m - right_m) / FLANK_M


def free_towards(ring: Ring, alpha_rad: float, distance_m: float, params: Params) -> float:
    """How far the robot could drive towards the goal at `alpha_rad` until something were a hit;
    0 where the sonars do not look, or one that does is silent."""
    if not -BESIDE < alpha_rad < BESIDE:
        return 0.0
    free_m = params.sonar_max_m
    for i in EVERY:
        range_m = ring.range_m[i]
        aside_rad = abs(BEARINGS[i] - alpha_rad) - HALF_CONE
        if range_m is None:
            if aside_rad < 0.0:
                return 0.0
            continue
        if range_m >= free_m:
            continue
        reach_m = range_m + params.radius_m
        if aside_rad <= 0.0:
            free_m = range_m
        elif reach_m * sin(aside_rad) < params.radius_m + MARGIN_M:
            free_m = min(free_m, reach_m * cos(aside_rad) - params.radius_m)
    if free_m >= distance_m:
        return distance_m
    return max(0.0, free_m - LOOK_M)
