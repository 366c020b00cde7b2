"""Timing of repeated publications of a value."""

from hypothesis import given
from hypothesis import strategies as st

from robot.vehicle import ReportTimer


def test_first_value_is_published_at_once() -> None:
    assert ReportTimer(10).due(None, 0)


def test_change_is_published_at_once_and_repeats_per_period() -> None:
    timer = ReportTimer(10)
    published = [timer.due(what, now) for what, now in [(1, 0), (1, 9), (1, 10), (2, 11), (2, 20)]]
    assert published == [True, False, True, True, False]


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=50))
def test_no_value_waits_longer_than_the_period(
    asked: list[tuple[bool, int]],
) -> None:
    timer, now, published_at, newest = ReportTimer(20), 0, -99, None
    for what, later in asked:
        now += later
        due = timer.due(what, now)
        assert due == (what is not newest or now - published_at >= 20)
        published_at, newest = (now, what) if due else (published_at, newest)
