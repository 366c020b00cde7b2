"""Read the frames of an MCAP file that may be truncated or damaged anywhere.

Whole records are found by their own lengths, so the size of the loss is known. A frame lies in its
channel as it was on the bus. Its key follows from message and sender, as in a `.tlog`; where it
does not, the key precedes the frame in a separate channel. Older recordings hold key and frame in
one JSON text.
"""

import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, Final

import msgspec
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Metadata

from ground.recording.frame_paths import path_in
from protocol.topics import ENCODING_FAMILY, PREFIX
from protocol.wire.codec import HEADER_SIZE
from runtime.files import opened

RAW_TOPIC: Final = "/mavlink"
KEY_TOPIC: Final = "/mavlink/key"
KEYS: Final = "keys"
"""Metadata key of a channel; its value is the common prefix of the frames' keys."""
MAGIC: Final = b"\x89MCAP0\r\n"
FACT: Final = "json"
RECORD: Final = struct.Struct("<BQ")
MESSAGE: Final = struct.Struct("<HIQQ")
LARGEST_RECORD: Final = 1 << 30
UNREADABLE: Final = (
    *(McapError, zstandard.ZstdError, struct.error),
    *(ValueError, OverflowError, RuntimeError, MemoryError),
)
MAX_UNPACKED: Final = 1 << 24
MAX_RATIO: Final = 200
"""Largest ratio of unpacked to packed size; own chunks unpack to ten times their size."""
SLACK: Final = 1 << 16
FIRST_CHUNKS: Final = 2
LAST_CHUNKS: Final = 3


class Raw(msgspec.Struct, frozen=True, gc=False):
    """A frame as it was on the bus; older recordings hold its bytes in base64."""

    key: str
    frame: bytes


class FrameKey(msgspec.Struct, frozen=True, gc=False):
    """The key of the frame that follows."""

    key: str


RAW_IN: Final = msgspec.json.Decoder(Raw)
KEY_IN: Final = msgspec.json.Decoder(FrameKey)


class McapFile:
    """Reads a file once from front to back; `facts` grow while reading."""

    def __init__(self, path: Path) -> None:
        self.facts: dict[str, str] = {}
        self.lost_bytes = 0
        self.share = 0.0
        self._path = path
        self._channels: dict[int, Channel] = {}
        self._key = ""
        self._places = 0
        self._closed = False

    def frames(self) -> Iterator[tuple[int, Raw]]:
        """Yield the time of arrival in ns and the frame, in order."""
        with opened(self._path) as source:
            size = self._path.stat().st_size
            if source.read(len(MAGIC)) != MAGIC:
                self._count_loss(size)
                return
            for opcode, content in self._records(source, size):
                self.share = source.tell() / size
                if opcode == Opcode.CHUNK:
                    yield from self._chunk(content)
                elif opcode == Opcode.METADATA:
                    self._fact(content)
                elif opcode == Opcode.DATA_END:
                    self._closed = True
                    return

    def read_facts(self) -> dict[str, str]:
        """Return the facts and skip everything else."""
        for content in self._metadata():
            self._fact(content)
        return self.facts

    def robot_in_header(self) -> str:
        """Return the robot's name in the header of the file, or an empty text."""
        for content in self._metadata():
            with suppress(*UNREADABLE, KeyError):
                return str(Metadata.read(ReadDataStream(BytesIO(content))).metadata["robot"])
        return ""

    def last_frames(self) -> Iterator[bytes]:
        """Yield the frames of the last chunks, and skip everything else."""
        with opened(self._path) as source:
            places = [place for opcode, *place in self._places_in(source) if opcode == Opcode.CHUNK]
            # The first chunks hold the channels, without which the last ones cannot be read.
            begin, end = places[:FIRST_CHUNKS], places[FIRST_CHUNKS:][-LAST_CHUNKS:]
            for at, length in [*begin, *end]:
                source.seek(at)
                for _, raw in self._chunk(source.read(length)):
                    yield raw.frame

    def _metadata(self) -> Iterator[bytes]:
        with opened(self._path) as source:
            for opcode, at, length in self._places_in(source):
                if opcode == Opcode.METADATA:
                    source.seek(at)
                    yield source.read(length)

    def _places_in(self, source: BinaryIO) -> Iterator[tuple[int, int, int]]:
        """Yield opcode, position and length of the content of each whole record."""
        size = self._path.stat().st_size
        if source.read(len(MAGIC)) != MAGIC:
            return
        while len(head := source.read(RECORD.size)) == RECORD.size:
            opcode, length = RECORD.unpack(head)
            at = source.tell()
            if opcode == Opcode.DATA_END or length > size - at:
                return
            yield opcode, at, length
            source.seek(at + length)

    def _records(self, source: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and content of each whole record."""
        while head := source.read(RECORD.size):
            left = size - source.tell()
            if len(head) < RECORD.size:
                self._count_loss(len(head))
                return
            opcode, length = RECORD.unpack(head)
            if length > min(left, LARGEST_RECORD):
                self._count_loss(len(head) + left)
                return
            yield opcode, source.read(length)

    def _chunk(self, content: bytes) -> Iterator[tuple[int, Raw]]:
        """Yield the frames of a chunk; skip the whole chunk when it is damaged."""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(content)))
            found = list(self._messages(unpacked(chunk)))
        except UNREADABLE:
            self._count_loss(RECORD.size + len(content))
            return
        yield from found

    def _messages(self, data: bytes) -> Iterator[tuple[int, Raw]]:
        at = 0
        while at < len(data):
            opcode, length = RECORD.unpack_from(data, at)
            at += RECORD.size
            if opcode == Opcode.MESSAGE:
                number, _, time_ns, _ = MESSAGE.unpack_from(data, at)
                if channel := self._channels.get(number):
                    raw = self._raw(channel, data[at + MESSAGE.size : at + length])
                    if raw is not None:
                        yield time_ns, raw
            elif opcode == Opcode.CHANNEL:
                made = Channel.read(ReadDataStream(BytesIO(data[at : at + length])))
                if made.topic in {RAW_TOPIC, KEY_TOPIC}:
                    self._channels[made.id] = made
            at += length

    def _raw(self, channel: Channel, body: bytes) -> Raw | None:
        """Return the frame in a message, or None for the key of the next frame."""
        if channel.topic == KEY_TOPIC:
            self._key = KEY_IN.decode(body).key
            return None
        if not channel.message_encoding.startswith(ENCODING_FAMILY):
            return RAW_IN.decode(body)
        if len(body) < HEADER_SIZE:
            raise ValueError(f"{len(body)} bytes are too few for a frame")
        key, self._key = self._key, ""
        return Raw(key or f"{channel.metadata.get(KEYS, PREFIX)}/{path_in(body)}", body)

    def _fact(self, content: bytes) -> None:
        try:
            fact = Metadata.read(ReadDataStream(BytesIO(content)))
        except UNREADABLE:
            self._count_loss(RECORD.size + len(content))
            return
        if FACT in fact.metadata:
            self.facts[fact.name] = fact.metadata[FACT]

    def _count_loss(self, size: int) -> None:
        self.lost_bytes += size
        self._places += 1
        self._key = ""

    def damage(self) -> str:
        """Return what was lost, in words; a file that was not closed may lack its last frames."""
        if self.lost_bytes:
            places = "one place" if self._places == 1 else f"{self._places} places"
            return f"{self.lost_bytes} bytes in {places} belong to no whole chunk and were skipped"
        if not self._closed:
            return "it was not closed: the last half second may be missing"
        return ""


def unpacked(chunk: Chunk) -> bytes:
    """Return the content of a chunk; McapError, ZstdError or ValueError if damaged."""
    limit = min(MAX_UNPACKED, MAX_RATIO * len(chunk.data) + SLACK)
    if chunk.compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(chunk.data) as reader:
            data = reader.read(limit + 1)
    elif chunk.compression:
        raise UnsupportedCompressionError(chunk.compression)
    else:
        data = chunk.data
    if len(data) > limit:
        raise ValueError(f"a chunk unpacks to more than {limit} bytes")
    if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        raise ValueError("the checksum of a chunk does not match")
    return data
