"""Measure encounters with people during a trial: time to collision, personal space, contacts.

`Encounters` is a `study.trial.drive.Watch`, so it works with every navigator.
"""

from math import inf, sqrt
from typing import Final, NamedTuple

from plant.model.types import Point, World
from plant.sim.simulation import Plant
from robot.core.values import Outputs
from runtime.elementary import atan2, cos_sin, hypot
from runtime.units import NS_PER_S
from study.people.walkers import STEP_S, Walker, Walkers
from study.trial.core_loop import CoreLoop

PERSONAL_M: Final = 0.45
"""Personal space: from the robot's rim to a person's body (Hall's intimate distance)."""

SOON_S: Final = 2.0
TOUCHING_M: Final = 0.003
"""A robot that was pressed and is this near to a person was touched by that person."""


class Contact(NamedTuple):
    """The beginning of a contact with a person.

    `bearing_rad` is 0 ahead; `speed_m_s` and `yaw_rate_rad_s` are the robot's one tick before.
    """

    time_s: float
    person: int
    bearing_rad: float
    speed_m_s: float
    yaw_rate_rad_s: float


class Encounters:
    """Accumulate encounters of one trial, one call per tick."""

    def __init__(self, world: World) -> None:
        self._walkers = Walkers(world)
        self._touching = False
        self._speeds = (0.0, 0.0)
        self.ticks = self.intruded_ticks = self.soon_ticks = 0
        self.least_s = inf
        self.contacts: list[Contact] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Count one tick."""
        truth = plant.truth()
        cosine, sine = cos_sin(truth.heading_rad)
        at_m, time_s = (truth.x_m, truth.y_m), plant.now_ns / NS_PER_S
        velocity_m_s = truth.speed_m_s * cosine, truth.speed_m_s * sine
        nearest_m, nearest, least_s = inf, -1, inf
        people = self._walkers.at(time_s)
        for number, walker in enumerate(people):
            gap_m = gap_of(at_m, walker)
            if gap_m < nearest_m:
                nearest_m, nearest = gap_m, number
            least_s = min(least_s, time_to_collision_s(at_m, velocity_m_s, walker))
        self.ticks += 1
        self.intruded_ticks += nearest_m < PERSONAL_M
        self.soon_ticks += least_s < SOON_S
        self.least_s = min(self.least_s, least_s)
        touching = bool(truth.contact) and nearest_m < TOUCHING_M
        if touching and not self._touching:
            x_m, y_m = people[nearest].at_m[0] - at_m[0], people[nearest].at_m[1] - at_m[1]
            off_rad = atan2(y_m * cosine - x_m * sine, x_m * cosine + y_m * sine)
            self.contacts.append(Contact(time_s, nearest, off_rad, *self._speeds))
        self._touching = touching
        self._speeds = truth.speed_m_s, truth.yaw_rate_rad_s

    @property
    def time_s(self) -> float:
        """Duration of the trial."""
        return self.ticks * STEP_S

    @property
    def person_s(self) -> float:
        """Duration of the trial times the number of people."""
        return self.time_s * len(self._walkers)

    @property
    def intruded_s(self) -> float:
        """Time with a person nearer than PERSONAL_M to the robot's rim."""
        return self.intruded_ticks * STEP_S

    @property
    def soon_s(self) -> float:
        """Time with less than SOON_S until a collision at constant velocities."""
        return self.soon_ticks * STEP_S


def gap_of(at_m: Point, walker: Walker) -> float:
    """Return the distance in metres between a robot's rim and a person, below 0 in contact."""
    return hypot(walker.at_m[0] - at_m[0], walker.at_m[1] - at_m[1]) - walker.touching_m


def time_to_collision_s(at_m: Point, velocity_m_s: Point, walker: Walker) -> float:
    """Return the time in seconds until two discs touch at constant velocities, inf if never."""
    x_m, y_m = walker.at_m[0] - at_m[0], walker.at_m[1] - at_m[1]
    x_m_s = walker.velocity_m_s[0] - velocity_m_s[0]
    y_m_s = walker.velocity_m_s[1] - velocity_m_s[1]
    apart_m2 = x_m * x_m + y_m * y_m - walker.touching_m * walker.touching_m
    closing = -(x_m * x_m_s + y_m * y_m_s)
    if closing <= 0.0:
        return inf
    if apart_m2 <= 0.0:
        return 0.0
    square = x_m_s * x_m_s + y_m_s * y_m_s
    root = closing * closing - square * apart_m2
    if root < 0.0:
        return inf
    return apart_m2 / (closing + sqrt(root))
