from math import cos, dist, pi, radians, sin

import pytest

from plant.model.geometry import clearance_m
from plant.sim.simulation import Plant
from protocol.world import Circle, Obstacle, Polygon, Polyline, World
from tests.support.each import each
from tests.support.plant.rooms import FOREVER_NS, NONE, bumper, drive, room

LEFT, RIGHT, REAR = 1, 2, 4
THIN_WALL = Polyline(((2.0, 0.0), (2.0, 4.0)), 0.01)
BAY = Polygon(
    ((2.0, 1.0), (3.0, 1.0), (3.0, 3.0), (2.0, 3.0), (2.0, 2.8), (2.8, 2.8), (2.8, 1.2), (2.0, 1.2))
)


def plant(world: World, robots: int = 1) -> Plant:
    return Plant(world, 1, NONE, robots=robots)


@each(
    ("obstacle", "stopped_at_m"),
    [
        (THIN_WALL, 1.995),
        (Circle(x_m=2.5, y_m=2.0, radius_m=0.4), 2.1),
        (BAY, 2.8),
        (Polygon(((2.5, 1.0), (3.0, 1.0), (3.0, 3.0), (2.5, 3.0))), 2.5),
    ],
)
def test_robot_stops_at_an_obstacle(obstacle: Obstacle, stopped_at_m: float) -> None:
    one = plant(room(obstacle, start=(1.5, 2.0, 0.0)))
    deepest_m = 0.0
    for _ in range(200):
        drive(one, 0.3, 0.3, 1)
        deepest_m = min(deepest_m, one.truth().clearance_m)
    truth = one.truth()
    assert truth.x_m == pytest.approx(stopped_at_m - 0.12, abs=5e-4)
    assert (truth.contact, bumper(one), truth.speed_m_s) == (1, LEFT | RIGHT, 0.0)
    assert -0.001 < deepest_m <= 0.0
    assert one.score(FOREVER_NS).contacts == 1


def test_outer_wall_stops_and_releases_the_robot() -> None:
    one = plant(room(start=(3.7, 2.0, 0.0)))
    drive(one, 0.3, 0.3, 60)
    assert one.truth().x_m == pytest.approx(3.88, abs=5e-4)
    drive(one, -0.3, -0.3, 40)
    assert (one.truth().contact, bumper(one)) == (0, 0)
    assert one.truth().x_m < 3.5
    drive(one, 0.3, 0.3, 80)
    assert one.score(FOREVER_NS).contacts == 2


def test_robot_leaves_the_floor_without_outer_walls() -> None:
    one = plant(room(start=(3.7, 2.0, 0.0), walls=False))
    drive(one, 0.3, 0.3, 60)
    assert one.truth().x_m > 4.3
    assert one.truth().contact == 0


def test_robot_slides_along_a_wall_met_at_an_angle() -> None:
    one = plant(room(start=(3.5, 1.0, radians(35.0))))
    drive(one, 0.3, 0.3, 120)
    assert one.truth().x_m == pytest.approx(3.88, abs=5e-4)
    assert one.truth().y_m == pytest.approx(1.0 + 0.3 * sin(radians(35.0)) * 6.0, abs=0.03)
    assert (bumper(one), one.score(FOREVER_NS).contacts) == (RIGHT, 1)


@each(
    ("bearing_deg", "sectors"),
    [
        (0, LEFT | RIGHT),
        (30, LEFT),
        (-30, RIGHT),
        (100, LEFT),
        (-100, RIGHT),
        (150, REAR),
        (180, REAR),
    ],
)
def test_bumper_reports_the_touched_sector(bearing_deg: float, sectors: int) -> None:
    towards_rad = 1.0 + radians(bearing_deg)  # straight away from the pillar, which comes near
    far, near = 0.35, 0.2
    path = tuple((2.0 + d * cos(towards_rad), 2.0 + d * sin(towards_rad)) for d in (far, near))
    pillar = Circle(x_m=path[0][0], y_m=path[0][1], radius_m=0.1, path_m=path, speed_m_s=0.1)
    one = plant(room(pillar, start=(2.0, 2.0, 1.0)))
    while not one.truth().contact:
        one.advance()
    assert bumper(one) == sectors


@each("angle_deg", range(0, 90, 7))
def test_robot_never_pushes_through_a_thin_wall(angle_deg: int) -> None:
    one = plant(room(THIN_WALL, start=(1.7, 2.0, radians(angle_deg)), robot={"max_speed_m_s": 1.5}))
    for _ in range(60):
        drive(one, 1.5, 1.5, 1)
        assert one.truth().x_m <= 2.0 - 0.12
    drive(one, -1.5, 1.5, 2)
    drive(one, 1.5, 1.2, 60)
    assert one.truth().x_m <= 2.0 - 0.12


def test_clearance_is_from_rim_to_nearest_surface() -> None:
    obstacles = (BAY, THIN_WALL, Circle(x_m=0.5, y_m=0.5, radius_m=0.2))
    one = plant(room(*obstacles, start=(0.9, 2.0, -1.2)))
    for _ in range(100):
        drive(one, 0.3, 0.2, 1)
        truth = one.truth()
        gaps_m = [clearance_m((truth.x_m, truth.y_m), obstacle) for obstacle in obstacles]
        rim_m = min(truth.x_m, truth.y_m, 4.0 - truth.x_m, 4.0 - truth.y_m)
        assert truth.clearance_m == pytest.approx(min(*gaps_m, rim_m) - 0.12, abs=1e-9)


def test_clearance_far_from_obstacles_is_the_limit() -> None:
    assert plant(room(size_m=(40.0, 40.0), start=(20.0, 20.0, 0.0))).truth().clearance_m == 3.0


def test_two_robots_do_not_pass_through_each_other() -> None:
    pair = plant(room(start=(1.0, 1.8, pi / 2)), robots=2)
    assert pair.truth(1).x_m == pytest.approx(0.4)
    for _ in range(48):  # the one on the right turns left, towards the other
        pair.command(0, -2000, 2000, 150)
        pair.advance()
    nearest_m, touched = 1.0, 0
    for _ in range(60):
        drive(pair, 0.3, 0.3, 1)
        truths = [pair.truth(robot) for robot in (0, 1)]
        nearest_m = min(nearest_m, dist(*((truth.x_m, truth.y_m) for truth in truths)))
        touched += truths[0].contact and truths[1].contact
    assert nearest_m > 0.24 - 0.001
    assert touched > 10


def walker(bearing_rad: float, speed_m_s: float = 0.2) -> Circle:
    """Return a pedestrian that walks straight at the middle of the room."""
    ways = ((2.0 + d * cos(bearing_rad), 2.0 + d * sin(bearing_rad)) for d in (0.6, -0.6))
    path = tuple(ways)
    return Circle(x_m=path[0][0], y_m=path[0][1], radius_m=0.2, path_m=path, speed_m_s=speed_m_s)


def until_touched(one: Plant, left_m_s: float, right_m_s: float) -> tuple[int, int]:
    """Return all contacts and own contacts after the first touch."""
    for _ in range(200):
        drive(one, left_m_s, right_m_s, 1)
        if one.truth().contact:
            break
    score = one.score(FOREVER_NS)
    return score.contacts, score.own_contacts


@each("bearing_deg", range(0, 360, 45))
@each("spin_m_s", [0.0, 0.2])
def test_contact_of_a_still_or_turning_robot_is_not_its_own(
    bearing_deg: int, spin_m_s: float
) -> None:
    one = plant(room(walker(radians(bearing_deg)), start=(2.0, 2.0, 0.3)))
    assert until_touched(one, -spin_m_s, spin_m_s) == (1, 0)


@each(
    ("bearing_deg", "speed_m_s", "own"),
    [
        (0, 0.1, 1),  # towards each other
        (180, -0.1, 1),  # towards each other, backwards
        (180, 0.05, 0),  # overtaken from behind
        (0, -0.05, 0),  # backing away, too slowly
        (135, 0.05, 0),  # overtaken from behind, aslant
        (45, 0.05, 1),
    ],
)
def test_contact_is_caused_by_the_body_that_approaches(
    bearing_deg: int, speed_m_s: float, own: int
) -> None:
    one = plant(room(walker(radians(bearing_deg)), start=(2.0, 2.0, 0.0)))
    assert until_touched(one, speed_m_s, speed_m_s) == (1, own)


def test_contact_with_a_wall_is_always_the_robots() -> None:
    assert until_touched(plant(room(THIN_WALL, start=(1.5, 2.0, 0.0))), 0.02, 0.02) == (0, 0)
    assert until_touched(plant(room(THIN_WALL, start=(1.8, 2.0, 0.0))), 0.02, 0.02) == (1, 1)


def test_moving_obstacle_pushes_the_robot_away() -> None:
    roller = Circle(x_m=1.0, y_m=2.0, radius_m=0.3, path_m=((1.0, 2.0), (3.0, 2.0)), speed_m_s=0.5)
    one = plant(room(roller, start=(2.0, 2.0, 0.0)))
    for _ in range(60):
        one.advance()
        assert one.truth().clearance_m > -0.002
    assert one.truth().x_m == pytest.approx(1.0 + 0.5 * 3.0 + 0.42, abs=2e-3)
    assert bumper(one) == REAR


def test_robot_between_mover_and_wall_stays_in_the_room() -> None:
    press = Circle(x_m=1.0, y_m=2.0, radius_m=0.3, path_m=((1.0, 2.0), (3.9, 2.0)), speed_m_s=0.5)
    one = plant(room(press, start=(3.5, 2.0, 0.0)))
    for _ in range(200):
        one.advance()
        assert one.truth().x_m < 3.89


def test_grazing_a_static_obstacle_is_the_robots_contact() -> None:
    """Half a degree off along a wall, the robot approaches it by 3 mm/s."""
    one = plant(room(start=(1.0, 0.125, -0.009)))
    assert until_touched(one, 0.3, 0.3) == (1, 1)
