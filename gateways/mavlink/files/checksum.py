"""The CRC32 of MAVLink FTP: that of zlib without its two inversions."""

from typing import Final
from zlib import crc32

ALL_ONES: Final = 0xFFFF_FFFF


def checksum(data: bytes, before: int = 0) -> int:
    """Return the checksum of data, continued from the checksum `before` of the data before it."""
    return crc32(data, before ^ ALL_ONES) ^ ALL_ONES
