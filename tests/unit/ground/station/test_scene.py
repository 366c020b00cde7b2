"""The map shows live data, and where a silent robot may be."""

import pytest

from ground.map.pen import CHI2_2
from ground.station.scene import TRAIL_POINTS, thinned
from protocol.topics import WORLD, Role
from protocol.wire.enums import GoalState, Mode
from tests.support.each import each
from tests.support.ground.station.play import Play
from tests.support.ground.station.said import Robot


def test_scene_contains_live_data_only() -> None:
    play = Play()
    play.robot.goal_id, play.robot.goal = 4, GoalState.AVOIDING
    scene = play.forward(1.0).station.scene()
    assert scene.live
    assert scene.robot is not None
    assert scene.robot.radius_m == 0.15
    assert scene.goal is not None
    assert (scene.goal.x_m, scene.goal.heading_rad) == (5.0, None)
    assert scene.zone_m == pytest.approx(0.3)
    assert scene.virtual_goal is None
    assert len(scene.ranges_m) == 8
    assert (len(scene.hits), len(scene.movers)) == (1, 1)
    assert len(scene.seen) >= 4
    assert scene.current is None
    play.hang()
    scene = play.forward(2.0).station.scene()
    assert not scene.live
    assert scene.robot is not None
    assert (scene.goal, scene.zone_m) == (None, None)


def test_ellipse_of_a_silent_robot_grows() -> None:
    play = Play().forward(1.0)
    heard = play.station.scene().covariance
    play.hang()
    play.forward(1.0)
    later = play.station.scene().covariance
    play.forward(9.0)
    last = play.station.scene().covariance
    assert heard is not None
    assert later is not None
    assert last is not None
    assert heard[0] == pytest.approx(0.04)
    assert 0.04 + 0.2**2 / 6 < later[0] < 0.04 + 0.26**2 / 6
    assert last[0] == pytest.approx(0.04 + 0.5**2 / 6, rel=1e-2)
    assert last[2] == pytest.approx(0.01 + 0.5**2 / 6, rel=1e-2)


@each(
    ("limits", "gone_m"),
    [
        ({"op_lost_ms": 3000}, 0.25 * 3.5),
        ({"accel_m_s2": 0.125}, 0.25 * 3.8),
        ({}, 0.25 * 2.0),
    ],
)
def test_ellipse_follows_the_limits_of_the_robot(limits: dict[str, float], gone_m: float) -> None:
    play = Play()
    play.params.update(limits)
    play.forward(1.0)
    play.hang()
    covariance = play.forward(12.0).station.scene().covariance
    assert covariance is not None
    assert covariance[0] == pytest.approx(0.04 + gone_m**2 / CHI2_2, rel=1e-3)


def test_ellipse_of_a_robot_on_its_way_grows_with_its_fastest_speed() -> None:
    play = Play()
    play.params["v_max_m_s"] = 1.0
    play.robot.goal, play.robot.goal_id = GoalState.DRIVING, 4
    play.forward(1.0)
    play.hang()
    covariance = play.forward(12.0).station.scene().covariance
    assert covariance is not None
    assert covariance[0] == pytest.approx(0.04 + (1.8 + 1.0 / 1.25) ** 2 / CHI2_2, rel=1e-3)


def test_ellipse_without_known_limits_does_not_promise_a_stop() -> None:
    play = Play()
    del play.bus.answers["srv/parameters"]
    play.forward(1.0)
    play.hang()
    covariance = play.forward(12.0).station.scene().covariance
    assert covariance is not None
    assert covariance[0] > 0.04 + (0.25 * 11.0) ** 2 / CHI2_2


def test_robot_has_its_own_radius_and_the_true_one_that_of_the_plant() -> None:
    play = Play()
    play.params["radius_m"] = 0.3
    scene = play.forward(1.0).station.scene()
    assert scene.robot is not None
    assert scene.true_robot is not None
    assert (scene.robot.radius_m, scene.true_robot.radius_m) == (0.3, 0.15)


def test_robot_of_unknown_radius_has_no_outline_and_no_echoes() -> None:
    play = Play()
    del play.bus.answers[WORLD.path]
    scene = play.forward(1.0).station.scene()
    assert scene.robot is not None
    assert scene.robot.radius_m is None
    assert not scene.shows_sonars
    assert not scene.seen


def test_ellipse_grows_longer_during_a_mission() -> None:
    play = Play()
    play.robot.mode = Mode.AUTO
    play.forward(1.0)
    play.hang()
    play.forward(10.0)
    covariance = play.station.scene().covariance
    assert covariance is not None
    assert covariance[0] > 0.04 + 2.4**2 / 6


def test_other_robots_are_on_the_map_of_the_selected() -> None:
    play = Play()
    play.robots.append(Robot("r2", x_m=3.0))
    play.bus.come(Role.ROBOT, "r2")
    play.forward(0.5)
    assert play.station.robots() == ["r1", "r2"]
    play.station.select("r2")
    play.forward(1.0)
    assert play.station.robot == "r2"
    assert play.station.scene().robot is not None
    assert [other.name for other in play.station.scene().others] == ["r1"]
    assert play.station.scene().trail[0][0] == 3.0
    play.station.select("r1")
    assert play.station.scene().trail[0][0] == 0.0


def test_other_robots_have_trails_and_are_marked_when_lost() -> None:
    play, other = Play(), Robot("r2", x_m=1.0)
    play.robots.append(other)
    play.bus.come(Role.ROBOT, "r2")
    for _ in range(20):
        other.x_m += 0.1
        play.forward(0.2)
    (mark,) = play.station.scene().others
    assert mark.live
    assert mark.name == "r2"
    assert mark.trail[0][0] == pytest.approx(1.1, abs=0.11)
    assert mark.trail[-1][0] == pytest.approx(3.0, abs=0.11)
    other.loop = False
    play.forward(1.0)
    (mark,) = play.station.scene().others
    assert not mark.live


@each("count", [0, 1, 128, 129, 300, 1000])
def test_thinned_trail_is_short_and_keeps_its_ends(count: int) -> None:
    points = [(float(number), 0.0) for number in range(count)]
    found = thinned(points)
    assert len(found) <= TRAIL_POINTS + 1
    assert list(found[:1]) == points[:1]
    assert list(found[-1:]) == points[-1:]
