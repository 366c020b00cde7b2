"""Report in the log of a listening process which sessions it refused, and what they tried to do.

A link with the session id of another certificate is also reported to the operators, as a text of
each robot that this process serves.

Zenoh can only write its own log to standard output. Here each event of the log is one datagram to a
socket of this process on the loopback interface. The kernel keeps the boundaries between events,
cuts an event at MAX_EVENT_BYTES and drops events when the socket buffer is full. A write never
waits and never fails for lack of space. A pipe would block reception on the bus, a file in memory
would grow, and a line break inside a key would start a new line.

Zenoh's API has no event for a refusal (eclipse-zenoh/zenoh#2712), so its own words are reported,
with the certificate and address of the session. The refused session chooses part of them: the key,
which may be long and may contain line breaks. An event is therefore read from its beginning only,
and the key is cut and cleaned.
"""

import os
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Final, NamedTuple, Self

import zenoh

from protocol.bus.bus import Bus
from protocol.bus.peers import ID_TAKEN, RefusedLink
from protocol.bus.publisher import Publisher
from protocol.bus.rights import grant_of
from protocol.bus.sockets import end_in
from protocol.topics import TEXT, Role
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext
from protocol.wire.statustext import pieces_of
from runtime.cli.terminal import guarded, printable

AUDIT_FILTER: Final = "zenoh::net::routing::interceptor::access_control=trace,zenoh_link_tls=warn"
STDOUT: Final = 1
LOOPBACK: Final = "127.0.0.1"
BUFFER_BYTES: Final = 1 << 20
"""Requested buffer size; the kernel may grant less."""

MAX_EVENT_BYTES: Final = 600
MAX_READ: Final = 500
"""Events read in one call of `drain`: bounds its cost in a flood."""

MAX_KEPT: Final = 300
"""Events kept between two calls of `take`."""


class ZenohLog:
    """Capture Zenoh's log until `close`. Python's own standard output is not affected.

    Only events that contain one of `signs` are kept; without signs, all are.
    """

    def __init__(self, wanted: str, signs: tuple[bytes, ...] = ()) -> None:
        self._signs = signs
        self._kept: deque[bytes] = deque(maxlen=MAX_KEPT)
        self._reader, self._writer = channel()
        sys.stdout.flush()
        sys.stdout = guarded(os.fdopen(os.dup(STDOUT), "w", buffering=1))
        os.dup2(self._writer.fileno(), STDOUT)
        initialise(wanted)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def drain(self) -> None:
        """Read up to MAX_READ events from the kernel, and keep those that contain a sign."""
        for _ in range(MAX_READ):
            try:
                event = self._reader.recv(MAX_EVENT_BYTES)
            except BlockingIOError:
                return
            if not self._signs or any(sign in event for sign in self._signs):
                self._kept.append(event)

    def take(self) -> list[bytes]:
        """Return the events kept since the last call, the newest MAX_KEPT of them."""
        self.drain()
        kept = list(self._kept)
        self._kept.clear()
        return kept

    def close(self) -> None:
        """End the capture. Zenoh's log cannot be closed: later output is discarded.

        Python's own standard output continues on its separate descriptor.
        """
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, STDOUT)
        os.close(nowhere)
        self._writer.close()
        self._reader.close()


def channel() -> tuple[socket.socket, socket.socket]:
    """Return a reader and a writer of datagrams that accept nothing from any other socket."""
    reader = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    writer = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    for end in (reader, writer):
        end.bind((LOOPBACK, 0))
        end.setblocking(False)
    reader.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER_BYTES)
    reader.connect(writer.getsockname())
    writer.connect(reader.getsockname())
    return reader, writer


def initialise(wanted: str) -> None:
    """Start Zenoh's log, once per process, independent of the environment."""
    settings = {"RUST_LOG": wanted, "NO_COLOR": "1"}
    before = {name: os.environ.get(name) for name in settings}
    os.environ.update(settings)
    try:
        zenoh.init_log_from_env_or(wanted)
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


QUIET_NS: Final = 60_000_000_000
"""Period in which a refusal is reported once."""

MAX_LINES: Final = 10
"""Lines about one certificate in QUIET_NS; further ones are only counted."""

MAX_CHARACTERS: Final = 200
"""Length of a key or a cause in a line."""

ACCESS: Final = "zenoh::net::routing::interceptor::access_control: "
TLS: Final = "zenoh_link_tls::unicast: "
CACHED: Final = "Using cached result: "
UNAUTHORIZED: Final = "unauthorized to "
INGRESS: Final = " (ingress)"
COMPUTED: Final = "Declare/Undeclare"
"""Zenoh computes all permissions of a key at once and logs the missing ones as refusals."""

NO_ROLE: Final = "no role has the name of its certificate"
HINT: Final = ". Hint: "
SIGNS: Final = (f"is {UNAUTHORIZED}".encode(), HINT.encode())
"""Text in events about refusals. Most events are about permitted actions."""

REASONS: Final = (
    ("InvalidContentType", "it uses plain TCP, and this endpoint accepts only TLS"),
    ("peer sent no certificates", "it shows no certificate"),
    ("UnknownIssuer", "its certificate is signed by another authority"),
    ("BadSignature", "its certificate is signed by another authority"),
    ("InvalidPurpose", "its certificate is not one for clients"),
    ("received fatal alert", "it rejects the certificate of this process"),
)
PROBE_CAUSES: Final = ("handshake eof", "reset by peer", "Broken pipe", "end of file")
"""Causes of a connection that only probed whether a process listens."""


class Caller(NamedTuple):
    """A session that dialled: common name of its certificate, and address."""

    name: str
    address: str


UNKNOWN: Final = Caller("unknown process", "an unknown address")


class RefusalLine(NamedTuple):
    """A line about what was refused to the sessions with a certificate `name`."""

    name: str
    line: str


class Denial(NamedTuple):
    """What a session may not do, in Zenoh's words."""

    zid: str
    action: str
    key: str
    is_cached: bool


class Told:
    """What was reported about one certificate since `begun_ns`, and how many more times."""

    __slots__ = ("begun_ns", "lines", "more")

    def __init__(self, begun_ns: int) -> None:
        self.begun_ns = begun_ns
        self.lines: set[str] = set()
        self.more = 0


class RefusalLog:
    """Report each refusal once, and at most MAX_LINES about one certificate in QUIET_NS."""

    def __init__(self) -> None:
        self._told: dict[str, Told] = {}

    def report(self, refusals: Iterable[RefusalLine], now_ns: int) -> list[str]:
        """Return the lines that are to be reported now, and counts of the others afterwards."""
        lines = []
        for name, told in tuple(self._told.items()):
            if now_ns - told.begun_ns >= QUIET_NS:
                del self._told[name]
                if told.more:
                    lines.append(
                        f"refused: {name}: {told.more} more times in {QUIET_NS // 10**9} s"
                    )
        for name, line in refusals:
            told = self._told.setdefault(name, Told(now_ns))
            if line in told.lines or len(told.lines) >= MAX_LINES:
                told.more += 1
            else:
                told.lines.add(line)
                lines.append(line)
        return lines


def refusals_in(events: Sequence[bytes], caller: Callable[[str], Caller]) -> Iterator[RefusalLine]:
    """Yield what some events of the log report; `caller` returns the owner of a session id."""
    texts = [event.decode(errors="replace") for event in events]
    found = [one for text in texts if (one := denial_in(text)) is not None]
    computed = {(one.zid, one.key) for one in found if one.action.startswith(COMPUTED)}
    for zid, action, key, is_cached in found:
        is_attempt = is_cached or (zid, key) not in computed
        if is_attempt and not action.startswith("Undeclare"):
            name, address = caller(zid)
            grant = grant_of(name)
            why = f"{name} {grant.description}" if grant else NO_ROLE
            may_not = f"may not {action.lower()} on {cleaned(key)}"
            yield RefusalLine(name, f"refused: {name} at {address} {may_not}: {why}")
    for text in texts:
        cause, hint, _ = message_in(text, TLS).partition(HINT)
        if hint and not any(words in cause for words in PROBE_CAUSES):
            yield RefusalLine(UNKNOWN.name, f"connection refused: {in_words(cause)}")


def denial_in(text: str) -> Denial | None:
    """Return what an event denies to a session; None for an event about something else."""
    message = message_in(text, ACCESS)
    subject, _, verdict = message.removeprefix(CACHED).partition(" is ")
    what, _, key = verdict.partition(" on ")
    if not what.startswith(UNAUTHORIZED) or not what.endswith(INGRESS):
        return None
    action = what.removeprefix(UNAUTHORIZED).removesuffix(INGRESS)
    zid = subject.partition(" ")[0]
    return Denial(zid, action, key.removesuffix("\n"), message.startswith(CACHED))


def message_in(text: str, module: str) -> str:
    """Return the message of an event of a module, empty for an event of another one.

    What others have chosen stands behind the name of the module.
    """
    before, _, message = text.partition(module)
    return "" if ACCESS in before or TLS in before else message


def cleaned(key: str) -> str:
    """Cut a key and replace its blanks and unprintable characters by question marks.

    After a blank, a key could imitate a part of the line.
    """
    text = printable(key[:MAX_CHARACTERS]).replace(" ", "?")
    return text if len(key) <= MAX_CHARACTERS else f"{text}..."


def in_words(cause: str) -> str:
    """Return the cause of a failed handshake."""
    plain = (words for sign, words in REASONS if sign in cause)
    return next(plain, printable(cause[:MAX_CHARACTERS]))


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
        events = [] if self._log is None else self._log.take()
        for line in self._refusals.report(refusals_in(events, self._caller), now_ns):
            self._report(line)
        taken = [self._taken.popleft() for _ in range(len(self._taken))]
        for line in self._refusals.report(map(self._taken_id, taken), now_ns):
            self._report(line)
            self._tell_operators(line)

    def _taken_id(self, link: RefusedLink) -> RefusalLine:
        name, host = self._shown(link.name), end_in(link.address).host
        return RefusalLine(
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
