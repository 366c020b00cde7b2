"""Detect pedestrians: echoes whose range changes otherwise than by the robot's own motion.

The range to a static obstacle shrinks at the robot's own speed towards its nearest point. So the
echoes nearer than both neighbours are tracked, each by a line of best fit through its last scans.
An echo that closes at another rate is treated as a pedestrian. A pedestrian is assumed to keep
walking, seen or not, because most collisions happen outside the sonars' view.
"""

from math import sqrt
from typing import Final

from robot.core.parameters import DEFAULTS, Params
from robot.core.perception import people
from robot.core.perception.odometry import Odometry
from robot.core.perception.people import (
    EACH,
    PERSON_M,
    TRACKS,
    Pedestrians,
    clear,
    expect,
    goes_on,
)
from robot.core.perception.sonar_ring import CLAMPED_M, FRONT, Ring
from robot.core.ring import BEARINGS, HALF_CONE, SONARS
from robot.core.values import COSINES, EVERY, SINES, wrap
from runtime.elementary import cos, cos_sin

RIGHTWARDS: Final = tuple(range(SONARS - 1, -1, -1))
FAR_M: Final = 1.1
GATE_M: Final = 0.03  # farther from the prediction, or GATE_RAD aside: another echo
GATE_SHARE: Final = 0.04
GATE_RAD: Final = 0.5
LEAN_M: Final = 0.10  # a neighbour farther by this counts as without an echo
NOISE_M: Final = 0.003
NOISE_SHARE: Final = 0.01
SURE: Final = 8  # scans of a track until its rate counts
MAX_SCANS: Final = 24  # scans in the line of best fit
LEAST_M_S: Final = 0.025  # slower echoes, or within the noise, are static
SIGMAS: Final = 2.5
FASTEST_M_S: Final = 0.32  # a faster echo is another one
AGREE: Final = 3  # scans in a row that must agree
BELIEF: Final = 40  # scans for which it is believed after the last agreement
ACROSS_M_S: Final = 0.13  # for crossing; static bearings may seem to move more slowly
CURVED: Final = 0.11  # share of its distance by which neighbours see a person farther
ROUND_M: Final = 0.35  # radius of curvature up to that of a person
CROWD: Final = 3  # with more near echoes, apparent crossing may be several static ones
CAPPED_M_S: Final = 0.3
TURNING_RAD_S: Final = 0.15
EDGE_RAD: Final = 1.2  # farther aside, the bearing is too uncertain for a speed across
FORGET: Final = 0.95  # decay per scan of the recent speed
FLANK_M: Final = 0.06  # a pedestrian comes 3 cm nearer while the wheels stop
FLANKS: Final = (0, 1, 6, 7)
WAIT_M: Final = 0.25  # distance and time kept to a pedestrian approaching the way
WAIT_S: Final = 2.0

UNSURE: Final = tuple([cos(max(abs(b) - HALF_CONE, 0.0)) - cos(b) for b in BEARINGS])
"""Share of the robot's speed by which an echo in this cone may differ from one in its middle."""
GAIN: Final = tuple(
    [1.0, 1.0] + [2.0 * (2 * n - 1) / (n * (n + 1)) for n in range(2, MAX_SCANS + 1)]
)
RATE_GAIN: Final = tuple([0.0, 0.0] + [6.0 / (n * (n + 1)) for n in range(2, MAX_SCANS + 1)])
"""Shares of an innovation after n scans that correct end and slope of a line of best fit."""
DOUBT: Final = tuple(
    [SIGMAS * sqrt(12.0 / (n or 1)) / (DEFAULTS.period_s * (n or 1)) for n in range(MAX_SCANS + 1)]
)
"""Uncertainty of that slope per metre of noise, in 1/s."""


def watch(pedestrians: Pedestrians, ring: Ring, odometry: Odometry, params: Params) -> None:
    """Update tracks and people by one scan, and set the approach speeds of the ring."""
    track(pedestrians, ring, odometry, params)
    if pedestrians.people.any:
        people.update(pedestrians.people, ring.range_m, odometry, params)
    if pedestrians.any:
        introduce(pedestrians, odometry, params)


def introduce(w: Pedestrians, odometry: Odometry, params: Params) -> None:
    """Confirm the people behind the tracks that agreed in this scan."""
    pose = odometry.pose
    for k in EACH:
        if w.sure[k] == BELIEF and w.taken >> k & 1:
            away_m = w.range_m[k] + params.radius_m + PERSON_M
            cosine, sine = cos_sin(wrap(w.at_rad[k]))
            nears, across = w.approach_m_s[k], w.across_m_s[k]
            if not -EDGE_RAD < w.off_rad[k] < EDGE_RAD:
                across = 0.0
            people.confirm(
                w.people,
                pose.x_m + away_m * cosine,
                pose.y_m + away_m * sine,
                -nears * cosine - across * sine,
                -nears * sine + across * cosine,
                nears,
                pose,
            )


def track(pedestrians: Pedestrians, ring: Ring, odometry: Odometry, params: Params) -> None:
    """Update the tracks by one scan."""
    if pedestrians.reported:
        pedestrians.reported = False
        for i in EVERY:
            ring.approach_m_s[i] = 0.0
    speed_m_s = odometry.speed_m_s
    finite = speed_m_s + odometry.yaw_rate_rad_s + odometry.pose.heading_rad
    if finite - finite != 0.0:
        clear(pedestrians)
        return
    lately_m_s, now_m_s = FORGET * pedestrians.lately_m_s, abs(speed_m_s)
    if now_m_s > params.wheel_max_m_s:
        now_m_s = params.wheel_max_m_s
    pedestrians.lately_m_s = now_m_s if now_m_s > lately_m_s else lately_m_s
    if pedestrians.any:
        expect(pedestrians, odometry, params)
    elif ring.nearest_m >= FAR_M:
        return
    pedestrians.taken = 0
    follow(pedestrians, ring, odometry, params)
    pedestrians.any = False
    for k in EACH:
        if pedestrians.seen[k] and (pedestrians.taken >> k & 1 or goes_on(pedestrians, k)):
            pedestrians.any = True


def follow(w: Pedestrians, ring: Ring, odometry: Odometry, params: Params) -> None:
    """Find the cones nearer than both neighbours, and the position of the echo in each.

    At most TRACKS of them, alternately from the right and from the left.
    """
    before_m, bit, foremost, near = FAR_M, 1, 0, 0
    for here_m in ring.range_m:
        if here_m is not None and here_m < FAR_M:
            near += 1
            if here_m <= before_m:
                foremost = (foremost | bit) & ~(bit >> 1)
            before_m = here_m
        else:
            before_m = FAR_M
        bit += bit
    w.leftwards = not w.leftwards
    free = TRACKS
    for i in EVERY if w.leftwards else RIGHTWARDS:
        if foremost >> i & 1:
            see(w, ring, i, odometry, params)
            free -= 1
            if free == 0:
                break
    w.near = near


def see(w: Pedestrians, ring: Ring, i: int, odometry: Odometry, params: Params) -> None:
    """Take the echo of one cone.

    The ranges of both neighbours, none of which is nearer, give its bearing within the cone,
    whatever its shape. The even sonars were pinged half a period ago.
    """
    range_m = ring.range_m
    here_m, right_m, left_m = range_m[i] or 0.0, LEAN_M, LEAN_M
    if i > 0:
        beside_m = range_m[i - 1]
        if beside_m is not None and beside_m - here_m < LEAN_M:
            right_m = beside_m - here_m
    if i < SONARS - 1:
        beside_m = range_m[i + 1]
        if beside_m is not None and beside_m - here_m < LEAN_M:
            left_m = beside_m - here_m
    right, left = sqrt(right_m), sqrt(left_m)
    lean_rad = HALF_CONE * (right - left) / (right + left)
    off_rad = BEARINGS[i] + lean_rad
    sooner_s = drives_m_s = 0.0
    if i & 1 == 0:
        sooner_s = 0.5 * params.period_s
        off_rad -= sooner_s * odometry.yaw_rate_rad_s
        drives_m_s = odometry.speed_m_s * (COSINES[i] - lean_rad * SINES[i])
    k = find(w, here_m - sooner_s * drives_m_s, off_rad)
    if k < 0:
        start(w, here_m, off_rad, odometry.pose.heading_rad)
        return
    late_m = here_m - sooner_s * (drives_m_s + w.approach_m_s[k])
    at_edge = (i == 0 or i == SONARS - 1) and w.sure[k] == 0
    if at_edge and not -TURNING_RAD_S <= odometry.yaw_rate_rad_s <= TURNING_RAD_S:
        # The edge of the view sweeps over static obstacles beside the robot.
        w.seen[k], w.agreed[k] = 2, 0
        learn(w, k, late_m, off_rad, False, params)
        return
    learn(w, k, late_m, off_rad, here_m > CLAMPED_M, params)
    if w.seen[k] >= SURE:
        believe(w, k, walks(w, k, i, here_m, right + left, odometry, params))
        if w.sure[k] and w.approach_m_s[k] > 0.0:
            ring.approach_m_s[i] = w.approach_m_s[k]
            w.reported = True


def find(w: Pedestrians, here_m: float, off_rad: float) -> int:
    """Return the track with the nearest prediction, or -1."""
    best, least_m = -1, GATE_M + GATE_SHARE * here_m
    range_m, seen, taken = w.range_m, w.seen, w.taken
    for k in EACH:
        if seen[k] and not taken >> k & 1:
            off_m = here_m - range_m[k]
            if off_m < 0.0:
                off_m = -off_m
            if off_m < least_m and -GATE_RAD < off_rad - w.off_rad[k] < GATE_RAD:
                best, least_m = k, off_m
    return best


def learn(
    w: Pedestrians, k: int, here_m: float, off_rad: float, measured: bool, params: Params
) -> None:
    """Update the line of best fit of a track by one scan."""
    w.taken |= 1 << k
    w.missed[k] = 0
    n = w.seen[k]
    if n < MAX_SCANS:
        w.seen[k] = n = n + 1
    gain, rate_gain = GAIN[n], RATE_GAIN[n] / params.period_s
    off_m, turn_rad = here_m - w.range_m[k], off_rad - w.off_rad[k]
    w.range_m[k] += gain * off_m
    if measured:
        w.approach_m_s[k] -= rate_gain * off_m
    away_m = here_m + params.radius_m + PERSON_M
    across_m_s = w.across_m_s[k] + rate_gain * turn_rad * away_m
    if across_m_s > CAPPED_M_S:
        across_m_s = CAPPED_M_S
    elif across_m_s < -CAPPED_M_S:
        across_m_s = -CAPPED_M_S
    w.across_m_s[k] = across_m_s
    turn_rad *= gain
    w.at_rad[k] += turn_rad
    w.off_rad[k] += turn_rad


def walks(
    w: Pedestrians, k: int, i: int, here_m: float, width: float, odometry: Odometry, params: Params
) -> bool:
    """Return whether a track moves faster than the noise of a static echo, or crosses.

    At the edge of the view a static wall may seem to recede.
    """
    approach_m_s, across_m_s = w.approach_m_s[k], w.across_m_s[k]
    slow = -LEAST_M_S <= approach_m_s <= LEAST_M_S
    if slow and -ACROSS_M_S <= across_m_s <= ACROSS_M_S:
        return False
    noise_m, rim_m = NOISE_M + NOISE_SHARE * here_m, here_m + params.radius_m
    edge = i == 0 or i == SONARS - 1
    if not slow:
        blur = min(1.0, sqrt(1.4 * noise_m) / width)
        least_m_s = LEAST_M_S + noise_m * DOUBT[w.seen[k]] + w.lately_m_s * UNSURE[i] * blur
        if approach_m_s > least_m_s or (approach_m_s < -least_m_s and not edge):
            return True
    if edge or w.near > CROWD or not odometry.speed_m_s > 0.0:
        return False
    bent = width * width > CURVED * rim_m * (1.0 + rim_m / ROUND_M)
    return bent and crossing(w, k)


def crossing(w: Pedestrians, k: int) -> bool:
    """Return whether a track crosses in front of the robot, for long enough to be sure."""
    across_m_s = w.across_m_s[k]
    if w.seen[k] < MAX_SCANS or not (across_m_s > ACROSS_M_S or across_m_s < -ACROSS_M_S):
        return False
    return (across_m_s > 0.0) != (w.off_rad[k] > 0.0)


def believe(w: Pedestrians, k: int, walking: bool) -> None:
    """Confirm a pedestrian after some scans in a row; keep it for a while without agreement."""
    if w.sure[k]:
        w.sure[k] = BELIEF if walking else w.sure[k] - 1
        return
    approach_m_s, across_m_s = w.approach_m_s[k], w.across_m_s[k]
    if (
        not walking
        or approach_m_s * approach_m_s + across_m_s * across_m_s > FASTEST_M_S * FASTEST_M_S
    ):
        w.agreed[k] = 0
        return
    w.agreed[k] += 1
    if w.agreed[k] >= AGREE:
        w.sure[k] = BELIEF


def start(w: Pedestrians, here_m: float, off_rad: float, heading_rad: float) -> None:
    """Start a track in a free slot, or in that of the least important track."""
    best, least = -1, here_m
    for k in EACH:
        if w.seen[k] == 0:
            best = k
            break
        if w.sure[k] == 0 and w.range_m[k] > least and not w.taken >> k & 1:
            best, least = k, w.range_m[k]
    if best < 0:
        return
    w.range_m[best], w.off_rad[best], w.at_rad[best] = here_m, off_rad, heading_rad + off_rad
    w.approach_m_s[best] = w.across_m_s[best] = 0.0
    w.seen[best] = 1
    w.missed[best] = w.agreed[best] = w.sure[best] = 0
    w.taken |= 1 << best


def limit_m_s(ring: Ring, most_m_s: float) -> float:
    """Return the highest speed that lets an approaching pedestrian pass before the robot.

    For navigators without a model of pedestrians. With a pedestrian at a flank it is 0.
    """
    if is_flanked(ring):
        return min(most_m_s, 0.0)
    for i in FRONT:
        approach_m_s, range_m = ring.approach_m_s[i], ring.range_m[i]
        if approach_m_s > 0.0 and range_m is not None:
            may_m_s = (range_m - WAIT_M) / WAIT_S - approach_m_s
            most_m_s = min(most_m_s, max(may_m_s, 0.0) / COSINES[i])
    return most_m_s


def is_flanked(ring: Ring) -> bool:
    """Return whether a pedestrian is so near at a flank that the robot must not drive past it."""
    for i in FLANKS:
        range_m = ring.range_m[i]
        if ring.approach_m_s[i] > 0.0 and range_m is not None and range_m <= FLANK_M:
            return True
    return False
