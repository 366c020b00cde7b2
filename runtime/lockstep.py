"""A clock that advances only with the simulation, so that runs are reproducible bit by bit."""

import time
from collections.abc import Callable

from runtime.arrivals import WakeUp
from runtime.errors import ClockStoppedError
from runtime.timing import PERIOD_NS


class LockstepClock:
    """The time is the stamp of the newest sensor frames.

    After a restart of the plant its stamps begin again, but the time goes on: it is the stamp plus
    `offset_ns`, and `restarts` counts these restarts.

    `advance_to` and `stop` are thread-safe. If no stamp arrives for `patience_s` of wall time, a
    waiting thread raises ClockStoppedError. With `idle` it calls that instead, and also at each
    `nudge`, so that it can do other work.
    """

    def __init__(
        self,
        start_ns: int = 0,
        patience_s: float | None = None,
        idle: Callable[[], None] | None = None,
    ) -> None:
        self._time_ns: int | None = None
        self._start_ns = start_ns
        self._patience_s = patience_s
        self._idle = idle
        self._nudged = False
        self._stopped = False
        self._change = WakeUp()
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
            self._change.wake()

    def nudge(self) -> None:
        """Make the waiting thread call `idle` now, if set."""
        self._nudged = self._idle is not None
        self._change.wake()

    def stop(self) -> None:
        """Stop the time: threads that wait, now or later, raise ClockStoppedError."""
        self._stopped = True
        self._change.wake()

    def sleep_until(self, deadline_ns: int) -> None:
        """Wait for a stamp of at least `deadline_ns`; raise ClockStoppedError after `stop`."""
        while not self._reached(deadline_ns):
            if self._stopped:
                raise ClockStoppedError("the clock was stopped")
            if self._nudged or not self._change.wait(self._patience_s):
                self._nudged = False
                self._do_something_else()

    def _do_something_else(self) -> None:
        if self._idle is None:
            raise ClockStoppedError(f"no sensor frames for {self._patience_s} s")
        self._idle()

    def _reached(self, deadline_ns: int) -> bool:
        return self._time_ns is not None and self._time_ns >= deadline_ns
