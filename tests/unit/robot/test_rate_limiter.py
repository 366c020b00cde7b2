"""Timing of repeated publications of a value."""

from hypothesis import given
from hypothesis import strategies as st

from robot.vehicle import ReportTimer as Occasion


def test_first_value_is_published_at_once() -> None:
    assert Occasion(10).due(None, 0)


def test_change_is_published_at_once_and_repeats_per_period() -> None:
    occasion = Occasion(10)
    said = [occasion.due(what, now) for what, now in [(1, 0), (1, 9), (1, 10), (2, 11), (2, 20)]]
    assert said == [True, False, True, True, False]


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=50))
def test_no_value_waits_longer_than_the_period(
    asked: list[tuple[bool, int]],
) -> None:
    occasion, now, told_at, told = Occasion(20), 0, -99, None
    for what, later in asked:
        now += later
        due = occasion.due(what, now)
        assert due == (what is not told or now - told_at >= 20)
        told_at, told = (now, what) if due else (told_at, told)
