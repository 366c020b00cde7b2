"""Check that each stop acknowledged to an attacker put the robot into EMERGENCY_STOP."""

from bisect import bisect_left
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from runtime.units import PERIOD_NS

SLICE_NS: Final = PERIOD_NS
"""Answers are counted by the slice of time in which they arrived."""

EARLY_NS: Final = 2 * PERIOD_NS
LATE_NS: Final = 3 * PERIOD_NS
"""Tolerance around a slice: statuses come once a tick, and another process receives them."""


class StopStatus(NamedTuple):
    """The arrival time of a status, and whether it showed EMERGENCY_STOP."""

    at_ns: int
    stopped: bool


def slice_of(at_ns: int) -> int:
    """Return the number of the time slice that contains a monotonic time."""
    return at_ns // SLICE_NS


def unfounded(accepted: Mapping[int, int], shown: Sequence[StopStatus]) -> int:
    """Return how many acknowledgements, counted by slice, no status of that time confirms.

    `shown` is in the order of arrival. The first status after that time also counts, because a busy
    machine may delay it. Without any status the acknowledgements are unfounded.
    """
    times_ns = [one.at_ns for one in shown]
    found = 0
    for number, answers in accepted.items():
        first = bisect_left(times_ns, number * SLICE_NS - EARLY_NS)
        last = bisect_left(times_ns, (number + 1) * SLICE_NS + LATE_NS)
        if not any(one.stopped for one in shown[first : last + 1]):
            found += answers
    return found
