"""Checks each certificate of a folder: its role, its expiry and its faults."""

from collections.abc import Iterator
from datetime import datetime
from pathlib import Path
from typing import NamedTuple

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.serialization import load_pem_private_key
from cryptography.x509.oid import NameOID

from ground.certificates.folder import CA, MAX_BYTES
from protocol.bus.certificate import EXPIRES_SOON, OPEN_TO_OTHERS, RENEW
from protocol.bus.rights import grant_of
from runtime.errors import UserError
from runtime.files import bytes_in


class Checked(NamedTuple):
    """One certificate: holder, expiry, rights, and its faults (none: valid)."""

    name: str
    file: str
    until: datetime
    description: str
    wrong: tuple[str, ...]
    soon: bool

    def line(self) -> str:
        """Return one line, and one more for each fault."""
        end = f"{self.until:%Y-%m-%d %H:%M} UTC"
        about = f"{self.name:<24} until {end}  {self.description}"
        return "\n".join((about, *(f"  E {problem}" for problem in self.wrong)))


def check(folder: Path, now: datetime) -> list[Checked]:
    """Check all certificates, the authority first; UserError names an unreadable file."""
    if not (folder / CA).is_file():
        raise UserError(f"{folder} has no {CA}: name a folder created by `sidestep keys new`")
    authority = read(folder / CA)
    first = checked(folder / CA, authority, now, "signs the others", ())
    others = sorted(path for path in folder.glob("*.pem") if path.name != CA)
    return [first, *(check_one(path, authority, now) for path in others)]


def check_one(path: Path, authority: x509.Certificate, now: datetime) -> Checked:
    """Check the certificate of one role."""
    certificate = read(path)
    name = common_name(certificate)
    grant = grant_of(name)
    wrong = [] if grant else [f"there is no role {name!r}, so this certificate has no rights"]
    try:
        certificate.verify_directly_issued_by(authority)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm):
        wrong.append(f"is not signed by {CA}, so it is rejected: create new certificates")
    wrong += key_faults(path.with_suffix(".key"), certificate)
    return checked(path, certificate, now, grant.description if grant else "", tuple(wrong))


def checked(
    path: Path,
    certificate: x509.Certificate,
    now: datetime,
    description: str,
    wrong: tuple[str, ...],
) -> Checked:
    """Return a certificate with its faults and its expiry."""
    until = certificate.not_valid_after_utc
    wrong += tuple(times(certificate, now))
    soon = now <= until < now + EXPIRES_SOON
    return Checked(common_name(certificate), path.name, until, description, wrong, soon)


def times(certificate: x509.Certificate, now: datetime) -> Iterator[str]:
    """Yield the fault of a certificate that is not valid now."""
    since, until = certificate.not_valid_before_utc, certificate.not_valid_after_utc
    if now > until:
        yield f"expired at {until:%Y-%m-%d %H:%M} UTC: {RENEW}"
    if now < since:
        yield f"is not valid before {since:%Y-%m-%d %H:%M} UTC: check this machine's clock"


def key_faults(path: Path, certificate: x509.Certificate) -> Iterator[str]:
    """Yield the faults of a certificate's key, without its content."""
    try:
        mode = path.stat().st_mode
        key = load_pem_private_key(bytes_in(path, MAX_BYTES), password=None)
    except OSError as error:
        yield f"{path.name}: {error.strerror}"
        return
    except (ValueError, TypeError, UnsupportedAlgorithm):
        yield f"{path.name} is not a PEM key without password"
        return
    if key.public_key() != certificate.public_key():
        yield f"{path.name} is the key of another certificate"
    if mode & OPEN_TO_OTHERS:
        yield f"{path.name} can be read by others: chmod 600 {path.name}"


def read(path: Path) -> x509.Certificate:
    """Load a certificate; parse all fields that are needed later, because parsing is lazy."""
    try:
        found = x509.load_pem_x509_certificate(bytes_in(path, MAX_BYTES))
        found.public_key(), found.subject, found.not_valid_before_utc, found.not_valid_after_utc
        return found
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    except (ValueError, UnsupportedAlgorithm, x509.InvalidVersion) as error:
        raise UserError(f"{path} is not a certificate in PEM") from error


def common_name(certificate: x509.Certificate) -> str:
    """Return the common name of the holder."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else "(no name)"
