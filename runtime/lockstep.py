"""A clock that only goes on when the simulation does, so that a run repeats to the last bit."""

import time
from collections.abc import Callable

from runtime.arrivals import WakeUp
from runtime.errors import Stopped


class LockstepClock:
    """Time is the stamp of the newest senses; it stands still until somebody feeds it.

    `advance_to` and `stop` may be called from any thread. A waiting thread that is given no stamp
    for `patience_s` of wall time raises Stopped too, if a patience is set. With an `idle` it calls
    that instead, and whenever it is nudged: the waiting thread has other things to do meanwhile.
    """

    def __init__(
        self,
        start_ns: int = 0,
        patience_s: float | None = None,
        idle: Callable[[], None] | None = None,
    ) -> None:
        self._stamp_ns: int | None = None
        self._start_ns = start_ns
        self._patience_s = patience_s
        self._idle = idle
        self._nudged = False
        self._stopped = False
        self._change = WakeUp()

    def now_ns(self) -> int:
        stamp_ns = self._stamp_ns
        return self._start_ns if stamp_ns is None else stamp_ns

    def cpu_ns(self) -> int:
        return time.thread_time_ns()

    def advance_to(self, stamp_ns: int) -> None:
        """The newest senses bear this stamp; an older one changes nothing."""
        if self._stamp_ns is None or stamp_ns > self._stamp_ns:
            self._stamp_ns = stamp_ns
            self._change.wake()

    def nudge(self) -> None:
        """Let the waiting thread call `idle` now, if it has one."""
        self._nudged = self._idle is not None
        self._change.wake()

    def stop(self) -> None:
        """Time will not go on: whoever waits, now or later, gets Stopped."""
        self._stopped = True
        self._change.wake()

    def sleep_until(self, deadline_ns: int) -> None:
        """Block until a stamp of at least `deadline_ns` was fed; Stopped when it never will be."""
        while not self._reached(deadline_ns):
            if self._stopped:
                raise Stopped("the clock was stopped")
            if self._nudged or not self._change.wait(self._patience_s):
                self._nudged = False
                self._do_something_else()

    def _do_something_else(self) -> None:
        if self._idle is None:
            raise Stopped(f"no senses for {self._patience_s} s")
        self._idle()

    def _reached(self, deadline_ns: int) -> bool:
        return self._stamp_ns is not None and self._stamp_ns >= deadline_ns
