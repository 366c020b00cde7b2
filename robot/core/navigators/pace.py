"""Limits of speed, heading and free distance from the sonar ranges."""

from math import inf, pi
from typing import Final

from robot.core.parameters import Params
from robot.core.perception.sonar_ring import SATURATED_M, Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import EVERY
from runtime.elementary import cos, cos_sin

# Speed limits. `_PER_S`: metres per second for each metre of free range. Sonars 2 to 5 look ahead,
# the others to the flanks. "Default" refers to the default parameters.
CLOSE_M: Final = 0.30
"""Farther echoes do not limit the speed; beyond 0.23 m the default 0.3 m/s is not reduced."""
HOLD_M: Final = 0.10
RISE_M: Final = 0.005
"""A range below HOLD_M grows by at most RISE_M in a tick, a saturated one from 0.

The end of a thin wall is seen by few pings, and does not vanish in between.
"""
STOP_M: Final = 0.004
"""With an echo ahead at most this far above the guard's stop range, the robot only turns.

The guard would reduce the speed, and the turn with it, to almost nothing.
"""
KEEP_M: Final = 0.03
LEAST_M_S: Final = 0.03
"""Ahead, the speed limit grows from LEAST_M_S at KEEP_M.

KEEP_M is below the default guard stop of 0.04 m, so the robot moves wherever the guard permits it.
"""
AHEAD_PER_S: Final = 1.4
"""Sonars 3 and 4: from 0.08 m on slower than the default guard, which then seldom acts.

The guard would also slow the turn.
"""
ASIDE_PER_S: Final = 2.0
"""Sonars 2 and 5: faster, because they look 34 degrees aside at obstacles to be passed."""
FREE_PER_S: Final = 0.9
"""Free distance to remembered echoes: slowest, and 0 at 0 m, as the guard ignores those."""
TOUCHING_M: Final = 0.08
"""A nearer echo, ahead or at a flank, limits the approach to RIM_M in a quarter of a second.

At larger ranges this does not reduce the default speed.
"""
RIM_M: Final = 0.025
CRAWL_M_S: Final = 0.04
NARROW_M: Final = 0.05
"""Limits beside a near flank.

The robot crawls past a flank even if its limit is 0, or it could not get away. At a saturated range
it only turns: it may touch the obstacle. With at most NARROW_M at both flanks together it stops: no
sonar shows whether the gap narrows further.
"""

# Heading bias.
FLANK_M: Final = 0.06
FLANK_RAD: Final = 40.0 * pi / 180.0
"""An echo nearer than FLANK_M on one side turns the heading away by FLANK_RAD at 0 m.

The turn is proportional; an echo on the other side compensates it.
"""
FRONT_M: Final = 0.05
"""An echo ahead nearer than this counts as nearer by this much, so it outweighs any flank."""

WEAVE_RAD: Final = 10.0 * pi / 180.0
WEAVE_M: Final = 0.45
WEAVE_FROM_M: Final = 0.6
"""With no echo ahead and the goal not nearer than WEAVE_FROM_M, the heading is WEAVE_RAD left of
the goal, and then right of it, for WEAVE_M each. It costs less than 1 % of the way.
"""

DITHER_RAD: Final = 5.0 * pi / 180.0
DITHER_M: Final = 0.14
"""On the way to the goal the heading is DITHER_RAD left of it, and then right of it, for DITHER_M
each. The robot follows with about half of that.

The end of a thin wall returns an echo at few bearings only. It may be missed all the way by a robot
that drives straight at it.
"""
SLOW_MM: Final = 250
DITHER_TURNS: Final = 4
"""While following, the heading is swept likewise if the free distance is below SLOW_MM, for
DITHER_TURNS turns of the echo memory to each side.
"""

# Free distance towards the goal.
BESIDE: Final = 0.5 * pi
"""Radians from the heading to the outer edge of the outermost cones."""
LOOK_M: Final = 0.25
"""The obstacle may begin this much before its echo; DistBug subtracts as much."""
MARGIN_M: Final = 0.02
"""An obstacle is passed with at least this margin, as the tight margin of the headings."""
INNER: Final = tuple([cos(max(abs(b) - HALF_CONE, 0.0)) for b in BEARINGS])
"""Share of the speed with which the robot approaches an echo at the inner edge of a cone."""


class Held:
    """The ranges of the sonars, of which near ones are held; inf if there is none."""

    __slots__ = ("nearest_m", "range_m")

    def __init__(self) -> None:
        self.range_m = [inf] * SONARS
        self.nearest_m = inf


def hold(held: Held, ring: Ring) -> None:
    """Update the held ranges with those of a ring."""
    least_m, ranges_m, held_m = inf, ring.range_m, held.range_m
    if held.nearest_m >= HOLD_M and ring.nearest_m >= SATURATED_M:  # the ring as it is
        for i in EVERY:
            range_m = ranges_m[i]
            held_m[i] = inf if range_m is None else range_m
        held.nearest_m = ring.nearest_m
        return
    for i in EVERY:
        range_m, here_m = ranges_m[i], held_m[i]
        here_m = here_m + RISE_M if here_m < HOLD_M else inf
        if range_m is not None and range_m < here_m:
            here_m = range_m if range_m >= SATURATED_M else 0.0
        held_m[i] = here_m
        if here_m < least_m:
            least_m = here_m
    held.nearest_m = least_m


def speed(held: Held, free_mm: int, error_rad: float, params: Params) -> float:
    """Return the speed limit: lower near an echo, and while the heading error is large."""
    most_m_s = params.v_max_m_s
    if held.nearest_m < CLOSE_M:
        held_m = held.range_m
        stop_m = params.guard_stop_m + STOP_M
        if held.nearest_m < NARROW_M and is_narrow(held_m):
            return 0.0
        for i in EVERY:
            range_m = held_m[i]
            if range_m >= CLOSE_M:
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
                least_m_s = 0.0 if 1 < i < 6 or range_m < SATURATED_M else CRAWL_M_S
                may_m_s = (range_m - RIM_M) * 4.0 / INNER[i]
                if may_m_s < least_m_s:
                    may_m_s = least_m_s
                if may_m_s < most_m_s:
                    most_m_s = may_m_s
    if free_mm < 400:  # more range does not reduce the default speed
        most_m_s = min(most_m_s, FREE_PER_S * 0.001 * free_mm)
    if error_rad != 0.0:
        cosine = max(cos(error_rad), 0.0)
        most_m_s *= cosine * cosine
    return most_m_s


def is_narrow(held_m: "list[float]") -> bool:
    """Return whether the echoes at both flanks leave too little room to pass safely."""
    return min(held_m[0], held_m[1]) + min(held_m[6], held_m[7]) < NARROW_M


def keep_off(held: Held) -> float:
    """Return the heading bias in radians away from a flank that is too near."""
    if held.nearest_m >= FLANK_M:
        return 0.0
    held_m = held.range_m
    left_m = right_m = FLANK_M
    for i in EVERY:
        range_m = held_m[i]
        if range_m < SATURATED_M:
            range_m = 0.0
        if 1 < i < 6 and range_m < FRONT_M:
            # Until the obstacle is beside the robot, the guard stops forward motion.
            range_m = range_m - FRONT_M
        if i < SONARS // 2:
            right_m = min(right_m, range_m)
        else:
            left_m = min(left_m, range_m)
    return FLANK_RAD * (left_m - right_m) / FLANK_M


def weave(ring: Ring, distance_m: float) -> float:
    """Return the heading bias in radians to either side of the way to the goal.

    It is 0 near the goal, and unless both sonars ahead are without an echo: then a corner may point
    at the robot, which is seen only from a little aside.
    """
    if distance_m < WEAVE_FROM_M or ring.range_m[3] != inf or ring.range_m[4] != inf:
        return 0.0
    return WEAVE_RAD if int(distance_m / WEAVE_M) & 1 else -WEAVE_RAD


def dither(distance_m: float) -> float:
    """Return the heading bias in radians by which the cones sweep to and fro; 0 near the goal."""
    if distance_m < WEAVE_FROM_M:
        return 0.0
    return DITHER_RAD if int(distance_m / DITHER_M) & 1 else -DITHER_RAD


def sweep(turn: int) -> float:
    """Return the heading bias in radians by which the cones sweep to and fro while following.

    `turn` counts the turns of the echo memory (`Echoes.turn`).
    """
    return DITHER_RAD if turn // DITHER_TURNS & 1 else -DITHER_RAD


def free_towards(ring: Ring, alpha_rad: float, distance_m: float, params: Params) -> float:
    """Return the free distance towards the goal at `alpha_rad`, at most `distance_m`.

    It is 0 if no sonar looks there, or if one that does has no measurement.
    """
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
        else:
            cosine, sine = cos_sin(aside_rad)
            if reach_m * sine < params.radius_m + MARGIN_M:
                free_m = min(free_m, reach_m * cosine - params.radius_m)
    if free_m >= distance_m:
        return distance_m
    return max(0.0, free_m - LOOK_M)
