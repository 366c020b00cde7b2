"""The frames in an MCAP file that may have been cut off, or damaged, anywhere.

Whole records are found by their own lengths, so that it is known how much could not be used. A
frame lies in its channel as it was on the bus. Its key follows from message and sender, as in a
`.tlog`; where it does not, it stands in a channel of its own, just before the frame. Recordings
made earlier have key and frame in one JSON text.
"""

import os
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

RAW_TOPIC: Final = "/mavlink"
KEY_TOPIC: Final = "/mavlink/key"
KEYS: Final = "keys"
"""What the keys of a channel of frames begin with, in its metadata."""
MAGIC: Final = b"\x89MCAP0\r\n"
FACT: Final = "json"
RECORD: Final = struct.Struct("<BQ")
MESSAGE: Final = struct.Struct("<HIQQ")
LARGEST_RECORD: Final = 1 << 30
UNREADABLE: Final = (
    *(McapError, zstandard.ZstdError, struct.error),
    *(ValueError, OverflowError, RuntimeError, MemoryError),
)
LARGEST: Final = 1 << 24
MOST_DENSE: Final = 200
"""Times its size. Our own chunks unpack to ten times theirs."""
SLACK: Final = 1 << 16


class Raw(msgspec.Struct, frozen=True, gc=False):
    """A frame as it was on the bus; in the JSON of earlier recordings its bytes are base64."""

    key: str
    frame: bytes


class Key(msgspec.Struct, frozen=True, gc=False):
    """The key of the frame that follows."""

    key: str


RAW_IN: Final = msgspec.json.Decoder(Raw)
KEY_IN: Final = msgspec.json.Decoder(Key)


class McapFile:
    """Reads a file once, front to back; `facts` grow as they are met."""

    def __init__(self, path: Path) -> None:
        self.facts: dict[str, str] = {}
        self.lost_bytes = 0
        self._path = path
        self._channels: dict[int, Channel] = {}
        self._key = ""
        self._places = 0
        self._closed = False

    def __iter__(self) -> Iterator[tuple[int, Raw]]:
        with self._path.open("rb") as source:
            size = self._path.stat().st_size
            if source.read(len(MAGIC)) != MAGIC:
                self._lose(size)
                return
            for opcode, content in self._records(source, size):
                if opcode == Opcode.CHUNK:
                    yield from self._chunk(content)
                elif opcode == Opcode.METADATA:
                    self._fact(content)
                elif opcode == Opcode.DATA_END:
                    self._closed = True
                    return

    def facts_alone(self) -> dict[str, str]:
        """Only the facts: what lies between them is skipped, not read."""
        for content in self._metadata():
            self._fact(content)
        return self.facts

    def robot(self) -> str:
        """The name of the robot in the head of the file; empty when there is none."""
        for content in self._metadata():
            with suppress(*UNREADABLE, KeyError):
                return str(Metadata.read(ReadDataStream(BytesIO(content))).metadata["robot"])
        return ""

    def _metadata(self) -> Iterator[bytes]:
        with self._path.open("rb") as source:
            size = self._path.stat().st_size
            if source.read(len(MAGIC)) != MAGIC:
                return
            while len(head := source.read(RECORD.size)) == RECORD.size:
                opcode, length = RECORD.unpack(head)
                if opcode == Opcode.DATA_END or length > size - source.tell():
                    return
                if opcode == Opcode.METADATA:
                    yield source.read(length)
                else:
                    source.seek(length, os.SEEK_CUR)

    def _records(self, source: BinaryIO, size: int) -> Iterator[tuple[int, bytes]]:
        """Opcode and content of each whole record."""
        while head := source.read(RECORD.size):
            left = size - source.tell()
            if len(head) < RECORD.size:
                self._lose(len(head))
                return
            opcode, length = RECORD.unpack(head)
            if length > min(left, LARGEST_RECORD):
                self._lose(len(head) + left)
                return
            yield opcode, source.read(length)

    def _chunk(self, content: bytes) -> Iterator[tuple[int, Raw]]:
        """All or nothing: a chunk whose checksum does not match is left out."""
        try:
            chunk = Chunk.read(ReadDataStream(BytesIO(content)))
            found = list(self._messages(unpacked(chunk)))
        except UNREADABLE:
            self._lose(RECORD.size + len(content))
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
        """The frame in a message; None for the key of the next one."""
        if channel.topic == KEY_TOPIC:
            self._key = KEY_IN.decode(body).key
            return None
        if not channel.message_encoding.startswith(ENCODING_FAMILY):
            return RAW_IN.decode(body)
        if len(body) < HEADER_SIZE:
            raise ValueError(f"{len(body)} bytes are no frame")
        key, self._key = self._key, ""
        return Raw(key or f"{channel.metadata.get(KEYS, PREFIX)}/{path_in(body)}", body)

    def _fact(self, content: bytes) -> None:
        try:
            fact = Metadata.read(ReadDataStream(BytesIO(content)))
        except UNREADABLE:
            self._lose(RECORD.size + len(content))
            return
        if FACT in fact.metadata:
            self.facts[fact.name] = fact.metadata[FACT]

    def _lose(self, size: int) -> None:
        self.lost_bytes += size
        self._places += 1
        self._key = ""

    def damage(self) -> str:
        """What was lost, in words; a file that was never closed may have lost its very end."""
        if self.lost_bytes:
            places = "one place" if self._places == 1 else f"{self._places} places"
            return f"{self.lost_bytes} bytes in {places} belong to no whole chunk and were left out"
        if not self._closed:
            return "it was not closed: the last half second may be missing"
        return ""


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
