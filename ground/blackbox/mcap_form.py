"""Frames as an MCAP file: raw, decoded as JSON, and drawn as Foxglove and Lichtblick know it.

What a viewer shows is made here; what replay and re-execution need is the raw frame alone.
"""

from collections.abc import Mapping
from io import BytesIO
from typing import Any, Final

import msgspec
from mcap.writer import CompressionType, Writer

from ground.blackbox.mcap_file import FACT, RAW_TOPIC, Raw
from ground.blackbox.picture import Drawn, Picture
from ground.blackbox.schemas import RAW_SCHEMA, Schema, schema_of
from ground.blackbox.shape_schemas import SHAPES
from protocol.codec import decode
from protocol.errors import RemoteError
from protocol.message import Message

LIBRARY: Final = "sidestep"
NS_PER_US: Final = 1000
TO_JSON: Final = msgspec.json.Encoder()
"""What is not finite becomes null: JSON has no infinity. The raw frame beside it is exact."""


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


class McapForm:
    """Turns frames into chunks, one for each batch."""

    def __init__(self, robot: str, build: Mapping[str, str]) -> None:
        self._robot = robot
        self._outbox = Outbox()
        self._writer: Any = Writer(self._outbox, compression=CompressionType.ZSTD)
        self._schemas: dict[str, int] = {}
        self._channels: dict[tuple[str, str], int] = {}
        self._counts: dict[int, int] = {}
        self._picture = Picture()
        self._newest_ns = 0
        self._writer.start(library=LIBRARY)
        self._writer.add_metadata(LIBRARY, {"robot": robot, **build})
        self._raw = self._channel(RAW_TOPIC, RAW_SCHEMA)

    def add(self, key: str, frame: bytes, time_us: int) -> None:
        """A whole frame. One of a newer dialect is kept, and cannot be shown."""
        time_ns = self._newest_ns = time_us * NS_PER_US
        self._write(self._raw, TO_JSON.encode(Raw(key, frame)), time_ns)
        try:
            message = decode(frame).message
        except RemoteError:
            return
        self._write(self._channel_of(key, message), TO_JSON.encode(message), time_ns)
        self._draw(self._picture.see(key, message, time_ns), time_ns)

    def know(self, name: str, text: str) -> None:
        """A fact as JSON text, such as the world; it may come at any time, and again."""
        self._writer.add_metadata(name, {FACT: text})
        self._draw(self._picture.know(name, text, self._newest_ns), self._newest_ns)

    def batch(self) -> bytes:
        """Everything since the last batch; whole chunks, so that it can be appended as it is."""
        self._writer.flush()
        return self._outbox.take()

    def end(self) -> bytes:
        """The rest, with the index that makes opening it fast."""
        self._writer.finish()
        return self._outbox.take()

    def _draw(self, drawn: list[Drawn], time_ns: int) -> None:
        for topic, shape, content in drawn:
            channel = self._channel(topic, SHAPES[shape])
            self._write(channel, TO_JSON.encode(content), time_ns)

    def _channel_of(self, key: str, message: Message) -> int:
        """Keys that carry several messages have a channel for each: a channel has one schema."""
        name = type(message).__name__
        channel = self._channels.get((key, name))
        if channel is None:
            path = key.partition(f"/{self._robot}/")[2] or key
            channel = self._channels[(key, name)] = self._channel(
                f"/{path}/{name}", schema_of(type(message))
            )
        return channel

    def _channel(self, topic: str, schema: Schema) -> int:
        known = self._channels.get((topic, ""))
        if known is None:
            if schema.name not in self._schemas:
                self._schemas[schema.name] = self._writer.register_schema(
                    schema.name, "jsonschema", schema.text
                )
            number = self._schemas[schema.name]
            known = self._channels[(topic, "")] = self._writer.register_channel(
                topic, "json", number
            )
        return known

    def _write(self, channel: int, data: bytes, time_ns: int) -> None:
        count = self._counts.get(channel, 0)
        self._counts[channel] = (count + 1) & 0xFFFFFFFF
        self._writer.add_message(channel, time_ns, data, time_ns, count)
