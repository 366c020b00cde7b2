"""Between a session and its subscribers: loses, delays, doubles and swaps samples when told to."""

import threading
import time
from collections.abc import Callable
from typing import Final, TypeAlias

import zenoh

from protocol.bus.faults.link_faults import FaultyLink, LinkFaults, earliest
from protocol.topics import CLOCK, TOPICS, key_parts
from runtime.units import NS_PER_S

Take: TypeAlias = Callable[[zenoh.Sample], None]
SPARED: Final = frozenset(topic.path for topic in TOPICS if topic.history) | {CLOCK.path}


class FaultInjector:
    """All subscribers of one bus hear through it. A thread lets go what is late, if anything is.

    `by_hand`: simulated time does not go on by itself, so whoever owns it calls `release`.
    `after` is told the key of each sample when it has been dealt with: heard, lost or held back.
    Lockstep's own clock is spared: it is no part of what is simulated. So are events: what of them
    is lost below is fetched again, so their listeners hear each one all the same.
    """

    def __init__(self, trouble: LinkFaults | None, now_ns: Callable[[], int]) -> None:
        self.by_hand = False
        self.after: Callable[[str], None] | None = None
        self._now_ns = now_ns
        self._trouble = trouble
        self._ways: dict[tuple[int, str, LinkFaults], tuple[FaultyLink[zenoh.Sample], Take]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False

    def disturb(self, trouble: LinkFaults | None) -> None:
        """From now on like this; None: no more. What is on its way goes on as it was."""
        self._trouble = trouble

    def through(self, take: Take) -> Take:
        """What to give to Zenoh in place of a subscriber's callback."""

        def heard(sample: zenoh.Sample) -> None:
            if self._trouble is None:
                take(sample)
            else:
                self._roughly(sample, take)
            if self.after is not None:
                self.after(str(sample.key_expr))

        return heard

    def release(self, now_ns: int) -> None:
        """Hand on what is due."""
        with self._changed:
            for way, take in tuple(self._ways.values()):
                for sample in way.due(now_ns):
                    take(sample)

    def close(self) -> None:
        """What is still on its way is lost."""
        with self._changed:
            self._closed = True
            self._ways.clear()
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout=1.0)

    def _roughly(self, sample: zenoh.Sample, take: Take) -> None:
        trouble = self._trouble
        parts = key_parts(str(sample.key_expr))
        spared = parts is None or parts.path in SPARED
        if trouble is None or parts is None or spared or not trouble.concerns(parts.path):
            take(sample)
            return
        key = f"{parts.robot}/{parts.path}"
        with self._changed:
            way, _ = self._ways.setdefault(
                (id(take), key, trouble), (FaultyLink(trouble, key), take)
            )
            for one in way.take(sample, self._now_ns()):
                take(one)
            if way.next_ns is not None and not self.by_hand:
                self._changed.notify()
                self._start()

    def _start(self) -> None:
        if self._thread is None and not self._closed:
            self._thread = threading.Thread(target=self._let_go, name="trouble", daemon=True)
            self._thread.start()

    def _let_go(self) -> None:
        with self._changed:
            while not self._closed:
                self.release(self._now_ns())
                next_ns = earliest(way for way, _ in self._ways.values())
                wait_ns = None if next_ns is None else next_ns - time.monotonic_ns()
                self._changed.wait(None if wait_ns is None else max(0, wait_ns) / NS_PER_S)
