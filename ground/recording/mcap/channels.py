"""Split a frame into its channel messages: raw, message as JSON, and drawings.

Files and live viewers get the same messages.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

import msgspec

from ground.recording.foxglove_scene import SceneDrawer, ViewerMessage
from ground.recording.foxglove_schemas import SHAPES
from ground.recording.frame_paths import path_in
from ground.recording.mcap.json_schemas import KEY_SCHEMA, Schema, schema_of
from ground.recording.mcap.reader import KEY_TOPIC, RAW_TOPIC, FrameKey
from protocol.topics import ENCODING, path_of
from protocol.wire.codec import decode
from protocol.wire.message import Message
from runtime.errors import RemoteError

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
