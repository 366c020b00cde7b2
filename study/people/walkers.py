"""Positions and velocities of the people of a world, as functions of time."""

from collections.abc import Sequence
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.configuration import body_of
from plant.model.geometry import movers
from plant.model.types import Point, World
from plant.sim.physics import Mover
from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S

STEP_S: Final = PERIOD_NS / NS_PER_S
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
        self._movers = [Mover(circle) for circle in movers(world)]

    def __len__(self) -> int:
        """Return the number of people."""
        return len(self._movers)

    def at(self, time_s: float) -> list[Walker]:
        """Return all people at a time."""
        found = []
        for mover in self._movers:
            x_m, y_m = mover.position_m(time_s)
            next_x_m, next_y_m = mover.position_m(time_s + STEP_S)
            velocity_m_s = (next_x_m - x_m) / STEP_S, (next_y_m - y_m) / STEP_S
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
