"""Bags of ROS 2 as two readers of others see them: rosbags, and mcap-ros2-support as Foxglove."""

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore


class Read(NamedTuple):
    """A message with its topic, its type and its time."""

    topic: str
    type_name: str
    time_ns: int
    message: Any


def read_bag(folder: Path) -> list[Read]:
    """Return all messages; counts must be those of metadata.yaml, and of the other reader."""
    with AnyReader([folder]) as reader:
        found = [
            Read(one.topic, one.msgtype, time_ns, reader.deserialize(data, one.msgtype))
            for one, time_ns, data in reader.messages()
        ]
        counts = Counter(one.topic for one in found)
        assert counts == {one.topic: one.msgcount for one in reader.connections}
        assert reader.message_count == len(found)
    others: Counter[str] = Counter()
    for file in sorted(folder.glob("*.mcap")):
        with file.open("rb") as source:
            decoded = make_reader(source, decoder_factories=[DecoderFactory()])
            others.update(one.channel.topic for one in decoded.iter_decoded_messages())
    assert counts == others
    return found


def made_bag(
    folder: Path, messages: Iterable[Read], *, sqlite3: bool = False, humble: bool = False
) -> Path:
    """Write a bag by rosbags, with the types of a distribution; bytes are written as they are."""
    store = get_typestore(Stores.ROS2_HUMBLE if humble else Stores.ROS2_JAZZY)
    plugin = StoragePlugin.SQLITE3 if sqlite3 else StoragePlugin.MCAP
    with Writer(folder, version=9, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, type_name, time_ns, message in messages:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, type_name, typestore=store)
            data = message
            if not isinstance(message, bytes):
                data = store.serialize_cdr(message, type_name)
            writer.write(connections[topic], time_ns, data)
    return folder
