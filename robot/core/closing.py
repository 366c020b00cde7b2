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
LEAST_M_S: Final = 0.02  # slower than this, and a share of the range, is noise
LEAST_SHARE_PER_S: Final = 0.1
FLANK_M: Final = 0.06  # what walks comes 3 cm nearer while the wheels stop
FLANKS: Final = (0, 1, 6, 7)
HOLD: Final = 20  # scans for which a walker counts that is too near to be measured any more
HOLD_FROM_M: Final = 0.10
HELD_M: Final = 0.05
WAIT_M: Final = 0.25
WAIT_S: Final = 2.0

UNSURE: Final = tuple([cos(max(abs(b) - HALF_CONE, 0.0)) - cos(b) for b in BEARINGS])
"""How much of the robot's speed an echo in this cone may see beyond what its middle sees."""
FORGET: Final = 0.95


class Closing:
    """Per cone: the range as followed, how fast it falls by itself, in how many scans it was seen.

    `held` counts for how many scans a walker at the right, at the left is still believed there;
    `any` says whether there is one at all, `lately_m_s` how fast the robot has driven lately.
    """

    __slots__ = (
        "any",
        "held",
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
        self.any = False
        self.held = [0, 0]


def watch(closing: Closing, ring: Ring, speed_m_s: float, params: Params) -> None:
    """Follow the echoes by one scan more, and tell the ring how fast each one walks."""
    lately_m_s = FORGET * closing.lately_m_s
    closing.lately_m_s = max(min(abs(speed_m_s), params.wheel_max_m_s), lately_m_s)
    if not closing.any and ring.nearest_m >= FAR_M:
        return
    closing.old_range_m, closing.range_m = closing.range_m, closing.old_range_m
    closing.old_rate_m_s, closing.rate_m_s = closing.rate_m_s, closing.old_rate_m_s
    closing.old_seen, closing.seen = closing.seen, closing.old_seen
    expect(closing, speed_m_s, params.period_s)
    taken = follow(closing, ring, params.period_s)
    seen, walking = closing.seen, ring.walks_m_s
    closing.any = False
    for i in range(SONARS):
        walking[i] = 0.0
        if not seen[i]:
            if closing.old_seen[i] <= MISSED or taken >> i & 1:
                continue
            coast(closing, i)
            closing.any = True
            continue
        closing.any = True
        if seen[i] >= SURE:
            walks_m_s = closing.rate_m_s[i] - closing.lately_m_s * UNSURE[i]
            if walks_m_s > LEAST_M_S + LEAST_SHARE_PER_S * closing.range_m[i]:
                walking[i] = walks_m_s
    for side in (0, 1):
        hold(closing, ring, side)


def hold(closing: Closing, ring: Ring, side: int) -> None:
    """Nearer than a sonar can measure everything seems to stand: what walked there, walks on."""
    half = SONARS // 2
    for i in range(half * side, half * side + half):
        range_m = ring.range_m[i]
        if range_m is None or range_m > HOLD_FROM_M:
            continue
        if ring.walks_m_s[i] > 0.0:
            closing.held[side] = HOLD
            return
        if closing.held[side] > 0 and range_m <= HELD_M:
            ring.walks_m_s[i] = LEAST_M_S
    closing.held[side] = max(closing.held[side] - 1, 0)


def expect(closing: Closing, speed_m_s: float, period_s: float) -> None:
    """Where the echoes should be by now: the robot came nearer to them and they to it."""
    expected_m, old_seen, seen = closing.old_range_m, closing.old_seen, closing.seen
    for j in range(SONARS):
        seen[j] = 0
        if old_seen[j]:
            nearing_m_s = speed_m_s * COSINES[j] + closing.old_rate_m_s[j]
            expected_m[j] -= nearing_m_s * period_s


def follow(closing: Closing, ring: Ring, period_s: float) -> int:
    """Find each foremost echo among those before; the bits of the cones that they came from."""
    range_m, last, taken = ring.range_m, SONARS - 1, 0
    for i in range(SONARS):
        here_m = range_m[i]
        if here_m is None or here_m >= FAR_M:
            continue
        if i > 0:
            before_m = range_m[i - 1]
            if before_m is not None and before_m < here_m:
                continue
        if i < last:
            after_m = range_m[i + 1]
            if after_m is not None and after_m <= here_m:
                continue
        taken |= find(closing, i, here_m, period_s)
    return taken


def find(closing: Closing, i: int, here_m: float, period_s: float) -> int:
    """Go on with what was followed here or beside; the bit of its cone, or 0 for a new echo."""
    old_seen, expected_m = closing.old_seen, closing.old_range_m
    best, surprise_m = -1, 0.0
    least_m = GATE_M + GATE_SHARE * here_m
    for j in (i - 1, i, i + 1):
        if 0 <= j < SONARS and old_seen[j]:
            off_m = here_m - expected_m[j]
            if -least_m < off_m < least_m:
                best, surprise_m, least_m = j, off_m, abs(off_m)
    if best < 0:
        closing.range_m[i], closing.rate_m_s[i], closing.seen[i] = here_m, 0.0, 1
        return 0
    closing.range_m[i] = expected_m[best] + SMOOTH * surprise_m
    closing.rate_m_s[i] = closing.old_rate_m_s[best] - SMOOTH_RATE * surprise_m / period_s
    closing.seen[i] = min(old_seen[best] + 1, MOST)
    return 1 << best


def coast(closing: Closing, i: int) -> None:
    """An echo that stays away for a scan or two goes on as it was."""
    closing.range_m[i] = closing.old_range_m[i]
    closing.rate_m_s[i] = closing.old_rate_m_s[i]
    closing.seen[i] = closing.old_seen[i] - MISSED


def limit_m_s(ring: Ring, most_m_s: float) -> float:
    """How fast to go on at what walks towards the way, so that it can pass before the robot; with
    somebody at the flank not at all."""
    if is_flanked(ring):
        return min(most_m_s, 0.0)
    for i in FRONT:
        walks_m_s, range_m = ring.walks_m_s[i], ring.range_m[i]
        if walks_m_s > 0.0 and range_m is not None:
            may_m_s = (range_m - WAIT_M) / WAIT_S - walks_m_s
            most_m_s = min(most_m_s, max(may_m_s, 0.0) / COSINES[i])
    return most_m_s


def is_flanked(ring: Ring) -> bool:
    """Whether something walks so near at a flank that the robot must not drive on past it."""
    for i in FLANKS:
        range_m = ring.range_m[i]
        if ring.walks_m_s[i] > 0.0 and range_m is not None and range_m <= FLANK_M:
            return True
    return False
