"""The content of a chunk of an MCAP file, and no more of it than any recording of ours has.

What a chunk says of its size is somebody's word: a kilobyte that unpacks to gigabytes is no log.
"""

import zlib
from typing import Final

import zstandard
from mcap.exceptions import UnsupportedCompressionError
from mcap.records import Chunk

LARGEST: Final = 1 << 24
MOST_DENSE: Final = 200
"""Times its size. Our own chunks unpack to ten times theirs."""

SLACK: Final = 1 << 16


def unpacked(chunk: Chunk) -> bytes:
    """Raises McapError, ZstdError or ValueError for what cannot be had, or is no log."""
    most = min(LARGEST, MOST_DENSE * len(chunk.data) + SLACK)
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
            data = reader.read(most + 1)
    elif chunk.compression:
        raise UnsupportedCompressionError(chunk.compression)
    else:
        data = chunk.data
    if len(data) > most:
        raise ValueError(f"a chunk unpacks to more than {most} bytes")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk does not match")
    return data
