"""Report in the log of a listening process which sessions it refused, and what they tried to do.

A link with the session id of another certificate is also reported to the operators, as a text of
each robot that this process serves.
"""

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Final

from protocol.bus.bus import Bus
from protocol.bus.publisher import Publisher
from protocol.bus.tls.identities import ID_TAKEN, RefusedLink
from protocol.bus.tls.peer_address import ClosingConnections, end_in
from protocol.bus.tls.refusal_log import SIGNS, UNKNOWN, Caller, RefusalLog, Sentence
from protocol.bus.tls.zenoh_log import AUDIT_FILTER, ZenohLog
from protocol.topics import TEXT, Role
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext
from protocol.wire.statustext import pieces_of

LOOK_S: Final = 0.5
DRAIN_S: Final = 0.05
"""Period at which the log is read from the kernel, which buffers some hundred events."""

MAX_CALLERS: Final = 1000
MAX_REFUSED: Final = 100
"""Refused links between two looks of which the certificates are named."""

NAMELESS: Final = "a process whose certificate has no name"


class ConnectionAudit:
    """Read Zenoh's log a few times a second; a flood of refusals costs bounded time and memory.

    Without `log` only links with the session id of another certificate are reported.
    """

    def __init__(self, bus: Bus, log: ZenohLog | None, report: Callable[[str], None]) -> None:
        self._bus = bus
        self._log = log
        self._report = report
        self._refusals = RefusalLog()
        self._closing = ClosingConnections([end_in(bus.locator()).port])
        self._callers: dict[str, Caller] = {}
        self._revoked = bus.network.revoked
        self._taken: deque[RefusedLink] = deque(maxlen=MAX_REFUSED)
        self._texts: dict[str, Publisher[Statustext]] = {}
        self._number = 0
        bus.on_caller(self._add_caller)
        bus.on_refused(self._taken.append)

    def look(self) -> None:
        """Report the refusals since the last call."""
        now_ns = time.monotonic_ns()
        if self._log is not None:
            events = self._log.take()
            for line in self._refusals.sentences(events, self._caller, self._failed_hosts, now_ns):
                self._report(line)
        taken = [self._taken.popleft() for _ in range(len(self._taken))]
        for line in self._refusals.limited(map(self._sentence, taken), now_ns):
            self._report(line)
            self._tell_operators(line)

    def _sentence(self, link: RefusedLink) -> Sentence:
        name, host = self._shown(link.name), end_in(link.address).host
        return Sentence(
            name,
            f"{ID_TAKEN}{name} at {host} used {link.zid}, which {self._shown(link.holder)} has "
            "used first since this process started: its link was ended",
        )

    def _tell_operators(self, line: str) -> None:
        """Publish a line as a text of each robot that this process serves."""
        robots = {self._bus.robot}
        if self._bus.role is not Role.ROBOT:
            present = self._bus.present()
            robots = {token.robot for token in present if token.role == Role.ROBOT.value}
        self._number = self._number % 65_535 + 1
        for robot in robots:
            if robot not in self._texts:
                self._texts[robot] = self._bus.publisher(TEXT, robot)
            for piece in pieces_of(line, self._number, Severity.WARNING):
                self._texts[robot].put(piece)

    def _add_caller(self, zid: str, name: str | None, address: str) -> None:
        self._callers[zid] = Caller(self._shown(name), address)
        while len(self._callers) > MAX_CALLERS:
            del self._callers[next(iter(self._callers))]

    def _shown(self, name: str | None) -> str:
        return f"{name} (revoked)" if name in self._revoked else name or NAMELESS

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
    if tls is None or not bus.network.listen:
        yield
        return
    ended = threading.Event()
    with ExitStack() as stack:
        told = tls.tell_refusals
        log = stack.enter_context(ZenohLog(AUDIT_FILTER, SIGNS)) if told else None
        audit = ConnectionAudit(bus, log, report)

        def run() -> None:
            next_look_s = time.monotonic() + LOOK_S
            while not ended.wait(DRAIN_S if log else LOOK_S):
                if log is not None:
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
