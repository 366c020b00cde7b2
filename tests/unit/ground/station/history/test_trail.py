"""Trail, echoes and marks are bounded and located correctly."""

from math import inf, isfinite, nan, pi

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ground.station.history.telemetry_history import uncertainty_m
from ground.station.history.trail import BoundaryMarks, DrivenPath, EchoGrid, ranges_m
from protocol.wire.enums import GoalState
from protocol.wire.messages import PlanarOdometry
from tests.support.each import each
from tests.support.ground.station.said import Robot

NUMBERS = st.floats(width=32)


def pose(x_m: float = 0.0, y_m: float = 0.0, heading_rad: float = 0.0) -> PlanarOdometry:
    return PlanarOdometry(
        time_ns=0, x_m=x_m, y_m=y_m, heading_rad=heading_rad, speed_m_s=0.0, yaw_rate_rad_s=0.0,
        cov_xx_m2=0.04, cov_xy_m2=0.0, cov_xh_m_rad=0.0, cov_yy_m2=0.01, cov_yh_m_rad=0.0,
        cov_hh_rad2=0.0,
    )  # fmt: skip


def test_standing_robot_extends_no_trail() -> None:
    trail = DrivenPath()
    for _ in range(100):
        trail.add(1.0, 2.0)
    assert trail.points() == ((1.0, 2.0),)


def test_long_trail_gets_coarser_but_keeps_its_start() -> None:
    trail = DrivenPath(size=100)
    for step in range(5000):
        trail.add(step * 0.03, 0.0)
    points = trail.points()
    assert 50 <= len(points) <= 100
    assert points[0] == (0.0, 0.0)
    assert points[-1][0] > 140.0


def test_trail_is_one_object_until_it_grows() -> None:
    trail = DrivenPath()
    trail.add(0.0, 0.0)
    assert trail.points() is trail.points()


@given(st.lists(st.tuples(NUMBERS, NUMBERS)))
def test_trail_contains_finite_positions_only(
    places: list[tuple[float, float]],
) -> None:
    trail = DrivenPath(size=10)
    for x_m, y_m in places:
        trail.add(x_m, y_m)
    assert len(trail.points()) <= 10
    assert all(isfinite(x_m) and isfinite(y_m) for x_m, y_m in trail.points())


def test_echoes_lie_in_the_direction_of_the_sonars() -> None:
    echoes = EchoGrid()
    echoes.scan(Robot().scan(), pose(1.0, 1.0, pi / 2), radius_m=0.12, time_s=0.0)
    points = echoes.by_age(0.0).newest
    assert len(points) == 4
    assert all(abs((x - 1.0) ** 2 + (y - 1.0) ** 2 - 1.12**2) < 1e-9 for x, y in points)
    assert points[0][0] > 1.9  # rightmost sonar of a robot that faces upwards


def test_repeated_echoes_add_no_points() -> None:
    echoes = EchoGrid()
    for _ in range(50):
        echoes.scan(Robot().scan(), pose(), radius_m=0.12, time_s=0.0)
    shown = echoes.by_age(0.0).newest
    echoes.scan(Robot().scan(), pose(0.001), radius_m=0.12, time_s=0.0)
    assert len(shown) == 4
    assert echoes.by_age(0.0).newest is shown


def test_echoes_unseen_for_longest_are_dropped() -> None:
    echoes = EchoGrid(size=10)
    for step in range(100):
        echoes.add(step * 1.0, 0.0, 0.0)
        echoes.add(0.0, 0.0, 0.0)
    points = echoes.by_age(0.0).newest
    assert len(points) == 10
    assert (0.0, 0.0) in points
    assert (99.0, 0.0) in points


def test_echoes_age_and_are_renewed_when_seen_again() -> None:
    echoes = EchoGrid()
    for time_s in (0.0, 10.0, 26.0):
        echoes.add(time_s, 0.0, time_s)
    points = {time_s: (time_s, 0.0) for time_s in (0.0, 10.0, 26.0)}
    assert echoes.by_age(29.0) == ((points[26.0],), (points[10.0],), (points[0.0],))
    echoes.add(0.0, 0.0, 29.5)
    assert echoes.by_age(30.0) == ((points[26.0], points[0.0]), (), (points[10.0],))


def test_echo_without_a_pose_is_ignored() -> None:
    echoes = EchoGrid()
    echoes.scan(Robot().scan(), pose(nan), radius_m=0.12, time_s=0.0)
    assert echoes.by_age(0.0).newest == ()


def test_no_echo_is_infinite_and_no_measurement_missing() -> None:
    assert list(ranges_m(Robot().scan())) == [1.0, 1.0, 1.0, 1.0, inf, inf, inf, None]


def test_hit_and_leave_points_belong_to_one_goal() -> None:
    marks, robot = BoundaryMarks(), Robot(goal_id=1)
    way = (
        (0.0, GoalState.DRIVING), (1.0, GoalState.AVOIDING), (2.0, GoalState.AVOIDING),
        (3.0, GoalState.DRIVING), (4.0, GoalState.AVOIDING), (5.0, GoalState.STUCK),
    )  # fmt: skip
    for x_m, robot.goal in way:
        marks.update(robot.status(), pose(x_m))
    assert list(marks.hit) == [(1.0, 0.0), (4.0, 0.0)]
    assert list(marks.leave) == [(3.0, 0.0)]
    robot.goal_id, robot.goal = 2, GoalState.DRIVING
    marks.update(robot.status(), pose(6.0))
    assert (list(marks.hit), list(marks.leave)) == ([], [])


@each(
    ("xx", "xy", "yy", "expected"),
    [(0.04, 0.0, 0.01, 0.2), (0.01, 0.0, 0.04, 0.2), (0.02, 0.02, 0.02, 0.2), (0.0, 0.0, 0.0, 0.0)],
)
def test_uncertainty_is_the_longer_semi_axis(
    xx: float, xy: float, yy: float, expected: float
) -> None:
    found = PlanarOdometry(
        **{**{name: getattr(pose(), name) for name in pose().__struct_fields__},
           "cov_xx_m2": xx, "cov_xy_m2": xy, "cov_yy_m2": yy}
    )  # fmt: skip
    assert uncertainty_m(found) == pytest.approx(expected)


@given(NUMBERS, NUMBERS, NUMBERS)
def test_uncertainty_accepts_any_covariance(xx: float, xy: float, yy: float) -> None:
    found = PlanarOdometry(
        **{**{name: getattr(pose(), name) for name in pose().__struct_fields__},
           "cov_xx_m2": xx, "cov_xy_m2": xy, "cov_yy_m2": yy}
    )  # fmt: skip
    assert not uncertainty_m(found) < 0.0
