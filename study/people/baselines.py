"""Fair baselines for contacts with people: a robot that stands still, and an omniscient one.

People in the simulator evade nobody. So a robot that stands at a place is touched by everyone who
passes there. The omniscient robot has all positions and paths beforehand.
"""

from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.model.configuration import body_of
from plant.model.geometry import clearance_m, distance_m
from plant.model.scene import moves
from plant.model.types import Point, World
from plant.placement.shortest_path import path_length_m, shortest_path
from study.people.walkers import STEP_S, Walkers

Mask: TypeAlias = NDArray[np.bool_]

PLACES: Final = 12
CELL_M: Final = 0.10
LAYER_S: Final = 0.5
"""In this time a robot at 0.3 m/s moves to a neighbour of its cell, diagonals included."""

MOVING_M: Final = 0.071
"""Farthest that the robot is from the nearer end of a diagonal step."""

MARGIN_M: Final = 0.01
SAMPLES: Final = 4
"""Positions of people per layer; between two samples 0.4 m/s is 5 cm, half of it to either."""


class Standing(NamedTuple):
    """A place along the way, and whether a robot that stands there is touched, and how often."""

    at_m: Point
    contacts: int


def places_along(world: World, count: int = PLACES) -> list[Point]:
    """Return the middles of `count` equal parts of the shortest path; none without a path."""
    path = shortest_path(world)
    length_m = path_length_m(path)
    if path is None or length_m is None:
        return []
    return [_along(path, length_m * (k + 0.5) / count) for k in range(count)]


def _along(path: list[Point], way_m: float) -> Point:
    """Return the point of a path at a distance from its beginning."""
    for a, b in pairwise(path):
        leg_m = distance_m(a, b)
        if way_m <= leg_m and leg_m > 0.0:
            share = way_m / leg_m
            return a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
        way_m -= leg_m
    return path[-1]


def stand(world: World, at_m: Point, duration_s: float, begin_s: float = 0.0) -> Standing:
    """Count the contacts of a robot that stands at a place for a time.

    A person who is there at the beginning does not count until it comes back, as no robot can
    begin inside of a person.
    """
    walkers, ticks = Walkers(world), round(duration_s / STEP_S)
    before = contacts = 0
    for tick in range(ticks + 1):
        touching = 0
        for number, (x_m, y_m, least_m) in enumerate(walkers.places(begin_s + tick * STEP_S)):
            x_m, y_m = x_m - at_m[0], y_m - at_m[1]
            touching |= (x_m * x_m + y_m * y_m < least_m * least_m) << number
        if tick:
            contacts += (touching & ~before).bit_count()
        before = touching
    return Standing(at_m, contacts)


def omniscient_s(world: World, limit_s: float) -> float | None:
    """Return the time of arrival of a robot that has all paths beforehand and touches nothing.

    Searches layers of a grid, LAYER_S apart. The margins cover what happens between the layers, so
    the result is possible for a point robot that turns at once. None if there is no such way.
    """
    floor = _Floor(world)
    here = floor.near(world.start.x_m, world.start.y_m) & floor.open
    goal = floor.near(world.goal.x_m, world.goal.y_m)
    walkers = Walkers(world)
    for layer in range(round(limit_s / LAYER_S) + 1):
        here &= floor.free_of(walkers, layer * LAYER_S)
        if (here & goal).any():
            return layer * LAYER_S
        if not here.any():
            return None
        here = _grown(here) & floor.open
    return None


class _Floor:
    """A grid of the places of the robot's centre."""

    def __init__(self, world: World) -> None:
        radius_m = body_of(world).radius_m
        self._x_m, self._y_m = (np.arange(0.5 * CELL_M, side_m, CELL_M) for side_m in world.size_m)
        still = [one for one in world.obstacles if not moves(one)]
        least_m = radius_m + MARGIN_M
        self.open: Mask = np.array(
            [
                [
                    all(clearance_m((x_m, y_m), one) >= least_m for one in still)
                    and least_m <= x_m <= world.size_m[0] - least_m
                    and least_m <= y_m <= world.size_m[1] - least_m
                    for y_m in self._y_m.tolist()
                ]
                for x_m in self._x_m.tolist()
            ]
        )

    def near(self, x_m: float, y_m: float) -> Mask:
        """Return the cells whose centres are within a cell of a point."""
        return self._beyond(x_m, y_m, CELL_M) ^ True

    def free_of(self, walkers: Walkers, time_s: float) -> Mask:
        """Return the cells that nobody touches from half a layer before a time until after it."""
        free = np.ones_like(self.open)
        for sample in range(-SAMPLES // 2, SAMPLES // 2 + 1):
            moment_s = max(0.0, time_s + sample * LAYER_S / SAMPLES)
            for x_m, y_m, touching_m in walkers.places(moment_s):
                free &= self._beyond(x_m, y_m, touching_m + MOVING_M + MARGIN_M)
        return free

    def _beyond(self, x_m: float, y_m: float, away_m: float) -> Mask:
        across_m2, up_m2 = (self._x_m - x_m) ** 2, (self._y_m - y_m) ** 2
        beyond: Mask = across_m2[:, None] + up_m2[None, :] > away_m * away_m
        return beyond


def _grown(here: Mask) -> Mask:
    """Return the cells that are reached within a layer: these and their eight neighbours."""
    wide = here.copy()
    wide[1:] |= here[:-1]
    wide[:-1] |= here[1:]
    grown = wide.copy()
    grown[:, 1:] |= wide[:, :-1]
    grown[:, :-1] |= wide[:, 1:]
    return grown
