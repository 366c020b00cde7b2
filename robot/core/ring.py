"""The ring of eight sonars: what each saw last, how old that is, and what is nearest."""

from math import inf

from robot.core.geometry import BEARINGS
from robot.core.parameters import Params
from robot.core.typed import Final
from robot.core.values import SONARS, Scan

FRONT: Final = (2, 3, 4, 5)
AHEAD: Final = (3, 4)
NEVER_MS: Final = -1_000_000
NOISY: Final = 3  # echoes that changed before a standing robot, until they are called noisy
RIGHT_SIDE: Final = 0x0F
LEFT_SIDE: Final = 0xF0
BEYOND: Final = 1.1  # noise may carry a true echo a little beyond the maximum range


class Ring:
    """`range_m[i]` is a range, inf for no echo, or None for a sonar that is missing or stale.

    `nearest` is the index of the nearest echo or -1, `fresh` the number of sonars not missing,
    `front_m` the nearest echo within 45 degrees of the heading. `frozen` and `impossible` are
    verdicts on the sonars themselves.
    """

    __slots__ = (
        "echo",
        "fresh",
        "front_m",
        "frozen",
        "impossible",
        "moved_m",
        "nearest",
        "nearest_m",
        "pinged_ms",
        "range_m",
        "range_mm",
        "still",
        "still_changes",
        "turned_rad",
    )

    def __init__(self) -> None:
        self.range_m: list[float | None] = [None] * SONARS
        self.pinged_ms = [NEVER_MS] * SONARS
        self.nearest = -1
        self.nearest_m = self.front_m = inf
        self.fresh = 0
        self.range_mm: tuple[int, ...] = ()
        self.echo = 0
        self.moved_m = self.turned_rad = 0.0
        self.frozen = self.impossible = self.still = False
        self.still_changes = 0


def bearing_rad(ring: Ring) -> float | None:
    """Bearing of the nearest echo (beta of the paper, positive to the left); None without one."""
    return BEARINGS[ring.nearest] if ring.nearest >= 0 else None


def update(ring: Ring, scan: Scan | None, now_ms: int, params: Params) -> None:
    """Take a scan, drop what is older than a sonar may be, and find the nearest echo."""
    if scan is not None:
        take(ring, scan, now_ms, params)
    oldest_ms = now_ms - params.sonar_stale_ms
    pinged_ms, range_m = ring.pinged_ms, ring.range_m
    ring.nearest, ring.nearest_m, ring.fresh = -1, inf, 0
    for i in range(SONARS):
        if pinged_ms[i] < oldest_ms:
            range_m[i] = None
            continue
        ring.fresh += 1
        here_m = range_m[i]
        if here_m is not None and here_m < ring.nearest_m:
            ring.nearest_m = here_m
            ring.nearest = i
    ring.front_m = inf
    for i in FRONT:
        here_m = range_m[i]
        if here_m is not None and here_m < ring.front_m:
            ring.front_m = here_m


def take(ring: Ring, scan: Scan, now_ms: int, params: Params) -> None:
    """Store what the sonars that measured saw; a value that cannot be is no measurement."""
    limit_mm = params.sonar_max_m * 1000.0 * BEYOND
    ring.impossible = False
    bit = 1
    for i in range(SONARS):
        if scan.valid & bit:
            here_mm = scan.range_mm[i]
            if not scan.echo & bit:
                ring.range_m[i] = inf
                ring.pinged_ms[i] = now_ms - scan.age_ms[i]
            elif 0 < here_mm <= limit_mm:
                ring.range_m[i] = here_mm / 1000.0
                ring.pinged_ms[i] = now_ms - scan.age_ms[i]
            else:
                ring.impossible = True
        bit += bit


def watch_frozen(
    ring: Ring, scan: Scan | None, moved_m: float, turned_rad: float, params: Params
) -> None:
    """Judge whether the echoes have stopped following the motion.

    Unchanged to the millimetre while the wheels rolled `freeze_m` is proof only if something had
    to change: the sonars have been seen to be noisy, something is close ahead, or the robot
    turned. Without noise a robot between parallel walls sees the same all along, and so does one
    that circles a disc: a turn counts when it is tight or there are echoes on both sides.
    """
    if scan is None:
        return
    echo = scan.echo & scan.valid
    if echo != ring.echo or scan.range_mm != ring.range_mm or echo == 0:
        ring.still_changes += 1 if moved_m == 0.0 and ring.still and echo == ring.echo else 0
        ring.still = moved_m == 0.0
        ring.echo, ring.range_mm = echo, scan.range_mm
        ring.moved_m = ring.turned_rad = 0.0
        ring.frozen = False
        return
    ring.moved_m += moved_m
    turn_rad = abs(turned_rad)
    if moved_m <= turn_rad * params.radius_m or (echo & RIGHT_SIDE and echo & LEFT_SIDE):
        ring.turned_rad += turn_rad
    ring.frozen = ring.moved_m >= params.freeze_m and (
        ring.still_changes >= NOISY
        or ring.turned_rad >= params.freeze_rad
        or is_close_ahead(ring, params.freeze_front_m)
    )


def is_close_ahead(ring: Ring, range_m: float) -> bool:
    for i in AHEAD:
        here_m = ring.range_m[i]
        if here_m is not None and here_m < range_m:
            return True
    return False
