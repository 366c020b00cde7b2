"""The memory of who may walk: the foremost echoes, each followed as if it were a person.

For each track: how far its echo is from the rim of the robot, in which direction of the odometry
frame, how fast it comes nearer by itself, and how fast its middle goes leftwards across the line
of sight. `closing` keeps it, `headings` closes the headings along which the robot would meet one.
"""

from math import inf

from robot.core.typed import Final

TRACKS: Final = 3
PERSON_M: Final = 0.20
"""So far behind the nearest point of a person is its middle."""


class Walkers:
    """`seen` counts the scans that showed a track (0: there is none), `missed` those since.

    `agreed` scans in a row said that it walks, and while `sure` is above 0 that is believed.
    `off_rad` is its bearing from the heading, `taken` has a bit for each track in this scan; `any`
    says whether there is one at all, `near` how many cones saw something near in the last scan,
    `leftwards` in which order they were looked at, `lately_m_s` how fast the robot drove lately.
    """

    __slots__ = (
        "across_m_s",
        "agreed",
        "any",
        "at_rad",
        "lately_m_s",
        "leftwards",
        "missed",
        "near",
        "nears_m_s",
        "off_rad",
        "range_m",
        "seen",
        "sure",
        "taken",
    )

    def __init__(self) -> None:
        self.range_m = [inf] * TRACKS
        self.at_rad, self.off_rad = [0.0] * TRACKS, [0.0] * TRACKS
        self.nears_m_s, self.across_m_s = [0.0] * TRACKS, [0.0] * TRACKS
        self.seen, self.missed = [0] * TRACKS, [0] * TRACKS
        self.agreed, self.sure = [0] * TRACKS, [0] * TRACKS
        self.taken = self.near = 0
        self.lately_m_s = 0.0
        self.any = self.leftwards = False
