from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from robot.core import motion as trails
from robot.core.motion import LIMIT, PASSED_M, SPACING_M, Trail


def walked(distance_m: float) -> Trail:
    trail = Trail()
    for k in range(int(distance_m / 0.015) + 1):
        trails.drop_crumb(trail, k * 0.015, 0.0)
    return trail


def newest_m(trail: Trail) -> float:
    return trail.xs_m[trail.count - 1]


def test_crumbs_are_a_spacing_apart() -> None:
    trail = walked(5.0)
    used_m = trail.xs_m[: trail.count]
    gaps = [b - a for a, b in pairwise(used_m)]
    assert len(gaps) == 19
    assert all(SPACING_M <= gap < SPACING_M + 0.02 for gap in gaps)


@given(st.floats(0.0, 400.0))
def test_trail_is_bounded_and_begins_at_the_start(far_m: float) -> None:
    trail = walked(far_m)
    assert 1 <= trail.count <= LIMIT
    assert (trail.xs_m[0], trail.ys_m[0]) == (0.0, 0.0)
    assert far_m - newest_m(trail) <= 2 * trail.spacing_m + 0.02


def test_crumbs_are_taken_up_from_the_newest_and_the_start_stays() -> None:
    trail = walked(1.0)
    before_m = newest_m(trail)
    assert not trails.pass_crumb(trail, before_m + PASSED_M + 0.01, 0.0)
    assert trails.pass_crumb(trail, before_m + PASSED_M - 0.01, 0.0)
    assert newest_m(trail) < before_m
    while trails.pass_crumb(trail, newest_m(trail), 0.0):
        pass
    assert (trail.count, newest_m(trail)) == (1, 0.0)


def test_lists_of_the_trail_never_change_their_length() -> None:
    trail = Trail()
    xs_m, ys_m = trail.xs_m, trail.ys_m
    for k in range(10 * LIMIT):
        trails.drop_crumb(trail, float(k * LIMIT), 0.0)
        assert trail.xs_m is xs_m
        assert trail.ys_m is ys_m
        assert len(xs_m) == len(ys_m) == LIMIT
    trails.pass_crumb(trail, newest_m(trail), 0.0)
    assert len(xs_m) == len(ys_m) == LIMIT
