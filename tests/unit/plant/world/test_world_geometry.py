from math import cos, dist, isclose, pi, sin

from hypothesis import given
from hypothesis import strategies as st

from plant.model.geometry import (
    area_m2,
    clearance_m,
    crossing_edges,
    from_segment_m,
    inside,
    meet,
)
from protocol.world import Circle, Point, Polygon, Polyline

coordinates = st.integers(-50, 50).map(lambda tenths: tenths / 10.0)
points = st.tuples(coordinates, coordinates)
L_SHAPE: tuple[Point, ...] = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))


@given(points, points, points)
def test_no_segment_point_is_nearer_than_the_distance(p: Point, a: Point, b: Point) -> None:
    nearest_m = from_segment_m(p, a, b)
    for tenth in range(11):
        share = tenth / 10
        on_it = (a[0] + share * (b[0] - a[0]), a[1] + share * (b[1] - a[1]))
        assert dist(p, on_it) >= nearest_m - 1e-9


@given(points, points, points, points)
def test_segment_intersection_is_symmetric(a: Point, b: Point, c: Point, d: Point) -> None:
    assert meet(a, b, c, d) == meet(d, c, b, a)


@given(points, points, points)
def test_segments_with_a_common_end_intersect(a: Point, b: Point, c: Point) -> None:
    assert meet(a, b, b, c)


def test_bay_of_an_l_shape_is_outside() -> None:
    assert inside((0.5, 1.5), L_SHAPE)
    assert not inside((1.5, 1.5), L_SHAPE)
    assert isclose(clearance_m((1.5, 1.4), Polygon(L_SHAPE)), 0.4)
    assert clearance_m((0.5, 0.5), Polygon(L_SHAPE)) == 0.0
    assert area_m2(L_SHAPE) == 3.0


def test_clearance_is_measured_from_the_surface() -> None:
    assert isclose(clearance_m((3.0, 0.0), Circle(x_m=0.0, y_m=0.0, radius_m=1.0)), 2.0)
    assert isclose(clearance_m((1.0, 1.0), Polyline(((0.0, 0.0), (2.0, 0.0)), 0.2)), 0.9)


@given(st.integers(3, 30), st.lists(st.floats(0.1, 5.0), min_size=30, max_size=30))
def test_simple_outline_never_crosses_itself(count: int, radii_m: list[float]) -> None:
    outline = tuple(
        (radii_m[i] * cos(2 * pi * i / count), radii_m[i] * sin(2 * pi * i / count))
        for i in range(count)
    )
    assert crossing_edges(outline) is None


def test_outline_with_two_swapped_corners_crosses_itself() -> None:
    assert crossing_edges(((0, 0), (1, 1), (1, 0), (0, 1))) == (0, 2)
