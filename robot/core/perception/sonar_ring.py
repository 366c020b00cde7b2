"""The ring of eight sonars: latest range and age of each, the nearest echo, and frozen sonars.

The echoes of a frozen sonar no longer follow the robot's motion. Ranges that stay the same to the
millimetre over `freeze_m` are proof only if they had to change. Without noise they also stay the
same for a robot that drives straight between parallel walls, or circles a disc. So they count in
these cases: the sonars are known to be noisy; the robot turned tightly or between echoes; an
obstacle close ahead should have come closer; an obstacle ahead came closer at the robot's speed and
then stopped from one scan to the next.
"""

from math import inf
from typing import Final

from robot.core.parameters import Params
from robot.core.perception.people import Pedestrians
from robot.core.ring import BEARINGS, SONARS
from robot.core.values import EVERY, Scan

FRONT: Final = (2, 3, 4, 5)
AHEAD: Final = (3, 4)
NEVER_MS: Final = -1_000_000
CLAMPED_M: Final = 0.03  # nearer than a sonar can measure, every echo seems static
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
    range_mm, age_ms, valid, echo = scan
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


NOISY: Final = 3  # changed scans of a stationary robot until sonars count as noisy
RIGHT_SIDE: Final = 0x0F
LEFT_SIDE: Final = 0xF0
STRAIGHT_RAD_PER_M: Final = 0.5
CLOSING: Final = 3  # scans in a row with a closer echo ahead until it counts as closing
CLOSING_SHARE: Final = 0.9
SWING_MM: Final = 4
SWING_SHARE: Final = 2.0  # maximum change of a range by turning, along an oblique wall
LEAP_MM: Final = 100  # a larger change is another echo
SWINGS: Final = 4  # alternating changes in a row until a sonar counts as noisy


class FrozenSonar:
    """The last new echoes and the motion since; `verdict` is set if they are frozen."""

    __slots__ = (
        "change_mm",
        "closing",
        "echo",
        "moved_m",
        "noise",
        "range_mm",
        "still",
        "swings",
        "swung_rad",
        "turned_rad",
        "verdict",
    )

    def __init__(self) -> None:
        self.range_mm: tuple[int, ...] = ()
        self.echo = 0
        self.moved_m = self.turned_rad = self.swung_rad = 0.0
        self.noise = self.closing = 0
        self.change_mm = [0] * SONARS
        self.swings = [0] * SONARS
        self.still = self.verdict = False


def watch(
    frozen: FrozenSonar, scan: Scan | None, moved_m: float, turned_rad: float, params: Params
) -> None:
    """Judge one scan and the motion before it; one changed echo resets the verdict."""
    if scan is None:
        return
    range_mm, _, valid, echo = scan
    echo &= valid
    if echo != frozen.echo or range_mm != frozen.range_mm or echo == 0:
        frozen.noise += moved_m == 0.0 and frozen.still and echo == frozen.echo
        frozen.still = moved_m == 0.0
        if frozen.noise < NOISY:
            compare(frozen, range_mm, echo & frozen.echo, moved_m, abs(turned_rad))
        frozen.echo, frozen.range_mm = echo, range_mm
        frozen.moved_m = frozen.turned_rad = frozen.swung_rad = 0.0
        frozen.verdict = False
        return
    turn_rad = abs(turned_rad)
    frozen.moved_m += moved_m
    frozen.swung_rad += turn_rad
    if moved_m <= turn_rad * params.radius_m or (echo & RIGHT_SIDE and echo & LEFT_SIDE):
        frozen.turned_rad += turn_rad
    if frozen.moved_m >= params.freeze_m:
        frozen.verdict = had_to_change(frozen, scan, params)


def had_to_change(frozen: FrozenSonar, scan: Scan, params: Params) -> bool:
    """Return whether these echoes must have changed."""
    if frozen.noise >= NOISY or frozen.turned_rad >= params.freeze_rad:
        return True
    for i in AHEAD:
        if frozen.echo >> i & 1 and scan.range_mm[i] < params.freeze_front_m * 1000.0:
            return True
    straight = frozen.swung_rad <= STRAIGHT_RAD_PER_M * frozen.moved_m
    return straight and frozen.closing >= CLOSING


def compare(
    frozen: FrozenSonar, range_mm: "tuple[int, ...]", both: int, moved_m: float, turned_rad: float
) -> None:
    """Compare new echoes with the last: closing with the motion ahead, alternating by noise.

    `both` masks the sonars with an echo in both scans.
    """
    before_mm, changes_mm, swings = frozen.range_mm, frozen.change_mm, frozen.swings
    closing = False
    for i in EVERY:
        change_mm = range_mm[i] - before_mm[i] if both >> i & 1 else 0
        if i in AHEAD and moved_m > 0.0 and -change_mm >= CLOSING_SHARE * 1000.0 * moved_m:
            closing = True
        swung = change_mm * changes_mm[i] < 0
        changes_mm[i] = change_mm
        if swung:
            least_mm = SWING_MM + SWING_SHARE * turned_rad * range_mm[i]
            swung = least_mm <= abs(change_mm) < LEAP_MM
        swings[i] = swings[i] + 1 if swung else 0
        if swings[i] >= SWINGS:
            frozen.noise = NOISY
    frozen.closing = frozen.closing + 1 if closing else 0
