"""A clock that only goes on when the simulation does, so that a run repeats to the last bit."""

import threading
import time

from protocol.errors import Stopped


class LockstepClock:
    """Time is the stamp of the newest senses; it stands still until somebody feeds it.

    `advance_to` and `stop` may be called from any thread. A waiting thread that is given no stamp
    for `patience_s` of wall time raises Stopped too, if a patience is set.
    """

    def __init__(self, start_ns: int = 0, patience_s: float | None = None) -> None:
        self._stamp_ns: int | None = None
        self._start_ns = start_ns
        self._patience_s = patience_s
        self._stopped = False
        self._changed = threading.Condition()

    def now_ns(self) -> int:
        stamp_ns = self._stamp_ns
        return self._start_ns if stamp_ns is None else stamp_ns

    def cpu_ns(self) -> int:
        return time.thread_time_ns()

    def advance_to(self, stamp_ns: int) -> None:
        """The newest senses bear this stamp; an older one changes nothing."""
        with self._changed:
            if self._stamp_ns is None or stamp_ns > self._stamp_ns:
                self._stamp_ns = stamp_ns
                self._changed.notify_all()

    def stop(self) -> None:
        """Time will not go on: whoever waits, now or later, gets Stopped."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def sleep_until(self, deadline_ns: int) -> None:
        """Block until a stamp of at least `deadline_ns` was fed; Stopped when it never will be."""
        with self._changed:
            while not self._stopped and not self._reached(deadline_ns):
                if not self._changed.wait(self._patience_s):
                    raise Stopped(f"no senses for {self._patience_s} s")
            if not self._reached(deadline_ns):
                raise Stopped("the clock was stopped")

    def _reached(self, deadline_ns: int) -> bool:
        return self._stamp_ns is not None and self._stamp_ns >= deadline_ns
