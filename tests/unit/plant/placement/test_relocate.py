"""A run may begin at any place and time, but not inside an obstacle."""

from math import inf, nan

import pytest

from plant.model.configuration import LEVELS
from plant.sim.simulation import Plant
from protocol.world import Circle, GoalPose, Polygon, Polyline, Start, World
from runtime.errors import UserError
from study.cli.trial import elsewhere
from tests.support.each import each
from tests.support.plant.rooms import room

ROLLER = Circle(x_m=2.0, y_m=1.0, radius_m=0.2, path_m=((2.0, 1.0), (2.0, 3.0)), speed_m_s=0.5)
BOX = Polygon(((1.0, 1.0), (1.5, 1.0), (1.5, 1.5), (1.0, 1.5)))
FENCE = Polyline(((3.0, 1.0), (3.0, 3.0)))


def at(x_m: float, y_m: float) -> Start:
    return Start(x_m=x_m, y_m=y_m)


def test_relocate_without_changes_returns_the_same_world() -> None:
    world = room(ROLLER)
    assert elsewhere(world, None, None, 0.0) == world


def test_start_and_goal_are_replaced_and_the_rest_kept() -> None:
    world = room(BOX)
    moved = elsewhere(world, at(3.0, 3.0), GoalPose(x_m=0.5, y_m=0.5), 4.0)
    assert (moved.start, moved.goal) == (at(3.0, 3.0), GoalPose(x_m=0.5, y_m=0.5))
    assert moved.obstacles == world.obstacles


@each(
    ("obstacle", "place", "reason"),
    [
        (BOX, (1.2, 1.2), "obstacle#1 is 0.000 m"),
        (BOX, (0.95, 1.2), "obstacle#1 is 0.050 m"),
        (FENCE, (3.05, 2.0), "obstacle#1 is 0.040 m"),
        (ROLLER, (2.0, 1.1), "obstacle#1 is 0.000 m"),
        (BOX, (0.05, 2.0), "the outer wall is 0.050 m"),
        (BOX, (-1.0, 2.0), "outside the world"),
        (BOX, (1.0, 99.0), "outside the world"),
        (BOX, (nan, 2.0), "finite"),
        (BOX, (1.0, inf), "finite"),
    ],
)
def test_blocked_start_is_rejected_with_the_reason(
    obstacle: Circle | Polygon | Polyline, place: tuple[float, float], reason: str
) -> None:
    with pytest.raises(UserError, match="start") as refused:
        elsewhere(room(obstacle), at(*place), None, 0.0)
    assert reason in str(refused.value)


def test_start_in_contact_with_an_obstacle_is_allowed() -> None:
    radius_m = 0.12
    against = at(BOX.points_m[0][0] - radius_m + 0.004, 1.2)
    assert elsewhere(room(BOX), against, None, 0.0).start == against


def test_moving_obstacle_blocks_only_its_current_position() -> None:
    """Place the obstacle where it is after 4 s: two metres up, at the end of its path."""
    world = room(ROLLER)
    assert elsewhere(world, at(2.0, 1.0), None, 4.0).start == at(2.0, 1.0)
    with pytest.raises(UserError, match=r"taken.*at 4 s"):
        elsewhere(world, at(2.0, 3.0), None, 4.0)


def test_start_of_the_world_may_be_used_later() -> None:
    world = room(ROLLER, start=(2.0, 3.0, 0.0))
    assert elsewhere(world, None, None, 0.0) == world
    with pytest.raises(UserError, match="taken"):
        elsewhere(world, None, None, 4.0)


def test_goal_may_be_in_an_obstacle_but_not_outside() -> None:
    world = room(BOX)
    assert elsewhere(world, None, GoalPose(x_m=1.2, y_m=1.2), 0.0).goal.x_m == 1.2
    for goal in (GoalPose(x_m=99.0, y_m=1.0), GoalPose(x_m=nan, y_m=1.0)):
        with pytest.raises(UserError, match="goal"):
            elsewhere(world, None, goal, 0.0)
    with pytest.raises(UserError, match="finite"):
        elsewhere(world, None, GoalPose(x_m=1.0, y_m=1.0, heading_rad=inf), 0.0)


def plant_at(world: World, at_ns: int) -> Plant:
    return Plant(world, 1, LEVELS["none"], at_ns=at_ns)


def test_plant_started_later_matches_the_earlier_plant() -> None:
    """Compare sonars and contacts of a robot that does not move."""
    world = room(ROLLER, start=(1.4, 2.0, 0.0))
    begun, later = plant_at(world, 0), plant_at(world, 2_000_000_000)
    while begun.now_ns < later.now_ns:
        begun.advance()
    for _ in range(60):
        begun.advance()
        later.advance()
        assert begun.now_ns == later.now_ns
        assert begun.truth().clearance_m == pytest.approx(later.truth().clearance_m, abs=1e-9)
        assert begun.senses()[1] == later.senses()[1]


def test_score_of_a_later_start_counts_from_that_start() -> None:
    plant = plant_at(room(), 2_000_000_000)
    for _ in range(10):
        plant.advance()
    score = plant.score(plant.now_ns)
    assert (score.ticks, score.time_ns) == (10, 2_500_000_000)
