"""The worlds that come with the program."""

from itertools import combinations
from math import dist

import pytest

from checks.speed.accuracy import PASSAGE_M, grow
from plant.model.configuration import Body
from plant.shortest_path import shortest_path_m
from plant.world.file import SHIPPED_DIR, load, shipped
from protocol.world import Circle
from tests.support.each import each

FORESTS = {"forest_sparse": (15, 1), "forest_medium": (35, 2), "forest_dense": (60, 3)}
FIGURES = ["paper_fig5", "paper_fig7", "paper_fig11", "paper_fig12", "paper_fig13"]
NAMES = [
    *("open", "disc", "box", "corner", "u_trap", "wall", "corridor", "zigzag", "door", "moving"),
    *FORESTS,
    *FIGURES,
]


def test_shipped_worlds_are_listed() -> None:
    assert set(shipped()) == set(NAMES)


def test_paper_figures_are_listed_by_number() -> None:
    assert [name for name in shipped() if name in FIGURES] == FIGURES


@each("name", NAMES)
def test_robot_can_reach_the_goal(name: str) -> None:
    world = load(name)
    length_m = shortest_path_m(world)
    start, goal = world.start, world.goal
    straight_m = dist((start.x_m, start.y_m), (goal.x_m, goal.y_m))
    assert length_m is not None
    assert straight_m - 1e-9 <= length_m < 2.0 * straight_m


@each("name", NAMES)
def test_shipped_file_has_its_world_name_and_description(name: str) -> None:
    opening = (SHIPPED_DIR / f"{name}.toml").read_text(encoding="utf-8").split("\n")[0]
    assert load(name).name == name
    assert opening.startswith("# ")
    assert opening.endswith(".")


@each("name", NAMES)
def test_shipped_worlds_use_the_default_robot_noise_and_faults(name: str) -> None:
    world = load(name)
    assert (world.robot, world.noise, world.faults) == ({}, {}, ())


@each("name", FORESTS)
def test_forest_is_determined_by_its_seed(name: str) -> None:
    world, (count, seed) = load(name), FORESTS[name]
    clearings = ((world.start.x_m, world.start.y_m), (world.goal.x_m, world.goal.y_m))
    assert world.obstacles == grow(count, world.size_m, clearings, seed)


@each("name", FORESTS)
def test_robot_fits_between_any_two_trunks(name: str) -> None:
    trunks = [one for one in load(name).obstacles if isinstance(one, Circle)]
    gaps_m = [
        dist((a.x_m, a.y_m), (b.x_m, b.y_m)) - a.radius_m - b.radius_m
        for a, b in combinations(trunks, 2)
    ]
    assert len(trunks) == FORESTS[name][0]
    assert min(gaps_m) >= PASSAGE_M
    assert min(gaps_m) > 2.0 * Body().radius_m


def test_too_many_trunks_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"60 trunks do not fit on 2 x 2 m"):
        grow(60, (2.0, 2.0), (), seed=1)


def test_compared_figures_have_the_same_obstacle() -> None:
    virtual_goal, bug = load("paper_fig11"), load("paper_fig12")
    assert virtual_goal.obstacles == bug.obstacles
    assert (virtual_goal.start, virtual_goal.goal) == (bug.start, bug.goal)


def test_moving_obstacles_are_slower_than_the_robot() -> None:
    walkers = [one for one in load("moving").obstacles if isinstance(one, Circle)]
    assert all(0.0 < walker.speed_m_s <= 0.2 < Body().max_speed_m_s for walker in walkers)
    assert len(walkers) == 3
