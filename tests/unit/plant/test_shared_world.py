"""Several plants that share a world: equal to one plant, for every number and placement."""

from collections.abc import Iterable, Sequence
from functools import cache
from itertools import chain
from random import Random

from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import LEVELS, Fault
from plant.sim.simulation import Plant, RobotMotion
from protocol.world import WorldCircle
from tests.support.plant import FOREVER_NS, NONE, drive, ranges_m, room

ROBOTS = 6
TICKS = 100
SPEEDS = ((9000, 3000), (3000, 9000), (9000, 9000), (-6000, -6000))
NARROW = room(
    WorldCircle(x_m=3.0, y_m=2.0, radius_m=0.2),
    WorldCircle(x_m=2.5, y_m=0.5, radius_m=0.15, path_m=((2.5, 0.5), (2.5, 3.5)), speed_m_s=0.3),
    start=(1.0, 2.0, 0.0),
)
"""So narrow that the robots push each other, and a moving obstacle them."""

FAULTS = (Fault("wheel_slip", "left", value=0.5, robot=4), Fault("sonar_dead", "2", robot=1))


class SharedWorld:
    """Plants that tell each other the motions of their robots in each tick."""

    def __init__(self, shares: Iterable[Sequence[int]]) -> None:
        noise = LEVELS["default"]
        self.of: dict[int, Plant] = {}
        self.plants: list[Plant] = []
        for share in shares:
            plant = Plant(NARROW, 3, noise, FAULTS, robots=ROBOTS, own=share)
            self.plants.append(plant)
            self.of |= dict.fromkeys(share, plant)

    def advance(self, commands: Sequence[tuple[int, int]]) -> None:
        for number, (left, right) in enumerate(commands):
            self.of[number].command(number, left, right, 150)
        told = [plant.motions() for plant in self.plants]
        for plant, own in zip(self.plants, told, strict=True):
            others = (motions.items() for motions in told if motions is not own)
            plant.advance(dict(chain.from_iterable(others)))

    def results(self) -> list[object]:
        """Return all that anyone can see of each robot."""
        return [
            (plant.score(FOREVER_NS, number), plant.truth(number), plant.senses(number))
            for number, plant in sorted(self.of.items())
        ]


@cache
def wandering(seed: int) -> list[list[tuple[int, int]]]:
    """Return the wheel speeds of all robots in each tick; one robot changes its mind in each."""
    random = Random(seed)
    speeds = [SPEEDS[number % 3] for number in range(ROBOTS)]
    found = []
    for _ in range(TICKS):
        speeds[random.randrange(ROBOTS)] = random.choice(SPEEDS)
        found.append(list(speeds))
    return found


def driven(shares: Iterable[Sequence[int]], seed: int) -> SharedWorld:
    world = SharedWorld(shares)
    for commands in wandering(seed):
        world.advance(commands)
    return world


@cache
def together(seed: int) -> SharedWorld:
    """Return the world with one plant for all robots."""
    return driven([range(ROBOTS)], seed)


@given(owners=st.lists(st.integers(0, 3), min_size=ROBOTS, max_size=ROBOTS), seed=st.integers(0, 3))
def test_no_number_and_no_placement_of_plants_can_be_seen(owners: list[int], seed: int) -> None:
    shares = [
        [number for number, owner in enumerate(owners) if owner == plant] for plant in set(owners)
    ]
    assert driven(shares, seed).results() == together(seed).results()


def test_robots_of_this_test_touch_each_other() -> None:
    contacts = [
        plant.score(FOREVER_NS, number).contacts for number, plant in together(0).of.items()
    ]
    assert sum(count > 0 for count in contacts) >= 2, contacts


def test_robot_without_a_plant_stands_where_it_was() -> None:
    """Keep it as an obstacle: a plant that has gone must not free its place."""
    world = room(start=(2.0, 1.5, 0.0))
    alone = Plant(world, 1, NONE, robots=2, own=[0])
    before_m = ranges_m(alone, 0)[7]
    drive(alone, 0.0, 0.0, 5)
    assert ranges_m(alone, 0)[7] == before_m is not None


def seen_m(sonar: int, y_m: float, *speeds_m_s: float) -> float | None:
    """Return what a robot sees of one of another plant, which moves along y in two substeps."""
    alone = Plant(room(start=(2.0, 1.5, 0.0)), 1, NONE, robots=2, own=[0])
    early, late = ((0.0, speed_m_s, abs(speed_m_s)) for speed_m_s in speeds_m_s)
    alone.advance({1: RobotMotion(x_m=2.0, y_m=y_m, clearance_m=1.0, legs=(early, late))})
    return ranges_m(alone, 0)[sonar]


def test_robot_of_another_plant_is_seen_where_its_plant_says() -> None:
    """Its place is that of the early pings on the right, and that of the late ones on the left."""
    assert seen_m(0, 0.5, 0.4, 0.8) == seen_m(0, 0.51, 0.0, 0.0) != seen_m(0, 0.53, 0.0, 0.0)
    assert seen_m(7, 2.5, -0.4, -0.8) == seen_m(7, 2.47, 0.0, 0.0) != seen_m(7, 2.49, 0.0, 0.0)
