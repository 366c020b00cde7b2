"""Shapes of worlds."""

from math import cos, dist, isclose, pi, sin

from hypothesis import given
from hypothesis import strategies as st

from plant.model.geometry import area_m2, clearance_m, crossing_edges, from_segment_m, inside, meet
from protocol.world import Point, Polyline, WorldCircle, WorldPolygon
from tests.support.each import each
from tests.support.plant import GOOD, Bad, assert_told, more, polygon, with_line

BAD = [
    Bad(
        "two points", polygon("[[2, 1], [3, 1]]"), "7 obstacle#1.polygon_m: 2 points -> at least 3"
    ),
    Bad(
        "a bow tie",
        polygon("[[2, 1], [3, 2], [3, 1], [2, 2]]"),
        "7 obstacle#1.polygon_m: crosses itself: edge 1-2 (2,"
        " 1)-(3, 2) meets edge 3-4 (3, 1)-(2, 2)"
        " -> order the points along the outline",
    ),
    Bad(
        "a corner that touches an edge",
        polygon("[[2, 1], [4, 1], [4, 2], [3, 1], [2, 2]]"),
        "7 obstacle#1.polygon_m: edge 1-2 (2, 1)-(4, 1) meets edge 3-4 (4, 2)-(3, 1)"
        " -> order the points",
    ),
    Bad(
        "all in a line",
        polygon("[[2, 1], [3, 1], [2.5, 1]]"),
        "7 obstacle#1.polygon_m: zero area -> move a point off the line, or make it a wall_m",
    ),
    Bad(
        "a spike",
        polygon("[[2, 1], [3, 1], [2.5, 1], [2.5, 2]]"),
        "7 obstacle#1.polygon_m: edge 1-2 (2, 1)-(3, 1) meets edge 3-4 -> order the points",
    ),
    Bad(
        "closed by hand",
        polygon("[[2, 1], [3, 1], [3, 2], [2, 1]]"),
        "7 obstacle#1.polygon_m: point 4 is the same as point 1 -> remove point 4",
    ),
    Bad(
        "a point of three",
        polygon("[[2, 1],\n[3, 1],\n[3, 2, 1]]"),
        "9 obstacle#1.polygon_m#3: expected two numbers, found 3 values -> write as in [[2.0, 1.0]",
    ),
    Bad(
        "points of text",
        polygon('"here"'),
        "7 obstacle#1.polygon_m: a list of points -> polygon_m =",
    ),
    Bad(
        "a word as coordinate",
        polygon('[[2, 1], [3, "1"], [3, 2]]'),
        "7 obstacle#1.polygon_m#2: expected a number, found text -> -100 to 100 m",
    ),
    Bad(
        "radius 0",
        with_line(10, "circle_m = { x = 4.0, y = 3.0, radius = 0.0 }"),
        "10 obstacle#2.circle_m.radius: 0.0 is out of range -> more than 0",
    ),
    Bad(
        "negative radius",
        with_line(10, "circle_m = { x = 4.0, y = 3.0, radius = -1 }"),
        "10 obstacle#2.circle_m.radius: -1 is out of range -> more than 0",
    ),
    Bad(
        "a wall of one point",
        with_line(13, "wall_m = [[1.0, 3.0]]"),
        "13 obstacle#3.wall_m: 1 points, expected 2 -> at least 2 points",
    ),
    Bad(
        "a wall that stays where it is",
        with_line(13, "wall_m = [[1, 3], [1, 3], [2, 3]]"),
        "13 obstacle#3.wall_m: point 2 is the same as point 1 -> remove point 2",
    ),
    Bad(
        "a paper wall",
        with_line(14, "thickness_m = 0"),
        "14 obstacle#3.thickness_m: 0 is out -> 0.001",
    ),
    Bad(
        "no shape",
        more("[[obstacle]]\n"),
        "20 obstacle#5: found none -> give each [[obstacle]] one",
    ),
    Bad(
        "two shapes",
        with_line(8, "wall_m = [[1, 3], [2, 3]]"),
        "6 obstacle#1: found polygon_m and wall_m -> one shape",
    ),
    Bad(
        "one bracket too few",
        'obstacle = { circle_m = "?" }\n' + "\n".join(GOOD.split("\n")[:4]),
        "1 obstacle: expected [[obstacle]] tables, found a table"
        " -> write [[obstacle]] instead of [obstacle]",
    ),
    Bad(
        "a path without speed",
        with_line(19, ""),
        "16 obstacle#4.speed_m_s: missing -> add speed_m_s = 0.1",
    ),
    Bad(
        "a speed without path",
        with_line(18, ""),
        "16 obstacle#4.path_m: missing -> add path_m = [[",
    ),
    Bad(
        "speed 0",
        with_line(19, "speed_m_s = 0.0"),
        "19 obstacle#4.speed_m_s: 0.0 is out -> more than 0",
    ),
    Bad(
        "a path from elsewhere",
        with_line(18, "path_m = [[3.0, 1.0], [3.0, 2.0]]"),
        "18 obstacle#4.path_m: does not start at the circle's centre (3.5, 0.5)"
        " -> make [3.5, 0.5] its first point",
    ),
    Bad(
        "a path of one point",
        with_line(18, "path_m = [[3.5, 0.5]]"),
        "18 obstacle#4.path_m: 1 points, expected 2 -> at least 2 points",
    ),
    Bad(
        "a walking polygon",
        with_line(8, "speed_m_s = 0.1"),
        "8 obstacle#1.speed_m_s: polygon_m cannot move -> make it a circle_m",
    ),
    Bad(
        "a thick circle",
        with_line(11, "thickness_m = 0.1"),
        "11 obstacle#2.thickness_m: not a key of circle_m -> make it a wall_m",
    ),
]


@each("bad", BAD)
def test_impossible_obstacle_is_rejected(bad: Bad) -> None:
    assert_told(bad, alone=True)


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
    assert isclose(clearance_m((1.5, 1.4), WorldPolygon(L_SHAPE)), 0.4)
    assert clearance_m((0.5, 0.5), WorldPolygon(L_SHAPE)) == 0.0
    assert area_m2(L_SHAPE) == 3.0


def test_clearance_is_measured_from_the_surface() -> None:
    assert isclose(clearance_m((3.0, 0.0), WorldCircle(x_m=0.0, y_m=0.0, radius_m=1.0)), 2.0)
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
