"""The ring of eight sonars: latest range and age of each, and the nearest echo."""

from math import inf
from typing import Final

from robot.core.geometry import BEARINGS
from robot.core.parameters import Params
from robot.core.perception.pedestrians import Pedestrians
from robot.core.values import EVERY, SONARS, Scan

FRONT: Final = (2, 3, 4, 5)
AHEAD: Final = (3, 4)
NEVER_MS: Final = -1_000_000
BEYOND: Final = 1.1  # noise may carry a true echo a little beyond the maximum range
SATURATED_M: Final = 0.0205
"""Below it a range is an upper bound: our sonars measure none below 0.02 m, however near."""


class Ring:
    """The latest usable measurement of each sonar.

    `range_m[i]` is a range, inf for no echo, or None for a missing or stale measurement. `nearest`
    is the index of the nearest echo or -1, and `fresh` counts the sonars that are not missing.
    `front_m` is the nearest echo within 45 degrees of the heading. `impossible` is set if the last
    scan contained an impossible range. `approach_m_s[i]` is the speed at which an echo approaches
    beyond the robot's own motion, 0 if unknown or without an echo; `pedestrians` holds the tracks
    behind it (see `closing_speed`).
    """

    __slots__ = (
        "approach_m_s",
        "fresh",
        "front_m",
        "impossible",
        "nearest",
        "nearest_m",
        "pedestrians",
        "pinged_ms",
        "range_m",
    )

    def __init__(self) -> None:
        self.range_m: list[float | None] = [None] * SONARS
        self.pinged_ms = [NEVER_MS] * SONARS
        self.approach_m_s = [0.0] * SONARS
        self.pedestrians = Pedestrians()
        self.nearest = -1
        self.nearest_m = self.front_m = inf
        self.fresh = 0
        self.impossible = False


def bearing_rad(ring: Ring) -> float | None:
    """Return the bearing of the nearest echo (beta of the paper, positive left), or None."""
    return BEARINGS[ring.nearest] if ring.nearest >= 0 else None


def update(ring: Ring, scan: Scan | None, now_ms: int, params: Params) -> None:
    """Take a scan, drop stale measurements, and find the nearest echo."""
    if scan is not None:
        take(ring, scan, now_ms, params)
    oldest_ms = now_ms - params.sonar_stale_ms
    pinged_ms, range_m = ring.pinged_ms, ring.range_m
    nearest, nearest_m, fresh = -1, inf, 0
    for i in EVERY:
        if pinged_ms[i] < oldest_ms:
            range_m[i] = None
            continue
        fresh += 1
        here_m = range_m[i]
        if here_m is not None and here_m < nearest_m:
            nearest, nearest_m = i, here_m
    ring.nearest, ring.nearest_m, ring.fresh = nearest, nearest_m, fresh
    front_m = inf
    if nearest in FRONT:
        front_m = nearest_m
    else:
        for i in FRONT:
            here_m = range_m[i]
            if here_m is not None and here_m < front_m:
                front_m = here_m
    ring.front_m = front_m


def take(ring: Ring, scan: Scan, now_ms: int, params: Params) -> None:
    """Store the measurements of a scan; an impossible value is none."""
    limit_mm = int(params.sonar_max_m * 1000.0 * BEYOND)
    range_mm, age_ms, valid, echo = scan.range_mm, scan.age_ms, scan.valid, scan.echo
    range_m, pinged_ms = ring.range_m, ring.pinged_ms
    ring.impossible = False
    bit = 1
    for i in EVERY:
        if valid & bit:
            here_mm = range_mm[i]
            if not echo & bit:
                range_m[i] = inf
                pinged_ms[i] = now_ms - age_ms[i]
            elif here_mm > 0 and here_mm <= limit_mm:
                range_m[i] = here_mm / 1000.0
                pinged_ms[i] = now_ms - age_ms[i]
            else:
                ring.impossible = True
        bit += bit
