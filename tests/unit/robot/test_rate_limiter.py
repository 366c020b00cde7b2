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


def test_a_late_call_does_not_delay_the_following_ones() -> None:
    timer = ReportTimer(20)
    published = [now for now in (0, 21, 40, 63, 80) if timer.due("x", now)]
    assert published == [0, 21, 40, 63, 80], "the mean period is 20"


def test_after_a_pause_the_period_counts_anew() -> None:
    timer = ReportTimer(20)
    published = [now for now in (0, 100, 110, 119, 120) if timer.due("x", now)]
    assert published == [0, 100, 120]


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=50))
def test_no_value_waits_longer_than_the_period(
    asked: list[tuple[bool, int]],
) -> None:
    timer, now, published_at, newest = ReportTimer(20), 0, -99, None
    for what, later in asked:
        now += later
        due = timer.due(what, now)
        if what is not newest or now - published_at >= 20:
            assert due
        published_at, newest = (now, what) if due else (published_at, newest)


@given(st.lists(st.integers(1, 30), min_size=1, max_size=100))
def test_the_mean_rate_of_an_unchanged_value_is_at_most_one_a_period(gaps: list[int]) -> None:
    timer, now, published = ReportTimer(20), 0, 0
    for gap in gaps:
        published += timer.due("x", now)
        now += gap
    assert published <= 1 + now // 20
