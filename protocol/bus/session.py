"""Zenoh sessions with the settings of this project, which last while links and hubs come and go.

Zenoh's own log is not initialised here: it can only write to standard output, which is reserved for
`--json` and the terminal interface.

In Zenoh 1.10 a reply has the priority and the congestion control of its query. A client could thus
make the answering process wait for up to 5 s, with everything else that it sends to that client at
the same priority. Each process therefore overwrites both on the queries that it receives: data that
a slow reader does not accept is dropped, so that it delays no other reader. Replies have priorities
that no stream has, so a stream never waits behind a reply.

A hub admits one link per session id, and an id is public: after an interruption another process may
have taken its place, and Zenoh dials with the same id for ever. What was declared is therefore kept
and declared again on a fresh session, whose id nobody knows yet.

Zenoh 1.10 also gives up an attempt to dial that takes too long, as on a busy machine, when the link
is registered but not read yet. Such a link is reported and sends its signs of life, so it lasts for
ever, but nothing arrives. If the other end drops it, the next link joins the same transport, where
nothing is declared again. A session in either state is replaced, too.

`protocol.bus.certificate` is imported only where it is needed: OpenSSL takes 4 MB of memory.
"""

import json
import logging
import os
import re
import socket
import struct
import threading
from collections.abc import Callable, Iterable
from itertools import count
from time import monotonic
from typing import Any, Final, Generic, TypeVar
from weakref import WeakValueDictionary

import zenoh

from protocol.bus.callbacks import zenoh_callback
from protocol.bus.network import Hub, Network, Tls
from protocol.bus.peers import declare_link_events
from protocol.bus.rights import access_control, dialled_access_control, role_mismatch
from protocol.topics import PARAMETERS, STOP_SERVICE, WORLD, Role
from runtime.errors import (
    AccessDeniedError,
    EndpointError,
    EndpointInUseError,
    KeysError,
    NoPeerError,
    PeerHangsError,
    UserError,
)
from runtime.watchdog import load_words, slowdown

ANSWERS: Final = "interactive_low"
LISTS: Final = "background"
"""Priority of long replies: JSON texts and cached events."""

STOPS: Final = "real_time"
WAIT_BEFORE_CLOSE_US: Final = 20_000
"""Time after which a reader that does not accept declarations is disconnected.

Declarations must not be dropped."""

LISTS_BATCHES: Final = 16
"""Batches of 48 KiB in the queue of long replies for one reader: a whole history fits."""


WAIT_BEFORE_DROP_US: Final = 1_000
PATIENT_WAIT_US: Final = 500_000
"""Time after which a sample that a reader does not accept is dropped. The longer one is less than
the time for which a plant in lockstep waits for its robot."""


def congestion(prefix: str, *, patient: bool = False) -> dict[str, object]:
    """Return the congestion settings of a session; the last matching rule applies."""
    lists = [f"{prefix}/*/{service.path}/**" for service in (PARAMETERS, WORLD)]
    return {
        "qos/network": [
            overwritten("answers", ["**"], ANSWERS),
            overwritten("stops", [f"{prefix}/*/{STOP_SERVICE.path}/**"], STOPS),
            overwritten("lists", [*lists, "**/@adv/**"], LISTS),
        ],
        "transport/link/tx/queue/size/background": LISTS_BATCHES,
        "transport/link/tx/queue/congestion_control/block/wait_before_close": WAIT_BEFORE_CLOSE_US,
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": (
            PATIENT_WAIT_US if patient else WAIT_BEFORE_DROP_US
        ),
    }


def overwritten(name: str, keys: list[str], priority: str) -> dict[str, object]:
    """Return a rule for the queries that arrive on these keys, and so for the replies to them."""
    return {
        "id": name,
        "messages": ["query"],
        "flows": ["ingress"],
        "key_exprs": keys,
        "overwrite": {"priority": priority, "congestion_control": "drop"},
    }


def holder(tls: Tls | None, role: Role | None, robot: str) -> str | None:
    """Return the common name of our certificate, None without TLS.

    Raises KeysError for a certificate of another role.
    """
    if tls is None:
        return None
    from protocol.bus.certificate import own_certificate

    name = own_certificate(tls).name
    if why := role_mismatch(name, role, robot):
        raise KeysError(why)
    return name


def peer_refusal(network: Network) -> AccessDeniedError | None:
    """Return why the dialled processes refuse this one; None if they do not."""
    from protocol.bus import certificate

    return certificate.peer_refusal(network)


def tls_settings(network: Network) -> dict[str, object]:
    """Return the TLS and access-control settings of a session; empty without TLS.

    Raises KeysError for unusable files, and for a listener whose certificate others would reject.
    """
    tls = network.tls
    if tls is None:
        return {}
    from protocol.bus.certificate import own_certificate, remedy

    seen = own_certificate(tls)
    if network.listen and seen.trouble:
        raise KeysError(f"{seen.trouble}, so all others would reject it: {remedy(seen)}")
    found: dict[str, object] = {
        "transport/link/protocols": ["tls"],
        "transport/link/tls/root_ca_certificate": tls.ca,
        "transport/link/tls/enable_mtls": True,
        "transport/link/tls/listen_certificate": tls.certificate,
        "transport/link/tls/listen_private_key": tls.key,
        "transport/link/tls/connect_certificate": tls.certificate,
        "transport/link/tls/connect_private_key": tls.key,
        "transport/link/tls/close_link_on_expiration": True,
    }
    if network.listen:
        found["access_control"] = access_control(network)
    elif allowed := dialled_access_control(network, seen.name):
        found["access_control"] = allowed
    return found


THREADS: Final = (
    "(rx: (handover: acc), net: (handover: acc), app: (handover: acc), acc: (worker_threads: 2))"
)
"""Zenoh's threads: one pool for all but sending. By default the thread that waits for the sockets
wakes another one, of its pool for reception, for all that arrives. What a callback puts must leave
while it runs, so sending has a thread of its own. A process has one setting, which its environment
can override."""

RETRY = {"period_init_ms": 100, "period_max_ms": 200, "period_increase_factor": 2}
OPEN_MS = 500  # closing a session waits for a reconnection attempt, at most this long
LARGEST_BYTES = 1 << 23  # of an answer, such as a world; limits the memory for fragments
DIAL_S = 1.0  # while Zenoh dials, Python handles no signal
SLOW_DIAL_S = 2.0
PROBE_S = 0.3  # the system accepts a connection for its process; stretched while it is busy
RESET = struct.pack("ii", 1, 0)  # a probe that ends so never reaches an acceptor behind a door
BOUND_S = 10.0  # for our own admin space; the answer is usually there at once
SOURCE_PLACES = re.compile(r" at /\S+")
UNCONNECTED = "Unable to connect"
BOUND_TO = re.compile(r"bound to (\S+?):? ")


def settings(network: Network, dial_s: float, open_ms: int = OPEN_MS) -> dict[str, object]:
    """Return Zenoh's settings. Endpoints are explicit: no discovery, no waiting for peers."""
    return {
        "mode": network.mode,
        "listen/endpoints": list(network.listen),
        "connect/endpoints": list(network.connect),
        "connect/timeout_ms": max(1, round(dial_s * 1000)),
        "connect/retry": RETRY,  # nested keys that are null by default take only a whole object
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": network.lease_ms,
        "transport/link/tx/keep_alive": 4,
        "transport/unicast/open_timeout": open_ms,
        "transport/link/rx/max_message_size": LARGEST_BYTES,
        "transport/shared_memory/enabled": False,
        "adminspace/enabled": bool(network.listen),  # the only source of a bound port
        **congestion(network.prefix, patient=network.patient),
        **tls_settings(network),
    }


def open_session(network: Network) -> zenoh.Session:
    """Open a session.

    Raises EndpointInUseError, NoPeerError, PeerHangsError, AccessDeniedError, EndpointError or
    KeysError. Dials in short turns, because Python handles a signal only between them. While this
    machine is busy, a process that listens but has not answered in time is dialled longer.
    """
    os.environ.setdefault("ZENOH_RUNTIME", THREADS)
    deadline_s, busiest = monotonic() + network.connect_timeout_s, slowdown()
    while True:
        try:
            return zenoh.open(configured(network, min(DIAL_S, deadline_s - monotonic())))
        except zenoh.ZError as error:
            busiest = max(busiest, slowdown())
            text = SOURCE_PLACES.sub("", str(error))
            if UNCONNECTED not in text:
                raise error_of(network, text) from error
            if monotonic() >= deadline_s:
                if is_silent(network):
                    return open_slowly(network, busiest)
                raise error_of(network, text) from error


def is_silent(network: Network) -> bool:
    """Return whether a dialled process listens and has not refused."""
    return any(map(listens, network.connect)) and not peer_refusal(network)


def open_slowly(network: Network, busiest: float) -> zenoh.Session:
    """Open a session to a process that listens, but has not answered in the usual time.

    It gets `SLOW_DIAL_S` more for each time that this machine is slower than an idle one, with as
    much time for the handshake.
    """
    turns = round(busiest) - 1
    for _ in range(turns):
        try:
            return zenoh.open(configured(network, SLOW_DIAL_S, round(SLOW_DIAL_S * 1000)))
        except zenoh.ZError as error:
            text = SOURCE_PLACES.sub("", str(error))
            if UNCONNECTED not in text or not is_silent(network):
                raise error_of(network, text) from error
    waited_s = network.connect_timeout_s + turns * SLOW_DIAL_S
    raise PeerHangsError(
        f"a process listens at {', '.join(network.connect)} but does not answer"
        f" (waited {waited_s:g} s{load_words(busiest)}): it is slow, hangs, is suspended"
        " or is another program: try again, restart it, or correct the endpoint"
    )


def redialled(network: Network) -> zenoh.Session:
    """Open another session with a single attempt, a longer one while this machine is busy.

    Raises zenoh.ZError, or UserError for settings.
    """
    dial_s = min(DIAL_S * slowdown(), SLOW_DIAL_S)
    config = configured(network, dial_s, round(dial_s * 1000))
    config.insert_json5("connect/timeout_ms", "0")  # no repetition
    return zenoh.open(config)


def configured(network: Network, dial_s: float, open_ms: int = OPEN_MS) -> zenoh.Config:
    """Return Zenoh's configuration."""
    config = zenoh.Config()
    try:
        for key, value in settings(network, dial_s, open_ms).items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise error_of(network, SOURCE_PLACES.sub("", str(error))) from error
    return config


def error_of(network: Network, text: str) -> UserError:
    """Return an error with its cause and remedy."""
    found = BOUND_TO.search(text)
    here = found[1] if found else ", ".join(network.listen)
    there = ", ".join(network.connect)
    if "Address already in use" in text:
        return EndpointInUseError(
            f"{here} is in use: stop the process that listens there, or choose another endpoint"
        )
    if UNCONNECTED in text:
        return unconnected(there, network)
    if "listener" in text or "port value" in text or "lookup address" in text:
        return EndpointError(f"cannot listen at {here}: {text}")
    return UserError(f"cannot open the bus at {here or there}: {text}")


def unconnected(there: str, network: Network) -> NoPeerError:
    """Return why there is no connection: refused, no such name, or no process."""
    if refusal := peer_refusal(network):
        return refusal
    if host := unknown_host(network.connect):
        return NoPeerError(f"the name {host} of {there} does not resolve: correct the endpoint")
    return NoPeerError(
        f"no process answers at {there} (waited {network.connect_timeout_s:g} s): "
        "start the process that listens there, or correct the endpoint"
    )


def unknown_host(endpoints: Iterable[str]) -> str:
    """Return the host if no endpoint has one that resolves, else an empty text."""
    host = ""
    for endpoint in endpoints:
        protocol, _, address = endpoint.partition("/")
        host, _, _ = host_and_port(address)
        if protocol == "unixsock-stream":
            return ""
        try:
            socket.getaddrinfo(host, None)
        except (OSError, UnicodeError):
            continue
        return ""
    return host


def host_and_port(address: str) -> tuple[str, str, str]:
    """Split the address of an endpoint; the host is without brackets."""
    host, colon, port = address.partition("#")[0].partition("?")[0].rpartition(":")
    return host.strip("[]"), colon, port


def listens(endpoint: str) -> bool:
    """Return whether the system accepts a TCP connection there, even for a process that hangs."""
    return probed(endpoint) is Hub.HANGS


def probed(endpoint: str) -> Hub:
    """Return the result of a TCP connection; endpoints of other protocols count as ended."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = host_and_port(address)
    if protocol not in ("tcp", "tls"):
        return Hub.ENDED
    try:
        with socket.create_connection((host, int(port)), timeout=PROBE_S * slowdown()) as one:
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
            return Hub.HANGS
    except ConnectionError:
        return Hub.ENDED
    except OSError:
        return Hub.UNREACHABLE


def loss_text(hub: Hub, there: str) -> str:
    """Return what happened to the processes at the endpoints; empty while there is a link."""
    if hub is Hub.HANGS:
        return (
            f"the process at {there} accepts connections but no longer answers: it is slow or hangs"
        )
    if hub is Hub.UNREACHABLE:
        return f"no reply from {there}: the network in between is cut"
    return "" if hub.linked else f"the process at {there} has ended"


def bound_endpoints(session: zenoh.Session) -> tuple[str, ...]:
    """Return the endpoints on which a session listens.

    Only its admin space contains the real port behind a 0.
    """
    for reply in session.get(f"@/{session.zid()}/*", timeout=BOUND_S):
        if reply.ok is not None:
            found = json.loads(reply.ok.payload.to_bytes()).get("locators")
            if found:
                return tuple(found)
    return ()


LOG = logging.getLogger(__name__)
T = TypeVar("T")
SILENT_S: Final = 1.0
"""Time for which a process accepts connections, and no link, before a fresh session is opened."""

KEEPER_SILENT_S: Final = 5.0
"""The same for robot and plant: a fresh session has none of the events that the old one cached."""

STEADY_S: Final = 0.5
"""Time for which a link must last until it counts: a hub may accept it and end it at once."""

POLL_S: Final = 0.1
LINK_PROBE_S: Final = 0.5
"""Between two attempts to connect without TLS; the hub may pay for each with a pause of 100 ms."""

LONGEST_S: Final = 8.0
"""Longest pause between two attempts that fail; each doubles the one before."""

NOBODY: Final = "@nobody"
"""A key that no process serves: the answer to a query on it is empty, and comes from the hub."""

CLOSING_S: Final = 2.0
"""Time for an attempt under way to end when the session is closed."""


class Declared(Generic[T]):
    """What was declared on a session, and is declared again on the next one. It ends when dropped.

    `now` is the one on the present session.
    """

    def __init__(self, declare: Callable[[zenoh.Session], T], session: zenoh.Session) -> None:
        self.declare = declare
        self.now = declare(session)


class Links:
    """What the events of a session say about its links, in whatever order they come.

    `broken`: a link has joined the transport of another one, or the other end does not answer.
    """

    def __init__(self) -> None:
        self.broken = False
        self._begun: set[str] = set()
        self._since_s: dict[str, float] = {}

    @property
    def since_s(self) -> float | None:
        """Since when there is a link on which data may be sent, by `monotonic`; None without."""
        return max(tuple(self._since_s.values()), default=None)

    def begin(self, event: zenoh.TransportEvent) -> None:
        """Note the beginning of a transport, which precedes its first link."""
        if event.kind == zenoh.SampleKind.PUT:
            self._begun.add(str(event.transport.zid))
            self.broken = False

    def change(self, event: zenoh.LinkEvent) -> None:
        """Note the beginning or the end of a link."""
        zid = str(event.link.zid)
        if event.kind != zenoh.SampleKind.PUT:
            self._since_s.pop(zid, None)
        elif zid in self._begun:
            self._begun.discard(zid)
            self._since_s[zid] = monotonic()
        else:
            self.broken = True


class LastingSession:
    """A Zenoh session that can be replaced; `now` is the present one.

    `open_fresh` opens another session with a single attempt; it returns None if no process accepts
    it. `accepts` returns whether a dialled process accepts a TCP connection; if it is given, the
    session is replaced when its link does not come back for `silent_s`, longer while this machine
    is busy, or comes back broken. No thread runs before the first loss.
    """

    def __init__(
        self,
        session: zenoh.Session,
        open_fresh: Callable[[], zenoh.Session | None],
        accepts: Callable[[], bool] | None,
        silent_s: float = SILENT_S,
    ) -> None:
        self.now = session
        self._silent_s = silent_s
        self._open_fresh = open_fresh
        self._accepts = accepts or (lambda: False)
        self._all: WeakValueDictionary[int, Declared[Any]] = WeakValueDictionary()
        self._numbers = count()
        self._declaring = threading.RLock()
        self._replacing = threading.Lock()
        self._lost = threading.Event()
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        self._links = Links()
        self._following = None if accepts is None else self.declare(self._declare_links)

    def declare(self, declare: Callable[[zenoh.Session], T]) -> Declared[T]:
        """Declare something on this session and on each that replaces it, in the same order."""
        with self._declaring:
            one = Declared(declare, self.now)
            self._all[next(self._numbers)] = one
            return one

    def undeclare(self, one: Declared[Any]) -> None:
        """End what was declared."""
        with self._declaring:
            for number, other in tuple(self._all.items()):
                if other is one:
                    del self._all[number]
        one.now.undeclare()

    def close(self) -> None:
        """Close the session."""
        self._closed.set()
        self._lost.set()
        with self._declaring:
            close_session(self.now)
        if self._thread is not None:
            self._thread.join(timeout=CLOSING_S)

    def replace(self, before: zenoh.Session, *, if_lost: bool = False) -> bool:
        """Open a fresh session in place of `before`; return whether a process has accepted it.

        `if_lost`: keep the session if it is linked again, and steadily.
        """
        with self._replacing:
            if self.now is not before:
                return True
            fresh = self._open_fresh()
            if fresh is None:
                return False
            kept = if_lost and self._is_steady(before)
            with self._declaring:
                if self._closed.is_set() or kept:
                    close_session(fresh)
                    return False
                self.now = fresh
                for one in tuple(self._all.values()):
                    one.now = one.declare(fresh)
            close_session(before)
        return True

    def _is_steady(self, session: zenoh.Session) -> bool:
        """Return whether a session is linked again, and its link is not ended at once."""
        steady_s = monotonic() + STEADY_S
        while is_linked(session) and not self._links.broken:
            if monotonic() >= steady_s:
                return True
            self._closed.wait(POLL_S)
        return False

    def _declare_links(self, session: zenoh.Session) -> Any:
        """Follow the links of a session."""
        links = self._links = Links()

        def changed(event: zenoh.LinkEvent) -> None:
            links.change(event)
            if session is self.now and (links.broken or event.kind != zenoh.SampleKind.PUT):
                self._lost.set()
                if self._thread is None and not self._closed.is_set():
                    thread = threading.Thread(target=self._run, name="links", daemon=True)
                    thread.start()  # first: `close` joins what it finds
                    self._thread = thread

        return (
            session.info.declare_transport_events_listener(
                zenoh_callback(links.begin), history=True
            ),
            declare_link_events(session, changed),
        )

    def _run(self) -> None:
        while not self._closed.is_set():
            self._lost.wait()
            self._lost.clear()
            try:
                self._await_link()
            except Exception:  # the next loss needs this thread again
                LOG.exception("a session could not be replaced")

    def _patience_s(self) -> float:
        return self._silent_s * slowdown()

    def _await_link(self) -> None:
        """Return when a link lasts; replace the session while it is kept out."""
        silent_s = probe_s = monotonic()
        pause_s = self._patience_s()
        while not self._closed.wait(POLL_S):
            session, links, now_s = self.now, self._links, monotonic()
            since_s = links.since_s if is_linked(session) else None
            if since_s is not None and not links.broken:
                if now_s - since_s < STEADY_S:
                    continue
                links.broken = not answers(session, SILENT_S * slowdown())
                if links.since_s == since_s and not links.broken:
                    return
            if now_s < probe_s:
                continue
            if not self._accepts():
                silent_s, pause_s = monotonic(), self._patience_s()
            elif now_s - silent_s >= pause_s:
                self.replace(session, if_lost=True)
                silent_s, pause_s = monotonic(), min(2 * pause_s, LONGEST_S)
            probe_s = monotonic() + LINK_PROBE_S


def is_linked(session: zenoh.Session) -> bool:
    """Return whether a session has a link."""
    try:
        return bool(list(session.info.links()))
    except zenoh.ZError:  # it was closed
        return False


def answers(session: zenoh.Session, within_s: float) -> bool:
    """Return whether the process at the other end of the link answers."""
    try:
        late: list[zenoh.Reply] = list(session.get(NOBODY, timeout=within_s))
    except zenoh.ZError:  # it was closed
        return False
    return not late


def close_session(session: Any) -> None:
    """Close a session. This may take as long as one attempt to dial."""
    session.close()
