"""The path of the topic that a frame was published on, as far as message and sender tell."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from protocol.sender import COMPONENT
from protocol.topics import TOPICS
from protocol.wire.codec import HEADER_SIZE, WIRE_OF_ID, WIRE_OF_TYPE

UNKNOWN_PATH: Final = "unknown"
PATH_OF: Final[Mapping[tuple[int, int], str]] = MappingProxyType(
    {
        (WIRE_OF_TYPE[message].number, COMPONENT[topic.publisher]): topic.path
        for topic in reversed(TOPICS)
        for message in topic.messages
    }
)
"""Message id and component that sends it, to the path of its topic; the first topic wins."""


def path_in(frame: bytes) -> str:
    """The path of a whole frame; under `unknown` when no topic has it."""
    number = int.from_bytes(frame[HEADER_SIZE - 3 : HEADER_SIZE], "little")
    path = PATH_OF.get((number, frame[HEADER_SIZE - 4]))
    if path is None:
        wire = WIRE_OF_ID.get(number)
        path = f"{UNKNOWN_PATH}/{number if wire is None else wire.name.lower()}"
    return path
