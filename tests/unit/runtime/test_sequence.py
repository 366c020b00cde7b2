"""Frames that are late, repeated or from a restarted sender are distinguished."""

from hypothesis import given
from hypothesis import strategies as st

from runtime.sequence import MAX_LATE_NS, MAX_LATE_TICKS, Order, SequenceTracker, order_of
from tests.support.each import each

WRAP = 1 << 32


@each(
    ("number", "order"),
    [
        (101, Order.NEWER),
        (1000, Order.NEWER),
        (100, Order.REPEATED),
        (99, Order.LATE),
        (80, Order.LATE),
        (79, Order.RESTARTED),
        (0, Order.RESTARTED),
    ],
)
def test_order_follows_from_the_distance_to_the_newest(number: int, order: Order) -> None:
    assert order_of(number, 100, 20) is order


@each(
    ("number", "newest", "order"),
    [
        (0, WRAP - 1, Order.NEWER),
        (WRAP - 1, 0, Order.LATE),
        (WRAP - 20, 0, Order.LATE),
        (WRAP - 21, 0, Order.RESTARTED),
        (5, 5, Order.REPEATED),
        (WRAP // 2 + 1, 0, Order.NEWER),
        (WRAP // 2 + 2, 0, Order.RESTARTED),
    ],
)
def test_order_continues_over_the_wrap_of_a_count(number: int, newest: int, order: Order) -> None:
    assert order_of(number, newest, 20, modulus=WRAP) is order


@each(
    ("behind", "order"),
    [(1, Order.LATE), (2, Order.RESTARTED), (3, Order.RESTARTED), (4, Order.NEWER)],
)
def test_half_of_all_counts_is_ahead(behind: int, order: Order) -> None:
    assert order_of(8 - behind, 8, 1, modulus=9) is order


@given(st.integers(0, WRAP - 1), st.integers(-(WRAP // 4), WRAP // 4))
def test_a_wrapping_count_is_ordered_like_one_that_does_not_wrap(newest: int, step: int) -> None:
    wrapped = order_of((newest + step) % WRAP, newest, 20, modulus=WRAP)
    assert wrapped is order_of(newest + step, newest, 20)


def test_stamps_may_be_as_late_as_counts() -> None:
    assert (MAX_LATE_TICKS, MAX_LATE_NS) == (20, 1_000_000_000)


def test_tracker_follows_every_frame_that_is_not_late() -> None:
    tracker = SequenceTracker(3)
    found = [tracker.take(number) for number in (10, 12, 11, 12, 9, 2, 3, 0, 13)]
    assert found == [
        *(Order.NEWER, Order.NEWER, Order.LATE, Order.REPEATED, Order.LATE),
        *(Order.RESTARTED, Order.NEWER, Order.LATE, Order.NEWER),
    ]


def test_tracker_takes_any_first_frame() -> None:
    assert SequenceTracker(3).take(-5) is Order.NEWER
