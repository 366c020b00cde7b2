"""Frames as an MCAP file: raw, decoded as JSON, and drawn as Foxglove and Lichtblick know it.

What a viewer shows is made here; what replay and re-execution need is the raw frame alone.
"""

from collections.abc import Iterable, Mapping
from io import BytesIO
from typing import Any, Final

from mcap.data_stream import RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import CompressionType, Writer

from ground.blackbox.mcap_file import FACT
from ground.blackbox.schemas import Schema
from ground.blackbox.spread import Piece, Spread

LIBRARY: Final = "sidestep"
ENTRIES: Final = "_Writer__chunk_indices"
"""Where the writer collects the index that it writes at the end."""
NS_PER_US: Final = 1000


class Outbox(BytesIO):
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


class McapForm:
    """Turns frames into chunks, one for each batch."""

    def __init__(self, robot: str, build: Mapping[str, str]) -> None:
        self._outbox = Outbox()
        self._writer: Any = Writer(self._outbox, compression=CompressionType.ZSTD)
        self._spread = Spread()
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[int, int] = {}
        self._newest_ns = 0
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(LIBRARY, {"robot": robot, **build})

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

    def _write(self, pieces: Iterable[Piece], told_ns: int) -> None:
        for topic, schema, data in pieces:
            channel = self._channels.get(topic)
            if channel is None:
                channel = self._channels[topic] = self._channel(topic, schema)
            count = self._counts.get(channel, 0)
            self._counts[channel] = (count + 1) & 0xFFFFFFFF
            self._writer.add_message(channel, self._newest_ns, data, told_ns, count)

    def _channel(self, topic: str, schema: Schema) -> int:
        if schema.name not in self._schemas:
            self._schemas[schema.name] = self._writer.register_schema(
                schema.name, "jsonschema", schema.text
            )
        number: int = self._writer.register_channel(topic, "json", self._schemas[schema.name])
        return number
