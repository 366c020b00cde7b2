"""When something is told again."""

from hypothesis import given
from hypothesis import strategies as st

from robot.vehicle import ReportTimer as Occasion


def test_the_first_time_is_an_occasion_whatever_there_is_to_tell() -> None:
    assert Occasion(10).due(None, 0)


def test_a_change_is_told_at_once_and_the_same_again_after_the_period() -> None:
    occasion = Occasion(10)
    said = [occasion.due(what, now) for what, now in [(1, 0), (1, 9), (1, 10), (2, 11), (2, 20)]]
    assert said == [True, False, True, True, False]


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 30)), max_size=50))
def test_nothing_is_left_untold_for_longer_than_the_period(
    asked: list[tuple[bool, int]],
) -> None:
    occasion, now, told_at, told = Occasion(20), 0, -99, None
    for what, later in asked:
        now += later
        due = occasion.due(what, now)
        assert due == (what is not told or now - told_at >= 20)
        told_at, told = (now, what) if due else (told_at, told)
