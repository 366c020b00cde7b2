"""The memory of who may walk: the foremost echoes, each followed as if it were a person.

For each track: how far its echo is from the rim of the robot, in which direction of the odometry
frame, how fast it comes nearer by itself, and how fast its middle goes leftwards across the line
of sight. `closing` keeps it, `headings` closes the headings along which the robot would meet one.
"""

from math import cos, inf, sin

from robot.core.geometry import wrap
from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry
from robot.core.typing_shim import Final

TRACKS: Final = 3
EACH: Final = tuple(range(TRACKS))
PERSON_M: Final = 0.20
"""So far behind the nearest point of a person is its middle."""
MISSED: Final = 5  # scans without it until a track ends,
HIDDEN: Final = 15  # if it walks and should be in view,
BEHIND: Final = 60  # or walks where no sonar looks
VIEW_RAD: Final = 1.45
GONE_M: Final = 1.5


class Pedestrians:
    """`seen` counts the scans that showed a track (0: there is none), `missed` those since.

    `agreed` scans in a row said that it walks, and while `sure` is above 0 that is believed.
    `off_rad` is its bearing from the heading, `taken` has a bit for each track in this scan; `any`
    says whether there is one at all, `near` how many cones saw something near in the last scan,
    `leftwards` in which order they were looked at, `lately_m_s` how fast the robot drove lately,
    `told` whether the ring has been told of anybody's speed.
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
        self.taken = self.near = 0
        self.lately_m_s = 0.0
        self.any = self.leftwards = self.reported = False


def clear(pedestrians: Pedestrians) -> None:
    """Forget everybody."""
    for k in EACH:
        pedestrians.seen[k] = pedestrians.sure[k] = 0
    pedestrians.any = False


def expect(w: Pedestrians, odometry: Odometry, params: Params) -> None:
    """Where each track should be by now, by the robot's motion and its own."""
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
        w.range_m[k] = range_m - (speed_m_s * cos(off_rad) + approach_m_s) * period_s
        turn_rad = (across_m_s + speed_m_s * sin(off_rad)) * period_s / away_m
        w.at_rad[k] += turn_rad
        if w.sure[k]:
            w.approach_m_s[k] = approach_m_s - across_m_s * turn_rad
            w.across_m_s[k] = across_m_s + approach_m_s * turn_rad
        w.off_rad[k] = wrap(off_rad + turn_rad)


def goes_on(w: Pedestrians, k: int) -> bool:
    """A track that this scan does not show goes on as it was, and ends in time."""
    w.missed[k] += 1
    most = MISSED
    if w.sure[k]:
        most = HIDDEN if -VIEW_RAD < w.off_rad[k] < VIEW_RAD else BEHIND
    if w.missed[k] > most or w.range_m[k] > GONE_M:
        w.seen[k] = w.sure[k] = 0
        return False
    return True
