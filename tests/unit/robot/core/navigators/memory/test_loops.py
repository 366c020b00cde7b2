from fractions import Fraction
from itertools import pairwise
from math import atan2, cos, pi, sin

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from robot.core.navigators import loops as way
from robot.core.navigators.loops import (
    CRUMBS,
    HIT_CM,
    HITS,
    IN_A_ROW,
    MIN_AWAY,
    SPACING_CM,
    Loops,
)
from robot.core.perception.echoes import BRADS
from tests.support.each import each

LEFT, RIGHT = 1, -1


def walk_round(loops: Loops, radius_cm: float, laps: float, turn: int = 1) -> float | None:
    """Walk around a circle in small steps; return the number of laps until detection."""
    steps = round(laps * 2.0 * pi * radius_cm / 4.0)
    for k in range(steps):
        angle_rad = turn * 4.0 * k / radius_cm
        x_cm, y_cm = radius_cm * cos(angle_rad), radius_cm * sin(angle_rad)
        heading = int(BRADS * (angle_rad + turn * 0.5 * pi))
        if way.drop(loops, int(x_cm), int(y_cm), heading):
            return 4.0 * k / (2.0 * pi * radius_cm)
    return None


def walk_along(loops: Loops, *places: tuple[float, float]) -> bool:
    """Walk straight from place to place, turning on the spot at each."""
    for (x0, y0), (x1, y1) in pairwise(places):
        heading = int(BRADS * atan2(y1 - y0, x1 - x0))
        steps = int(max(abs(x1 - x0), abs(y1 - y0)) / 4.0)
        for k in range(steps + 1):
            x_cm, y_cm = x0 + (x1 - x0) * k / steps, y0 + (y1 - y0) * k / steps
            if way.drop(loops, int(x_cm), int(y_cm), heading):
                return True
    return False


@each("turn", [1, -1])
@each("radius_cm", [60.0, 150.0, 300.0])
def test_a_closed_way_is_noticed_early_in_its_second_lap(radius_cm: float, turn: int) -> None:
    laps = walk_round(Loops(), radius_cm, 2.0, turn)
    assert laps is not None
    assert 1.0 - 2.0 * SPACING_CM / radius_cm < laps < 1.5


@each("radius_cm", [500.0, 1000.0, 2500.0])
def test_long_way_is_thinned_and_still_detected(radius_cm: float) -> None:
    assert 2.0 * pi * radius_cm > CRUMBS * SPACING_CM
    loops = Loops()
    laps = walk_round(loops, radius_cm, 4.0)
    assert laps is not None
    assert loops.spacing_cm > SPACING_CM
    assert loops.count <= CRUMBS


@each("times", [1, 4])
def test_there_and_back_along_a_corridor_is_no_loop(times: int) -> None:
    """Visit the same places in the other direction."""
    loops = Loops()
    assert not walk_along(loops, (0.0, 0.0), (400.0, 0.0), (0.0, 0.0))
    assert not walk_along(loops, (0.0, 60.0), (0.0, 460.0), (0.0, 60.0))


def test_the_same_places_in_the_same_direction_are_a_loop() -> None:
    corridor = (0.0, 0.0), (400.0, 0.0), (400.0, 60.0), (0.0, 60.0), (0.0, 0.0)
    assert walk_along(Loops(), *corridor, (200.0, 0.0))
    assert not walk_along(Loops(), *corridor)


def test_crossing_the_own_way_is_no_loop() -> None:
    eight = (0.0, 0.0), (300.0, 0.0), (300.0, 200.0), (150.0, 200.0), (150.0, -200.0)
    assert not walk_along(Loops(), *eight)


def test_a_single_place_seen_again_is_no_loop_yet() -> None:
    loops = Loops()
    walk_along(loops, (0.0, 0.0), (400.0, 0.0))
    assert IN_A_ROW > 1
    assert not way.drop(loops, 0, 0, 0)
    assert loops.matches == 1
    assert not way.drop(loops, 1000, 1000, 0)
    assert loops.matches == 0


def test_stationary_robot_stores_one_point() -> None:
    loops = Loops()
    for heading in range(0, 4096, 64):
        assert not way.drop(loops, 10, 10, heading)
    assert loops.count == 1


def test_the_newest_crumbs_are_no_earlier_visit() -> None:
    loops = Loops()
    for k in range(MIN_AWAY):
        way.drop(loops, k * SPACING_CM, 0, 0)
    assert way.visited(loops, 0, 0, 0) == -1
    way.drop(loops, MIN_AWAY * SPACING_CM, 0, 0)
    assert way.visited(loops, 0, 0, 0) == 0
    assert way.visited(loops, 0, 0, 128) == -1


def test_the_way_is_as_long_as_it_was_walked_also_when_thinned() -> None:
    loops, length_cm = Loops(), 0.0
    for k in range(1500):
        length_cm = 4.0 * k
        way.drop(loops, int(length_cm), 0, 0)
    assert loops.spacing_cm > SPACING_CM
    assert way.walked_cm(loops) == pytest.approx(length_cm, rel=0.2)
    way.restart(loops)
    assert way.walked_cm(loops) == 0
    assert loops.spacing_cm == SPACING_CM


def test_at_the_same_place_the_other_side_is_tried() -> None:
    loops = Loops()
    assert way.side_at(loops, 100, 100, LEFT) == LEFT
    way.remember(loops, 100, 100, LEFT)
    assert way.side_at(loops, 100 + HIT_CM // 2, 100, LEFT) == RIGHT
    assert way.side_at(loops, 100 + HIT_CM // 2, 100, RIGHT) == RIGHT
    assert way.side_at(loops, 100 + HIT_CM, 100, LEFT) == LEFT


def test_of_two_hits_at_a_place_the_newer_counts() -> None:
    loops = Loops()
    way.remember(loops, 0, 0, LEFT)
    way.remember(loops, 5, 0, RIGHT)
    assert way.side_at(loops, 0, 0, RIGHT) == LEFT


def test_only_so_many_hits_are_kept_and_the_oldest_goes() -> None:
    loops = Loops()
    for k in range(HITS + 1):
        way.remember(loops, 1000 * k, 0, LEFT)
    assert way.side_at(loops, 0, 0, LEFT) == LEFT
    assert all(way.side_at(loops, 1000 * k, 0, LEFT) == RIGHT for k in range(1, HITS + 1))
    assert len(loops.hit_place) == len(loops.hit_side) == HITS


def test_after_a_hit_the_way_begins_anew() -> None:
    loops = Loops()
    walk_along(loops, (0.0, 0.0), (400.0, 0.0))
    way.remember(loops, 400, 0, LEFT)
    assert way.walked_cm(loops) == 0


def closed_way(corners: list[tuple[int, int]], before: int = 0) -> Loops:
    """Return a loop through these places, with a few points before it."""
    loops = Loops()
    places = [(-900, 800)] * before + corners
    for k, (x_cm, y_cm) in enumerate(places):
        loops.place[k] = way.packed(x_cm, y_cm)
    loops.count, loops.first = len(places), before
    return loops


def crossings_cm(corners: list[tuple[int, int]], x_cm: int, y_cm: int) -> list[Fraction]:
    """Return where the line to the right and left of a place crosses the loop, exactly."""
    found = []
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
        if (y1 > y_cm) != (y2 > y_cm):
            found.append(x1 - x_cm + Fraction((x2 - x1) * (y_cm - y1), y2 - y1))
    return found


coordinates = st.integers(-600, 600)
corners = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=20)


@given(corners, coordinates, coordinates, st.integers(0, 9))
def test_places_inside_and_outside_a_loop_are_distinguished(
    corners: list[tuple[int, int]], x_cm: int, y_cm: int, before: int
) -> None:
    """Test any winding of the loop, except for places within a centimetre of it."""
    met = crossings_cm(corners, x_cm, y_cm)
    assume(all(abs(x) > 1 for x in met))
    inside = sum(1 for x in met if x > 0) % 2 == 1
    assert way.encloses(closed_way(corners, before), x_cm, y_cm) == inside


@given(
    st.lists(st.integers(60, 400), min_size=8, max_size=30),
    st.sampled_from([1, -1]),
    coordinates,
    coordinates,
    st.integers(0, 9),
)
def test_a_loop_round_a_place_turns_as_it_was_walked(
    radii_cm: list[int], turn: int, x_cm: int, y_cm: int, before: int
) -> None:
    step_rad = turn * 2.0 * pi / len(radii_cm)
    star = [
        (x_cm + int(r * cos(k * step_rad)), y_cm + int(r * sin(k * step_rad)))
        for k, r in enumerate(radii_cm)
    ]
    loops = closed_way(star, before)
    assert way.turns_left(loops) == (turn > 0)
    assert way.encloses(loops, x_cm, y_cm)


@given(
    st.lists(st.tuples(coordinates, coordinates, st.integers(-5000, 5000)), max_size=400),
)
def test_wherever_it_goes_nothing_grows(story: list[tuple[int, int, int]]) -> None:
    loops = Loops()
    for x_cm, y_cm, heading in story:
        way.drop(loops, x_cm, y_cm, heading)
        assert 0 < loops.count <= CRUMBS
        assert 0 <= loops.first < CRUMBS
    assert len(loops.place) == len(loops.heading) == CRUMBS


@each("heading_rad", [0.0, 0.7, 2.5])
def test_way_without_a_bend_is_straight(heading_rad: float) -> None:
    loops = Loops()
    assert not way.is_straight(loops)
    for k in range(60):
        way.drop(loops, int(4.0 * k * cos(heading_rad)), int(4.0 * k * sin(heading_rad)), 0)
    assert loops.count > 5
    assert way.is_straight(loops)


@each("end", [(200.0, 150.0), (0.0, 0.0), (300.0, 250.0)])
def test_way_with_a_bend_is_not_straight(end: tuple[float, float]) -> None:
    loops = Loops()
    walk_along(loops, (0.0, 0.0), (200.0, 0.0), end)
    assert not way.is_straight(loops)
