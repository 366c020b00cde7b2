"""Inject loss, delay, duplication and reordering between a session and its subscribers."""

import threading
import time
from collections.abc import Callable
from typing import Final, TypeAlias

import zenoh

from protocol.bus.link_faults import FaultyLink, LinkFaults, earliest
from protocol.topics import CLOCK, TOPICS, key_parts
from runtime.units import NS_PER_S

Take: TypeAlias = Callable[[zenoh.Sample], None]
EXEMPT: Final = frozenset(topic.path for topic in TOPICS if topic.history) | {CLOCK.path}


class FaultInjector:
    """Pass all samples of one bus through faulty links. A thread delivers the delayed ones.

    `by_hand`: simulated time advances only on command, so the owner of the clock calls `release`.
    `after` is called with the key of each sample that was delivered, lost or delayed. The lockstep
    clock is exempt because it is not part of the simulation. Events are exempt because the layer
    below fetches lost ones again.
    """

    def __init__(self, trouble: LinkFaults | None, now_ns: Callable[[], int]) -> None:
        self.by_hand = False
        self.after: Callable[[str], None] | None = None
        self._now_ns = now_ns
        self._trouble = trouble
        self._links: dict[tuple[int, str, LinkFaults], tuple[FaultyLink[zenoh.Sample], Take]] = {}
        self._changed = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False

    def disturb(self, trouble: LinkFaults | None) -> None:
        """Apply these faults from now on; None: none. Delayed samples keep their delay."""
        self._trouble = trouble

    def wrapped(self, take: Take) -> Take:
        """Return the callback to be given to Zenoh in place of a subscriber's callback."""

        def receive(sample: zenoh.Sample) -> None:
            if self._trouble is None:
                take(sample)
            else:
                self._pass_through(sample, take)
            if self.after is not None:
                self.after(str(sample.key_expr))

        return receive

    def release(self, now_ns: int) -> None:
        """Deliver the samples that are due."""
        with self._changed:
            for link, take in tuple(self._links.values()):
                for sample in link.due(now_ns):
                    take(sample)

    def close(self) -> None:
        """Stop; delayed samples are lost."""
        with self._changed:
            self._closed = True
            self._links.clear()
            self._changed.notify()
        if self._thread is not None:
            self._thread.join(timeout=1.0)

    def _pass_through(self, sample: zenoh.Sample, take: Take) -> None:
        trouble = self._trouble
        parts = key_parts(str(sample.key_expr))
        exempt = parts is None or parts.path in EXEMPT
        if trouble is None or parts is None or exempt or not trouble.concerns(parts.path):
            take(sample)
            return
        key = f"{parts.robot}/{parts.path}"
        with self._changed:
            link, _ = self._links.setdefault(
                (id(take), key, trouble), (FaultyLink(trouble, key), take)
            )
            for one in link.take(sample, self._now_ns()):
                take(one)
            if link.next_ns is not None and not self.by_hand:
                self._changed.notify()
                self._start()

    def _start(self) -> None:
        if self._thread is None and not self._closed:
            self._thread = threading.Thread(target=self._run, name="link faults", daemon=True)
            self._thread.start()

    def _run(self) -> None:
        with self._changed:
            while not self._closed:
                self.release(self._now_ns())
                next_ns = earliest(link for link, _ in self._links.values())
                wait_ns = None if next_ns is None else next_ns - time.monotonic_ns()
                self._changed.wait(None if wait_ns is None else max(0, wait_ns) / NS_PER_S)
