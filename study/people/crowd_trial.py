"""Trials in one world with people, with two baselines in the same world.

People in the simulator evade nothing. So each person that passes a standing robot touches it. The
omniscient robot has all positions and paths beforehand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant.corpus import generate
from plant.model.configuration import body_of
from plant.model.geometry import clearance_m, distance_m, moves
from plant.shortest_path import path_length_m, shortest_path
from protocol.world import Obstacle, Point, Polyline, World, WorldCircle
from runtime.units import PERIOD_S
from study.people.encounters import Encounters, Exposure, PersonContact, Walkers, gap_of
from study.runner.plan import digest_of, seed_of
from study.trial.trial import Trial, run_trial

Mask: TypeAlias = NDArray[np.bool_]

PLACES: Final = 12
CELL_M: Final = 0.10
LAYER_S: Final = 0.5
"""In this time a robot at 0.3 m/s moves to a neighbour of its cell, diagonals included."""

MOVING_M: Final = 0.071
"""Farthest that the robot is from the nearer end of a diagonal step."""

MARGIN_M: Final = 0.01
SAMPLES: Final = 4
"""Positions of people per layer. At 0.4 m/s two samples are 5 cm apart."""

STANDING_M_S: Final = (0.0, 0.0)


class Standing(NamedTuple):
    """A place, and the number of contacts of a robot standing there."""

    at_m: Point
    contacts: int


class Stay(NamedTuple):
    """Exposure of a standing robot until its first contact, if it has one."""

    exposure: Exposure
    touched: bool


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


def stand(world: World, places: Sequence[Point], duration_s: float) -> list[Standing]:
    """Count the contacts of a robot standing at each of the places for a time.

    A person that is there at the beginning does not count until it comes back, because no robot
    can begin inside of a person.
    """
    times_s = [tick * PERIOD_S for tick in range(round(duration_s / PERIOD_S) + 1)]
    tracks = Walkers(world).tracks(times_s)
    found = []
    for at_m in places:
        contacts = 0
        for x_m, y_m, least_m in tracks:
            touching = (x_m - at_m[0]) ** 2 + (y_m - at_m[1]) ** 2 < least_m * least_m
            contacts += int((touching[1:] & ~touching[:-1]).sum())
        found.append(Standing(at_m, contacts))
    return found


def stay(world: World, at_m: Point, duration_s: float) -> Stay:
    """Measure a robot standing at a place, from its first free tick to its first contact."""
    walkers, exposure, free = Walkers(world), Exposure(), False
    for tick in range(round(duration_s / PERIOD_S) + 1):
        people = walkers.at(tick * PERIOD_S)
        touching = any(gap_of(at_m, walker) < 0.0 for walker in people)
        free = free or not touching
        if free:
            exposure.add(at_m, STANDING_M_S, people)
            if touching:
                return Stay(exposure, True)
    return Stay(exposure, False)


def omniscient_route(world: World, limit_s: float) -> list[Point] | None:
    """Return the fastest way of a robot that has all paths beforehand and touches nothing.

    The points are LAYER_S apart. The search is over layers of a grid in time. Margins cover
    the motion between the layers, so a point robot that turns at once can drive the result. Of
    equal ways it takes the one that leaves the start last. None if there is no such way.
    """
    floor = _WalkableFloor(world)
    here = floor.near(world.start.x_m, world.start.y_m) & floor.open
    goal = floor.near(world.goal.x_m, world.goal.y_m)
    walkers, layers = Walkers(world), list[Mask]()
    for layer in range(round(limit_s / LAYER_S) + 1):
        layers.append(here & floor.free_of(walkers, layer * LAYER_S))
        if (layers[-1] & goal).any():
            layers[-1] &= goal
            return floor.route(layers, (world.start.x_m, world.start.y_m))
        if not layers[-1].any():
            return None
        here = _grown(layers[-1]) & floor.open
    return None


def route_exposure(world: World, route: list[Point]) -> Exposure:
    """Measure a robot on a route with points LAYER_S apart."""
    walkers, exposure, ticks = Walkers(world), Exposure(), round(LAYER_S / PERIOD_S)
    for layer, (a, b) in enumerate(pairwise(route)):
        velocity_m_s = (b[0] - a[0]) / LAYER_S, (b[1] - a[1]) / LAYER_S
        for tick in range(ticks):
            share = tick / ticks
            at_m = a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1])
            exposure.add(at_m, velocity_m_s, walkers.at((layer * ticks + tick) * PERIOD_S))
    return exposure


class _WalkableFloor:
    """A grid of the places of the robot's centre."""

    def __init__(self, world: World) -> None:
        radius_m = body_of(world).radius_m
        self._x_m, self._y_m = (np.arange(0.5 * CELL_M, side_m, CELL_M) for side_m in world.size_m)
        least_m = radius_m + MARGIN_M
        across, up = (
            (least_m <= at_m) & (at_m <= side_m - least_m)
            for at_m, side_m in zip((self._x_m, self._y_m), world.size_m, strict=True)
        )
        self.open: Mask = across[:, None] & up[None, :]
        for one in world.obstacles:
            if not moves(one):
                self._close(one, least_m)

    def _close(self, obstacle: Obstacle, least_m: float) -> None:
        """Close the cells too near to an obstacle; only those around it are compared with it."""
        x_m, y_m, reach_m = around(obstacle)
        for i, j in np.argwhere(self.open & ~self._beyond(x_m, y_m, reach_m + least_m)).tolist():
            place_m = float(self._x_m[i]), float(self._y_m[j])
            if clearance_m(place_m, obstacle) < least_m:
                self.open[i, j] = False

    def near(self, x_m: float, y_m: float) -> Mask:
        """Return the cells whose centres are within a cell of a point."""
        return self._beyond(x_m, y_m, CELL_M) ^ True

    def route(self, layers: list[Mask], start_m: Point) -> list[Point]:
        """Return a way from the first layer to a cell of the last one.

        The way is found backwards. Of the cells that lead to the next one, it takes the one that
        is nearest to the start.
        """
        next_cell: NDArray[np.int64] | None = None
        route: list[Point] = []
        for layer in reversed(layers):
            cells = np.argwhere(layer)
            if next_cell is not None:
                cells = cells[np.abs(cells - next_cell).max(axis=1) <= 1]
            x_m, y_m = self._x_m[cells[:, 0]], self._y_m[cells[:, 1]]
            best = int(np.argmin((x_m - start_m[0]) ** 2 + (y_m - start_m[1]) ** 2))
            next_cell = cells[best]
            route.append((float(x_m[best]), float(y_m[best])))
        return route[::-1]

    def free_of(self, walkers: Walkers, time_s: float) -> Mask:
        """Return the cells without a contact within half a layer before and after a time."""
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


def around(obstacle: Obstacle) -> tuple[float, float, float]:
    """Return centre and radius in metres of a circle that contains an obstacle."""
    if isinstance(obstacle, WorldCircle):
        return obstacle.x_m, obstacle.y_m, obstacle.radius_m
    points = np.array(obstacle.points_m)
    x_m, y_m = points.mean(axis=0).tolist()
    reach_m = float(np.hypot(points[:, 0] - x_m, points[:, 1] - y_m).max())
    wide_m = obstacle.thickness_m / 2.0 if isinstance(obstacle, Polyline) else 0.0
    return x_m, y_m, reach_m + wide_m + 1e-9


def _grown(here: Mask) -> Mask:
    """Return the cells that are reached within a layer: these and their eight neighbours."""
    wide = here.copy()
    wide[1:] |= here[:-1]
    wide[:-1] |= here[1:]
    grown = wide.copy()
    grown[:, 1:] |= wide[:, :-1]
    grown[:, :-1] |= wide[:, 1:]
    return grown


LIMIT_S: Final = 300.0


class TrialSeries(NamedTuple):
    """Worlds of one family and seed, and the trials in each of them.

    A navigator is NAME:SIDE. `repeats` is the number of trials of each navigator in each world,
    with different noise. With `is_exposed` the exposure of both baselines is measured, too; the
    standing robot then stays as long as the first trial of the last navigator took.
    """

    family: str
    noise: str
    seed: int
    worlds: int
    navigators: tuple[str, ...] = ("vgm_memory:left",)
    repeats: int = 1
    is_exposed: bool = False


@dataclass(frozen=True, slots=True)
class CrowdTrial:
    """Result of one trial.

    `arrived` means without a contact. `standing` is the share of places along the shortest path
    at which a standing robot is touched within the time of the trial.
    """

    arrived: bool
    touched: bool
    own_contacts: int
    standing: float
    exposure: Exposure
    contacts: tuple[PersonContact, ...]


@dataclass(frozen=True, slots=True)
class WorldResult:
    """Results in one world; `blocked`: the omniscient robot finds no way without a contact.

    `stays` has one entry for each place along the shortest path. `stays` and `route` are only
    measured if the series is exposed.
    """

    trials: Mapping[str, tuple[CrowdTrial, ...]]
    blocked: bool
    stays: tuple[Stay, ...]
    route: Exposure | None


def run_world(series: TrialSeries, index: int) -> WorldResult:
    """Run the trials and both baselines in one world of a series."""
    world = generate(series.family, index, series.seed)
    digest = digest_of(world)
    trials = {
        navigator: tuple(
            run_crowd_trial(world, navigator, series.noise, seed_of(digest, number))
            for number in range(series.repeats)
        )
        for navigator in series.navigators
    }
    route = omniscient_route(world, LIMIT_S)
    if not series.is_exposed:
        return WorldResult(trials, route is None, (), None)
    duration_s = trials[series.navigators[-1]][0].exposure.time_s
    stays = tuple(stay(world, place, duration_s) for place in places_along(world))
    exposure = None if route is None else route_exposure(world, route)
    return WorldResult(trials, route is None, stays, exposure)


def run_crowd_trial(world: World, navigator: str, noise: str, seed: int) -> CrowdTrial:
    """Run one trial and the standing robot beside it; the world must have a static way."""
    name, _, side = navigator.partition(":")
    encounters = Encounters(world)
    trial = Trial(world=world, navigator=name, side=side, noise=noise, seed=seed, timeout_s=LIMIT_S)
    outcome = run_trial(trial, encounters)
    stays = stand(world, places_along(world), outcome.time_s)
    return CrowdTrial(
        arrived=outcome.reached and not outcome.contacts,
        touched=outcome.contacts > 0,
        own_contacts=outcome.own_contacts,
        standing=sum(one.contacts > 0 for one in stays) / PLACES,
        exposure=encounters.exposure,
        contacts=tuple(encounters.contacts),
    )
