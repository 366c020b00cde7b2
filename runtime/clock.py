"""Clocks that are passed in, so that a test controls the time, and the grid of control ticks.

The loop locks the phase of its grid to the pulse of arriving frames. The garbage collector, which
would stall the grid, is kept from doing so.
"""

import ctypes
import gc
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from threading import Lock
from time import monotonic_ns
from typing import Final, Protocol

from runtime.errors import ClockStoppedError
from runtime.units import NS_PER_S


class WakeUp:
    """Wakes one waiting thread.

    A wake-up without a waiting thread is kept; several count as one. Store the data before `wake`:
    the thread reads it after `wait`.

    `SimpleQueue.get` is unsuitable. Before Python 3.13 it waits for ever if a signal interrupts it
    and the handler returns after the deadline. A condition would wake the waiting thread into a
    lock that the notifier still holds.
    """

    def __init__(self) -> None:
        self._held = Lock()
        self._held.acquire()

    def wake(self) -> None:
        """Wake the thread; returns at once, from any thread and from a signal handler."""
        if self._held.locked():
            with suppress(RuntimeError):  # another thread has just released it
                self._held.release()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Return True if woken, False after the timeout."""
        return self._held.acquire(timeout=-1.0 if timeout_s is None else max(0.0, timeout_s))


class PulseSource(Protocol):
    """A source of frame arrivals for the grid."""

    def wait_until(self, deadline_ns: int) -> int | None:
        """Return the time of an arrival, or None if there is none before the deadline."""


class Pulse:
    """Wakes one waiting thread when a frame arrives; only the newest arrival is kept."""

    def __init__(self, now_ns: Callable[[], int] = monotonic_ns) -> None:
        self._now_ns = now_ns
        self._newest_ns: deque[int] = deque(maxlen=1)
        self._arrival = WakeUp()

    def beat(self, arrived_ns: int) -> None:
        """Note the arrival of a frame; called from the bus, returns at once."""
        self._newest_ns.append(arrived_ns)
        self._arrival.wake()

    def wait_until(self, deadline_ns: int) -> int | None:
        """Return the newest arrival that was not yet returned, or None at the deadline."""
        while (arrived_ns := self._taken()) is None:
            remaining_s = (deadline_ns - self._now_ns()) / NS_PER_S
            if remaining_s <= 0 or not self._arrival.wait(remaining_s):
                return None
        return arrived_ns

    def _taken(self) -> int | None:
        return self._newest_ns.popleft() if self._newest_ns else None


class Clock(Protocol):
    """A clock of a control loop."""

    def now_ns(self) -> int:
        """Return the time in nanoseconds."""

    def cpu_ns(self) -> int:
        """Return the CPU time of this thread, which is independent of the load of the machine."""
        ...

    def sleep_until(self, deadline_ns: int) -> None:
        """Wait until the clock has reached the deadline."""


class WallClock:
    """The monotonic clock of this machine."""

    def now_ns(self) -> int:
        """Return the monotonic time."""
        return time.monotonic_ns()

    def cpu_ns(self) -> int:
        """Return the CPU time of this thread."""
        return time.thread_time_ns()

    def sleep_until(self, deadline_ns: int) -> None:
        """Sleep until the deadline."""
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns / NS_PER_S)  # noqa: TID251 - the one place that sleeps


class ManualClock:
    """A clock for tests, which jumps to each deadline: a minute of driving takes milliseconds."""

    def __init__(self, start_ns: int = 0) -> None:
        self._now_ns = start_ns

    def now_ns(self) -> int:
        """Return the simulated time."""
        return self._now_ns

    def cpu_ns(self) -> int:
        """Return the simulated time; computing costs nothing."""
        return self._now_ns

    def advance(self, ns: int) -> None:
        """Advance the time."""
        self._now_ns += ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Jump to the deadline."""
        self._now_ns = max(self._now_ns, deadline_ns)


SLACK: Final = 4
"""The grid waits this fraction of a period (1/4) for a late frame before it ticks without one."""

DRAWN: Final = 50
"""An early frame moves the next tick forward by at most this fraction of a period (1/50)."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One tick of the grid.

    `late_ns` counts from the arrival of the frame that started the tick, or from its deadline.
    `missed` counts the skipped ticks so far.
    """

    index: int
    due_ns: int
    late_ns: int
    missed: int
    by_frame: bool = False


def ticks(clock: Clock, rate_hz: float, pulse: PulseSource | None = None) -> Iterator[Tick]:
    """Yield ticks on a fixed grid; a late tick skips the deadlines it overran.

    With a pulse the grid is phase-locked to arriving frames. A frame starts the tick; without one
    the grid's own deadline does, a quarter of a period after the frame was due. The grid begins
    with the first tick and ends when the clock is stopped.
    """
    grid = _Grid(clock, round(NS_PER_S / rate_hz), pulse)
    try:
        while True:
            yield grid.next_tick()
    except ClockStoppedError:
        return


class _Grid:
    """State of a grid: when the next tick is due, and how many were skipped."""

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
        """Wait for the next tick and return it."""
        arrived_ns = self._wait()
        now_ns = self._clock.now_ns()
        if self._index < 0:
            self._due_ns = now_ns - self._slack_ns if arrived_ns is None else arrived_ns
        if arrived_ns is None:
            return self._started_by_grid(now_ns)
        return self._started_by_frame(arrived_ns, now_ns)

    def _wait(self) -> int | None:
        """Return the arrival of the frame that starts the tick, or None for a deadline."""
        if self._pulse is None:
            self._clock.sleep_until(self._due_ns)
            return None
        while True:
            arrived_ns = self._pulse.wait_until(self._due_ns + self._slack_ns)
            if arrived_ns is None or self._due_ns - arrived_ns <= self._period_ns // 2:
                return arrived_ns
            self._too_early(arrived_ns)

    def _too_early(self, arrived_ns: int) -> None:
        """Skip an early frame; correct the phase if the previous tick did not wait for it."""
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
        # A frame may start its tick early, but the grid follows only by a small step. A sender of
        # too many frames cannot speed up the loop.
        phase_ns = max(arrived_ns, self._due_ns - self._period_ns // DRAWN)
        self._due_ns = phase_ns + self._skip(late_ns // self._period_ns)
        return self._tick(arrived_ns, late_ns, by_frame=True)

    def _skip(self, periods: int) -> int:
        """Count whole periods as missed; return their duration."""
        skipped = max(0, periods)
        self._index += skipped
        self._missed += skipped
        return skipped * self._period_ns

    def _tick(self, due_ns: int, late_ns: int, *, by_frame: bool) -> Tick:
        self._index += 1
        self._due_ns += self._period_ns
        return Tick(self._index, due_ns, late_ns, self._missed, by_frame)


def freeze_heap() -> str | None:
    """Exclude all present objects from garbage collection; return a warning if unavailable.

    Memory that the imports needed for a moment goes back to the system: 3 MB where they had to
    compile, because no bytecode is kept.
    """
    if not hasattr(gc, "freeze"):
        return "this Python cannot freeze its heap: a collection may stall the loop"
    gc.collect()
    gc.freeze()
    with suppress(AttributeError, OSError):  # another C library may lack it
        ctypes.CDLL(None).malloc_trim(0)
    return None
