"""Bags of ROS 2 as two readers of others see them: rosbags, and mcap-ros2-support as Foxglove."""

from collections import Counter
from pathlib import Path
from typing import Any, NamedTuple

from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader


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
