"""Whether the echoes have stopped following the motion: sonars that repeat what they measured.

Unchanged to the millimetre while the wheels rolled `freeze_m` is proof only if something had to
change. Without noise a robot that drives straight between parallel walls sees the same all along,
and so does one that circles a disc. So it counts when the sonars have been seen to be noisy, when
the robot turned tightly or between echoes, when something close ahead should have come closer, or
when it drove straight and the echoes are not those of walls along its way.
"""

from math import pi, sin

from robot.core.geometry import BEARINGS, HALF_CONE
from robot.core.parameters import Params
from robot.core.ring import AHEAD
from robot.core.typed import Final
from robot.core.values import SONARS, Scan

NOISY: Final = 3  # echoes that changed before a standing robot, until they are called noisy
RIGHT_SIDE: Final = 0x0F
LEFT_SIDE: Final = 0xF0
STRAIGHT_RAD_PER_M: Final = 0.5
WALL_SHARE: Final = 0.15  # rays do not look exactly along the edge of the cone
WALL_SLACK_M: Final = 0.02
EDGE_SINES: Final = tuple([sin(min(abs(b) + HALF_CONE, 0.5 * pi)) for b in BEARINGS])


class Frozen:
    """The last new echoes, and what the robot did since; `verdict` says whether they are frozen."""

    __slots__ = (
        "echo",
        "moved_m",
        "range_mm",
        "still",
        "still_changes",
        "swung_rad",
        "turned_rad",
        "verdict",
    )

    def __init__(self) -> None:
        self.range_mm: tuple[int, ...] = ()
        self.echo = 0
        self.moved_m = self.turned_rad = self.swung_rad = 0.0
        self.still_changes = 0
        self.still = self.verdict = False


def watch(
    frozen: Frozen, scan: Scan | None, moved_m: float, turned_rad: float, params: Params
) -> None:
    """Judge one scan and the motion before it; a single changed echo clears the verdict."""
    if scan is None:
        return
    echo = scan.echo & scan.valid
    if echo != frozen.echo or scan.range_mm != frozen.range_mm or echo == 0:
        frozen.still_changes += moved_m == 0.0 and frozen.still and echo == frozen.echo
        frozen.still = moved_m == 0.0
        frozen.echo, frozen.range_mm = echo, scan.range_mm
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


def had_to_change(frozen: Frozen, scan: Scan, params: Params) -> bool:
    """Whether anything proves that these echoes cannot have stayed as they are."""
    if frozen.still_changes >= NOISY or frozen.turned_rad >= params.freeze_rad:
        return True
    for i in AHEAD:
        if frozen.echo >> i & 1 and scan.range_mm[i] < params.freeze_front_m * 1000.0:
            return True
    straight = frozen.swung_rad <= STRAIGHT_RAD_PER_M * frozen.moved_m
    return straight and not (
        is_wall_along(scan, 0, 1, params) and is_wall_along(scan, 7, -1, params)
    )


def is_wall_along(scan: Scan, outermost: int, inwards: int, params: Params) -> bool:
    """Whether one side sees nothing, or one wall parallel to the way: from abeam to some bearing,
    every sonar by its distance over the sine of the edge of its cone."""
    wall_m = 0.0
    open_ahead = False
    for k in range(SONARS // 2):
        i = outermost + inwards * k
        if not scan.valid >> i & 1:
            continue
        if not scan.echo >> i & 1:
            open_ahead = True
            continue
        aside_m = (scan.range_mm[i] / 1000.0 + params.radius_m) * EDGE_SINES[i]
        if open_ahead:
            return False
        if wall_m == 0.0:
            wall_m = aside_m
        elif abs(aside_m - wall_m) > WALL_SHARE * wall_m + WALL_SLACK_M:
            return False
    return True
