"""This process's own certificate, and why a peer and this process reject each other."""

import json
import socket
import ssl
from collections.abc import Mapping
from contextlib import suppress
from datetime import timedelta
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import zenoh

from protocol.bus.network import LOCKED, Network, Tls
from runtime.errors import AccessDeniedError, KeysError
from runtime.files import bytes_in

ROUNDS: Final = 4
MAX_BYTES: Final = 1 << 20
NO_TIME_CHECK: Final = 0x200000
"""OpenSSL's X509_V_FLAG_NO_CHECK_TIME, for which Python's `ssl` has no name."""

NOT_YET_VALID: Final = 9
EXPIRED: Final = 10
OPEN_TO_OTHERS: Final = 0o077
"""Permissions that a private key must not grant to group or others."""

CN: Final = "commonName"
NO_PASSWORD: Final = ""
"""Passed for keys that need a password: without it OpenSSL would prompt at the terminal."""


class CertificateStatus(NamedTuple):
    """Common name, expiry, and why others reject the certificate: empty if they do not.

    `is_early`: they reject it because it is not valid yet.
    """

    name: str
    until_s: float | None = None
    """Expiry in seconds since 1970; None if unknown."""

    trouble: str = ""
    is_early: bool = False


def own_certificate(tls: Tls) -> CertificateStatus:
    """Return the status of our certificate. KeysError names an unusable file."""
    check_files(tls)
    try:
        return status_of(presented(tls))
    except ssl.SSLCertVerificationError as error:
        code, why = error.verify_code, error.verify_message
    except ssl.SSLError as error:
        raise unusable(tls, error) from error
    if code not in (NOT_YET_VALID, EXPIRED):
        return CertificateStatus("", trouble=f"{tls.certificate} is not signed by {tls.ca} ({why})")
    seen = presented(tls, NO_TIME_CHECK)
    when = f"is not valid before {seen['notBefore']}"
    if code == EXPIRED:
        when = f"expired at {seen['notAfter']}"
    trouble = f"{tls.certificate} {when}"
    return status_of(seen)._replace(trouble=trouble, is_early=code == NOT_YET_VALID)


def check_files(tls: Tls) -> None:
    """Raise KeysError, with file and key of the configuration, unless all files are usable."""
    for name in ("ca", "certificate", "key"):
        path = getattr(tls, name)
        try:
            bytes_in(Path(path), MAX_BYTES)
        except OSError as error:
            raise KeysError(
                f"network.tls.{name}: {path}: {error.strerror}: check the path"
            ) from error
    if Path(tls.key).stat().st_mode & OPEN_TO_OTHERS:
        raise KeysError(
            f"network.tls.key: other users can read {tls.key} and impersonate this process: "
            f"chmod 600 {tls.key}, and make a new set if another user has read it"
        )
    try:
        context(ssl.PROTOCOL_TLS_CLIENT, tls)
    except ssl.SSLError as error:
        raise unusable(tls, error) from error


def unusable(tls: Tls, error: ssl.SSLError) -> KeysError:
    """Return the error for three files that do not fit together."""
    return KeysError(
        f"network.tls: {tls.ca}, {tls.certificate} and {tls.key} cannot be used together "
        f"({error.reason or error}): use PEM files of one set; see `sidestep keys check`"
    )


def context(side: int, tls: Tls) -> ssl.SSLContext:
    """Return a TLS context with our certificate and our certificate authority."""
    made = ssl.SSLContext(side)
    made.load_cert_chain(tls.certificate, tls.key, password=NO_PASSWORD)
    made.load_verify_locations(tls.ca)
    made.minimum_version = ssl.TLSVersion.TLSv1_2
    return made


def presented(tls: Tls, flags: int = 0) -> dict[str, Any]:
    """Return our certificate as seen by a listener with the same certificate authority.

    Raises SSLCertVerificationError.
    """
    server, client = (
        context(ssl.PROTOCOL_TLS_SERVER, tls),
        context(ssl.PROTOCOL_TLS_CLIENT, tls),
    )
    server.verify_mode = ssl.CERT_REQUIRED
    server.verify_flags |= ssl.VerifyFlags(flags)
    client.check_hostname, client.verify_mode = False, ssl.CERT_NONE
    to_server, to_client = ssl.MemoryBIO(), ssl.MemoryBIO()
    server_end = server.wrap_bio(to_server, to_client, server_side=True)
    client_end = client.wrap_bio(to_client, to_server)
    for _ in range(ROUNDS):
        for end in (client_end, server_end):
            with suppress(ssl.SSLWantReadError):
                end.do_handshake()
    return server_end.getpeercert() or {}


def status_of(seen: dict[str, Any]) -> CertificateStatus:
    """Return common name and expiry of a certificate in the form of `ssl`."""
    names = (value for part in seen.get("subject", ()) for key, value in part if key == CN)
    until = seen.get("notAfter")
    return CertificateStatus(
        next(names, ""), None if until is None else ssl.cert_time_to_seconds(until)
    )


HANDSHAKE_S: Final = 1.5
MAKE_NEW: Final = "make a new set with `sidestep keys new`, or use the one of that authority"
RENEW: Final = "run `sidestep keys new` again"
"""For a certificate that has expired or expires soon."""
WAIT: Final = "set the clock of this computer, or wait until the certificate is valid"
"""For a certificate that is not valid yet."""
EXPIRES_SOON: Final = timedelta(days=30)
"""Remaining validity below which a certificate is reported."""
EXPIRED_THERE: Final = (9, 10)
WRONG_NAME: Final = (62, 64)
"""OpenSSL's verify codes: times; host name, address."""
NO_TLS: Final = (TimeoutError, ssl.SSLEOFError, ConnectionResetError)
"""Errors of a TLS greeting to a process without TLS. Zenoh in plain TCP waits for the rest of a
short greeting, and closes the connection on a long one, as OpenSSL 3.5 sends it."""
NOT_ZENOH: Final = ("WRONG_VERSION_NUMBER", "HTTP_REQUEST", "PACKET_LENGTH_TOO_LONG")
"""Errors of OpenSSL about words that are no TLS, as those of a web or SSH server are none."""
PLAIN: Final = "tcp/"
PLAIN_CONFIG: Final[Mapping[str, object]] = MappingProxyType(
    {
        "mode": "client",
        "connect/timeout_ms": round(HANDSHAKE_S * 1000),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
    }
)


def remedy(own: CertificateStatus) -> str:
    """Return the remedy for a rejected certificate.

    The name of one that another authority has signed is empty.
    """
    if not own.name:
        return MAKE_NEW
    return WAIT if own.is_early else RENEW


def peer_refusal(network: Network) -> AccessDeniedError | None:
    """Return why the dialled processes refuse this one; None if they do not."""
    whys = (why for endpoint in network.connect if (why := refusal_at(endpoint, network.tls)))
    return next(whys, None)


def refusal_at(endpoint: str, tls: Tls | None) -> AccessDeniedError | None:
    """Return why a process refuses this one, found by a handshake without Zenoh.

    Zenoh does not report the cause of a failed handshake.
    """
    protocol, _, address = endpoint.partition("/")
    host, _, port = address.partition("#")[0].partition("?")[0].rpartition(":")
    place = (host.strip("[]"), int(port) if port.isdecimal() else 0)
    if tls is None:
        return peer_wants_tls(endpoint, place) if f"{protocol}/" == PLAIN else None
    try:
        handshake(place, context(ssl.PROTOCOL_TLS_CLIENT, tls))
    except ssl.SSLCertVerificationError as error:
        return untrusted_peer(endpoint, place[0], tls, error)
    except NO_TLS:
        return peer_wants_plain(endpoint, f"{PLAIN}{address}")
    except ssl.SSLError as error:
        if error.reason in NOT_ZENOH:
            return another_program(endpoint)
        return refused_by_peer(endpoint, tls, error)
    except OSError:
        return None
    return None


def another_program(endpoint: str) -> AccessDeniedError:
    """Return the error for a program that is no part of any stack."""
    return AccessDeniedError(
        f"another program listens at {endpoint}, which speaks neither Zenoh nor TLS",
        "dial another endpoint; `sidestep ps` lists what runs here",
    )


def handshake(place: tuple[str, int], client: ssl.SSLContext) -> None:
    """Do a TLS handshake and wait for a late alert: TLS 1.3 rejects a certificate after it."""
    with (
        socket.create_connection(place, timeout=HANDSHAKE_S) as plain,
        client.wrap_socket(plain, server_hostname=place[0]) as connection,
    ):
        try:
            connection.recv(1)
        except TimeoutError:
            return


def peer_wants_tls(endpoint: str, place: tuple[str, int]) -> AccessDeniedError | None:
    """Return an error if a process that we dial in plain TCP answers a TLS greeting."""
    greeting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    greeting.check_hostname, greeting.verify_mode = False, ssl.CERT_NONE
    try:
        handshake(place, greeting)
    except ssl.SSLEOFError:
        return None
    except ssl.SSLError as error:
        if error.reason in NOT_ZENOH:
            return another_program(endpoint)
        # Else the refusal is a TLS alert, so the peer uses TLS.
    except OSError:
        return None
    return AccessDeniedError(
        f"the process at {endpoint} accepts only TLS, and this one uses plain TCP",
        f"use --config DIR/ground.toml of `sidestep keys new DIR`, and {LOCKED}HOST:PORT",
    )


def peer_wants_plain(endpoint: str, plain: str) -> AccessDeniedError | None:
    """Return an error if a process that we dial by TLS answers in plain TCP."""
    config = zenoh.Config()
    for key, value in {**PLAIN_CONFIG, "connect/endpoints": [plain]}.items():
        config.insert_json5(key, json.dumps(value))
    try:
        with zenoh.open(config):
            pass
    except zenoh.ZError:
        return None
    return AccessDeniedError(
        f"the process at {endpoint} uses plain TCP, and this one accepts only TLS",
        f"give that process [network.tls], too, or dial {plain} without it",
    )


def untrusted_peer(
    endpoint: str, host: str, tls: Tls, error: ssl.SSLCertVerificationError
) -> AccessDeniedError:
    """Return the error for a peer whose certificate we reject."""
    there = f"the process at {endpoint} shows a certificate that"
    if error.verify_code in EXPIRED_THERE:
        words = "has expired" if error.verify_code == EXPIRED_THERE[1] else "is not valid yet"
        return AccessDeniedError(f"{there} {words}", f"compare the clocks; else {MAKE_NEW}")
    if error.verify_code in WRONG_NAME:
        do = (
            f"dial a name it has, or make a new set with `sidestep keys new DIR --host {host}` "
            f"(of one robot among several: --host ROBOT={host})"
        )
        return AccessDeniedError(f"{there} is not for {host}", do)
    return AccessDeniedError(f"{there} is signed by another authority than {tls.ca}", MAKE_NEW)


def refused_by_peer(endpoint: str, tls: Tls, error: ssl.SSLError) -> AccessDeniedError | None:
    """Return the error for a peer that rejects our certificate; None for other TLS errors."""
    reason = error.reason or ""
    if "ALERT" not in reason:
        return None
    seen = own_certificate(tls)
    why = f"the process at {endpoint} rejects this one: {complaint(seen, tls, reason)}"
    return AccessDeniedError(why, remedy(seen) if seen.trouble else MAKE_NEW)


def complaint(seen: CertificateStatus, tls: Tls, reason: str) -> str:
    """Return why a peer rejects our certificate, from its own check and the TLS error."""
    if seen.trouble:
        return seen.trouble
    if "EXPIRED" in reason:
        return f"for its clock {tls.certificate} is expired or not yet valid; compare the clocks"
    if "UNKNOWN_CA" in reason or "DECRYPT_ERROR" in reason:
        return f"{tls.certificate} is signed by another authority than the one it trusts"
    return f"it does not accept {tls.certificate} ({reason.lower().replace('_', ' ')})"
