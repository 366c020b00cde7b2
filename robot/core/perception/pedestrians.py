"""Tracks of possible pedestrians: the foremost echoes, each modelled as a person.

A track has its echo's distance from the robot's rim, its direction in the odometry frame, its own
approach speed, and its speed to the left across the line of sight. `closing_speed` updates the
tracks; `open_headings` closes the headings along which the robot would meet one.
"""

from math import inf
from typing import Final

from robot.core.geometry import wrap
from robot.core.parameters import Params
from robot.core.perception.odometry import Odometry
from robot.core.perception.people import People
from runtime.elementary import cos_sin

TRACKS: Final = 3
EACH: Final = tuple(range(TRACKS))
PERSON_M: Final = 0.20
"""Distance from the nearest point of a person to its middle."""
MISSED: Final = 5  # scans without an echo until a track ends
HIDDEN: Final = 15  # for a pedestrian that should be in view
BEHIND: Final = 60  # for a pedestrian where no sonar looks
VIEW_RAD: Final = 1.45
GONE_M: Final = 1.5


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
    if w.missed[k] > most or w.range_m[k] > GONE_M:
        w.seen[k] = w.sure[k] = 0
        return False
    return True
