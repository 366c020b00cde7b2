"""Remove stored echoes that are far away, old, or contradicted by longer echoes.

Bearings and cones are brads: integers, 4096 to the circle.
"""

from typing import Final

from robot.core.perception.echoes import (
    BRADS,
    CIRCLE,
    CONE,
    HALF_CIRCLE,
    NOTHING,
    QUARTER,
    SURE,
    Echoes,
    drop,
)
from robot.core.perception.sonar_ring import AHEAD, Ring
from robot.core.values import EVERY, Pose
from runtime.elementary import coarse_atan2

CORE: Final = 102  # 0.8 of half a cone
CORE_FROM: Final = CONE // 2 - CORE
CORE_TO: Final = CONE // 2 + CORE
FORGET_MM2: Final = 900 * 900
THROUGH_MM: Final = 70
SLICES: Final = 2
"""Number of slices of the points; one slice is checked at a time."""
FADE_TURNS: Final = 40
"""All points lose weight once in this many turns."""


def fade(echoes: Echoes, pose: Pose) -> None:
    """Check one slice of the points.

    Far points are dropped. Points that an echo passes through lose weight and, once in FADE_TURNS,
    all points do.
    """
    echoes.turn = turn = (echoes.turn + 1) % FADE_TURNS
    x_mm, y_mm = int(1000.0 * pose.x_m), int(1000.0 * pose.y_m)
    heading = int(BRADS * pose.heading_rad)
    xs, ys, weight = echoes.x_mm, echoes.y_mm, echoes.weight
    through_mm2 = echoes.through_mm2
    most_mm2 = max(through_mm2)
    old = turn < SLICES
    for k in range(echoes.count - 1 - turn % SLICES, -1, -SLICES):
        dx_mm, dy_mm = xs[k] - x_mm, ys[k] - y_mm
        square = dx_mm * dx_mm + dy_mm * dy_mm
        if square > FORGET_MM2:
            drop(echoes, k)
            continue
        weaker = old
        if square < most_mm2:
            bearing = int(BRADS * coarse_atan2(dy_mm, dx_mm)) - heading
            weaker = weaker or square < through_mm2[contradicting(bearing, weight[k])]
        if weaker and weight[k]:
            weight[k] -= 1
        if weight[k] == 0:
            drop(echoes, k)


def update_through(echoes: Echoes, ring: Ring, radius_mm: int) -> None:
    """Update the distance up to which each sonar contradicts stored points.

    No echo contradicts nothing: a wall at an oblique angle returns none.
    """
    if echoes.count == 0:
        return
    through_mm2, range_m = echoes.through_mm2, ring.range_m
    for i in EVERY:
        echo_m = range_m[i]
        if echo_m is None or echo_m > 9.0:
            through_mm2[i] = 0
        else:
            through_mm = int(970.0 * echo_m) - THROUGH_MM + radius_mm
            through_mm2[i] = through_mm * through_mm if through_mm > 0 else 0


def contradicting(bearing: int, weight: int) -> int:
    """Return the sonar whose longer echo contradicts a point, or NOTHING.

    It is the one whose inner cone contains the bearing in brads. The two front sonars contradict
    no single echo: the end of a thin wall returns few among longer ones, and lies in the way.
    """
    from_right = (bearing + QUARTER) % CIRCLE
    if from_right < HALF_CIRCLE and CORE_FROM < from_right % CONE < CORE_TO:
        sonar = from_right // CONE
        if weight >= SURE or sonar not in AHEAD:
            return sonar
    return NOTHING
