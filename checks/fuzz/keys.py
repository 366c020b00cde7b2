"""Certificates and keys for access control, and the files of MAVLink's signing."""

from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final

from checks.fuzz.target import FuzzTarget
from gateways.mavlink.signing import StampClock
from ground.certificates.folder import SECRET_MODE, check, make
from ground.user.mavlink_keys import KeyRing, new_key, read_keys, write_keys
from protocol.bus.certificate import own_certificate
from protocol.bus.network import Tls

SINCE: Final = datetime(2026, 1, 1, tzinfo=UTC)
NOW: Final = SINCE + timedelta(days=10)
UNTIL: Final = SINCE + timedelta(days=10_000)
NAME: Final = "robot-r1"
WORDS: Final = (b"-----BEGIN CERTIFICATE-----\n", b"-----END CERTIFICATE-----\n", b"\n", b"=")


@cache
def good() -> dict[str, bytes]:
    """Return the files of a complete set, by name."""
    with TemporaryDirectory() as parent:
        folder = Path(parent) / "keys"
        make(folder, ["r1"], {}, SINCE, UNTIL)
        return {path.name: path.read_bytes() for path in folder.iterdir()}


def check_among_good(ending: str, data: bytes, folder: Path) -> None:
    """Check a set in which one file has other content."""
    for name, content in good().items():
        if name == "ca.pem" or name.startswith(NAME):
            (folder / name).write_bytes(content)
    (folder / f"{NAME}{ending}").write_bytes(data)
    (folder / f"{NAME}.key").chmod(SECRET_MODE)
    check(folder, NOW)
    ca, certificate, key = (folder / one for one in ("ca.pem", f"{NAME}.pem", f"{NAME}.key"))
    own_certificate(Tls(ca=str(ca), certificate=str(certificate), key=str(key)))


def signing_keys() -> list[bytes]:
    """Return the files of one key and of two."""
    found = []
    with TemporaryDirectory() as folder:
        path = Path(folder) / "keys.toml"
        for number in (1, 2):
            write_keys(path, KeyRing(key=tuple(new_key() for _ in range(number))))
            found.append(path.read_bytes())
    return found


def read_signing_keys(data: bytes, folder: Path) -> None:
    """Read a file of signing keys."""
    path = folder / "signing.toml"
    path.write_bytes(data)
    path.chmod(SECRET_MODE)
    read_keys(path)


def read_stamp(data: bytes, folder: Path) -> None:
    """Read the newest time stamp of a signature, and give the next one."""
    path = folder / "stamp"
    path.write_bytes(data)
    StampClock(lambda: 1, path).next().to_bytes(6, "little")


KEYS: Final = (
    FuzzTarget(name="signing_keys", samples=signing_keys, run=read_signing_keys, weight=8),
    FuzzTarget(name="signing_stamp", samples=lambda: [b"123456789\n"], run=read_stamp, weight=4),
    FuzzTarget(
        name="certificate",
        samples=lambda: [good()[f"{NAME}.pem"]],
        run=lambda data, folder: check_among_good(".pem", data, folder),
        words=WORDS,
        weight=8,
    ),
    FuzzTarget(
        name="private_key",
        samples=lambda: [good()[f"{NAME}.key"]],
        run=lambda data, folder: check_among_good(".key", data, folder),
        words=WORDS,
        weight=8,
    ),
)
