"""Frames as an MCAP file: as on the bus, decoded as JSON, and drawn for Foxglove and Lichtblick.

What a viewer shows is made here; what replay and re-execution need is the raw frame alone.
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
ENTRIES: Final = "_Writer__chunk_indices"
"""Where the writer collects the index that it writes at the end."""
FRAME_CHANNELS: Final = (
    ChannelMessage(KEY_TOPIC, KEY_SCHEMA, b""),
    ChannelMessage(RAW_TOPIC, None, b"", ENCODING),
)


class OutputBuffer(BytesIO):
    """What has been written and not yet been taken; tells its place in the file as a whole."""

    def __init__(self) -> None:
        super().__init__()
        self._taken = 0

    def tell(self) -> int:
        return self._taken + super().tell()

    def take(self) -> bytes:
        data = self.getvalue()
        self._taken += len(data)
        self.seek(0)
        self.truncate()
        return data


class Entry:
    """One chunk's entry in the index, as its bytes: a fifth of what the writer would hold."""

    __slots__ = ("_record",)

    def __init__(self, index: Any) -> None:
        builder: Any = RecordBuilder()
        index.write(builder)
        self._record: bytes = builder.end()

    def write(self, out: Any) -> None:
        out.write(self._record)


class McapFormat:
    """Turns frames into chunks, one for each batch."""

    def __init__(self, robot: str, build: Mapping[str, str]) -> None:
        self._outbox = OutputBuffer()
        self._writer: Any = Writer(self._outbox, compression=CompressionType.ZSTD)
        self._spread = ChannelSplitter(robot)
        self._keys = f"{PREFIX}/{robot}"
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._newest_ns = 0
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(LIBRARY, {"robot": robot, **build})
        # In the first chunk, so that no other one has to be whole for a frame and its key.
        self._channels.update({piece.topic: self._channel(piece) for piece in FRAME_CHANNELS})

    def add(self, key: str, frame: bytes, time_us: int, told_us: int | None = None) -> None:
        """A whole frame; its publish time is when it was told, None: as it arrived."""
        self._newest_ns = time_us * NS_PER_US
        pieces = self._spread.add(key, frame, self._newest_ns)
        self._write(pieces, self._newest_ns if told_us is None else told_us * NS_PER_US)

    def know(self, name: str, text: str) -> None:
        """A fact as JSON text, such as the world; it may come at any time, and again."""
        self._writer.add_metadata(name, {FACT: text})
        self._write(self._spread.know(name, text, self._newest_ns), self._newest_ns)

    def batch(self) -> bytes:
        """Everything since the last batch; whole chunks, so that it can be appended as it is."""
        self._writer.flush()
        self._pack()
        return self._outbox.take()

    def end(self) -> bytes:
        """The rest, with the index that makes opening it fast."""
        self._writer.finish()
        return self._outbox.take()

    def _pack(self) -> None:
        """Two chunks a second over days are many entries; what there is of new ones is made small.

        With a writer that keeps them elsewhere they only stay as large as they were.
        """
        entries: list[Any] = getattr(self._writer, ENTRIES, [])
        place = len(entries) - 1
        while place >= 0 and isinstance(entries[place], ChunkIndex):
            entries[place] = Entry(entries[place])
            place -= 1

    def _write(self, pieces: Iterable[ChannelMessage], told_ns: int) -> None:
        for piece in pieces:
            channel = self._channels.get(piece.topic)
            if channel is None:
                channel = self._channels[piece.topic] = self._channel(piece)
            count = self._counts.get(channel, 0)
            self._counts[channel] = (count + 1) & 0xFFFFFFFF
            self._writer.add_message(channel, self._newest_ns, piece.data, told_ns, count)

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
