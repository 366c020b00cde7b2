"""Write frames to an MCAP file, and read one that may be truncated or damaged anywhere.

A frame becomes a raw message, the message as JSON, and drawings for Foxglove and Lichtblick; live
viewers get the same. Replay and re-execution need the raw frames only.

Whole records are found by their own lengths, so the size of the loss is known. A frame lies in its
channel as it was on the bus. Its key follows from message and sender, as in a `.tlog`; where it
does not, the key precedes the frame in a separate channel. Older recordings hold key and frame in
one JSON text.
"""

import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Any, BinaryIO, Final, NamedTuple

import msgspec
import zstandard
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.exceptions import McapError, UnsupportedCompressionError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, Metadata
from mcap.writer import CompressionType, Writer

from ground.recording.foxglove_scene import SceneDrawer, ViewerMessage
from ground.recording.foxglove_schemas import KEY_SCHEMA, SHAPES, Schema, schema_of
from protocol.topics import COMPONENT, ENCODING, ENCODING_FAMILY, PREFIX, TOPICS, path_of
from protocol.wire.codec import HEADER_SIZE, WIRE_OF_ID, WIRE_OF_TYPE, decode
from protocol.wire.message import Message
from runtime.errors import RemoteError
from runtime.files import opened
from runtime.units import NS_PER_US, UINT32

UNKNOWN_PATH: Final = "unknown"
PATH_OF: Final[Mapping[tuple[int, int], str]] = MappingProxyType(
    {
        (WIRE_OF_TYPE[message].number, COMPONENT[topic.publisher]): topic.path
        for topic in reversed(TOPICS)
        for message in topic.messages
    }
)
"""Map from message id and sending component to topic path; the first topic wins."""


def path_in(frame: bytes) -> str:
    """Return the path of a whole frame; it starts with `unknown` when no topic has the message."""
    number = int.from_bytes(frame[HEADER_SIZE - 3 : HEADER_SIZE], "little")
    path = PATH_OF.get((number, frame[HEADER_SIZE - 4]))
    if path is None:
        wire = WIRE_OF_ID.get(number)
        path = f"{UNKNOWN_PATH}/{number if wire is None else wire.name.lower()}"
    return path


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

    def last_frames(self) -> Iterator[list[bytes]]:
        """Yield the frames of the last chunk, then those of the one before, and so on."""
        with opened(self._path) as source:
            places = [place for opcode, *place in self._places_in(source) if opcode == Opcode.CHUNK]

            def frames(at: int, length: int) -> list[bytes]:
                source.seek(at)
                return [raw.frame for _, raw in self._chunk(source.read(length))]

            # The first chunks hold the channels, without which the last ones cannot be read.
            first = [frames(*place) for place in places[:FIRST_CHUNKS]]
            for place in reversed(places[FIRST_CHUNKS:]):
                yield frames(*place)
            yield from reversed(first)

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


TO_JSON: Final = msgspec.json.Encoder()
"""Values that are not finite become null, as JSON has no infinity; the raw frame is exact."""


class ChannelMessage(NamedTuple):
    """A message for the channel of its topic: JSON with a schema, or bytes in another encoding."""

    topic: str
    schema: Schema | None
    data: bytes
    encoding: str = "json"


class ChannelSplitter:
    """Splits the frames of one robot."""

    def __init__(self, robot: str) -> None:
        self._own = f"/{robot}/"
        self._drawer = SceneDrawer()
        self._topics: dict[tuple[str, str], tuple[str, Schema]] = {}

    def add(self, key: str, frame: bytes, time_ns: int) -> Iterator[ChannelMessage]:
        """Yield the messages of a whole frame; if it cannot be decoded, only the raw one."""
        if key.partition(self._own)[2] != path_in(frame):
            yield ChannelMessage(KEY_TOPIC, KEY_SCHEMA, TO_JSON.encode(FrameKey(key)))
        yield ChannelMessage(RAW_TOPIC, None, frame, ENCODING)
        path = path_of(key)
        if not path:
            return
        try:
            message = decode(frame).message
        except RemoteError:
            return
        yield ChannelMessage(*self._topic_of(path, message), TO_JSON.encode(message))
        yield from map(drawn_piece, self._drawer.draw(key, message, time_ns))

    def draw_fact(self, name: str, text: str, time_ns: int) -> Iterator[ChannelMessage]:
        """Yield the drawings of a fact."""
        yield from map(drawn_piece, self._drawer.draw_fact(name, text, time_ns))

    def _topic_of(self, path: str, message: Message) -> tuple[str, Schema]:
        """Return topic and schema of a message.

        A path that carries several messages has a topic for each, as a topic has one schema. All
        operators share one topic, although each session has a key of its own.
        """
        kind = type(message)
        found = self._topics.get((path, kind.__name__))
        if found is None:
            found = f"/{path}/{kind.__name__}", schema_of(kind)
            self._topics[(path, kind.__name__)] = found
        return found


def drawn_piece(drawn: ViewerMessage) -> ChannelMessage:
    """Encode a drawing."""
    return ChannelMessage(drawn.topic, SHAPES[drawn.shape], TO_JSON.encode(drawn.content))


LIBRARY: Final = "sidestep"
NO_SCHEMA: Final = 0
INDEX_ATTRIBUTE: Final = "_Writer__chunk_indices"
"""Attribute in which the library's writer collects the index for the end of the file."""
FRAME_CHANNELS: Final = (
    ChannelMessage(KEY_TOPIC, KEY_SCHEMA, b""),
    ChannelMessage(RAW_TOPIC, None, b"", ENCODING),
)


class OutputBuffer(BytesIO):
    """Buffers data until they are taken; positions count from the start of the whole file."""

    def __init__(self) -> None:
        super().__init__()
        self._taken = 0

    def tell(self) -> int:
        """Return the position in the whole file."""
        return self._taken + super().tell()

    def take(self) -> bytes:
        """Return the buffered data and clear the buffer."""
        data = self.getvalue()
        self._taken += len(data)
        self.seek(0)
        self.truncate()
        return data


class IndexEntry:
    """Index entry of one chunk as bytes, a fifth of the size of the library's object."""

    __slots__ = ("_record",)

    def __init__(self, index: Any) -> None:
        builder: Any = RecordBuilder()
        index.write(builder)
        self._record: bytes = builder.end()

    def write(self, out: Any) -> None:
        """Write the entry."""
        out.write(self._record)


class McapFormat:
    """Turns frames into chunks, one for each batch."""

    def __init__(self, robot: str, build: Mapping[str, str], begins_us: int = 0) -> None:
        """Begin a file; `begins_us` is the time of a fact that comes before the first frame."""
        self._buffer = OutputBuffer()
        self._writer: Any = Writer(self._buffer, compression=CompressionType.ZSTD)
        self._splitter = ChannelSplitter(robot)
        self._keys = f"{PREFIX}/{robot}"
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._newest_ns = begins_us * NS_PER_US
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(LIBRARY, {"robot": robot, **build})
        # The first chunk holds these channels, so a frame and its key depend on no other chunk.
        self._channels.update({piece.topic: self._channel(piece) for piece in FRAME_CHANNELS})

    def add(self, key: str, frame: bytes, time_us: int, published_us: int | None = None) -> None:
        """Add a whole frame; without `published_us` it was published when it arrived."""
        self._newest_ns = time_us * NS_PER_US
        pieces = self._splitter.add(key, frame, self._newest_ns)
        self._write(pieces, self._newest_ns if published_us is None else published_us * NS_PER_US)

    def add_fact(self, name: str, text: str) -> None:
        """Add a fact as JSON text, such as the world; repeated facts are allowed at any time."""
        self._writer.add_metadata(name, {FACT: text})
        self._write(self._splitter.draw_fact(name, text, self._newest_ns), self._newest_ns)

    def batch(self) -> bytes:
        """Return everything since the last batch in whole chunks, ready to be appended."""
        self._writer.flush()
        self._compact_index()
        return self._buffer.take()

    def end(self) -> bytes:
        """Return the rest with the index that makes opening fast."""
        self._writer.finish()
        return self._buffer.take()

    def _compact_index(self) -> None:
        """Replace new index entries by compact ones: two chunks a second add up over days.

        If the library keeps its entries elsewhere, they keep their size.
        """
        entries: list[Any] = getattr(self._writer, INDEX_ATTRIBUTE, [])
        place = len(entries) - 1
        while place >= 0 and isinstance(entries[place], ChunkIndex):
            entries[place] = IndexEntry(entries[place])
            place -= 1

    def _write(self, pieces: Iterable[ChannelMessage], published_ns: int) -> None:
        for piece in pieces:
            channel = self._channels.get(piece.topic)
            if channel is None:
                channel = self._channels[piece.topic] = self._channel(piece)
            count = self._counts.get(channel, 0)
            self._counts[channel] = (count + 1) & UINT32
            self._writer.add_message(channel, self._newest_ns, piece.data, published_ns, count)

    def _channel(self, piece: ChannelMessage) -> int:
        schema = NO_SCHEMA if piece.schema is None else self._schema(piece.schema)
        metadata = {KEYS: self._keys} if piece.schema is None else {}
        number: int = self._writer.register_channel(piece.topic, piece.encoding, schema, metadata)
        return number

    def _schema(self, schema: Schema) -> int:
        if schema.name not in self._schemas:
            self._schemas[schema.name] = self._writer.register_schema(
                schema.name, "jsonschema", schema.text
            )
        return self._schemas[schema.name]
