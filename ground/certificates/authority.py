"""Makes certificates; `cryptography` does all of the cryptography."""

from collections.abc import Iterable
from datetime import datetime
from ipaddress import ip_address
from typing import Final, NamedTuple, Self

from cryptography import x509
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

AUTHORITY: Final = "sidestep"
LONGEST: Final = 24
"""Of an authority's name, in characters."""

DIALS: Final = (ExtendedKeyUsageOID.CLIENT_AUTH,)
LISTENS: Final = (ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH)


class Pair(NamedTuple):
    """A certificate and its secret key, both as PEM."""

    certificate: bytes
    key: bytes

    def __repr__(self) -> str:
        return "Pair(...)"


class Authority:
    """Signs certificates. Unless it is kept, by `pair`, its key ends with the process."""

    def __init__(self, since: datetime, until: datetime) -> None:
        self._times = (since, until)
        self._key = generate_private_key(SECP256R1())
        # Each has a name of its own, so that a stranger's is told from a forgery.
        self._name = named(f"{AUTHORITY} {x509.random_serial_number():040x}"[:LONGEST])
        public = self._key.public_key()
        usage = key_usage(signs_certificates=True)
        self._certificate = (
            self._begun(self._name, public, self._times)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(usage, critical=True)
            .sign(self._key, SHA256())
        )

    @classmethod
    def kept(cls, pair: Pair) -> Self:
        """The authority whose certificate and key were kept; ValueError for what is none."""
        certificate = x509.load_pem_x509_certificate(pair.certificate)
        key = load_pem_private_key(pair.key, password=None)
        if not isinstance(key, EllipticCurvePrivateKey):
            raise ValueError("the key of the authority is of another kind")
        if key.public_key() != certificate.public_key():
            raise ValueError("the key is not that of the authority")
        found = cls.__new__(cls)
        found._times = (certificate.not_valid_before_utc, certificate.not_valid_after_utc)
        found._key, found._name, found._certificate = key, certificate.subject, certificate
        return found

    @property
    def pair(self) -> Pair:
        """Return the private key of the authority as PEM. It can certify every role."""
        return Pair(self.pem, secret(self._key))

    @property
    def until(self) -> datetime:
        """When all that it has signed ends at the latest."""
        return self._times[1]

    @property
    def pem(self) -> bytes:
        """What the others believe."""
        return self._certificate.public_bytes(Encoding.PEM)

    def certify(
        self, name: str, hosts: Iterable[str] = (), times: tuple[datetime, datetime] | None = None
    ) -> Pair:
        """A key and a certificate for it; with `hosts` its holder may be dialled, at these.

        Valid at the given times (since, until), or as long as the authority itself.
        """
        key = generate_private_key(SECP256R1())
        names = [alternative(host) for host in hosts]
        builder = (
            self._begun(named(name), key.public_key(), times or self._times)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(key_usage(signs_certificates=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(LISTENS if names else DIALS), critical=False)
        )
        if names:
            builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        certificate = builder.sign(self._key, SHA256())
        return Pair(certificate.public_bytes(Encoding.PEM), secret(key))

    def _begun(
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
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def alternative(host: str) -> x509.GeneralName:
    """An address as an address, anything else as a host name."""
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def hosts_in(pem: bytes) -> list[str]:
    """The host names and addresses that a certificate is for."""
    try:
        names = x509.load_pem_x509_certificate(pem).extensions.get_extension_for_class(
            x509.SubjectAlternativeName
        )
    except x509.ExtensionNotFound:
        return []
    return [str(name.value) for name in names.value]


def key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
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
    return key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())
