"""Time, passed in rather than looked up, so a test can own it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final, Protocol

from runtime.arrivals import Pulse, PulseSource
from runtime.errors import Stopped
from runtime.lockstep import LockstepClock
from runtime.units import NS_PER_S

__all__ = [
    "Clock",
    "LockstepClock",
    "ManualClock",
    "Pulse",
    "PulseSource",
    "Stopped",
    "Tick",
    "WallClock",
    "ticks",
]


class Clock(Protocol):
    def now_ns(self) -> int: ...
    def cpu_ns(self) -> int:
        """CPU time of this thread: what the work cost, whoever else had the core."""
        ...

    def sleep_until(self, deadline_ns: int) -> None: ...


class WallClock:
    """The monotonic clock of this machine."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def cpu_ns(self) -> int:
        return time.thread_time_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns / NS_PER_S)  # noqa: TID251 - the one place that sleeps


class ManualClock:
    """Jumps straight to whatever is waited for. A minute of driving takes milliseconds."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        return self._now_ns

    def cpu_ns(self) -> int:
        return self._now_ns

    def advance(self, ns: int) -> None:
        self._now_ns += ns

    def sleep_until(self, deadline_ns: int) -> None:
        self._now_ns = max(self._now_ns, deadline_ns)


SLACK: Final = 4
"""A frame may come this fraction of a period after it was due before the grid goes on without."""

DRAWN: Final = 50
"""By this fraction of a period an early frame draws the next tick forward."""


@dataclass(frozen=True, slots=True)
class Tick:
    """`late_ns` counts from the arrival of the frame that started it, or from its deadline."""

    index: int
    due_ns: int
    late_ns: int
    missed: int
    by_frame: bool = False


def ticks(clock: Clock, rate_hz: float, pulse: PulseSource | None = None) -> Iterator[Tick]:
    """Yield on a fixed grid. A late tick drops the deadlines it overran; it never bursts.

    With a pulse the grid is phase-locked to arriving frames: a frame starts the tick, the grid's
    own deadline (a quarter of a period after the frame was due) does when none comes. The grid
    begins with the first tick and ends when the clock is stopped.
    """
    grid = _Grid(clock, round(NS_PER_S / rate_hz), pulse)
    try:
        while True:
            yield grid.next_tick()
    except Stopped:
        return


class _Grid:
    """Where on the grid a loop is: when the next tick is due and what was skipped so far."""

    def __init__(self, clock: Clock, period_ns: int, pulse: PulseSource | None) -> None:
        self._clock = clock
        self._pulse = pulse
        self._period_ns = period_ns
        self._slack_ns = 0 if pulse is None else period_ns // SLACK
        self._due_ns = clock.now_ns()
        self._index = -1
        self._missed = 0
        self._frame_owed = False

    def next_tick(self) -> Tick:
        arrived_ns = self._wait()
        now_ns = self._clock.now_ns()
        if self._index < 0:
            self._due_ns = now_ns - self._slack_ns if arrived_ns is None else arrived_ns
        if arrived_ns is None:
            return self._started_by_grid(now_ns)
        return self._started_by_frame(arrived_ns, now_ns)

    def _wait(self) -> int | None:
        """Arrival of the frame that starts the tick; None when the deadline does."""
        if self._pulse is None:
            self._clock.sleep_until(self._due_ns)
            return None
        while True:
            arrived_ns = self._pulse.wait_until(self._due_ns + self._slack_ns)
            if arrived_ns is None or self._due_ns - arrived_ns <= self._period_ns // 2:
                return arrived_ns
            self._too_early(arrived_ns)

    def _too_early(self, arrived_ns: int) -> None:
        """Part of a burst, or the frame the grid's last tick did not wait for: re-phase once."""
        if self._frame_owed:
            self._frame_owed = False
            self._due_ns = arrived_ns + self._period_ns

    def _started_by_grid(self, now_ns: int) -> Tick:
        late_ns = now_ns - self._due_ns - self._slack_ns
        self._frame_owed = self._pulse is not None
        self._due_ns += self._skip(late_ns // self._period_ns)
        return self._tick(self._due_ns, late_ns, by_frame=False)

    def _started_by_frame(self, arrived_ns: int, now_ns: int) -> Tick:
        late_ns = now_ns - arrived_ns
        self._skip((arrived_ns - self._due_ns + self._period_ns // 2) // self._period_ns)
        self._frame_owed = False
        # A frame may start its tick early, but the grid follows only so far: whoever sends frames
        # all the time makes no faster loop of it.
        phase_ns = max(arrived_ns, self._due_ns - self._period_ns // DRAWN)
        self._due_ns = phase_ns + self._skip(late_ns // self._period_ns)
        return self._tick(arrived_ns, late_ns, by_frame=True)

    def _skip(self, periods: int) -> int:
        """Count whole periods as missed; how long they last."""
        skipped = max(0, periods)
        self._index += skipped
        self._missed += skipped
        return skipped * self._period_ns

    def _tick(self, due_ns: int, late_ns: int, *, by_frame: bool) -> Tick:
        self._index += 1
        self._due_ns += self._period_ns
        return Tick(self._index, due_ns, late_ns, self._missed, by_frame)
