"""The standing robot and the omniscient one."""

from itertools import pairwise
from math import inf, isclose

from protocol.world import Circle, GoalPose, Point, Polyline, Start, World
from study.people.crowd_trial import (
    CELL_M,
    LAYER_S,
    omniscient_route,
    places_along,
    route_exposure,
    stand,
    stay,
)
from study.people.encounters import Walker, time_to_collision_s


def floor_with(*obstacles: Circle | Polyline) -> World:
    """Return 4 by 2 m with a straight way of 3 m through its middle."""
    return World(
        name="crossing",
        size_m=(4.0, 2.0),
        start=Start(x_m=0.5, y_m=1.0),
        goal=GoalPose(x_m=3.5, y_m=1.0),
        obstacles=obstacles,
    )


def walker(speed_m_s: float, *path: Point) -> Circle:
    return Circle(x_m=path[0][0], y_m=path[0][1], radius_m=0.2, path_m=path, speed_m_s=speed_m_s)


def omniscient_s(world: World) -> float | None:
    route = omniscient_route(world, 60.0)
    return None if route is None else LAYER_S * (len(route) - 1)


def test_places_divide_the_shortest_path_evenly() -> None:
    places = places_along(floor_with(), 3)
    assert [round(x_m, 6) for x_m, _ in places] == [1.0, 2.0, 3.0]
    assert all(isclose(y_m, 1.0) for _, y_m in places)


def test_standing_robot_is_touched_at_every_passage() -> None:
    world = floor_with(walker(0.2, (2.0, 1.7), (2.0, 0.3)))
    assert stand(world, [(2.0, 1.0)], 1.0)[0].contacts == 0
    assert stand(world, [(2.0, 1.0)], 7.0)[0].contacts == 1
    assert stand(world, [(2.0, 1.0)], 14.0)[0].contacts == 2
    assert stand(world, [(1.0, 1.0)], 14.0)[0].contacts == 0


def test_standing_robot_is_not_touched_by_a_person_on_it() -> None:
    world = floor_with(walker(0.2, (2.0, 1.0), (2.0, 0.3)))
    assert stand(world, [(2.0, 1.0)], 3.0)[0].contacts == 0


def test_stay_ends_at_its_first_contact() -> None:
    world = floor_with(walker(0.2, (2.0, 1.7), (2.0, 0.3)))
    touched, free = stay(world, (2.0, 1.0), 14.0), stay(world, (1.0, 1.0), 14.0)
    assert touched.touched
    assert isclose(touched.exposure.time_s, (0.7 - 0.32) / 0.2, abs_tol=0.11)
    assert touched.exposure.least_s < 0.1
    assert not free.touched
    assert isclose(free.exposure.time_s, 14.05)
    assert free.exposure.least_s == inf


def test_stay_begins_when_the_person_there_has_left() -> None:
    world = floor_with(walker(0.2, (2.0, 1.0), (2.0, 0.3)))
    found = stay(world, (2.0, 1.0), 3.0)
    assert not found.touched
    assert isclose(found.exposure.time_s, 3.0 - 0.32 / 0.2, abs_tol=0.11)


def test_omniscient_route_is_connected_and_avoids_the_person() -> None:
    world = floor_with(walker(0.2, (2.0, 1.7), (2.0, 0.3)))
    route = omniscient_route(world, 60.0)
    assert route is not None
    assert isclose(route[0][0], 0.5, abs_tol=CELL_M)
    assert isclose(route[-1][0], 3.5, abs_tol=CELL_M)
    assert all(
        abs(bx - ax) < 1.01 * CELL_M and abs(by - ay) < 1.01 * CELL_M
        for (ax, ay), (bx, by) in pairwise(route)
    )
    exposure = route_exposure(world, route)
    assert isclose(exposure.time_s, LAYER_S * (len(route) - 1))
    assert exposure.least_s > 0.0
    assert 0 < exposure.intruded_ticks < exposure.ticks


def test_omniscient_robot_takes_the_straight_way_on_free_floor() -> None:
    time_s = omniscient_s(floor_with())
    assert time_s is not None
    assert 2.8 / 0.3 < time_s < 3.0 / 0.2


def test_omniscient_robot_waits_for_a_person_in_a_gate() -> None:
    gate = [
        Polyline(((2.0, 0.0), (2.0, 0.6))),
        Polyline(((2.0, 1.4), (2.0, 2.0))),
    ]
    free_s = omniscient_s(floor_with(*gate))
    person = walker(0.03, (2.0, 1.0), (2.5, 1.0), (3.3, 0.4))
    later_s = omniscient_s(floor_with(*gate, person))
    assert free_s is not None
    assert later_s is not None
    assert later_s > free_s


def test_omniscient_robot_finds_no_way_where_it_must_be_touched() -> None:
    walls = [Polyline(((0.0, y_m), (4.0, y_m))) for y_m in (0.7, 1.3)]
    person = walker(0.2, (3.4, 1.0), (0.4, 1.0))
    assert omniscient_s(floor_with(*walls, person)) is None


def test_time_to_collision_is_that_of_two_discs() -> None:
    person = Walker((2.0, 0.0), (-0.2, 0.0), 0.32)
    assert isclose(time_to_collision_s((0.0, 0.0), (0.3, 0.0), person), 1.68 / 0.5)
    assert time_to_collision_s((0.0, 0.4), (0.3, 0.0), person) == inf
    assert time_to_collision_s((0.0, 0.0), (-0.3, 0.0), person) == inf
    assert time_to_collision_s((1.9, 0.0), (0.3, 0.0), person) == 0.0
