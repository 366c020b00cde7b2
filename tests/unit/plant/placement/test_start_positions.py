from itertools import combinations
from math import dist, pi

import pytest

from plant.model.configuration import Body
from plant.placement import starts
from protocol.world import Circle, Polygon
from tests.support.plant.rooms import room


def test_one_robot_starts_at_the_start_of_the_world() -> None:
    assert starts(room(start=(1.0, 2.0, 0.7)), Body(), 1) == [(1.0, 2.0, 0.7)]


def test_several_robots_start_side_by_side_with_a_gap() -> None:
    places = starts(room(start=(1.0, 2.0, pi / 2)), Body(), 3)
    assert [place[:2] for place in places] == [
        pytest.approx((1.0, 2.0)),
        pytest.approx((0.4, 2.0)),
        pytest.approx((1.6, 2.0)),
    ]
    assert {place[2] for place in places} == {pi / 2}
    assert min(dist(a[:2], b[:2]) for a, b in combinations(places, 2)) > 2.0 * 0.12


def test_start_places_in_walls_and_obstacles_are_skipped() -> None:
    pillar = Circle(x_m=1.0, y_m=1.0, radius_m=0.1)
    block = Polygon(((0.8, 2.0), (1.2, 2.0), (1.2, 2.6), (0.8, 2.6)))
    places = starts(room(pillar, block, start=(1.0, 0.5, 0.0)), Body(), 3)
    assert [round(place[1], 3) for place in places] == [0.5, 1.7, 2.9]


def test_full_rank_is_followed_by_one_behind_and_one_ahead() -> None:
    places = starts(room(start=(1.0, 2.0, 0.0)), Body(), 21)
    assert [round(x_m, 3) for x_m, _, _ in places] == [1.0] * 7 + [0.4] * 7 + [1.6] * 7
    assert min(dist(a[:2], b[:2]) for a, b in combinations(places, 2)) > 0.59


def test_too_many_robots_are_rejected_with_the_number_that_fits() -> None:
    with pytest.raises(ValueError, match=r"^robots: room has room for 35 beside .* not for 99"):
        starts(room(), Body(), 99)


def test_zero_robots_are_rejected() -> None:
    with pytest.raises(ValueError, match=r"^robots: 0 is less than one"):
        starts(room(), Body(), 0)
