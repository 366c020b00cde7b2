"""Creates certificates; the library `cryptography` does all of the cryptography."""

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
