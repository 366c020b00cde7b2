"""Write and check the folder of `keys new`: a certificate, key and configuration for each role.

The library `cryptography` does all of the cryptography.

Operators and robots also have a file of secrets for the stop datagram. The check names the role,
the expiry and the faults of each certificate.
"""

import os
import re
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from datetime import datetime
from ipaddress import ip_address
from pathlib import Path
from typing import Final, NamedTuple, Self

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives.asymmetric.ec import (
    SECP256R1,
    EllipticCurvePrivateKey,
    EllipticCurvePublicKey,
    generate_private_key,
)
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from ground.client.connection import Config
from ground.user.folders import PRIVATE_FILE, PRIVATE_FOLDER
from protocol.bus.certificate import EXPIRES_SOON, OPEN_TO_OTHERS, RENEW
from protocol.bus.network import Network
from protocol.bus.rights import GATEWAY, GROUND, OPERATOR, RECORDER, ROBOT, VIEWER, grant_of
from protocol.stop_datagram import SECRET_BYTES, SECRETS, role_of
from runtime.config import load_shared
from runtime.errors import UserError
from runtime.files import bytes_in, replace

AUTHORITY: Final = "sidestep"
MAX_NAME: Final = 24
"""Limit of an authority's name, in characters."""

CLIENT_USAGES: Final = (ExtendedKeyUsageOID.CLIENT_AUTH,)
SERVER_USAGES: Final = (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH)


class Pair(NamedTuple):
    """A certificate and its private key, both as PEM."""

    certificate: bytes
    key: bytes

    def __repr__(self) -> str:
        return "Pair(...)"


class Authority:
    """Signs certificates. Unless it is kept as a `pair`, its key ends with the process."""

    def __init__(self, since: datetime, until: datetime) -> None:
        self._times = (since, until)
        self._key = generate_private_key(SECP256R1())
        # A unique name distinguishes certificates of other authorities from forged ones.
        self._name = named(f"{AUTHORITY} {x509.random_serial_number():040x}"[:MAX_NAME])
        public = self._key.public_key()
        usage = key_usage(signs_certificates=True)
        self._certificate = (
            self._builder(self._name, public, self._times)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .sign(self._key, SHA256())
        )

    @classmethod
    def kept(cls, pair: Pair) -> Self:
        """Load an authority from its certificate and key; ValueError if they do not fit."""
        certificate = x509.load_pem_x509_certificate(pair.certificate)
        key = load_pem_private_key(pair.key, password=None)
        if not isinstance(key, EllipticCurvePrivateKey):
            raise ValueError("the key of the authority is not an elliptic-curve key")
        if key.public_key() != certificate.public_key():
            raise ValueError("the key does not belong to the authority's certificate")
        found = cls.__new__(cls)
        found._times = (certificate.not_valid_before_utc, certificate.not_valid_after_utc)
        found._key, found._name, found._certificate = key, certificate.subject, certificate
        return found

    @property
    def pair(self) -> Pair:
        """The certificate and the private key of the authority, which can certify every role."""
        return Pair(self.pem, secret(self._key))

    @property
    def until(self) -> datetime:
        """The expiry of the authority, which limits all its certificates."""
        return self._times[1]

    @property
    def pem(self) -> bytes:
        """The certificate that other processes trust."""
        return self._certificate.public_bytes(Encoding.PEM)

    def certify(
        self, name: str, hosts: Iterable[str] = (), times: tuple[datetime, datetime] | None = None
    ) -> Pair:
        """Create a key and a certificate; with `hosts` its holder may listen, at these.

        Valid at the given times (since, until), or as long as the authority itself.
        """
        key = generate_private_key(SECP256R1())
        names = [alternative(host) for host in hosts]
        builder = (
            self._builder(named(name), key.public_key(), times or self._times)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(key_usage(signs_certificates=False), critical=True)
            .add_extension(
                x509.ExtendedKeyUsage(SERVER_USAGES if names else CLIENT_USAGES), critical=False
            )
        )
        if names:
            builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        certificate = builder.sign(self._key, SHA256())
        return Pair(certificate.public_bytes(Encoding.PEM), secret(key))

    def _builder(
        self, name: x509.Name, key: EllipticCurvePublicKey, times: tuple[datetime, datetime]
    ) -> x509.CertificateBuilder:
        ours = self._key.public_key()
        since, until = times
        return (
            x509.CertificateBuilder()
            .subject_name(name)
            .issuer_name(self._name)
            .public_key(key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(since)
            .not_valid_after(until)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(ours), critical=False)
        )


def named(name: str) -> x509.Name:
    """Return a subject with this common name."""
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def alternative(host: str) -> x509.GeneralName:
    """Return an address or a host name as a subject alternative name."""
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def hosts_in(pem: bytes) -> list[str]:
    """Return the host names and addresses in a certificate."""
    try:
        names = x509.load_pem_x509_certificate(pem).extensions.get_extension_for_class(
            x509.SubjectAlternativeName
        )
    except x509.ExtensionNotFound:
        return []
    return [str(name.value) for name in names.value]


def key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    """Return the key usage of an authority, or of a role."""
    return x509.KeyUsage(
        digital_signature=not signs_certificates,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def secret(key: EllipticCurvePrivateKey) -> bytes:
    """Return the private key as PEM, without a password."""
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())


CA: Final = "ca.pem"
CA_KEY: Final = "authority.key"
MAX_BYTES: Final = 1 << 20
"""The key of the authority can certify every role. Do not copy it to a machine of the stack."""

THIS_MACHINE: Final = ("localhost", "127.0.0.1", "::1")
REVOKED: Final = re.compile(r"^revoked = \[.*\]$", re.MULTILINE)
PUBLIC_MODE: Final = 0o644
STOPS_HEAD: Final = """\
# Created by `sidestep keys`: secrets of the stop datagram, which can stop a robot and nothing else.
"""
CONFIG: Final = """\
# Created by `sidestep keys new`: identity of a process and the authority it trusts, for --config.
robot = "{robot}"

[network]
robots = [{robots}]
operators = [{operators}]
revoked = []

[network.tls]
ca = "{ca}"
certificate = "{role}.pem"
key = "{role}.key"
"""


def make(
    folder: Path,
    robots: Sequence[str],
    hosts: Mapping[str, Sequence[str]],
    since: datetime,
    until: datetime,
    operators: Sequence[str] = (),
    authority_until: datetime | None = None,
) -> list[str]:
    """Create all files; return the roles that have a certificate now.

    Overwrites nothing: UserError names the file that exists. `hosts` are more names and addresses
    of roles that others connect to. With `authority_until` the authority is valid that long, and
    its key is kept for `renew`.
    """
    prepare(folder)
    authority = Authority(since, authority_until or until)
    written: list[Path] = []
    try:
        create_file(folder / CA, authority.pem, PUBLIC_MODE, written)
        if authority_until is not None:
            create_file(folder / CA_KEY, authority.pair.key, PRIVATE_FILE, written)
        for role, robot, dialled in roles_of(robots, operators):
            names = (*dialled_at(role), *hosts.get(role, ())) if dialled else ()
            pair = authority.certify(role, names, (since, until))
            create_file(folder / f"{role}.pem", pair.certificate, PUBLIC_MODE, written)
            create_file(folder / f"{role}.key", pair.key, PRIVATE_FILE, written)
            text = configuration(role, robot, robots, operators)
            create_file(folder / f"{role}.toml", text.encode(), PUBLIC_MODE, written)
        write_stop_secrets(folder, robots, [GROUND, GATEWAY, *operators], written)
    except OSError as error:
        for path in written:  # an incomplete set is useless and would block the next attempt
            path.unlink(missing_ok=True)
        raise UserError(f"{folder}: {error.strerror}: all new files were removed") from error
    return [role for role, _, _ in roles_of(robots, operators)]


def write_stop_secrets(
    folder: Path, robots: Sequence[str], operators: Sequence[str], written: list[Path]
) -> None:
    """Create a secret for each operator and robot, in the files of both."""
    held: dict[str, dict[str, str]] = {}
    for operator in operators:
        for robot in robots:
            secret = secrets.token_bytes(SECRET_BYTES).hex()
            held.setdefault(role_of(operator), {})[robot] = secret
            held.setdefault(ROBOT + robot, {})[operator] = secret
    for role, of in held.items():
        lines = (f'{name} = "{secret}"\n' for name, secret in of.items())
        text = f"{STOPS_HEAD}[secrets]\n{''.join(lines)}"
        create_file(folder / f"{role}{SECRETS}", text.encode(), PRIVATE_FILE, written)


def add_stop_secrets(folder: Path) -> list[str]:
    """Add stop secrets to a folder without them; return the roles that have some now.

    Raises UserError for a folder without certificates, or with stop secrets.
    """
    names = [path.stem for path in sorted(folder.glob("*.pem"))]
    robots = [name.removeprefix(ROBOT) for name in names if name.startswith(ROBOT)]
    operators = [name.removeprefix(OPERATOR) for name in names if name.startswith(OPERATOR)]
    operators = [name for name in (GROUND, GATEWAY) if name in names] + operators
    if not (robots and operators and CA.removesuffix(".pem") in names):
        raise UserError(f"{folder} has no {CA}, robot and operator: name a folder of `keys new`")
    if (there := next(iter(sorted(folder.glob(f"*{SECRETS}"))), None)) is not None:
        raise UserError(
            f"{folder} has stop secrets already ({there.name}): to make new ones, remove"
            f" its files *{SECRETS} first"
        )
    written: list[Path] = []
    try:
        write_stop_secrets(folder, robots, operators, written)
    except OSError as error:
        for path in written:
            path.unlink(missing_ok=True)
        raise UserError(f"{folder}: {error.strerror}") from error
    return [path.stem for path in written]


def dialled_at(role: str) -> tuple[str, ...]:
    """Return where a role can be reached: on this machine, or at a host of its name."""
    return (*THIS_MACHINE, role)


def roles_of(robots: Sequence[str], operators: Sequence[str]) -> Iterator[tuple[str, str, bool]]:
    """Yield each role, its robots as in a configuration, and whether others connect to it."""
    yield "router", robots[0], True
    yield "plant", ",".join(robots), False
    yield "ground", robots[0], False
    for operator in operators:
        yield f"{OPERATOR}{operator}", robots[0], False
    yield VIEWER, robots[0], False
    yield RECORDER, robots[0], False
    yield GATEWAY, robots[0], False
    for robot in robots:
        yield f"robot-{robot}", robot, True


def configuration(role: str, robot: str, robots: Sequence[str], operators: Sequence[str]) -> str:
    """Return the TOML file of a role; its paths are relative, so that the folder can be moved."""
    return CONFIG.format(
        role=role, robot=robot, robots=listed(robots), operators=listed(operators), ca=CA
    )


def renew(folder: Path, names: Sequence[str], since: datetime, until: datetime) -> datetime:
    """Give roles a new certificate and key with the same host names; return the expiry.

    The authority's expiry is the limit. Raises UserError if its key was not kept or is not usable.
    """
    try:
        pair = Pair(bytes_in(folder / CA, MAX_BYTES), bytes_in(folder / CA_KEY, MAX_BYTES))
        authority = Authority.kept(pair)
    except OSError as error:
        raise UserError(
            f"{folder / CA_KEY}: {error.strerror}: only certificates of `keys new "
            "--keep-authority` can be renewed; create new ones"
        ) from error
    except (ValueError, TypeError) as error:
        raise UserError(f"{folder / CA_KEY}: {error}") from error
    until = min(until, authority.until)
    before = {name: dialled_names(folder, name) for name in names}
    for name, hosts in before.items():
        made = authority.certify(name, hosts, (since, until))
        replace_file(folder / f"{name}.key", made.key, PRIVATE_FILE)
        replace_file(folder / f"{name}.pem", made.certificate, PUBLIC_MODE)
    return until


def dialled_names(folder: Path, name: str) -> list[str]:
    """Return the host names in a role's certificate; none if others do not connect to it."""
    path = folder / f"{name}.pem"
    if not path.is_file() or name == CA.removesuffix(".pem"):
        raise UserError(f"{folder} has no certificate {name}.pem: name one that it has")
    return hosts_in(bytes_in(path, MAX_BYTES))


def replace_file(path: Path, content: bytes, mode: int) -> None:
    """Replace a file atomically; the permissions are never wider than `mode`."""
    draft = path.with_name(f".{path.name}.part")
    draft.unlink(missing_ok=True)
    create_file(draft, content, mode, [])
    draft.replace(path)


def revoke(folder: Path, names: Sequence[str]) -> list[str]:
    """Add names to the revoked ones in every configuration of a folder; return all of them.

    Raises UserError for an unknown certificate or a file that cannot be changed.
    """
    for name in names:
        if not (folder / f"{name}.pem").is_file():
            raise UserError(f"{folder} has no certificate {name}.pem: name one that it has")
    found: list[str] = []
    for path in sorted(folder.glob("*.toml")):
        before = load_shared(path, Config).network or Network()
        found = list(dict.fromkeys((*before.revoked, *names)))
        text, count = REVOKED.subn(f"revoked = [{listed(found)}]", path.read_text())
        if count != 1:
            raise UserError(f"{path}: the line `revoked = []` is missing: create new certificates")
        try:
            replace(path, text)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}") from error
    return found


def listed(names: Sequence[str]) -> str:
    """Return names as the items of a TOML array."""
    return ", ".join(f'"{name}"' for name in names)


def prepare(folder: Path) -> None:
    """Create an empty private folder; UserError if it exists and is not empty."""
    try:
        folder.mkdir(mode=PRIVATE_FOLDER, parents=True, exist_ok=True)
        there = next(iter(sorted(folder.iterdir())), None)
        if there is None:
            folder.chmod(PRIVATE_FOLDER)
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}: name a folder that can be created") from error
    if there is not None:
        raise UserError(
            f"{folder} is not empty (it has {there.name}), and no file is overwritten: "
            "name a new folder, or move the old one"
        )


def create_file(path: Path, content: bytes, mode: int, written: list[Path]) -> None:
    """Create a file whose permissions are never wider than `mode`."""
    number = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
    written.append(path)
    with open(number, "wb") as file:
        file.write(content)


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
