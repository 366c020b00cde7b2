"""Where the people of a world are at a time, and how they move."""

from typing import Final, NamedTuple

from plant.model.configuration import body_of
from plant.model.movers import Mover
from plant.model.scene import movers
from plant.model.types import Point, World
from runtime.timing import PERIOD_NS
from runtime.units import NS_PER_S

STEP_S: Final = PERIOD_NS / NS_PER_S
"""Period of control; the speed of a person is its way in the period that begins."""


class Walker(NamedTuple):
    """A person at a time: position, velocity, and the distance of the centres at a contact."""

    at_m: Point
    velocity_m_s: Point
    touching_m: float


class Walkers:
    """The people of a world, whose positions are functions of time."""

    def __init__(self, world: World) -> None:
        self._robot_m = body_of(world).radius_m
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
            found.append(Walker((x_m, y_m), velocity_m_s, mover.radius_m + self._robot_m))
        return found

    def places(self, time_s: float) -> list[tuple[float, float, float]]:
        """Return position and contact distance of all people, cheaper than `at`."""
        return [
            (*mover.position_m(time_s), mover.radius_m + self._robot_m) for mover in self._movers
        ]
