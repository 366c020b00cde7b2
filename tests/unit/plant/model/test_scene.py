from plant.model.geometry import movers, still
from protocol.world import Circle, Polygon, Polyline
from tests.support.plant.rooms import room

SQUARE = ((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (1.0, 2.0))


def test_room_has_four_walls_visible_from_inside() -> None:
    edges = still(room()).edges
    assert len(edges) == 4
    for ax, ay, bx, by in edges:  # the middle of the room lies to the right of each
        assert (bx - ax) * (2.0 - ay) - (by - ay) * (2.0 - ax) < 0.0


def test_open_floor_has_no_shapes() -> None:
    assert still(room(walls=False)) == ((), ())


def test_polygon_is_visible_from_outside_in_either_orientation() -> None:
    forth = still(room(Polygon(SQUARE), walls=False)).edges
    back = still(room(Polygon(SQUARE[::-1]), walls=False)).edges
    assert set(forth) == set(back)
    assert (1.0, 1.0, 2.0, 1.0) in forth


def test_wall_has_two_flanks_per_segment_and_a_disc_per_point() -> None:
    scene = still(room(Polyline(((1.0, 1.0), (2.0, 1.0), (2.0, 3.0)), 0.1), walls=False))
    assert [disc[2] for disc in scene.discs] == [0.05] * 3
    assert len(scene.edges) == 4
    assert (1.0, 0.95, 2.0, 0.95) in scene.edges


def test_moving_circle_is_not_part_of_the_static_scene() -> None:
    still_one = Circle(x_m=3.0, y_m=3.0, radius_m=0.2)
    path = ((1.0, 1.0), (2.0, 1.0))
    waiting = Circle(x_m=1.0, y_m=1.0, radius_m=0.3, path_m=path, speed_m_s=0.0)
    moving = Circle(x_m=1.0, y_m=1.0, radius_m=0.1, path_m=path, speed_m_s=0.1)
    world = room(still_one, waiting, moving, walls=False)
    assert still(world).discs == ((3.0, 3.0, 0.2), (1.0, 1.0, 0.3))
    assert movers(world) == (moving,)
