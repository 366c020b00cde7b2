"""Wall-clock pacing at the control rate, for a program in the place of the plant."""

from collections.abc import Iterator

from runtime.clock import WallClock, ticks
from runtime.units import CONTROL_HZ


def paced(count: int) -> Iterator[int]:
    """Yield the monotonic time in ns at which each of `count` ticks was due."""
    for tick, _ in zip(ticks(WallClock(), CONTROL_HZ), range(count), strict=False):
        yield tick.due_ns


def wait_until(deadline_ns: int) -> None:
    """Sleep until a monotonic time."""
    WallClock().sleep_until(deadline_ns)
