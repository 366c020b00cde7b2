"""Our own certificate, as those see it to whom we show it."""

import ssl
from contextlib import suppress
from pathlib import Path
from typing import Any, Final, NamedTuple

from protocol.bus.network import Tls
from protocol.bus.tls.access import misfit
from protocol.topics import Role
from runtime.errors import BadKeys

ROUNDS: Final = 4
WHENEVER: Final = 0x200000
"""OpenSSL's X509_V_FLAG_NO_CHECK_TIME, for which Python's `ssl` has no name."""

NOT_YET_VALID: Final = 9
EXPIRED: Final = 10
OPEN_TO_OTHERS: Final = 0o077
"""Permissions that a private key must not grant to group or others."""

CN: Final = "commonName"
NO_PASSWORD: Final = ""
"""Said at once where a key has one: OpenSSL would ask at the terminal."""


class CertificateStatus(NamedTuple):
    """Whose certificate it is, until when, and why others refuse it: empty when they do not."""

    name: str
    until_s: float | None = None
    """Seconds since 1970; None where it cannot be told."""

    trouble: str = ""


def own(tls: Tls) -> CertificateStatus:
    """Show our certificate to ourselves. BadKeys names a file that is of no use."""
    check_files(tls)
    try:
        return own_in(shown(tls))
    except ssl.SSLCertVerificationError as error:
        code, why = error.verify_code, error.verify_message
    except ssl.SSLError as error:
        raise of_no_use(tls, error) from error
    if code not in (NOT_YET_VALID, EXPIRED):
        return CertificateStatus("", trouble=f"{tls.certificate} is not signed by {tls.ca} ({why})")
    seen = shown(tls, WHENEVER)
    when = f"is not valid before {seen['notBefore']}"
    if code == EXPIRED:
        when = f"expired at {seen['notAfter']}"
    return own_in(seen)._replace(trouble=f"{tls.certificate} {when}")


def holder(tls: Tls | None, role: Role | None, robot: str) -> str | None:
    """The common name of our certificate, None without one; BadKeys when it is not for us."""
    name = own(tls).name if tls else None
    if why := misfit(name, role, robot):
        raise BadKeys(why)
    return name


def check_files(tls: Tls) -> None:
    """Raise BadKeys, with file and key of the configuration, unless all three can be used."""
    for name in ("ca", "certificate", "key"):
        path = getattr(tls, name)
        try:
            Path(path).open("rb").close()
        except OSError as error:
            raise BadKeys(
                f"network.tls.{name}: {path}: {error.strerror}: check the path"
            ) from error
    if Path(tls.key).stat().st_mode & OPEN_TO_OTHERS:
        raise BadKeys(
            f"network.tls.key: {tls.key} can be read by others, who may be this process with it: "
            f"chmod 600 {tls.key}, and make a new set if somebody has read it"
        )
    try:
        context(ssl.PROTOCOL_TLS_CLIENT, tls)
    except ssl.SSLError as error:
        raise of_no_use(tls, error) from error


def of_no_use(tls: Tls, error: ssl.SSLError) -> BadKeys:
    return BadKeys(
        f"network.tls: {tls.ca}, {tls.certificate} and {tls.key} are of no use together "
        f"({error.reason or error}): are they PEM, and of one set? `sidestep keys check` tells"
    )


def context(side: int, tls: Tls) -> ssl.SSLContext:
    """With our certificate, and the authority that we believe."""
    made = ssl.SSLContext(side)
    made.load_cert_chain(tls.certificate, tls.key, password=NO_PASSWORD)
    made.load_verify_locations(tls.ca)
    made.minimum_version = ssl.TLSVersion.TLSv1_2
    return made


def shown(tls: Tls, flags: int = 0) -> dict[str, Any]:
    """What a listener that believes our authority sees of us; raises SSLCertVerificationError."""
    listener, caller = (
        context(ssl.PROTOCOL_TLS_SERVER, tls),
        context(ssl.PROTOCOL_TLS_CLIENT, tls),
    )
    listener.verify_mode = ssl.CERT_REQUIRED
    listener.verify_flags |= ssl.VerifyFlags(flags)
    caller.check_hostname, caller.verify_mode = False, ssl.CERT_NONE
    there, back = ssl.MemoryBIO(), ssl.MemoryBIO()
    door = listener.wrap_bio(there, back, server_side=True)
    knock = caller.wrap_bio(back, there)
    for _ in range(ROUNDS):
        for end in (knock, door):
            with suppress(ssl.SSLWantReadError):
                end.do_handshake()
    return door.getpeercert() or {}


def own_in(seen: dict[str, Any]) -> CertificateStatus:
    """Name and end of a certificate as `ssl` tells it."""
    names = (value for part in seen.get("subject", ()) for key, value in part if key == CN)
    until = seen.get("notAfter")
    return CertificateStatus(
        next(names, ""), None if until is None else ssl.cert_time_to_seconds(until)
    )
