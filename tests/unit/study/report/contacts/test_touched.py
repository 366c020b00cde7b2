"""What was touched: the nearest surface, its edges, and moving obstacles at their place."""

from dataclasses import replace

import pytest

from protocol.world import Circle, Obstacle, Point, Polygon, Polyline
from study.report.contact_kinds import touched, world_at
from tests.support.each import each
from tests.support.study.made import floor
from tests.support.study.report.contact_ticks import person

WALL = Polyline(((1.0, 1.0), (2.0, 1.0)), thickness_m=0.002)
BLOCK = Polygon(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0)))
DISC = Circle(x_m=1.0, y_m=1.0, radius_m=0.25)


@each(
    ("obstacle", "robot", "what", "point", "is_edge"),
    [
        (WALL, (1.5, 1.1), "wall of 2 mm", (1.5, 1.001), False),
        (WALL, (2.1, 1.0), "wall of 2 mm", (2.001, 1.0), True),
        (BLOCK, (1.5, 0.9), "block", (1.5, 1.0), False),
        (BLOCK, (0.9, 0.9), "block", (1.0, 1.0), True),
        (BLOCK, (0.9, 1.8), "block", (1.0, 1.8), False),
        (DISC, (1.5, 1.0), "disc", (1.25, 1.0), False),
        (DISC, (3.9, 1.5), "outer wall", (4.0, 1.5), False),
        (DISC, (2.0, 2.9), "outer wall", (2.0, 3.0), False),
    ],
)
def test_nearest_surface_is_touched(
    obstacle: Obstacle, robot: Point, what: str, point: Point, is_edge: bool
) -> None:
    found = touched(replace(floor(), obstacles=(obstacle,)), robot, 0.0)
    assert (found.name, found.is_edge, found.mover) == (what, is_edge, None)
    assert found.point == pytest.approx(point)


def test_end_at_another_wall_is_no_edge() -> None:
    across = Polyline(((2.0, 0.5), (2.0, 1.5)), thickness_m=0.002)
    world = replace(floor(), obstacles=(WALL, across))
    assert not touched(world, (1.98, 1.05), 0.0).is_edge
    assert touched(replace(world, obstacles=(WALL,)), (1.98, 1.05), 0.0).is_edge


def test_person_is_touched_where_it_has_walked_to() -> None:
    walker = person((1.0, 1.0), (3.0, 1.0))
    world = replace(floor(), obstacles=(walker,))
    found = touched(world, (2.3, 1.0), 10.0)
    assert (found.name, found.mover) == ("person", walker)
    assert found.point == pytest.approx((2.2, 1.0))
    assert found.at(5.0, (2.3, 1.0)) == pytest.approx((1.7, 1.0))
    (moved,) = world_at(world, 10.0).obstacles
    assert isinstance(moved, Circle)
    assert (moved.x_m, moved.y_m) == pytest.approx((2.0, 1.0))
