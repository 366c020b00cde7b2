"""Derive the topic path of a frame from its message and its sender."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from protocol.topics import COMPONENT, TOPICS
from protocol.wire.codec import HEADER_SIZE, WIRE_OF_ID, WIRE_OF_TYPE

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
