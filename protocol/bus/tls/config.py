"""Mutual TLS and access control as Zenoh takes them, and why a door did not open."""

import json
import socket
import ssl
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import zenoh

from protocol.bus.network import LOCKED, Network, Tls
from protocol.bus.tls.certificate import CertificateStatus, context, own
from protocol.bus.tls.rules import access_control, dialled_access_control
from runtime.errors import BadKeys, NotLetIn

KNOCK_S: Final = 1.5
MAKE_NEW: Final = "make a new set with `sidestep keys new`, or use the one of that authority"
EXPIRED_THERE: Final = (9, 10)
WRONG_NAME: Final = (62, 64)
"""OpenSSL's verify codes: times; host name, address."""

NO_TLS: Final = (TimeoutError, ssl.SSLEOFError, ConnectionResetError)
"""What comes of a greeting where nobody speaks TLS: Zenoh in plain TCP waits for the rest of a
short one, and hangs up on a long one, as OpenSSL 3.5 sends it."""

PLAIN: Final = "tcp/"
PLAINLY: Final[Mapping[str, object]] = MappingProxyType(
    {
        "mode": "client",
        "connect/timeout_ms": round(KNOCK_S * 1000),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
    }
)


def lock(network: Network) -> dict[str, object]:
    """Return the TLS and access-control settings of a locked session.

    Raises BadKeys for files of no use, and for a listener that nobody would believe.
    """
    tls = network.tls
    if tls is None:
        return {}
    seen = own(tls)
    if network.listen and seen.trouble:
        raise BadKeys(f"{seen.trouble}, so nobody would believe it: {MAKE_NEW}")
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


def shut(network: Network) -> NotLetIn | None:
    """Why none of those dialled lets this process in; None when that is not what is wrong."""
    whys = (why for endpoint in network.connect if (why := why_shut(endpoint, network.tls)))
    return next(whys, None)


def why_shut(endpoint: str, tls: Tls | None) -> NotLetIn | None:
    """Knock as anybody could who is no part of Zenoh: it tells nothing of a failed handshake."""
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.partition("#")[0].partition("?")[0].rpartition(":")
    place = (host.strip("[]"), int(port) if port.isdecimal() else 0)
    if tls is None:
        return locked_there(endpoint, place) if f"{protocol}/" == PLAIN else None
    try:
        knock(place, context(ssl.PROTOCOL_TLS_CLIENT, tls))
    except ssl.SSLCertVerificationError as error:
        return not_believed(endpoint, place[0], tls, error)
    except NO_TLS:
        return open_there(endpoint, f"{PLAIN}{address}")
    except ssl.SSLError as error:
        return refused(endpoint, tls, error)
    except OSError:
        return None
    return None


def knock(place: tuple[str, int], shown: ssl.SSLContext) -> None:
    """A handshake, and a moment for what comes after it: TLS 1.3 refuses a certificate late."""
    with (
        socket.create_connection(place, timeout=KNOCK_S) as call,
        shown.wrap_socket(call, server_hostname=place[0]) as talk,
    ):
        try:
            talk.recv(1)
        except TimeoutError:
            return


def locked_there(endpoint: str, place: tuple[str, int]) -> NotLetIn | None:
    """Plain TCP against TLS: does the other side answer a TLS greeting?"""
    greeting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    greeting.check_hostname, greeting.verify_mode = False, ssl.CERT_NONE
    try:
        knock(place, greeting)
    except ssl.SSLEOFError:
        return None
    except ssl.SSLError:
        pass  # it has refused in TLS, so it speaks it
    except OSError:
        return None
    return NotLetIn(
        f"the process at {endpoint} takes only TLS, and this one dials it in plain TCP",
        f"use --config DIR/ground.toml of `sidestep keys new DIR`, and {LOCKED}HOST:PORT",
    )


def open_there(endpoint: str, plain: str) -> NotLetIn | None:
    """TLS against plain TCP: does the other side talk when it is dialled like that?"""
    asking = zenoh.Config()
    for key, value in {**PLAINLY, "connect/endpoints": [plain]}.items():
        asking.insert_json5(key, json.dumps(value))
    try:
        with zenoh.open(asking):
            pass
    except zenoh.ZError:
        return None
    return NotLetIn(
        f"the process at {endpoint} speaks plain TCP, and this one only TLS",
        f"give that process [network.tls], too, or dial {plain} without",
    )


def not_believed(
    endpoint: str, host: str, tls: Tls, error: ssl.SSLCertVerificationError
) -> NotLetIn:
    """We do not believe the certificate that we are shown."""
    there = f"the process at {endpoint} shows a certificate that"
    if error.verify_code in EXPIRED_THERE:
        words = "has expired" if error.verify_code == EXPIRED_THERE[1] else "is not valid yet"
        return NotLetIn(f"{there} {words}", f"compare the clocks; else {MAKE_NEW}")
    if error.verify_code in WRONG_NAME:
        do = (
            f"dial a name it has, or make a new set with `sidestep keys new DIR --host {host}` "
            f"(of one robot among several: --host ROBOT={host})"
        )
        return NotLetIn(f"{there} is not for {host}", do)
    return NotLetIn(f"{there} is signed by another authority than {tls.ca}", MAKE_NEW)


def refused(endpoint: str, tls: Tls, error: ssl.SSLError) -> NotLetIn | None:
    """The other side does not believe ours."""
    reason = error.reason or ""
    if "ALERT" not in reason:
        return None
    seen = own(tls)
    why = f"the process at {endpoint} does not let us in: {complaint(seen, tls, reason)}"
    return NotLetIn(why, MAKE_NEW)


def complaint(seen: CertificateStatus, tls: Tls, reason: str) -> str:
    """What is wrong with our certificate, as far as we can see ourselves."""
    if seen.trouble:
        return seen.trouble
    if "EXPIRED" in reason:
        return f"it takes {tls.certificate} to be expired or not yet valid; compare the clocks"
    if "UNKNOWN_CA" in reason or "DECRYPT_ERROR" in reason:
        return f"{tls.certificate} is signed by another authority than the one it believes"
    return f"it does not accept {tls.certificate} ({reason.lower().replace('_', ' ')})"
