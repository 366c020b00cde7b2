"""What comes nearer by itself: how fast the echoes close in beyond the robot's own motion.

Turning on the spot moves an echo from cone to cone and leaves its range. So only the cones nearer
than both their neighbours are followed, each from wherever it or a neighbour was one scan before.
Where everything stands still no echo nears faster than the robot drives at it; what does, walks.
"""

from math import cos, inf

from robot.core.geometry import BEARINGS, COSINES, HALF_CONE
from robot.core.parameters import Params
from robot.core.ring import FRONT, Ring
from robot.core.typed import Final
from robot.core.values import SONARS

FAR_M: Final = 0.8
SMOOTH: Final = 0.4  # of a range's surprise that is believed; the rate is critically damped for it
SMOOTH_RATE: Final = 0.1
GATE_M: Final = 0.02  # a surprise greater than this, and a share of the range, is another echo
GATE_SHARE: Final = 0.04
SURE: Final = 8  # scans in which an echo was followed, until its rate counts
MOST: Final = 12
MISSED: Final = 3  # a scan without it takes away as much as so many with it gave
LEAST_M_S: Final = 0.04  # slower than this, and a share of the range, is noise
LEAST_SHARE_PER_S: Final = 0.06
WAIT_M: Final = 0.25
WAIT_S: Final = 2.0

UNSURE: Final = tuple([cos(max(abs(b) - HALF_CONE, 0.0)) - cos(b) for b in BEARINGS])
"""How much of the robot's speed an echo in this cone may see beyond what its middle sees."""
FORGET: Final = 0.95


class Closing:
    """Per cone: the range as followed, how fast it falls by itself, in how many scans it was seen.

    `lately_m_s` is how fast the robot has driven lately.
    """

    __slots__ = (
        "lately_m_s",
        "old_range_m",
        "old_rate_m_s",
        "old_seen",
        "range_m",
        "rate_m_s",
        "seen",
    )

    def __init__(self) -> None:
        self.range_m, self.old_range_m = [inf] * SONARS, [inf] * SONARS
        self.rate_m_s, self.old_rate_m_s = [0.0] * SONARS, [0.0] * SONARS
        self.seen, self.old_seen = [0] * SONARS, [0] * SONARS
        self.lately_m_s = 0.0


def watch(closing: Closing, ring: Ring, speed_m_s: float, params: Params) -> None:
    """Follow the echoes by one scan more, and tell the ring how fast each one walks."""
    closing.old_range_m, closing.range_m = closing.range_m, closing.old_range_m
    closing.old_rate_m_s, closing.rate_m_s = closing.rate_m_s, closing.old_rate_m_s
    closing.old_seen, closing.seen = closing.seen, closing.old_seen
    for i in range(SONARS):
        ring.walks_m_s[i] = 0.0
        closing.seen[i] = 0
    if ring.nearest_m >= FAR_M and max(closing.old_seen) == 0:
        return
    taken, way_m = 0, speed_m_s * params.period_s
    closing.lately_m_s = max(abs(speed_m_s), FORGET * closing.lately_m_s)
    for i in range(SONARS):
        if is_foremost(ring, i):
            taken |= follow(closing, ring, i, way_m, params)
    for i in range(SONARS):
        if not closing.seen[i] and not taken >> i & 1 and closing.old_seen[i] > MISSED:
            coast(closing, i, way_m, params)
        if closing.seen[i] >= SURE:
            walks_m_s = closing.rate_m_s[i] - closing.lately_m_s * UNSURE[i]
            if walks_m_s > LEAST_M_S + LEAST_SHARE_PER_S * closing.range_m[i]:
                ring.walks_m_s[i] = walks_m_s


def is_foremost(ring: Ring, i: int) -> bool:
    """Whether this sonar sees something near, and nearer than those beside it."""
    here_m = ring.range_m[i]
    if here_m is None or here_m >= FAR_M:
        return False
    before_m = ring.range_m[i - 1] if i > 0 else None
    after_m = ring.range_m[i + 1] if i < SONARS - 1 else None
    return (before_m is None or before_m >= here_m) and (after_m is None or after_m > here_m)


def follow(closing: Closing, ring: Ring, i: int, way_m: float, params: Params) -> int:
    """Find the echo of this cone among those before; the bit of the cone it came from, or 0."""
    here_m = ring.range_m[i] or 0.0
    best, best_off_m = -1, GATE_M + GATE_SHARE * here_m
    for j in range(max(i - 1, 0), min(i + 2, SONARS)):
        if closing.old_seen[j]:
            off_m = abs(here_m - expected_m(closing, j, way_m, params))
            if off_m < best_off_m:
                best, best_off_m = j, off_m
    if best < 0:
        closing.range_m[i] = here_m
        closing.rate_m_s[i] = 0.0
        closing.seen[i] = 1
        return 0
    guess_m = expected_m(closing, best, way_m, params)
    closing.range_m[i] = guess_m + SMOOTH * (here_m - guess_m)
    more_m_s = SMOOTH_RATE * (guess_m - here_m) / params.period_s
    closing.rate_m_s[i] = closing.old_rate_m_s[best] + more_m_s
    closing.seen[i] = min(closing.old_seen[best] + 1, MOST)
    return 1 << best


def expected_m(closing: Closing, j: int, way_m: float, params: Params) -> float:
    return closing.old_range_m[j] - way_m * COSINES[j] - closing.old_rate_m_s[j] * params.period_s


def coast(closing: Closing, i: int, way_m: float, params: Params) -> None:
    """An echo that stays away for a scan or two goes on as it was."""
    closing.range_m[i] = expected_m(closing, i, way_m, params)
    closing.rate_m_s[i] = closing.old_rate_m_s[i]
    closing.seen[i] = closing.old_seen[i] - MISSED


def limit_m_s(ring: Ring, most_m_s: float) -> float:
    """How fast to go on at what walks towards the way, so that it can pass before the robot."""
    for i in FRONT:
        walks_m_s, range_m = ring.walks_m_s[i], ring.range_m[i]
        if walks_m_s > 0.0 and range_m is not None:
            may_m_s = (range_m - WAIT_M) / WAIT_S - walks_m_s
            most_m_s = min(most_m_s, max(may_m_s, 0.0) / COSINES[i])
    return most_m_s
