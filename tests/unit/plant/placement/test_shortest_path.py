from itertools import pairwise
from math import acos, dist, hypot, isclose, pi, sqrt
from time import thread_time

from hypothesis import given, settings
from hypothesis import strategies as st

from plant.model.geometry import clearance_m
from plant.shortest_path import shortest_path, shortest_path_m
from plant.world.file import load, shipped
from protocol.world import Circle, GoalPose, Obstacle, Polygon, Polyline, Start, World
from tests.support.each import each

RADIUS_M = 0.12


def world_with(*obstacles: Obstacle, walls: bool = True, radius_m: float = RADIUS_M) -> World:
    return World(
        name="test",
        size_m=(6.0, 4.0),
        start=Start(x_m=1.0, y_m=2.0),
        goal=GoalPose(x_m=5.0, y_m=2.0),
        walls=walls,
        obstacles=obstacles,
        robot={"radius_m": radius_m, "track_m": radius_m},
    )


def box(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    return Polygon(((x0, y0), (x1, y0), (x1, y1), (x0, y1)))


def length_m(*obstacles: Obstacle, walls: bool = True) -> float:
    found = shortest_path_m(world_with(*obstacles, walls=walls))
    assert found is not None
    return found


def around_disc_m(radius_m: float, half_m: float) -> float:
    """Return the length of tangent, arc and tangent past a disc halfway along `2 * half_m`."""
    tangent_m = sqrt(half_m**2 - radius_m**2)
    return 2.0 * tangent_m + radius_m * (pi - 2.0 * acos(radius_m / half_m))


def test_path_without_obstacles_is_a_straight_line() -> None:
    assert isclose(length_m(), 4.0)


@each("radius_m", [0.05, 0.4, 0.8, 1.5])
def test_path_around_a_disc_is_tangent_arc_tangent(radius_m: float) -> None:
    exact_m = around_disc_m(radius_m + RADIUS_M, 2.0)
    assert exact_m - 1e-4 <= length_m(Circle(x_m=3.0, y_m=2.0, radius_m=radius_m)) < 1.006 * exact_m


def test_path_passes_a_box_on_its_short_side() -> None:
    # Tangent to the corner circle, straight along the top, and the same again.
    along_m, up_m = 1.5, 0.3
    to_corner_m = sqrt(along_m**2 + up_m**2 - RADIUS_M**2)
    turn_rad = pi / 2 - acos(RADIUS_M / hypot(along_m, up_m)) + _elevation(along_m, up_m)
    exact_m = 2.0 * (to_corner_m + RADIUS_M * turn_rad) + 1.0
    assert isclose(length_m(box(2.5, 1.0, 3.5, 2.3)), exact_m, rel_tol=0.006)


def _elevation(along_m: float, up_m: float) -> float:
    return acos(along_m / hypot(along_m, up_m))


def test_path_respects_the_thickness_of_a_wall() -> None:
    thick = Polyline(((3.0, 0.0), (3.0, 2.5)), 0.4)
    # Its round end is a disc of 0.2 m, which the robot passes above.
    exact_m = length_m(Circle(x_m=3.0, y_m=2.5, radius_m=0.2), box(2.9, 0.0, 3.1, 2.5))
    assert isclose(length_m(thick), exact_m, rel_tol=1e-3)


def test_path_needs_the_width_of_the_robot() -> None:
    narrow = (box(2.9, 0.0, 3.1, 1.9), box(2.9, 2.13, 3.1, 4.0))
    wide = (box(2.9, 0.0, 3.1, 1.9), box(2.9, 2.17, 3.1, 4.0))
    assert shortest_path(world_with(*narrow)) is None
    assert length_m(*wide) < 4.1
    assert shortest_path(world_with(*narrow, radius_m=0.1)) is not None


def test_wall_across_the_room_leaves_no_path() -> None:
    across = Polyline(((3.0, 0.0), (3.0, 4.0)))
    assert shortest_path(world_with(across)) is None
    assert shortest_path_m(world_with(across)) is None


def test_path_goes_outside_when_there_are_no_outer_walls() -> None:
    assert 5.6 < length_m(Polyline(((3.0, 0.0), (3.0, 4.0))), walls=False) < 6.1


def test_point_that_is_given_twice_changes_nothing() -> None:
    once = length_m(Polyline(((2.0, 0.8), (2.0, 3.0))))
    assert length_m(Polyline(((2.0, 0.8), (2.0, 3.0), (2.0, 3.0)))) == once > 0.0


def test_enclosed_goal_has_no_path() -> None:
    ring = Polyline(((4.5, 1.5), (5.5, 1.5), (5.5, 2.5), (4.5, 2.5), (4.5, 1.5)))
    assert shortest_path(world_with(ring)) is None


def test_path_leaves_a_trap_around_its_arms() -> None:
    trap = Polyline(((0.5, 2.5), (2.5, 2.5), (2.5, 1.5), (0.5, 1.5)), 0.02)
    # Tangent to the arm's end, round it, along the arm, round its joint, tangent to the goal.
    exact_m = 0.695 + 0.130 * 2.541 + 2.0 + 0.130 * 0.248 + 2.546
    assert isclose(length_m(trap), exact_m, rel_tol=0.006)


def test_moving_obstacles_are_ignored() -> None:
    walker = Circle(x_m=3.0, y_m=2.0, radius_m=0.5, path_m=((3.0, 2.0), (3.0, 3.0)), speed_m_s=0.1)
    assert isclose(length_m(walker), 4.0)


discs = st.lists(
    st.builds(
        Circle, x_m=st.floats(1.8, 4.2), y_m=st.floats(0.2, 3.8), radius_m=st.floats(0.02, 0.6)
    ),
    max_size=8,
)


@settings(max_examples=60, deadline=None)
@given(discs)
def test_adding_a_disc_never_shortens_the_path(
    circles: list[Circle],
) -> None:
    before_m = 4.0
    for count in range(1, len(circles) + 1):
        path = shortest_path(world_with(*circles[:count]))
        if path is None:
            return
        after_m = sum(dist(a, b) for a, b in pairwise(path))
        assert after_m >= 0.994 * before_m
        assert all(_clear(a, b, circles[:count]) for a, b in pairwise(path))
        before_m = after_m


def _clear(a: tuple[float, float], b: tuple[float, float], circles: list[Circle]) -> bool:
    points = [(a[0] + (b[0] - a[0]) * i / 50, a[1] + (b[1] - a[1]) * i / 50) for i in range(51)]
    return all(clearance_m(p, one) >= RADIUS_M - 1e-5 for p in points for one in circles)


def test_each_shipped_world_takes_under_a_second() -> None:
    for name in shipped():
        world, before_s = load(name), thread_time()
        shortest_path(world)
        assert thread_time() - before_s < 1.0, name
