"""Write frames to an MCAP file: raw, decoded as JSON, and drawn for Foxglove and Lichtblick.

Viewers show the drawings; replay and re-execution need the raw frames only.
"""

from collections.abc import Iterable, Mapping
from io import BytesIO
from typing import Any, Final

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from ground.recording.mcap.channels import ChannelMessage, ChannelSplitter
from ground.recording.mcap.json_schemas import KEY_SCHEMA, Schema
from ground.recording.mcap.reader import FACT, KEY_TOPIC, KEYS, RAW_TOPIC
from protocol.topics import ENCODING, PREFIX
from runtime.units import NS_PER_US

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
            self._counts[channel] = (count + 1) & 0xFFFFFFFF
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
