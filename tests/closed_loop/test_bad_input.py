"""Impossible goals, bad starts and failing sensors: each run ends with a reason."""

from collections.abc import Callable
from dataclasses import replace
from math import inf, nan, pi

import pytest

from plant.sim.simulation import Plant
from protocol.outcome import Outcome
from protocol.world import Circle, GoalPose, Obstacle, Polygon, Settings, Start, World
from robot.core.values import Outputs
from study.trial.core_loop import CoreLoop
from study.trial.trial import NAVIGATORS, Trial, run_trial
from tests.support.each import each

TIMEOUT_S = 300.0
GIVEN_UP = ("unreachable", "lost", "stuck")
BLOCK = Polygon(((2.2, 1.4), (3.4, 1.4), (3.4, 2.6), (2.2, 2.6)))
every_navigator = each("navigator", NAVIGATORS)
some_navigators = pytest.mark.parametrize("navigator", NAVIGATORS)


def room(*obstacles: Obstacle, goal: tuple[float, float], walls: bool = True) -> World:
    return World(
        name="room",
        size_m=(5.0, 4.0),
        start=Start(x_m=1.0, y_m=2.0, heading_rad=0.0),
        goal=GoalPose(x_m=goal[0], y_m=goal[1]),
        walls=walls,
        obstacles=obstacles,
    )


def ends(
    world: World,
    navigator: str,
    watch: Callable[[Plant, CoreLoop, Outputs], None] | None = None,
) -> Outcome:
    trial = Trial(world=world, navigator=navigator, noise="none", timeout_s=TIMEOUT_S)
    return run_trial(trial, watch)


@pytest.mark.sweep(4)
@some_navigators
def test_a_goal_inside_an_obstacle_is_given_up(navigator: str) -> None:
    outcome = ends(room(BLOCK, goal=(2.8, 2.0)), navigator)
    assert outcome.outcome in GIVEN_UP
    assert outcome.own_contacts == 0
    assert outcome.reason != "ok"


@pytest.mark.sweep(4)
@some_navigators
def test_a_goal_behind_the_outer_wall_is_given_up(navigator: str) -> None:
    outcome = ends(room(goal=(5.6, 2.0)), navigator)
    assert outcome.outcome in GIVEN_UP
    assert outcome.own_contacts == 0


@every_navigator
@each("heading_rad", [None, 0.0, pi / 2])
def test_a_goal_at_the_robot_is_reached_without_a_way(
    navigator: str, heading_rad: float | None
) -> None:
    world = room(goal=(1.0, 2.0))
    world = replace(world, goal=replace(world.goal, heading_rad=heading_rad))
    outcome = ends(world, navigator)
    assert (outcome.outcome, outcome.path_m < 0.01) == ("reached", True)
    assert outcome.time_s < 5.0


@every_navigator
@each("walls", [True, False])
def test_a_world_without_any_obstacle_is_crossed_straight(navigator: str, walls: bool) -> None:
    outcome = ends(room(goal=(4.0, 2.6), walls=walls), navigator)
    assert (outcome.outcome, outcome.contacts) == ("reached", 0)
    assert outcome.path_m < 1.02 * (3.0**2 + 0.6**2) ** 0.5


@pytest.mark.sweep(5)
@some_navigators
@pytest.mark.parametrize("heading_deg", [0, 60, 120, 180])
def test_a_robot_that_starts_in_contact_does_not_push(navigator: str, heading_deg: int) -> None:
    """Check that it drives away or stops with its back to the wall, and turns or stops facing it.

    Only vgm follows the tangent, as in the paper, and scrapes along the wall it touches.
    """
    pillar = Circle(x_m=1.0 + 0.12 + 0.3, y_m=2.0, radius_m=0.3)
    world = room(pillar, goal=(4.0, 2.0))
    start = replace(world.start, heading_rad=heading_deg * pi / 180)
    outcome = ends(replace(world, start=start), navigator)
    grazes = navigator == "vgm" and heading_deg <= 60
    assert outcome.own_contacts == 0 or grazes
    assert outcome.outcome in ("reached", *GIVEN_UP, "aborted") or grazes
    assert outcome.outcome == "reached" or outcome.reason != "ok"


@every_navigator
def test_sonars_that_freeze_beside_an_obstacle_stop_the_robot(navigator: str) -> None:
    fault: Settings = {"kind": "sonar_frozen", "target": "all", "start_s": 6.0}
    outcome = ends(replace(room(BLOCK, goal=(4.4, 2.0)), faults=(fault,)), navigator)
    assert (outcome.outcome, outcome.reason) == ("aborted", "sonar values are frozen")
    assert outcome.contacts == 0
    assert outcome.time_s < 12.0


@every_navigator
@each("range_m", [0.0, 60.0])
def test_impossible_range_stops_the_robot(navigator: str, range_m: float) -> None:
    fault: Settings = {"kind": "sonar_fixed", "target": "4", "start_s": 6.0, "value": range_m}
    outcome = ends(replace(room(BLOCK, goal=(4.4, 2.0)), faults=(fault,)), navigator)
    assert (outcome.outcome, outcome.reason) == ("aborted", "sonar values are impossible")
    assert outcome.contacts == 0


@every_navigator
@each("value", [nan, inf])
def test_pose_with_nan_while_following_stops_the_robot(navigator: str, value: float) -> None:
    def spoil(plant: Plant, onboard: CoreLoop, _outputs: Outputs) -> None:
        if plant.now_ns == 6_000_000_000:
            odometry = onboard.state.odometry
            odometry.pose = odometry.pose._replace(x_m=value)

    outcome = ends(room(BLOCK, goal=(4.4, 2.0)), navigator, spoil)
    assert (outcome.outcome, outcome.reason) == ("aborted", "a value is not a number")
    assert outcome.contacts == 0


@every_navigator
def test_a_ring_gone_blind_in_mid_follow_stops_the_robot(navigator: str) -> None:
    fault: Settings = {"kind": "sonar_dead", "target": "all", "start_s": 6.0}
    outcome = ends(replace(room(BLOCK, goal=(4.4, 2.0)), faults=(fault,)), navigator)
    assert (outcome.outcome, outcome.reason) == ("aborted", "no fresh sonar scan for 250 ms")
    assert outcome.contacts == 0
