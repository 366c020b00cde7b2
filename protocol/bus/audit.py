"""Report in the log of a listening process which sessions it refused, and what they tried to do."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from protocol.bus.bus import Bus
from protocol.bus.tls.peer_address import ClosingConnections, end_in
from protocol.bus.tls.refusal_log import SIGNS, UNKNOWN, Caller, RefusalLog
from protocol.bus.tls.zenoh_log import AUDIT_FILTER, ZenohLog

LOOK_S: Final = 0.5
DRAIN_S: Final = 0.05
"""Period at which the log is read from the kernel, which buffers some hundred events."""

MAX_CALLERS: Final = 1000
NAMELESS: Final = "a process whose certificate has no name"


class ConnectionAudit:
    """Read Zenoh's log a few times a second; a flood of refusals costs bounded time and memory."""

    def __init__(self, bus: Bus, log: ZenohLog, report: Callable[[str], None]) -> None:
        self._log = log
        self._report = report
        self._refusals = RefusalLog()
        self._closing = ClosingConnections([end_in(bus.locator()).port])
        self._callers: dict[str, Caller] = {}
        self._revoked = bus.network.revoked
        bus.on_caller(self._add_caller)

    def look(self) -> None:
        """Report the refusals since the last call."""
        log, now_ns = self._log.take(), time.monotonic_ns()
        for line in self._refusals.sentences(log, self._caller, self._failed_hosts, now_ns):
            self._report(line)

    def _add_caller(self, zid: str, name: str | None, address: str) -> None:
        shown = f"{name} (revoked)" if name in self._revoked else name or NAMELESS
        self._callers[zid] = Caller(shown, address.partition("/")[2])
        while len(self._callers) > MAX_CALLERS:
            del self._callers[next(iter(self._callers))]

    def _caller(self, zid: str) -> Caller:
        return self._callers.get(zid, UNKNOWN)

    def _failed_hosts(self) -> list[str]:
        known = [end_in(caller.address) for caller in tuple(self._callers.values())]
        return self._closing.new(known)


@contextmanager
def audited_connections(bus: Bus, report: Callable[[str], None]) -> Iterator[None]:
    """Report refused sessions, and impostors that this process dialled, while the block runs.

    Do nothing for a process without TLS.

    Redirect standard output, to which Zenoh writes its log: only for processes that print nothing.
    """
    bus.on_impostor(report)
    tls = bus.network.tls
    if tls is None or not tls.tell_refusals or not bus.network.listen:
        yield
        return
    ended = threading.Event()
    with ZenohLog(AUDIT_FILTER, SIGNS) as log:
        audit = ConnectionAudit(bus, log, report)

        def run() -> None:
            next_look_s = time.monotonic() + LOOK_S
            while not ended.wait(DRAIN_S):
                log.drain()
                if time.monotonic() >= next_look_s:
                    audit.look()
                    next_look_s = time.monotonic() + LOOK_S

        thread = threading.Thread(target=run, name="audit", daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()
            audit.look()
