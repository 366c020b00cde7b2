"""The file of the signing keys: one that signs, and during a rotation an older one that verifies.

The file must be readable by its owner only. A key is the SHA-256 of a passphrase, as in MAVProxy,
Mission Planner and QGroundControl; a key that a client has set has no passphrase.
"""

import os
import secrets
import stat
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Final

import msgspec

from ground.user.folders import PRIVATE_FILE, config_folder
from runtime.config import load
from runtime.errors import UserError
from runtime.files import make_folder, replace

KEY_BYTES: Final = 32
MAX_KEYS: Final = 2
PASSPHRASE_BYTES: Final = 15
SHARED_BITS: Final = 0o077
NO_KEY: Final = bytes(KEY_BYTES)
"""The key by which SETUP_SIGNING ends signing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SigningKey:
    """A key as hexadecimal digits. Its text form does not contain the secret."""

    secret: Annotated[str, msgspec.Meta(pattern="^[0-9a-f]{64}$")]
    passphrase: str = ""

    @property
    def raw(self) -> bytes:
        """The 32 bytes."""
        return bytes.fromhex(self.secret)

    @property
    def name(self) -> str:
        """A short name, from which the secret cannot be found."""
        return sha256(b"sidestep key name" + self.raw).hexdigest()[:8]

    def __repr__(self) -> str:
        return f"SigningKey({self.name})"


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyRing:
    """The valid keys; the first one signs."""

    key: tuple[SigningKey, ...] = ()


def usual_file() -> Path:
    """Return the default path of the keys."""
    return config_folder() / "mavlink-keys.toml"


def new_key() -> SigningKey:
    """Return a random key with its passphrase."""
    passphrase = secrets.token_urlsafe(PASSPHRASE_BYTES)
    return SigningKey(secret=sha256(passphrase.encode()).hexdigest(), passphrase=passphrase)


def read_keys(path: Path) -> KeyRing:
    """Return the keys of a file, none if it does not exist; UserError if others may read it."""
    try:
        mode = stat.S_IMODE(path.stat().st_mode)
    except FileNotFoundError:
        return KeyRing()
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    if not path.is_file():
        raise UserError(f"{path} is not a file: name a file for the keys")
    if mode & SHARED_BITS:
        raise UserError(f"{path}: other users may read the keys: chmod 600 {path}")
    ring = load(path, KeyRing)
    if len(ring.key) > MAX_KEYS:
        raise UserError(f"{path}: at most {MAX_KEYS} keys are valid: remove the oldest")
    return ring


def write_keys(path: Path, ring: KeyRing) -> None:
    """Replace the keys of a file; no other user may read it at any time."""
    rows = []
    for key in ring.key:
        rows += ["[[key]]", f'secret = "{key.secret}"', f'passphrase = "{key.passphrase}"', ""]
    before = os.umask(SHARED_BITS)
    try:
        make_folder(path.parent)
        replace(path, "\n".join(["# Signing keys of MAVLink; the first one signs.", *rows]))
        path.chmod(PRIVATE_FILE)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}") from error
    finally:
        os.umask(before)
