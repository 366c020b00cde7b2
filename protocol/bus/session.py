"""Open a Zenoh session with the settings of this project; explain why it could not be opened.

Zenoh's own log is not initialised here: it can only write to standard output, which is reserved for
`--json` and the terminal interface.
"""

import json
import re
import socket
import struct
from collections.abc import Iterable
from time import monotonic

import zenoh

from protocol.bus.congestion import congestion
from protocol.bus.network import Hub, Network
from protocol.bus.tls.certificate_advice import peer_refusal
from protocol.bus.tls.config import tls_settings
from runtime.errors import (
    EndpointError,
    EndpointInUseError,
    NoPeerError,
    PeerHangsError,
    UserError,
)
from runtime.load import load_words, slowdown

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
    deadline_s, busiest = monotonic() + network.connect_timeout_s, slowdown()
    while True:
        try:
            return zenoh.open(configured(network, min(DIAL_S, deadline_s - monotonic())))
        except zenoh.ZError as error:
            busiest = max(busiest, slowdown())
            text = SOURCE_PLACES.sub("", str(error))
            if UNCONNECTED not in text:
                raise in_words(network, text) from error
            if monotonic() >= deadline_s:
                if is_silent(network):
                    return open_slowly(network, busiest)
                raise in_words(network, text) from error


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
                raise in_words(network, text) from error
    waited_s = network.connect_timeout_s + turns * SLOW_DIAL_S
    raise PeerHangsError(
        f"a process listens at {', '.join(network.connect)} but does not answer"
        f" (waited {waited_s:g} s{load_words(busiest)}): it is slow, hangs, is suspended"
        " or is another program: try again, restart it, or correct the endpoint"
    )


def redialled(network: Network) -> zenoh.Session:
    """Open another session with a single attempt; raise zenoh.ZError, or UserError for settings."""
    config = configured(network, DIAL_S, round(DIAL_S * 1000))
    config.insert_json5("connect/timeout_ms", "0")  # no repetition
    return zenoh.open(config)


def configured(network: Network, dial_s: float, open_ms: int = OPEN_MS) -> zenoh.Config:
    """Return Zenoh's configuration."""
    config = zenoh.Config()
    try:
        for key, value in settings(network, dial_s, open_ms).items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise in_words(network, SOURCE_PLACES.sub("", str(error))) from error
    return config


def in_words(network: Network, text: str) -> UserError:
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
