"""How fast and how far the sonars let the robot go: what lies ahead, at the flanks, goalwards."""

from math import cos, pi, sin

from robot.core.geometry import BEARINGS, HALF_CONE
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.typed import Final
from robot.core.values import SONARS

STOP_M: Final = 0.004
FRONT_M: Final = 0.05
CLOSE_M: Final = 0.30
KEEP_M: Final = 0.03
AHEAD_PER_S: Final = 1.4
ASIDE_PER_S: Final = 2.0
FREE_PER_S: Final = 0.9
LEAST_M_S: Final = 0.03
TOUCHING_M: Final = 0.08
RIM_M: Final = 0.025
CRAWL_M: Final = 0.015
CRAWL_M_S: Final = 0.04
FLANK_M: Final = 0.06
FLANK_RAD: Final = 40.0 * pi / 180.0
BESIDE: Final = 0.5 * pi
LOOK_M: Final = 0.25
MARGIN_M: Final = 0.02
INNER: Final = tuple([cos(max(abs(b) - HALF_CONE, 0.0)) for b in BEARINGS])
"""How much of its speed the robot closes in with on what is at the inner edge of a cone."""


def speed(ring: Ring, free_mm: int, error_rad: float, params: Params) -> float:
    """The most speed: slower the nearer something is, and while the heading is `error_rad` off."""
    most_m_s = params.v_max_m_s
    if ring.nearest_m < CLOSE_M:
        stop_m, ranges_m = params.guard_stop_m + STOP_M, ring.range_m
        for i in range(SONARS):
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
    if free_mm < 400:
        most_m_s = min(most_m_s, FREE_PER_S * 0.001 * free_mm)
    if error_rad != 0.0:
        cosine = max(cos(error_rad), 0.0)
        most_m_s *= cosine * cosine
    return most_m_s


def keep_off(ring: Ring) -> float:
    """How far to bias the heading away from a flank that is nearer than it should be."""
    if ring.nearest_m >= FLANK_M:
        return 0.0
    left_m = right_m = FLANK_M
    for i in range(SONARS):
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
    for i in range(SONARS):
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
