"""Twenty times a second by the wall clock, for whoever stands in for the plant."""

from collections.abc import Iterator

from runtime.clock import WallClock, ticks

RATE_HZ = 20.0
PERIOD_NS = round(1e9 / RATE_HZ)


def paced(count: int) -> Iterator[int]:
    """The wall-clock stamp at which each of `count` ticks was due."""
    for tick, _ in zip(ticks(WallClock(), RATE_HZ), range(count), strict=False):
        yield tick.due_ns


def wait_until(deadline_ns: int) -> None:
    WallClock().sleep_until(deadline_ns)
