"""Places and velocities of confirmed people."""

from math import atan2, hypot, inf

from robot.core.parameters import DEFAULTS
from robot.core.perception import people as peoples
from robot.core.perception.odometry import Odometry
from robot.core.perception.people import BEGIN, BODY_M, MAX_LEFT, MAX_PEOPLE, PROVEN, People
from robot.core.values import BEARINGS, HALF_CONE, Pose

HERE = Pose(0.0, 0.0, 0.0)
NO_ECHO: "list[float | None]" = [inf] * 8


def ranges(x_m: float, y_m: float) -> "list[float | None]":
    """Return the ranges to a person at a place, of a robot at the origin."""
    away_m, off_rad = hypot(x_m, y_m), atan2(y_m, x_m)
    beside_rad = [max(0.0, abs(bearing - off_rad) - HALF_CONE) for bearing in BEARINGS]
    return [peoples.expected_m(away_m, one, DEFAULTS.radius_m) for one in beside_rad]


def confirmed(x_m: float, y_m: float, vx_m_s: float, vy_m_s: float) -> People:
    """Return people with one that has proved to move."""
    people = People()
    peoples.confirm(people, x_m, y_m, vx_m_s, vy_m_s, 0.0, HERE)
    people.proof[0], people.left[0] = PROVEN, MAX_LEFT
    return people


def used(people: People) -> list[int]:
    return [k for k in range(MAX_PEOPLE) if people.left[k]]


def test_person_is_followed_and_its_velocity_found() -> None:
    people, x_m = confirmed(1.2, 0.1, 0.0, 0.0), 1.2
    for _ in range(80):
        x_m -= 0.1 * DEFAULTS.period_s
        peoples.update(people, ranges(x_m, 0.1), Odometry(), DEFAULTS)
    (k,) = used(people)
    assert hypot(people.x_m[k] - x_m, people.y_m[k] - 0.1) < 0.03
    assert abs(people.vx_m_s[k] + 0.1) < 0.02
    assert people.left[k] == MAX_LEFT


def test_person_walks_on_behind_the_robot_and_is_forgotten() -> None:
    people = confirmed(-0.6, 0.0, 0.05, 0.0)
    for _ in range(60):
        peoples.update(people, NO_ECHO, Odometry(), DEFAULTS)
    assert abs(people.x_m[0] + 0.45) < 1e-9
    for _ in range(MAX_LEFT - 60):
        peoples.update(people, NO_ECHO, Odometry(), DEFAULTS)
    assert used(people) == []
    assert not people.any


def test_person_in_view_without_echo_is_forgotten_sooner() -> None:
    people, behind = confirmed(0.7, 0.0, 0.0, 0.0), confirmed(-0.7, 0.0, 0.0, 0.0)
    for _ in range(30):
        peoples.update(people, NO_ECHO, Odometry(), DEFAULTS)
        peoples.update(behind, NO_ECHO, Odometry(), DEFAULTS)
    assert used(people) == []
    assert used(behind) == [0]


def test_standing_obstacle_never_proves_motion() -> None:
    people = People()
    for _ in range(BEGIN + 30):
        peoples.confirm(people, 0.8, 0.0, -0.02, 0.0, 0.02, HERE)
        peoples.update(people, ranges(0.8, 0.0), Odometry(), DEFAULTS)
        assert people.proof[0] < PROVEN
    assert used(people) in ([], [0])


def test_person_who_comes_nearer_proves_it_within_a_second() -> None:
    people, x_m = People(), 1.0
    peoples.confirm(people, x_m, 0.0, -0.1, 0.0, 0.1, HERE)
    for _ in range(20):
        x_m -= 0.1 * DEFAULTS.period_s
        peoples.update(people, ranges(x_m, 0.0), Odometry(), DEFAULTS)
    assert people.proof[0] == PROVEN


def test_slow_departure_is_no_proof() -> None:
    people, x_m = People(), 0.6
    peoples.confirm(people, x_m, 0.0, 0.05, 0.0, -0.05, HERE)
    for _ in range(20):
        x_m += 0.05 * DEFAULTS.period_s
        peoples.update(people, ranges(x_m, 0.0), Odometry(), DEFAULTS)
    assert people.proof[0] == 0


def test_full_memory_replaces_the_farthest_person() -> None:
    people = People()
    for k in range(MAX_PEOPLE + 1):
        peoples.confirm(people, 2.0 - 0.5 * k, 1.0, 0.0, 0.0, 0.0, HERE)
    assert sorted(people.x_m) == [0.0, 0.5, 1.0, 1.5]


def test_body_beside_a_cone_gives_no_echo() -> None:
    assert peoples.expected_m(1.0, 0.3, DEFAULTS.radius_m) == inf
    assert peoples.expected_m(1.0, -0.1, DEFAULTS.radius_m) == 1.0 - BODY_M - DEFAULTS.radius_m
