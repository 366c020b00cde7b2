"""Measures of a trial among people: time to collision, personal space, contacts.

Positions and velocities of people are functions of time. `Encounters` is a
`study.trial.core_loop.Watch`, so it works with every navigator. `Exposure` also measures a robot
that no trial drives.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.configuration import body_of
from plant.model.geometry import movers
from plant.sim.physics import MovingDisc
from plant.sim.simulation import Plant
from protocol.world import Point, World
from robot.core.perception.people import PROVEN, SAME_M, SLOTS, People
from robot.core.values import Outputs
from runtime.elementary import atan2, cos_sin, hypot
from runtime.units import NS_PER_S, PERIOD_S
from study.trial.core_loop import CoreLoop

"""Control period; the velocity of a person is its mean over the period that begins."""


class Walker(NamedTuple):
    """A person at a time: position, velocity, and the distance of the centres at a contact."""

    at_m: Point
    velocity_m_s: Point
    touching_m: float


Track: TypeAlias = tuple[NDArray[np.float64], NDArray[np.float64], float]
"""Arrays of x and y of a person over time, and the distance of the centres at a contact."""


class Walkers:
    """The people of a world."""

    def __init__(self, world: World) -> None:
        self._robot_radius_m = body_of(world).radius_m
        self._movers = [MovingDisc(circle) for circle in movers(world)]

    def __len__(self) -> int:
        """Return the number of people."""
        return len(self._movers)

    def at(self, time_s: float) -> list[Walker]:
        """Return all people at a time."""
        found = []
        for mover in self._movers:
            x_m, y_m = mover.position_m(time_s)
            next_x_m, next_y_m = mover.position_m(time_s + PERIOD_S)
            velocity_m_s = (next_x_m - x_m) / PERIOD_S, (next_y_m - y_m) / PERIOD_S
            touching_m = mover.radius_m + self._robot_radius_m
            found.append(Walker((x_m, y_m), velocity_m_s, touching_m))
        return found

    def places(self, time_s: float) -> list[tuple[float, float, float]]:
        """Return x, y and contact distance in metres of all people; costs less than `at`."""
        return [
            (*mover.position_m(time_s), mover.radius_m + self._robot_radius_m)
            for mover in self._movers
        ]

    def tracks(self, times_s: Sequence[float]) -> list[Track]:
        """Return the track of each person over the given times."""
        found = []
        for mover in self._movers:
            at_m = np.array([mover.position_m(time_s) for time_s in times_s])
            found.append((at_m[:, 0], at_m[:, 1], mover.radius_m + self._robot_radius_m))
        return found


PERSONAL_M: Final = 0.45
"""Personal space: from the robot's rim to a person's body (Hall's intimate distance)."""

SOON_S: Final = 2.0
TOUCHING_M: Final = 0.003
"""A contact is one with a person if that person is at most this far from the robot."""


class PersonContact(NamedTuple):
    """The beginning of a contact with a person.

    `bearing_rad` is 0 ahead; `speed_m_s` and `yaw_rate_rad_s` are the robot's one tick before.
    `tracked_s` is the time since the robot last had a proven track near the person, inf if never.
    `person_m_s` is the speed of the person.
    """

    time_s: float
    person: int
    bearing_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float
    tracked_s: float
    person_m_s: float


@dataclass(slots=True)
class Exposure:
    """Nearness to people, summed over ticks.

    `person_ticks` counts each tick once for each person of the world. `least_s` is the least time
    to collision with any person at any tick.
    """

    ticks: int = 0
    person_ticks: int = 0
    intruded_ticks: int = 0
    soon_ticks: int = 0
    least_s: float = inf

    def add(self, at_m: Point, velocity_m_s: Point, people: list[Walker]) -> tuple[float, int]:
        """Add one tick; return the distance in metres to the nearest person, and its index."""
        nearest_m, nearest, least_s = inf, -1, inf
        for number, walker in enumerate(people):
            gap_m = gap_of(at_m, walker)
            if gap_m < nearest_m:
                nearest_m, nearest = gap_m, number
            least_s = min(least_s, time_to_collision_s(at_m, velocity_m_s, walker))
        self.ticks += 1
        self.person_ticks += len(people)
        self.intruded_ticks += nearest_m < PERSONAL_M
        self.soon_ticks += least_s < SOON_S
        self.least_s = min(self.least_s, least_s)
        return nearest_m, nearest

    @property
    def time_s(self) -> float:
        """Duration of all ticks."""
        return self.ticks * PERIOD_S

    @property
    def person_s(self) -> float:
        """Duration of all ticks times the number of people."""
        return self.person_ticks * PERIOD_S

    @property
    def intruded_s(self) -> float:
        """Time with a person nearer than PERSONAL_M to the robot's rim."""
        return self.intruded_ticks * PERIOD_S

    @property
    def soon_s(self) -> float:
        """Time with less than SOON_S until a collision at constant velocities."""
        return self.soon_ticks * PERIOD_S


class Encounters:
    """Accumulate exposure and contacts of one trial, one call per tick."""

    def __init__(self, world: World) -> None:
        self._walkers = Walkers(world)
        self._touching = False
        self._speeds = (0.0, 0.0)
        self._tracked_at_s: dict[int, float] = {}
        self.exposure = Exposure()
        self.contacts: list[PersonContact] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Count one tick."""
        truth = plant.truth()
        cosine, sine = cos_sin(truth.heading_rad)
        at_m, time_s = (truth.x_m, truth.y_m), plant.now_ns / NS_PER_S
        people = self._walkers.at(time_s)
        velocity_m_s = truth.speed_m_s * cosine, truth.speed_m_s * sine
        nearest_m, nearest = self.exposure.add(at_m, velocity_m_s, people)
        for number in tracked(onboard.state.ring.pedestrians.people, people):
            self._tracked_at_s[number] = time_s
        touching = bool(truth.contact) and nearest_m < TOUCHING_M
        if touching and not self._touching:
            x_m, y_m = people[nearest].at_m[0] - at_m[0], people[nearest].at_m[1] - at_m[1]
            off_rad = atan2(y_m * cosine - x_m * sine, x_m * cosine + y_m * sine)
            contact = PersonContact(
                *(time_s, nearest, off_rad, *self._speeds),
                tracked_s=time_s - self._tracked_at_s.get(nearest, -inf),
                person_m_s=hypot(*people[nearest].velocity_m_s),
            )
            self.contacts.append(contact)
        self._touching = touching
        self._speeds = truth.speed_m_s, truth.yaw_rate_rad_s


def tracked(tracks: People, people: list[Walker]) -> list[int]:
    """Return the indices of the people that a proven track of the robot lies near."""
    if not tracks.any:
        return []
    proven = [k for k in SLOTS if tracks.left[k] and tracks.proof[k] >= PROVEN]
    return [
        number
        for number, ((x_m, y_m), _, _) in enumerate(people)
        if any(hypot(tracks.x_m[k] - x_m, tracks.y_m[k] - y_m) < SAME_M for k in proven)
    ]


def gap_of(at_m: Point, walker: Walker) -> float:
    """Return the distance in metres between a robot's rim and a person, below 0 in contact."""
    return hypot(walker.at_m[0] - at_m[0], walker.at_m[1] - at_m[1]) - walker.touching_m


def time_to_collision_s(at_m: Point, velocity_m_s: Point, walker: Walker) -> float:
    """Return the time in seconds until two discs touch at constant velocities, inf if never."""
    x_m, y_m = walker.at_m[0] - at_m[0], walker.at_m[1] - at_m[1]
    x_m_s = walker.velocity_m_s[0] - velocity_m_s[0]
    y_m_s = walker.velocity_m_s[1] - velocity_m_s[1]
    apart_m2 = x_m * x_m + y_m * y_m - walker.touching_m * walker.touching_m
    closing_m2_s = -(x_m * x_m_s + y_m * y_m_s)
    if closing_m2_s <= 0.0:
        return inf
    if apart_m2 <= 0.0:
        return 0.0
    speed_m2_s2 = x_m_s * x_m_s + y_m_s * y_m_s
    root = closing_m2_s * closing_m2_s - speed_m2_s2 * apart_m2
    if root < 0.0:
        return inf
    return apart_m2 / (closing_m2_s + sqrt(root))
