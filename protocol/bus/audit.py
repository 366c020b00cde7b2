"""Report in the log of a listening process which sessions it refused, and what they tried to do.

A link with the session id of another certificate is also reported to the operators, as a text of
each robot that this process serves.

Zenoh can only write its own log to standard output. Here each event of the log is one datagram to a
socket of this process on the loopback interface. The kernel keeps the boundaries between events,
cuts an event at MAX_EVENT_BYTES and drops events when the socket buffer is full. A write never
waits and never fails for lack of space. A pipe would block reception on the bus, a file in memory
would grow, and a line break inside a key would start a new line.

The refused session chooses part of an event: the key, which may be long and may contain line
breaks. An event is therefore parsed from its beginning only, and the key is cut and cleaned.
"""

import os
import re
import socket
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from datetime import UTC, datetime
from types import MappingProxyType
from typing import Final, NamedTuple, Self

import zenoh

from protocol.bus.bus import Bus
from protocol.bus.peers import ID_TAKEN, RefusedLink
from protocol.bus.publisher import Publisher
from protocol.bus.rights import grant_of
from protocol.bus.sockets import ClosingConnections, end_in
from protocol.topics import TEXT, Role
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext
from protocol.wire.statustext import pieces_of
from runtime.cli.terminal import guarded

AUDIT_FILTER: Final = "zenoh::net::routing::interceptor::access_control=trace,zenoh_link_tls=debug"
ENVIRONMENT: Final[Mapping[str, str | None]] = MappingProxyType({"RUST_LOG": None, "NO_COLOR": "1"})
"""Environment variables that Zenoh's log reads, with the values set for it."""

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

    def __init__(self, wanted: str = AUDIT_FILTER, signs: tuple[bytes, ...] = ()) -> None:
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
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    set_all(ENVIRONMENT)
    try:
        zenoh.init_log_from_env_or(wanted)
    finally:
        set_all(before)


def set_all(values: Mapping[str, str | None]) -> None:
    """Set or remove environment variables."""
    for name, value in values.items():
        if value is None:
            os.environ.pop(name, None)
        else:
            os.environ[name] = value


QUIET_NS: Final = 60_000_000_000
"""Period after which a sentence is repeated, with a count. Budgets apply to this period."""

MAX_SENTENCES: Final = 10
"""Sentences about one certificate in QUIET_NS; further ones are only counted."""

MAX_NAMES: Final = 200
MAX_CHARACTERS: Final = 200
"""Length of a key or a cause in a sentence."""

MAX_EVENTS: Final = 300
SIGNS: Final = (b"is unauthorized to", b". Hint: ")
"""Text in events about refusals. Most events are about permitted actions."""

BEGIN: Final = (
    r"\A\d{4}-\d\d-\d\dT[\d:.]+Z +(?P<level>[A-Z]+) +\S+ ThreadId\(\d+\) "
    r"(?:[\w=.:/ {}\[\]-]{0,200}?: )??"
)
DENIED: Final = re.compile(
    BEGIN + r"zenoh::net::routing::interceptor::access_control: "
    r"(?P<known>Using cached result: )?(?P<zid>[0-9a-f]{1,32})(?: on \S*)? is unauthorized to "
    r"(?P<what>[A-Z][A-Za-z/ ]{1,60}) \(ingress\) on (?P<key>.+)",
    re.DOTALL,
)
FAILED: Final = re.compile(BEGIN + r"zenoh_link_tls::unicast: (?P<why>.+?)\. Hint: ", re.DOTALL)
PRECOMPUTED: Final = "Declare/Undeclare"
"""Zenoh computes all permissions of a key at once and logs the missing ones as refusals."""

ACTIONS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "Put": "put on",
        "Delete": "delete",
        "Query": "query",
        "Reply": "answer on",
        "Declare Subscriber": "subscribe to",
        "Declare Queryable": "serve",
        "Liveliness Token": "announce itself as",
        "Liveliness Query": "query presence at",
        "Declare Liveliness Subscriber": "query presence at",
    }
)
WHEN: Final = re.compile(r"not valid (?P<which>after|before) (?P<s>\d{1,11})\b")
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


class Sentence(NamedTuple):
    """A sentence about the refused session with a certificate `name`."""

    name: str
    text: str


class Budget:
    """The sentences about one certificate within QUIET_NS, with their numbers of repetitions."""

    __slots__ = ("before", "begun_ns", "more", "reported")

    def __init__(self, begun_ns: int, before: dict[str, int]) -> None:
        self.begun_ns = begun_ns
        self.before = before
        self.reported: dict[str, int] = {}
        self.more = 0

    def is_over(self, now_ns: int) -> bool:
        """Return whether the period has ended."""
        return now_ns - self.begun_ns >= QUIET_NS


class RefusalLog:
    """Report each refusal once, and at most MAX_SENTENCES about one certificate in QUIET_NS."""

    def __init__(self) -> None:
        self._budgets: dict[str, Budget] = {}

    def sentences(
        self,
        events: Sequence[bytes],
        caller: Callable[[str], Caller],
        failed_hosts: Callable[[], Iterable[str]],
        now_ns: int,
    ) -> list[str]:
        """Return the sentences about some events of the log.

        `caller` returns the owner of a session id; `failed_hosts` the hosts of failed connections.
        """
        read = [event.decode(errors="replace") for event in events[:MAX_EVENTS]]
        found = (*denials(read, caller), *failed_handshakes(read, failed_hosts))
        return [*self.limited(found, now_ns), *self._ended(now_ns)]

    def limited(self, sentences: Iterable[Sentence], now_ns: int) -> list[str]:
        """Return the sentences that are to be reported now."""
        return [line for sentence in sentences for line in self._limited(sentence, now_ns)]

    def _limited(self, sentence: Sentence, now_ns: int) -> Iterator[str]:
        """Yield the sentence unless it was reported before or there were too many."""
        name, text = sentence
        budget = self._budgets.get(name)
        if budget is None or budget.is_over(now_ns):
            yield from summary(name, budget)
            budget = self._begun(name, now_ns, {} if budget is None else budget.reported)
        if text in budget.reported:
            budget.reported[text] += 1
        elif len(budget.reported) >= MAX_SENTENCES:
            budget.more += 1
        else:
            budget.reported[text] = 0
            before = budget.before.get(text, 0)
            yield f"{text} ({before} more times since the last report)" if before else text

    def _begun(self, name: str, now_ns: int, before: dict[str, int]) -> Budget:
        self._budgets.pop(name, None)
        while len(self._budgets) >= MAX_NAMES:
            del self._budgets[next(iter(self._budgets))]
        budget = self._budgets[name] = Budget(now_ns, before)
        return budget

    def _ended(self, now_ns: int) -> Iterator[str]:
        """Yield the summaries of floods that have ended."""
        for name, budget in self._budgets.items():
            if budget.is_over(now_ns):
                yield from summary(name, budget)
                budget.more = 0


def summary(name: str, budget: Budget | None) -> Iterator[str]:
    """Yield the number of sentences that were not reported one by one."""
    if budget is not None and budget.more:
        yield f"refused: {name}: {budget.more} other attempts in {QUIET_NS // 10**9} s"


def denials(events: Sequence[str], caller: Callable[[str], Caller]) -> Iterator[Sentence]:
    """Yield what sessions with a certificate tried without permission."""
    found = [one for event in events if (one := DENIED.match(event))]
    computed = {(one["zid"], one["key"]) for one in found if one["what"].startswith(PRECOMPUTED)}
    for one in found:
        is_attempt = one["known"] or (one["zid"], one["key"]) not in computed
        if one["what"] not in ACTIONS or not is_attempt:
            continue
        name, address = caller(one["zid"])
        grant = grant_of(name)
        why = f"{name} {grant.description}" if grant else "no role has the name of its certificate"
        key, action = cleaned(one["key"].removesuffix("\n")), ACTIONS[one["what"]]
        yield Sentence(name, f"refused: {name} at {address} may not {action} {key}: {why}")


def failed_handshakes(
    events: Sequence[str], failed_hosts: Callable[[], Iterable[str]]
) -> Iterator[Sentence]:
    """Yield the failed handshakes. Zenoh does not log their addresses."""
    found = [one["why"] for event in events if (one := FAILED.match(event))]
    causes = [why for why in found if not any(words in why for words in PROBE_CAUSES)]
    address = (", ".join(failed_hosts()) if causes else "") or UNKNOWN.address
    for cause in causes:
        text = f"connection refused: {UNKNOWN.name} at {address}: {in_words(cause)}"
        yield Sentence(UNKNOWN.name, text)


def cleaned(key: str) -> str:
    """Cut a key and replace its blanks and unprintable characters by question marks.

    After a blank, a key could imitate a part of the sentence.
    """
    shown = key[:MAX_CHARACTERS]
    text = "".join(c if c.isprintable() and c != " " else "?" for c in shown)
    return text if len(key) <= MAX_CHARACTERS else f"{text}..."


def in_words(why: str) -> str:
    """Return the cause of a failed handshake as text."""
    when = WHEN.search(why)
    if when:
        moment = f"{datetime.fromtimestamp(int(when['s']), UTC):%Y-%m-%d %H:%M} UTC"
        expired = when["which"] == "after"
        return (
            f"its certificate expired at {moment}"
            if expired
            else f"its certificate is not valid before {moment}; compare the clocks"
        )
    shown = "".join(c if c.isprintable() else "?" for c in why[:MAX_CHARACTERS])
    return next((words for sign, words in REASONS if sign in why), shown)


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
