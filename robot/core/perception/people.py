"""People around the robot: tracks of echoes that may be one, and those that are confirmed.

A track models one of the foremost echoes as a person. It has its echo's distance from the robot's
rim, its direction in the odometry frame, its own approach speed, and its speed to the left across
the line of sight. `closing_speed` updates the tracks; `open_headings` closes the headings along
which the robot would meet one.

`closing_speed` also confirms a person. Its position and velocity in the odometry frame are then
followed here through all cones that its body reaches into, and it is assumed to keep walking where
no sonar looks.
"""

from math import inf, sqrt
from typing import Final

from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry
from robot.core.ring import BEARINGS, CONE, HALF_CONE, SONARS
from robot.core.values import Pose, wrap
from runtime.elementary import coarse_atan2, cos_sin

MAX_PEOPLE: Final = 4
SLOTS: Final = tuple(range(MAX_PEOPLE))
BODY_M: Final = 0.20
"""Radius of a person."""
BEGIN: Final = 30  # scans for which a new person is believed
PROVEN: Final = 8  # counts of motion, at most two in a scan, until a person is evaded
MAX_LEFT: Final = 120  # scans for which that person is believed without an echo
LEAST_M_S: Final = 0.025  # slower along the line of sight an echo may be static
RECEDES_M_S: Final = 0.05
SEEN_THROUGH: Final = 6  # scans less for an echo from beyond
GATE_M: Final = 0.10  # farther from the expected range, an echo is not of this person
LEAST_M: Final = 0.02  # the sonars measure no shorter range
SAME_M: Final = 0.45  # a confirmed track this near to a person is that person
GONE_M: Final = 2.2
EDGE_RAD: Final = 0.5 * SONARS * CONE
CENTRAL: Final = 3
GAIN: Final = 0.30
RATE_GAIN: Final = 0.05
"""Shares of a difference along the line of sight that correct place and velocity."""
ASIDE_GAIN: Final = 0.12
ASIDE_RATE_GAIN: Final = 0.012
"""The same across the line of sight, where the cones show little."""
SURE_RAD: Final = 1.40  # bearing up to which a missing echo counts
FASTEST_M_S: Final = 0.45


class People:
    """The people; `left` counts down to 0, at which a slot is free; `any` is set if one is used.

    `proof` counts motion, up to PROVEN. The other fields are the working
    memory of `compare`.
    """

    __slots__ = (
        *("any", "aside_m", "cones", "left", "off_m", "proof", "through"),
        *("vx_m_s", "vy_m_s", "x_m", "y_m"),
    )

    def __init__(self) -> None:
        self.x_m, self.y_m = [0.0] * MAX_PEOPLE, [0.0] * MAX_PEOPLE
        self.vx_m_s, self.vy_m_s = [0.0] * MAX_PEOPLE, [0.0] * MAX_PEOPLE
        self.left, self.proof = [0] * MAX_PEOPLE, [0] * MAX_PEOPLE
        self.any = self.through = False
        self.cones, self.off_m, self.aside_m = 0, 0.0, 0.0


def update(
    people: People, range_m: "list[float | None]", odometry: Odometry, params: Params
) -> None:
    """Move every person by one period and correct the places by the scan."""
    x_m, y_m, _ = odometry.pose
    people.any = False
    for k in SLOTS:
        if people.left[k] == 0:
            continue
        people.left[k] -= 1
        people.x_m[k] += people.vx_m_s[k] * params.period_s
        people.y_m[k] += people.vy_m_s[k] * params.period_s
        dx_m, dy_m = people.x_m[k] - x_m, people.y_m[k] - y_m
        square = dx_m * dx_m + dy_m * dy_m
        if square > GONE_M * GONE_M:
            people.left[k] = 0
        if people.left[k]:
            people.any = True
            if square > BODY_M * BODY_M:
                away_m = sqrt(square)
                cosine, sine = cos_sin(odometry.pose.heading_rad)
                off_rad = coarse_atan2(dy_m * cosine - dx_m * sine, dx_m * cosine + dy_m * sine)
                compare(people, away_m, off_rad, range_m, params.radius_m)
                if people.cones:
                    correct(people, k, dx_m / away_m, dy_m / away_m, params.period_s)
                elif people.through:
                    people.left[k] = max(0, people.left[k] - SEEN_THROUGH)


def compare(
    people: People, away_m: float, off_rad: float, range_m: "list[float | None]", radius_m: float
) -> None:
    """Compare the echoes around a bearing with those of a person there.

    `cones` counts the cones that fit, and CENTRAL for the one with the middle of the body; `off_m`
    is how much farther the echo is than expected, and `aside_m` a measure of how far the person is
    to the left of its expected place. `through` is set if the echo comes from beyond the person.
    """
    middle = int(off_rad / CONE + 0.5 * SONARS) if off_rad >= -EDGE_RAD else -1
    people.cones, people.off_m, people.aside_m, people.through = 0, 0.0, 0.0, False
    for i in range(max(middle - 1, 0), min(middle + 2, SONARS)):
        here_m = range_m[i]
        if here_m is None:
            continue
        beside_rad = BEARINGS[i] - off_rad
        aside_rad = (beside_rad if beside_rad > 0.0 else -beside_rad) - HALF_CONE
        miss_m = here_m - expected_m(away_m, aside_rad, radius_m)
        if -GATE_M < miss_m < GATE_M:
            if aside_rad <= 0.0:
                people.off_m = miss_m
                people.cones += CENTRAL
            else:
                # A shorter range at this side: the person is farther to this side.
                people.aside_m += -miss_m if beside_rad > 0.0 else miss_m
                people.cones += 1
                if people.cones == 1:
                    people.off_m = miss_m
        elif miss_m >= GATE_M and i == middle and -SURE_RAD < off_rad < SURE_RAD:
            people.through = True


def expected_m(away_m: float, aside_rad: float, radius_m: float) -> float:
    """Return the range of a person's nearest point in a cone; inf if the body is beside the cone.

    `aside_rad` is the angle from the edge of the cone to the middle of the body, below 0 inside.
    """
    range_m = away_m - BODY_M - radius_m
    if aside_rad > 0.0:
        cosine, sine = cos_sin(aside_rad)
        room_m2 = BODY_M * BODY_M - away_m * away_m * sine * sine
        if room_m2 <= 0.0:
            return inf
        range_m = away_m * cosine - sqrt(room_m2) - radius_m
    return range_m if range_m > LEAST_M else LEAST_M


def correct(people: People, k: int, ux: float, uy: float, period_s: float) -> None:
    """Correct place and velocity of a person by the last comparison; `ux`, `uy` point at it."""
    off_m, aside_m = people.off_m, people.aside_m
    if people.cones < CENTRAL:
        off_m *= 0.5
    if aside_m > GATE_M:
        aside_m = GATE_M
    elif aside_m < -GATE_M:
        aside_m = -GATE_M
    rate, aside_rate = RATE_GAIN / period_s, ASIDE_RATE_GAIN / period_s
    people.x_m[k] += GAIN * off_m * ux - ASIDE_GAIN * aside_m * uy
    people.y_m[k] += GAIN * off_m * uy + ASIDE_GAIN * aside_m * ux
    vx_m_s = people.vx_m_s[k] + rate * off_m * ux - aside_rate * aside_m * uy
    vy_m_s = people.vy_m_s[k] + rate * off_m * uy + aside_rate * aside_m * ux
    square = vx_m_s * vx_m_s + vy_m_s * vy_m_s
    if square > FASTEST_M_S * FASTEST_M_S:
        share = FASTEST_M_S / sqrt(square)
        vx_m_s, vy_m_s = vx_m_s * share, vy_m_s * share
    people.vx_m_s[k], people.vy_m_s[k] = vx_m_s, vy_m_s
    agree(people, k, -vx_m_s * ux - vy_m_s * uy)


def agree(people: People, k: int, nears_m_s: float) -> None:
    """Count a scan in which a person moved along the line of sight, and renew the belief.

    Echoes of static obstacles seem to go away more often than to come nearer, so a person that goes
    away proves its motion only by a higher speed.
    """
    proven = people.proof[k] >= PROVEN
    if -(LEAST_M_S if proven else RECEDES_M_S) <= nears_m_s <= LEAST_M_S:
        if not proven and people.proof[k] > 0:
            people.proof[k] -= 1
    elif proven:
        people.left[k] = min(people.left[k] + 2, MAX_LEFT)
    else:
        people.proof[k] += 1
        if people.proof[k] == PROVEN:
            people.left[k] = MAX_LEFT


def confirm(
    people: People,
    x_m: float,
    y_m: float,
    vx_m_s: float,
    vy_m_s: float,
    nears_m_s: float,
    pose: Pose,
) -> None:
    """Renew the belief in a person near a place, or add one there, in place of the farthest."""
    free = farthest = -1
    most_m2 = 0.0
    for k in SLOTS:
        if people.left[k] == 0:
            if free < 0:
                free = k
            continue
        dx_m, dy_m = people.x_m[k] - x_m, people.y_m[k] - y_m
        if dx_m * dx_m + dy_m * dy_m < SAME_M * SAME_M:
            agree(people, k, nears_m_s)
            return
        dx_m, dy_m = people.x_m[k] - pose.x_m, people.y_m[k] - pose.y_m
        square = dx_m * dx_m + dy_m * dy_m
        if square > most_m2:
            farthest, most_m2 = k, square
    if free < 0:
        free = farthest
    people.x_m[free], people.y_m[free] = x_m, y_m
    people.vx_m_s[free], people.vy_m_s[free] = vx_m_s, vy_m_s
    people.left[free], people.proof[free] = BEGIN, 0
    people.any = True


TRACKS: Final = 3
EACH: Final = tuple(range(TRACKS))
PERSON_M: Final = 0.20
"""Distance from the nearest point of a person to its middle."""
MISSED: Final = 5  # scans without an echo until a track ends
HIDDEN: Final = 15  # for a pedestrian that should be in view
BEHIND: Final = 60  # for a pedestrian where no sonar looks
VIEW_RAD: Final = 1.45
TRACK_GONE_M: Final = 1.5


class Pedestrians:
    """The tracks; `seen` counts the scans of a track (0: unused), `missed` those without an echo.

    `agreed` counts the scans in a row that showed a pedestrian; it is confirmed while `sure` is
    above 0. `off_rad` is the bearing from the heading. `taken` has a bit for each track of the
    current scan. `any` is set if there is a track. `near` counts the cones with a near echo in the
    last scan, `leftwards` is the order of their processing. `lately_m_s` is the recent maximum
    speed of the robot. `reported` is set while the ring has an approach speed.
    """

    __slots__ = (
        "across_m_s",
        "agreed",
        "any",
        "approach_m_s",
        "at_rad",
        "lately_m_s",
        "leftwards",
        "missed",
        "near",
        "off_rad",
        "people",
        "range_m",
        "reported",
        "seen",
        "sure",
        "taken",
    )

    def __init__(self) -> None:
        self.range_m = [inf] * TRACKS
        self.at_rad, self.off_rad = [0.0] * TRACKS, [0.0] * TRACKS
        self.approach_m_s, self.across_m_s = [0.0] * TRACKS, [0.0] * TRACKS
        self.seen, self.missed = [0] * TRACKS, [0] * TRACKS
        self.agreed, self.sure = [0] * TRACKS, [0] * TRACKS
        self.people = People()
        self.taken = self.near = 0
        self.lately_m_s = 0.0
        self.any = self.leftwards = self.reported = False


def clear(pedestrians: Pedestrians) -> None:
    """Forget all tracks."""
    for k in EACH:
        pedestrians.seen[k] = pedestrians.sure[k] = 0
    pedestrians.any = False
    pedestrians.people = People()


def expect(w: Pedestrians, odometry: Odometry, params: Params) -> None:
    """Predict each track by the robot's motion and its own."""
    speed_m_s, heading_rad = odometry.speed_m_s, odometry.pose.heading_rad
    period_s, radius_m = params.period_s, params.radius_m
    for k in EACH:
        if w.seen[k] == 0:
            continue
        off_rad, approach_m_s, across_m_s = (
            w.at_rad[k] - heading_rad,
            w.approach_m_s[k],
            w.across_m_s[k],
        )
        range_m = w.range_m[k]
        away_m = range_m + radius_m + PERSON_M
        if away_m < PERSON_M:
            away_m = PERSON_M
        cosine, sine = cos_sin(off_rad)
        w.range_m[k] = range_m - (speed_m_s * cosine + approach_m_s) * period_s
        turn_rad = (across_m_s + speed_m_s * sine) * period_s / away_m
        w.at_rad[k] += turn_rad
        if w.sure[k]:
            w.approach_m_s[k] = approach_m_s - across_m_s * turn_rad
            w.across_m_s[k] = across_m_s + approach_m_s * turn_rad
        w.off_rad[k] = wrap(off_rad + turn_rad)


def goes_on(w: Pedestrians, k: int) -> bool:
    """Keep a track without an echo in this scan; return False when it ends."""
    w.missed[k] += 1
    most = MISSED
    if w.sure[k]:
        most = HIDDEN if -VIEW_RAD < w.off_rad[k] < VIEW_RAD else BEHIND
    if w.missed[k] > most or w.range_m[k] > TRACK_GONE_M:
        w.seen[k] = w.sure[k] = 0
        return False
    return True
