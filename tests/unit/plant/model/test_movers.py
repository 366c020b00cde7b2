from math import dist

import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.sim.physics import Mover
from protocol.world import Circle
from tests.support.each import each

CORNER = Circle(
    x_m=0.0, y_m=0.0, radius_m=0.1, path_m=((0.0, 0.0), (1.0, 0.0), (1.0, 2.0)), speed_m_s=0.5
)


@each(
    ("time_s", "place"),
    [
        (0.0, (0.0, 0.0)),
        (1.0, (0.5, 0.0)),
        (2.0, (1.0, 0.0)),
        (4.0, (1.0, 1.0)),
        (6.0, (1.0, 2.0)),
        (8.0, (1.0, 1.0)),
        (12.0, (0.0, 0.0)),
        (13.0, (0.5, 0.0)),
    ],
)
def test_obstacle_moves_back_and_forth_along_its_waypoints(
    time_s: float, place: tuple[float, float]
) -> None:
    assert Mover(CORNER).position_m(time_s) == pytest.approx(place)


def test_obstacle_passes_a_repeated_waypoint() -> None:
    path = ((0.0, 0.0), (0.0, 0.0), (1.0, 0.0))
    mover = Mover(Circle(x_m=0.0, y_m=0.0, radius_m=0.1, path_m=path, speed_m_s=1.0))
    assert mover.position_m(0.0) == (0.0, 0.0)
    assert mover.position_m(0.25) == pytest.approx((0.25, 0.0))


@given(st.floats(0.0, 1e5), st.floats(0.0, 10.0))
def test_obstacle_never_exceeds_its_speed(time_s: float, span_s: float) -> None:
    mover = Mover(CORNER)
    way_m = dist(mover.position_m(time_s), mover.position_m(time_s + span_s))
    assert way_m <= 0.5 * span_s + 1e-9
