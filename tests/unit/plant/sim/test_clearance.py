from itertools import accumulate
from math import pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.model.geometry import clearance_m, inside
from plant.sim.physics import CLEARANCE_LIMIT_M, Arena
from protocol.world import Circle, Obstacle, Point, Polygon, Polyline
from tests.support.plant.rooms import room

RADIUS_M = 0.12
TRIANGLE = Polygon(points_m=((1.0, 3.0), (2.5, 3.2), (1.3, 4.0)))
STILL: tuple[Obstacle, ...] = (
    *(Circle(x_m=1.0 + 0.9 * i, y_m=1.0 + 0.7 * j, radius_m=0.1) for i in range(5) for j in (0, 1)),
    TRIANGLE,
    Polyline(points_m=((3.0, 3.0), (4.5, 3.1), (4.6, 3.1), (4.6, 4.4)), thickness_m=0.07),
)


def arena() -> Arena:
    made = Arena(room(*STILL, size_m=(50.0, 12.0)), RADIUS_M)
    made.add_robot(0.5, 0.5)
    return made


def step_m() -> st.SearchStrategy[float]:
    return st.floats(-0.2, 0.2) | st.floats(-0.02, 0.02)


@settings(max_examples=50, deadline=None)
@given(
    st.tuples(st.floats(0.2, 9.0), st.floats(0.2, 9.0)),
    st.lists(st.tuples(step_m(), step_m()), max_size=60),
)
def test_cached_clearance_is_bit_identical(start: Point, steps: list[Point]) -> None:
    remembering = arena()
    for at in accumulate(steps, lambda a, b: (a[0] + b[0], a[1] + b[1]), initial=start):
        assert remembering.clearance_m(0, at) == arena().clearance_m(0, at)


@settings(max_examples=50, deadline=None)
@given(st.tuples(st.floats(0.2, 9.0), st.floats(0.2, 9.0)))
def test_clearance_is_that_of_the_geometry(at: Point) -> None:
    gaps_m = [clearance_m(at, obstacle) for obstacle in STILL]
    nearest_m = min(*gaps_m, at[0], at[1], 50.0 - at[0], 12.0 - at[1])
    if not inside(at, TRIANGLE.points_m):
        wanted_m = min(nearest_m - RADIUS_M, CLEARANCE_LIMIT_M)
        assert arena().clearance_m(0, at) == pytest.approx(wanted_m, abs=1e-12)


def test_clearance_to_a_one_point_wall_is_to_its_rim() -> None:
    point = Polyline(points_m=((5.0, 6.0), (5.0, 6.0)), thickness_m=0.2)
    lonely = Arena(room(point, walls=False), RADIUS_M)
    lonely.add_robot(1.0, 1.0)
    assert lonely.clearance_m(0, (5.0, 5.0)) == pytest.approx(1.0 - 0.1 - RADIUS_M)


def test_clearance_without_obstacles_is_the_limit() -> None:
    empty = Arena(room(walls=False), RADIUS_M)
    empty.add_robot(1.0, 1.0)
    assert empty.clearance_m(0, (pi, pi)) == CLEARANCE_LIMIT_M
