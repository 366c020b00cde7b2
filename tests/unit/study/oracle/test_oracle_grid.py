"""The navigator with a map drives in closed loop, and is in the robot's table only meanwhile."""

from math import inf

import pytest

from plant.corpus.generate import generate
from plant.world.file import load
from protocol.outcome import Outcome
from protocol.world import World
from robot.core.navigators.registry import NAVIGATORS as OF_ROBOT
from robot.core.parameters import DEFAULTS
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Goal, Pose
from robot.parameter_table import OutOfRangeError
from study.oracle.grid_map import GridMap
from study.oracle.names import ORACLE_GRID
from study.oracle.oracle_grid import OracleMemory, away_from_flank, registered, step
from study.trial.trial import Trial, run_trial
from tests.support.each import each
from tests.unit.study.oracle.test_evidence import ring_with


def drive(world: World, noise: str = "none", navigator: str = "oracle_grid") -> Outcome:
    return run_trial(Trial(world=world, navigator=navigator, noise=noise, timeout_s=400.0))


@each("name", ["open", "box", "u_trap", "zigzag", "corner"])
def test_goal_is_reached_without_contact(name: str) -> None:
    found = drive(load(name))
    assert found.reached
    assert found.contacts == 0


def test_goal_is_reached_with_noise() -> None:
    found = drive(load("u_trap"), "default")
    assert found.reached
    assert found.contacts == 0


def test_way_is_shorter_than_with_a_small_memory() -> None:
    world = load("zigzag")
    assert drive(world).path_m < 0.8 * drive(world, navigator="vgm_memory").path_m


def test_unreachable_goal_is_recognised() -> None:
    found = drive(generate("unreachable", 1, 31))
    assert found.outcome == "unreachable"


def test_same_seed_gives_the_same_drive() -> None:
    world = load("box")
    assert drive(world, "default").digest == drive(world, "default").digest


def test_table_of_the_robot_stays_as_it_was() -> None:
    before = dict(OF_ROBOT)
    drive(load("open"))
    assert before == OF_ROBOT
    with registered(ORACLE_GRID):
        assert ORACLE_GRID in OF_ROBOT
    assert before == OF_ROBOT


def test_parameter_cannot_choose_a_study_only_navigator() -> None:
    chosen = {"navigator": float(ORACLE_GRID)}
    with pytest.raises(OutOfRangeError):
        run_trial(Trial(world=load("open"), parameters=chosen))


def test_map_grows_where_the_robot_drives() -> None:
    grid = GridMap((0, 0), (1000, 1000))
    grid.mark(500, 500)
    assert grid.has_room(500, 500)
    assert not grid.has_room(4500, 500)
    wider = grid.extended(4500, 500)
    assert wider.has_room(4500, 500)
    assert wider.has_room(-1000, 500)
    for place in ((500, 500), (3000, 500), (-2000, 2000)):
        assert wider.terrain.cost[wider.cell_of(*place)] == grid.terrain.cost[grid.cell_of(*place)]


def test_robot_that_is_held_up_marks_the_place_ahead() -> None:
    memory, goal = OracleMemory(), Goal(2.0, 0.0, None, 0.05, 0.05)
    ring = ring_with({}, inf)
    for _ in range(80):
        step(memory, Pose(0.0, 0.0, 0.0), ring, goal, DEFAULTS)
    assert memory.grid is not None
    assert memory.grid.line_cost(0, 0, 2000, 0) == 0
    assert not memory.sees_goal


def test_new_goal_begins_with_an_empty_map() -> None:
    memory, ring = OracleMemory(), ring_with({3: 0.1, 4: 0.1}, inf)
    for _ in range(9):
        step(memory, Pose(0.0, 0.0, 0.0), ring, Goal(2.0, 0.0, None, 0.05, 0.05), DEFAULTS)
    assert memory.grid is not None
    assert (memory.grid.evidence.score > 0).any()
    step(memory, Pose(0.0, 0.0, 0.0), Ring(), Goal(2.0, 1.0, None, 0.05, 0.05), DEFAULTS)
    assert not (memory.grid.evidence.score > 0).any()


def test_robot_turns_away_from_a_flank_that_it_almost_touches() -> None:
    assert away_from_flank(ring_with({0: 0.02}, inf), -0.5) == 0.3
    assert away_from_flank(ring_with({7: 0.02}, inf), 0.5) == -0.3
    assert away_from_flank(ring_with({0: 0.02, 7: 0.02}, inf), 0.5) == 0.5
    assert away_from_flank(ring_with({0: 0.02}, inf), 0.8) == 0.8
