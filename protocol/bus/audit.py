"""Report in the log of a listening process which sessions it refused, and what they tried."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from protocol.bus.bus import Bus
from protocol.bus.tls.peer_address import ClosingConnections, end_in
from protocol.bus.tls.refusal_log import SIGNS, UNKNOWN, Caller, Refusals
from protocol.bus.tls.zenoh_log import DOORS, ZenohLog

LOOK_S: Final = 0.5
DRAIN_S: Final = 0.05
"""So often the log is taken out of the kernel, which keeps some hundred events."""

CALLERS: Final = 1000
NAMELESS: Final = "somebody whose certificate has no name"


class ConnectionAudit:
    """Reads the log a few times a second; a flood of refusals costs a bounded time and memory."""

    def __init__(self, bus: Bus, log: ZenohLog, tell: Callable[[str], None]) -> None:
        self._log = log
        self._tell = tell
        self._refusals = Refusals()
        self._strangers = ClosingConnections([end_in(bus.locator()).port])
        self._callers: dict[str, Caller] = {}
        self._revoked = bus.network.revoked
        bus.on_caller(self._came)

    def look(self) -> None:
        """Report the refusals since the last look."""
        log, now_ns = self._log.take(), time.monotonic_ns()
        for line in self._refusals.heard(log, self._caller, self._came_to_nothing, now_ns):
            self._tell(line)

    def _came(self, zid: str, name: str | None, address: str) -> None:
        shown = f"{name} (revoked)" if name in self._revoked else name or NAMELESS
        self._callers[zid] = Caller(shown, address.partition("/")[2])
        while len(self._callers) > CALLERS:
            del self._callers[next(iter(self._callers))]

    def _caller(self, zid: str) -> Caller:
        return self._callers.get(zid, UNKNOWN)

    def _came_to_nothing(self) -> list[str]:
        known = [end_in(caller.address) for caller in tuple(self._callers.values())]
        return self._strangers.new(known)


@contextmanager
def watched_doors(bus: Bus, tell: Callable[[str], None]) -> Iterator[None]:
    """Report while the block runs whom a listening process refuses, and impostors that are dialled.

    Do nothing for a process without locked doors.

    Takes the place of standard output, where Zenoh writes: for processes that print nothing there.
    """
    bus.on_impostor(tell)
    tls = bus.network.tls
    if tls is None or not tls.tell_refusals or not bus.network.listen:
        yield
        return
    ends = threading.Event()
    with ZenohLog(DOORS, SIGNS) as log:
        doors = ConnectionAudit(bus, log, tell)

        def watch() -> None:
            looks_s = time.monotonic() + LOOK_S
            while not ends.wait(DRAIN_S):
                log.drain()
                if time.monotonic() >= looks_s:
                    doors.look()
                    looks_s = time.monotonic() + LOOK_S

        watching = threading.Thread(target=watch, name="doors", daemon=True)
        watching.start()
        try:
            yield
        finally:
            ends.set()
            watching.join()
            doors.look()
