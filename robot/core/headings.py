"""Which headings are open: every near point closes a sector, and a sweep finds the next free one.

The disc of the robot, grown by a margin, must be able to move a look-ahead along a heading without
meeting a remembered point. So a point closes the sector of headings around its bearing for which
it does not; sectors are exact, there are no bins.
"""

from math import acos, asin, atan2, cos, pi, sin, sqrt

from robot.core.echoes import CONE, CORE_RAD, SURE, THROUGH_M, Echoes
from robot.core.parameters import Params
from robot.core.ring import Ring
from robot.core.typed import Final
from robot.core.values import Pose

NEAR: Final = 40
"""At most this many points close sectors at a time."""
LOOK_M: Final = 0.20
TIGHT_M: Final = 0.02
WIDE_M: Final = 0.08
SQUEEZE_M: Final = 0.01
DOUBT: Final = 1.25
TWO_PI: Final = 2.0 * pi
HALF_TURN: Final = 0.5 * pi
NOTHING: Final = -1


class Sectors:
    """Bearings of the near points in the odometry frame, and half the sector each closes, with
    the tight margin and with the wide one; `point` is its index among the echoes."""

    __slots__ = (
        "away_m",
        "bearing_rad",
        "closing",
        "count",
        "doubt_m",
        "from_rad",
        "point",
        "squeezed_rad",
        "tight_rad",
        "wide_rad",
    )

    def __init__(self) -> None:
        self.count = 0
        self.point = [0] * NEAR
        self.away_m = [0.0] * NEAR
        self.doubt_m = [0.0] * NEAR
        self.bearing_rad = [0.0] * NEAR
        self.tight_rad = [0.0] * NEAR
        self.squeezed_rad = [0.0] * NEAR
        self.wide_rad = [0.0] * NEAR
        self.from_rad = [0.0] * NEAR
        self.closing = NOTHING


def measure(
    sectors: Sectors, echoes: Echoes, pose: Pose, ring: Ring, ease_m: float, params: Params
) -> None:
    """Collect the points that are near enough to close anything; `ease_m` is taken off margins."""
    reach_mm = 1000.0 * (LOOK_M + params.radius_m + WIDE_M)
    x_mm, y_mm = 1000.0 * pose.x_m, 1000.0 * pose.y_m
    xs, ys, weight = echoes.x_mm, echoes.y_mm, echoes.weight
    n = 0
    for k in range(echoes.count):
        dx_mm = xs[k] - x_mm
        if not -reach_mm < dx_mm < reach_mm:
            continue
        dy_mm = ys[k] - y_mm
        if not -reach_mm < dy_mm < reach_mm or weight[k] < SURE:
            continue
        away_m = 0.001 * sqrt(dx_mm * dx_mm + dy_mm * dy_mm)
        if away_m < params.radius_m:
            push_out(echoes, k, pose, away_m, params)
            away_m = params.radius_m
        doubt_m = 0.001 * DOUBT * echoes.spread_mm[k]
        body_m = params.radius_m - doubt_m - ease_m
        wide_rad = closed(away_m, body_m + WIDE_M)
        if wide_rad <= 0.0 or n >= NEAR:
            continue
        sectors.point[n] = k
        sectors.away_m[n] = away_m
        bearing_rad = atan2(dy_mm, dx_mm)
        if passed_through(ring, bearing_rad - pose.heading_rad, away_m - params.radius_m):
            weight[k] -= 1
        sectors.bearing_rad[n] = bearing_rad
        sectors.wide_rad[n] = wide_rad
        sectors.doubt_m[n] = doubt_m + ease_m
        sectors.tight_rad[n] = closed(away_m, body_m + TIGHT_M)
        n += 1
    sectors.count = n


def push_out(echoes: Echoes, k: int, pose: Pose, away_m: float, params: Params) -> None:
    """Where the robot stands there is no obstacle: the echo came from beyond its rim."""
    if away_m > 0.0:
        stretch = params.radius_m / away_m
        x_mm, y_mm = 1000.0 * pose.x_m, 1000.0 * pose.y_m
        echoes.x_mm[k] = int(x_mm + stretch * (echoes.x_mm[k] - x_mm))
        echoes.y_mm[k] = int(y_mm + stretch * (echoes.y_mm[k] - y_mm))


def passed_through(ring: Ring, bearing_rad: float, range_m: float) -> bool:
    """Whether the sonar that looks there hears an echo from well behind."""
    bearing_rad = (bearing_rad + pi) % TWO_PI - HALF_TURN
    if not 0.0 < bearing_rad < pi:
        return False
    sonar = int(bearing_rad / CONE)
    if not -CORE_RAD < bearing_rad - (sonar + 0.5) * CONE < CORE_RAD:
        return False
    echo_m = ring.range_m[sonar]
    return echo_m is not None and range_m + THROUGH_M < 0.97 * echo_m < 9.0


def closed(away_m: float, body_m: float) -> float:
    """Half the sector of headings along which a disc of `body_m` meets a point within the look."""
    if away_m >= LOOK_M + body_m:
        return 0.0
    if away_m <= body_m:
        return HALF_TURN
    if away_m * away_m - body_m * body_m <= LOOK_M * LOOK_M:
        return asin(body_m / away_m)
    cosine = (away_m * away_m + LOOK_M * LOOK_M - body_m * body_m) / (2.0 * away_m * LOOK_M)
    return acos(cosine) if cosine < 1.0 else 0.0


def is_open(sectors: Sectors, heading_rad: float, half_rad: "list[float]") -> bool:
    """Whether no point closes this heading; `half_rad`: `tight_rad` or `wide_rad`."""
    bearing_rad = sectors.bearing_rad
    for k in range(sectors.count):
        off_rad = (bearing_rad[k] - heading_rad + pi) % TWO_PI - pi
        if -half_rad[k] < off_rad < half_rad[k]:
            return False
    return True


def sweep(sectors: Sectors, start_rad: float, side: int, half_rad: "list[float]") -> float:
    """How far to turn from `start_rad` towards `side` until a heading is open, 0 to 2 pi.

    `closing` is then the number of the sector that closes the heading just before; NOTHING when
    the start itself is open. 2 pi or more: every heading is closed.
    """
    from_rad, bearing_rad, n = sectors.from_rad, sectors.bearing_rad, sectors.count
    for k in range(n):
        from_rad[k] = (side * (bearing_rad[k] - start_rad) + pi) % TWO_PI - pi
    turn_rad = 0.0
    sectors.closing = NOTHING
    for _ in range(n + 1):
        moved = False
        for k in range(n):
            half = half_rad[k]
            off_rad = turn_rad - from_rad[k]
            if off_rad > pi:
                off_rad -= TWO_PI
            if -half < off_rad < half:
                turn_rad += half - off_rad + 1e-6
                sectors.closing = k
                moved = True
        if not moved or turn_rad >= TWO_PI:
            break
    return turn_rad


def squeeze(sectors: Sectors, params: Params) -> None:
    """Work out the sectors without any margin."""
    for k in range(sectors.count):
        body_m = params.radius_m - sectors.doubt_m[k] - SQUEEZE_M
        sectors.squeezed_rad[k] = closed(sectors.away_m[k], body_m)


def room(sectors: Sectors, turn_rad: float, half_rad: "list[float]") -> float:
    """How much farther headings stay open beyond the one that the last sweep ended with."""
    least_rad = pi
    for k in range(sectors.count):
        if half_rad[k] > 0.0:
            ahead_rad = (sectors.from_rad[k] - half_rad[k] - turn_rad) % TWO_PI
            if ahead_rad < least_rad:
                least_rad = ahead_rad
    return least_rad


def free_ahead(sectors: Sectors, heading_rad: float, params: Params) -> float:
    """How far the robot can drive on along its heading before it would touch a near point; at most
    a metre."""
    free_m = 1.0
    for k in range(sectors.count):
        away_m = sectors.away_m[k]
        body_m = params.radius_m - sectors.doubt_m[k]
        off_rad = sectors.bearing_rad[k] - heading_rad
        along_m = away_m * cos(off_rad)
        if along_m <= 0.0:
            continue
        aside_m = away_m * sin(off_rad)
        if -body_m < aside_m < body_m:
            here_m = along_m - sqrt(body_m * body_m - aside_m * aside_m)
            if here_m < free_m:
                free_m = here_m
    return max(free_m, 0.0)
