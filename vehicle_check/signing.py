"""Signatures of MAVLink 2 frames, made here and not by pymavlink, so that tests can forge them."""

import re
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Final

from fastcrc.crc16 import mcrf4xx

from runtime.errors import UserError
from runtime.files import bytes_in

KEY_LENGTH: Final = 32
HEXADECIMAL: Final = re.compile("[0-9a-fA-F]{64}")
MAX_PASSPHRASE: Final = 200
MAX_BYTES: Final = 4096
EPOCH_S: Final = 1_420_070_400
"""2015-01-01, from which the time stamps of signatures count units of 10 us."""
UNITS_PER_S: Final = 100_000


class Signer:
    """Signs the frames of one link. `timestamp` grows with each frame, and follows a clock.

    A vehicle refuses new links whose time stamps are more than a minute behind.
    """

    def __init__(
        self, key: bytes, link: int, timestamp: int, clock: Callable[[], int] = lambda: 0
    ) -> None:
        self.key = key
        self.link = link
        self.timestamp = timestamp
        self._clock = clock

    def signed(self, frame: bytes) -> bytes:
        """Return a MAVLink 2 frame with a signature."""
        crc_extra = _crc_extra(frame)
        flagged = bytearray(frame)
        flagged[2] |= 1
        flagged[-2:] = mcrf4xx(bytes(flagged[1:-2]) + bytes([crc_extra])).to_bytes(2, "little")
        self.timestamp = max(self.timestamp + 1, self._clock())
        head = bytes(flagged) + bytes([self.link]) + self.timestamp.to_bytes(6, "little")
        return head + sha256(self.key + head).digest()[:6]


_CRC_EXTRA: Final[dict[bytes, int]] = {}
"""The byte of the layout by message id."""


def _crc_extra(frame: bytes) -> int:
    """Return the byte of the layout with which a frame's checksum was made."""
    number = bytes(frame[7:10])
    if number not in _CRC_EXTRA:
        checksum, body = int.from_bytes(frame[-2:], "little"), bytes(frame[1:-2])
        found = (one for one in range(256) if mcrf4xx(body + bytes([one])) == checksum)
        _CRC_EXTRA[number] = next(found)
    return _CRC_EXTRA[number]


def is_signed_with(frame: bytes, key: bytes) -> bool:
    """Return True if the signature at the end of a frame was made with this key."""
    return sha256(key + frame[:-6]).digest()[:6] == frame[-6:]


def timestamp_at(unix_s: float) -> int:
    """Return the time stamp of a signature."""
    return round((unix_s - EPOCH_S) * UNITS_PER_S)


def read_key(path: Path) -> bytes:
    """Read a key: 32 raw bytes, 64 hexadecimal digits, or a passphrase.

    The key of a passphrase is its SHA-256, as in MAVProxy, Mission Planner and QGroundControl.
    UserError if the file holds none of them.
    """
    try:
        data = bytes_in(path, MAX_BYTES)
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}: name a file with a key") from error
    if len(data) == KEY_LENGTH:
        return data
    try:
        text = data.decode("utf-8").strip()
    except UnicodeDecodeError:
        text = ""
    if HEXADECIMAL.fullmatch(text):
        return bytes.fromhex(text)
    if not text or len(text) > MAX_PASSPHRASE or "\n" in text:
        words = "32 bytes, 64 hexadecimal digits, or one line with a passphrase"
        raise UserError(f"{path}: a signing key is {words}")
    return sha256(text.encode()).digest()
