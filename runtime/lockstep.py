"""A clock that advances only with the simulation, so that runs are reproducible bit by bit."""

import time
from collections.abc import Callable, Iterator
from threading import Lock

from runtime.clock import Tick, WakeUp
from runtime.errors import ClockStoppedError
from runtime.units import PERIOD_NS


class LockstepClock:
    """The time is the stamp of the newest sensor frames.

    After a restart of the plant its stamps begin again, but the time goes on: it is the stamp plus
    `offset_ns`, and `restarts` counts these restarts.

    It does not wait: a thread that would have to wait for a stamp raises ClockStoppedError.
    """

    def __init__(self, start_ns: int = 0) -> None:
        self._time_ns: int | None = None
        self._start_ns = start_ns
        self.offset_ns = self.restarts = 0

    def now_ns(self) -> int:
        """Return the time of the newest stamp."""
        time_ns = self._time_ns
        return self._start_ns if time_ns is None else time_ns

    def cpu_ns(self) -> int:
        """Return the CPU time of this thread."""
        return time.thread_time_ns()

    def advance_to(self, stamp_ns: int) -> None:
        """Set the time to the stamp of the newest sensor frames; an older one is a restart."""
        before_ns, time_ns = self._time_ns, stamp_ns + self.offset_ns
        if before_ns is not None and time_ns < before_ns:
            self.restarts += 1
            self.offset_ns = before_ns + PERIOD_NS - stamp_ns
            time_ns = stamp_ns + self.offset_ns
        if before_ns is None or time_ns > before_ns:
            self._time_ns = time_ns

    def sleep_until(self, deadline_ns: int) -> None:
        """Return if a stamp of at least `deadline_ns` has arrived; raise ClockStoppedError."""
        if not self.reached(deadline_ns):
            raise ClockStoppedError(f"no stamp of {deadline_ns} ns has arrived")

    def reached(self, time_ns: int) -> bool:
        """Return whether a stamp of at least `time_ns` has arrived."""
        return self._time_ns is not None and self._time_ns >= time_ns


class LockstepLoop:
    """Runs control cycles in the thread that advances the clock: to wake another one costs time.

    The thread that calls `run` does the work between the cycles: it calls `idle` at each `nudge`,
    and whenever no cycle has run for `patience_s` of wall time. A lock separates the two threads.

    Cycles that may block, because the core runs on a board, run in the thread that calls `run`: a
    thread of the bus that waits loses its connections.
    """

    def __init__(
        self,
        clock: LockstepClock,
        grid: Iterator[Tick],
        idle: Callable[[], None],
        patience_s: float,
        *,
        blocking: bool = False,
    ) -> None:
        """Create a loop with the grid of `clock`; `blocking`: cycles may block."""
        self._clock = clock
        self._grid = grid
        self._idle = idle
        self._patience_s = patience_s
        self._blocking = blocking
        self._due_ns = 0
        self._cycle: Callable[[Tick], None] | None = None
        self._error: Exception | None = None
        self._cycles = 0
        self._stopped = False
        self._lock = Lock()
        self._nudged = WakeUp()

    def advance_to(self, stamp_ns: int) -> None:
        """Advance the clock and run the cycle that is due; if cycles may block, wake `run` for it.

        Call this from one thread at a time.
        """
        if self._blocking:
            self._clock.advance_to(stamp_ns)
            self._nudged.wake()
            return
        with self._lock:
            self._clock.advance_to(stamp_ns)
            self._run_due()

    def nudge(self) -> None:
        """Call `idle` soon; returns at once, from any thread."""
        self._nudged.wake()

    def stop(self) -> None:
        """End `run`; returns at once, from any thread and from a signal handler."""
        self._stopped = True
        self._nudged.wake()

    def run(self, cycle: Callable[[Tick], None]) -> None:
        """Run cycles until stopped; raise the error of a cycle. No cycle runs after the return."""
        with self._lock:
            self._cycle = cycle
            self._run_due()
        while not self._stopped:
            before = self._cycles
            nudged = self._nudged.wait(self._patience_s)
            with self._lock:
                if self._blocking and self._run_due():
                    continue
                if not self._stopped and (nudged or self._cycles == before):
                    self._idle()
        with self._lock:
            self._cycle = None
        if self._error is not None:
            raise self._error

    def _run_due(self) -> bool:
        """Run the cycle if it is due, and return whether it was; keep its error for `run`."""
        if self._cycle is None or self._stopped or not self._clock.reached(self._due_ns):
            return False
        try:
            tick = next(self._grid)
            self._due_ns = tick.due_ns + PERIOD_NS
            self._cycles += 1
            self._cycle(tick)
        except Exception as error:
            self._error = error
            self.stop()
        return True
