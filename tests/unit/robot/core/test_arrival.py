"""Arrival: within the tolerance, or beside an obstacle that keeps the robot from the goal."""

from math import inf, pi

from robot.core import brain
from robot.core.parameters import DEFAULTS
from robot.core.state import State
from robot.core.values import Goal, Pose
from tests.support.each import each

TOLERANCE_M = 0.05
AWAY_M = 0.16
"""Distance to the goal: beyond the tolerance, but nearer than an echo at NEAR_M."""
NEAR_M = 0.07
SIGMA_M = 0.10


def standing(
    *,
    nearest_m: float = NEAR_M,
    sigma_m: float = SIGMA_M,
    heading_rad: float = 0.6 * pi,
    arrived: bool = False,
) -> State:
    """Return a robot at the origin with an echo at its side and a doubt about its position."""
    state = State(DEFAULTS)
    state.odometry.pose = Pose(0.0, 0.0, heading_rad)
    state.odometry.pxx = state.odometry.pyy = sigma_m * sigma_m
    state.ring.nearest_m = nearest_m
    state.arrived = arrived
    return state


def arrives(state: State, away_m: float = AWAY_M) -> bool:
    goal = Goal(away_m, 0.0, None, TOLERANCE_M, pi)
    return brain.has_arrived(state, goal, away_m, DEFAULTS)


def test_robot_arrives_beside_an_obstacle_if_it_may_stand_on_the_goal() -> None:
    assert arrives(standing())


def test_robot_that_knows_its_position_does_not_arrive_beside_the_goal() -> None:
    assert not arrives(standing(sigma_m=0.0))
    assert not arrives(standing(sigma_m=0.06))
    assert arrives(standing(sigma_m=0.07))


def test_robot_with_a_large_doubt_does_not_arrive_beside_the_goal() -> None:
    assert not arrives(standing(sigma_m=0.13))


def test_robot_drives_on_while_the_goal_lies_ahead() -> None:
    assert not arrives(standing(heading_rad=0.25 * pi))
    assert arrives(standing(heading_rad=0.75 * pi))


def test_no_wall_may_lie_between_robot_and_goal() -> None:
    assert not arrives(standing(nearest_m=0.03))
    assert not arrives(standing(), DEFAULTS.radius_m + NEAR_M + 0.001)


@each("nearest_m", [0.13, 1.0, inf])
def test_robot_in_the_open_drives_to_the_goal(nearest_m: float) -> None:
    assert not arrives(standing(nearest_m=nearest_m))


def test_arrival_beside_an_obstacle_lasts_while_the_robot_turns() -> None:
    turned = standing(nearest_m=inf, heading_rad=0.0, arrived=True)
    assert arrives(turned)
    assert not arrives(turned, 0.25)


def test_arrival_without_doubt_is_revoked_beyond_three_tolerances() -> None:
    sure = standing(sigma_m=0.0, arrived=True)
    assert arrives(sure, 3.0 * TOLERANCE_M - 1e-6)
    assert not arrives(sure, 3.0 * TOLERANCE_M + 1e-6)
