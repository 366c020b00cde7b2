"""Frames that are more than 200 ms later than usual for their sender are late."""

from hypothesis import given
from hypothesis import strategies as st

from robot.senses import MAX_SENDERS, DelayFilter
from tests.support.each import each
from tests.support.robot.vehicles import MS

S = 1_000 * MS
ADA, BOB = "ada/1", "bob/2"


def late(delays: DelayFilter, delay_ms: float, at_ns: int, sender: str = ADA) -> bool:
    """Return whether a frame with this delay is late when it arrives at this time."""
    return delays.is_late(sender, at_ns - round(delay_ms * MS), at_ns)


def used_to(delay_ms: float, sender: str = ADA) -> DelayFilter:
    """Return a filter for a sender with this delay at second 0."""
    delays = DelayFilter()
    assert not late(delays, delay_ms, 0, sender)
    return delays


@each("delay_ms", [-5_000.0, 0.0, 3_000.0])
def test_first_frame_sets_the_usual_delay(delay_ms: float) -> None:
    """Clocks may differ, so the usual delay may have any value, even a negative one."""
    delays = used_to(delay_ms)
    assert not late(delays, delay_ms + 200.0, 1 * S)
    assert late(delays, delay_ms + 200.000_001, 1 * S)


def test_faster_frame_sets_a_new_usual_delay() -> None:
    delays = used_to(300.0)
    assert not late(delays, 50.0, 1 * S)
    assert late(delays, 300.0, 2 * S)


def test_a_late_frame_changes_nothing_for_the_next() -> None:
    delays = used_to(50.0)
    for second in (1, 2, 3):
        assert late(delays, 900.0, second * S)
    assert not late(delays, 250.0, 4 * S)


def test_longer_delay_is_usual_after_two_time_spans() -> None:
    delays = used_to(50.0)
    for at_ms in range(100, 10_000, 100):
        assert late(delays, 300.0, at_ms * MS), at_ms
    assert not late(delays, 300.0, 10_000 * MS)
    assert not late(delays, 500.0, 10_100 * MS)
    assert late(delays, 500.001, 10_200 * MS)


def test_a_span_lasts_five_seconds_to_the_nanosecond() -> None:
    delays = used_to(50.0)
    assert late(delays, 300.0, 5 * S - 1)
    assert late(delays, 300.0, 5 * S)
    assert late(delays, 300.0, 10 * S - 1)
    assert not late(delays, 300.0, 10 * S)


def test_minimum_of_the_previous_span_counts() -> None:
    delays = used_to(300.0)
    assert not late(delays, 50.0, 4 * S)
    assert late(delays, 300.0, 5 * S)
    assert late(delays, 300.0, 9 * S)


def test_senders_have_delays_of_their_own() -> None:
    delays = used_to(50.0)
    assert not late(delays, 2_000.0, 1 * S, BOB)
    assert not late(delays, 2_200.0, 1 * S, BOB)
    assert late(delays, 300.0, 1 * S, ADA)


def test_the_sixteen_newest_senders_are_kept() -> None:
    assert MAX_SENDERS == 16
    delays = used_to(0.0)
    for number in range(15):
        late(delays, 0.0, 0, f"op/{number}")
    assert late(delays, 300.0, 1, ADA), "its frame makes it the newest sender"
    for number in range(15, 30):
        late(delays, 0.0, 1, f"op/{number}")
    assert late(delays, 300.0, 2, ADA)
    for number in range(30, 46):
        late(delays, 0.0, 3, f"op/{number}")
    assert not late(delays, 300.0, 4, ADA), "forgotten, so this is its first"


@given(st.lists(st.integers(0, 190), min_size=1, max_size=50), st.integers(-(10**6), 10**6))
def test_jitter_of_less_than_200_ms_makes_no_frame_late(
    jitters_ms: list[int], offset_ms: int
) -> None:
    delays = DelayFilter()
    assert not any(
        late(delays, offset_ms + jitter_ms, at * 300 * MS)
        for at, jitter_ms in enumerate(jitters_ms)
    )
