from hypothesis import given
from hypothesis import strategies as st

from robot.core.motion import trail as trails
from robot.core.motion.trail import LIMIT, PASSED_M, SPACING_M, Trail


def walked(distance_m: float) -> Trail:
    trail = Trail()
    for k in range(int(distance_m / 0.015) + 1):
        trails.drop_crumb(trail, k * 0.015, 0.0)
    return trail


def test_crumbs_are_a_spacing_apart() -> None:
    trail = walked(5.0)
    gaps = [b - a for a, b in zip(trail.xs_m, trail.xs_m[1:], strict=False)]
    assert all(SPACING_M <= gap < SPACING_M + 0.02 for gap in gaps)


@given(st.floats(0.0, 400.0))
def test_trail_is_bounded_and_begins_at_the_start(far_m: float) -> None:
    trail = walked(far_m)
    assert 1 <= len(trail.xs_m) == len(trail.ys_m) <= LIMIT
    assert (trail.xs_m[0], trail.ys_m[0]) == (0.0, 0.0)
    assert far_m - trail.xs_m[-1] <= 2 * trail.spacing_m + 0.02


def test_crumbs_are_taken_up_from_the_newest_and_the_start_stays() -> None:
    trail = walked(1.0)
    newest_m = trail.xs_m[-1]
    assert not trails.pass_crumb(trail, newest_m + PASSED_M + 0.01, 0.0)
    assert trails.pass_crumb(trail, newest_m + PASSED_M - 0.01, 0.0)
    assert trail.xs_m[-1] < newest_m
    while trails.pass_crumb(trail, trail.xs_m[-1], 0.0):
        pass
    assert trail.xs_m == [0.0]
