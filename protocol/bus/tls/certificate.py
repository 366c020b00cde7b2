"""This process's own certificate, as other processes see it."""

import ssl
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from protocol.bus.network import Tls
from protocol.bus.tls.role_grants import role_mismatch
from protocol.topics import Role
from runtime.errors import KeysError
from runtime.regular_file import bytes_in

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


def holder(tls: Tls | None, role: Role | None, robot: str) -> str | None:
    """Return the common name of our certificate, None without TLS.

    Raises KeysError for a certificate of another role.
    """
    name = own_certificate(tls).name if tls else None
    if why := role_mismatch(name, role, robot):
        raise KeysError(why)
    return name


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
