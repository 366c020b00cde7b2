"""One frame as all that is made of it: itself, its message as JSON, and what a viewer draws of it.

A file and a live viewer are given the same.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import msgspec

from ground.recording.foxglove.scene import SceneDrawer, ViewerMessage
from ground.recording.foxglove.schemas import SHAPES
from ground.recording.frame_paths import path_in
from ground.recording.mcap.json_schemas import KEY_SCHEMA, Schema, schema_of
from ground.recording.mcap.reader import KEY_TOPIC, RAW_TOPIC, Key
from protocol.topics import ENCODING, path_of
from protocol.wire.codec import decode
from protocol.wire.message import Message
from runtime.errors import RemoteError

TO_JSON: Final = msgspec.json.Encoder()
"""What is not finite becomes null: JSON has no infinity. The raw frame beside it is exact."""


class ChannelMessage(NamedTuple):
    """A message for a channel of this topic: a JSON text, or without a schema what the encoding
    says.
    """

    topic: str
    schema: Schema | None
    data: bytes
    encoding: str = "json"


class ChannelSplitter:
    """Of one robot."""

    def __init__(self, robot: str) -> None:
        self._own = f"/{robot}/"
        self._picture = SceneDrawer()
        self._topics: dict[tuple[str, str], tuple[str, Schema]] = {}

    def add(self, key: str, frame: bytes, time_ns: int) -> Iterator[ChannelMessage]:
        """A whole frame. What is of a newer dialect or on a foreign key is there raw only."""
        if key.partition(self._own)[2] != path_in(frame):
            yield ChannelMessage(KEY_TOPIC, KEY_SCHEMA, TO_JSON.encode(Key(key)))
        yield ChannelMessage(RAW_TOPIC, None, frame, ENCODING)
        path = path_of(key)
        if not path:
            return
        try:
            message = decode(frame).message
        except RemoteError:
            return
        yield ChannelMessage(*self._topic_of(path, message), TO_JSON.encode(message))
        yield from map(drawn_piece, self._picture.see(key, message, time_ns))

    def know(self, name: str, text: str, time_ns: int) -> Iterator[ChannelMessage]:
        """What is drawn of a fact."""
        yield from map(drawn_piece, self._picture.know(name, text, time_ns))

    def _topic_of(self, path: str, message: Message) -> tuple[str, Schema]:
        """Keys that carry several messages have a topic for each: a topic has one schema.

        All operators share one: each session has a key of its own, and they come and go.
        """
        kind = type(message)
        found = self._topics.get((path, kind.__name__))
        if found is None:
            found = f"/{path}/{kind.__name__}", schema_of(kind)
            self._topics[(path, kind.__name__)] = found
        return found


def drawn_piece(drawn: ViewerMessage) -> ChannelMessage:
    return ChannelMessage(drawn.topic, SHAPES[drawn.shape], TO_JSON.encode(drawn.content))
