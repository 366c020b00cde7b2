from math import cos, pi, sin

import pytest

from robot.core.navigators import evasion as flank_walkers
from robot.core.navigators.evasion import (
    ALONG_MM,
    ASIDE,
    BEFORE_M,
    GIVE_WAY_TICKS,
    WALKER_NEAR_M,
    FlankWalker,
)
from robot.core.perception.echoes import BRADS, CIRCLE, HALF_CIRCLE
from robot.core.perception.sonar_ring import Ring
from robot.core.values import Pose
from tests.support.robot.core.rings import Wall, ring, seen_from

FLANKS = pytest.mark.parametrize("side", [1, -1])
STEP_M = 0.01
ALONG_TICKS = int(0.001 * ALONG_MM / STEP_M) + 2


def watch(flank_walker: FlankWalker, pose: Pose, seen: Ring) -> bool:
    return flank_walkers.watch(flank_walker, seen, pose)


def beside(side: int, range_m: float = 0.5 * WALKER_NEAR_M) -> Ring:
    """Return a ring in which only the last sonar of a flank has a near echo."""
    last, before = (7, 6) if side > 0 else (0, 1)
    return ring({last: round(1000.0 * range_m), before: 2500})


def straight(ticks: int, heading_rad: float = 0.0) -> list[Pose]:
    c, s = STEP_M * cos(heading_rad), STEP_M * sin(heading_rad)
    return [Pose(k * c, k * s, heading_rad) for k in range(ticks)]


@FLANKS
@pytest.mark.parametrize("heading_rad", [0.0, 2.0, pi - 0.01])
def test_pedestrian_alongside_is_detected(side: int, heading_rad: float) -> None:
    flank_walker = FlankWalker()
    told = [watch(flank_walker, pose, beside(side)) for pose in straight(ALONG_TICKS, heading_rad)]
    assert sum(told) == 1
    assert flank_walker.ticks == GIVE_WAY_TICKS
    turned = (flank_walker.heading - int(BRADS * heading_rad) + HALF_CIRCLE) % CIRCLE - HALF_CIRCLE
    assert turned == -side * ASIDE


@FLANKS
def test_passed_end_of_a_wall_is_no_pedestrian(side: int) -> None:
    wall: list[Wall] = [(-3.0, side * 0.25, 0.0, side * 0.25)]
    flank_walker = FlankWalker()
    for k in range(200):
        pose = Pose(-1.0 + STEP_M * k, 0.0, 0.0)
        assert not watch(flank_walker, pose, seen_from(pose, wall))


@FLANKS
def test_passed_post_is_no_pedestrian(side: int) -> None:
    flank_walker = FlankWalker()
    for k in range(200):
        pose = Pose(-1.0 + STEP_M * k, 0.0, 0.0)
        assert not watch(flank_walker, pose, seen_from(pose, [], [(0.0, side * 0.25, 0.05)]))


@FLANKS
def test_disc_that_keeps_up_is_a_pedestrian(side: int) -> None:
    flank_walker = FlankWalker()
    told = []
    for pose in straight(ALONG_TICKS):
        person = (pose.x_m - 0.04, side * 0.30, 0.10)
        told.append(watch(flank_walker, pose, seen_from(pose, [], [person])))
    assert any(told)


def test_continuing_wall_is_no_pedestrian() -> None:
    flank_walker = FlankWalker()
    wall: list[Wall] = [(-3.0, -0.25, 3.0, -0.25)]
    assert not any(watch(flank_walker, pose, seen_from(pose, wall)) for pose in straight(100))


@FLANKS
def test_pillar_circled_on_an_arc_is_no_pedestrian(side: int) -> None:
    """Circle a static obstacle, which stays beside the robot."""
    flank_walker, radius_m = FlankWalker(), 0.3
    for k in range(400):
        angle_rad = side * k * STEP_M / radius_m
        pose = Pose(radius_m * sin(angle_rad), -side * radius_m * cos(angle_rad), angle_rad)
        assert not watch(flank_walker, pose, beside(side))


@FLANKS
def test_change_of_flank_restarts_the_measurement(side: int) -> None:
    flank_walker = FlankWalker()
    half = ALONG_TICKS * 2 // 3
    told = [
        watch(flank_walker, pose, beside(side if k < half else -side))
        for k, pose in enumerate(straight(2 * half))
    ]
    assert not any(told)


def test_stationary_robot_detects_no_pedestrian() -> None:
    flank_walker = FlankWalker()
    assert not any(watch(flank_walker, Pose(1.0, 1.0, 0.5), beside(1)) for _ in range(500))


@FLANKS
def test_flank_is_where_only_the_last_sonar_has_an_echo(side: int) -> None:
    last, before = (7, 6) if side > 0 else (0, 1)
    near_mm, far_mm = round(500.0 * WALKER_NEAR_M), round(1000.0 * (WALKER_NEAR_M + BEFORE_M))
    assert flank_walkers.flank(ring({last: near_mm, before: near_mm + far_mm})) == side
    assert flank_walkers.flank(ring({last: near_mm})) == side
    assert flank_walkers.flank(ring({last: near_mm, before: near_mm + 50})) == 0
    assert flank_walkers.flank(ring({last: far_mm})) == 0
    assert flank_walkers.flank(ring({})) == 0


@FLANKS
@pytest.mark.parametrize("silent", [0, 1])
def test_flank_with_a_missing_sonar_does_not_count(side: int, silent: int) -> None:
    seen = beside(side)
    seen.range_m[(7 - silent) if side > 0 else silent] = None
    assert flank_walkers.flank(seen) == 0
