"""Read any bytes as a row of messages, each in a readable frame.

So the content of the fields is fuzzed, not the frame around them.
"""

from collections.abc import Iterator
from typing import Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from protocol.topics import COMPONENT, SERVICES, TOPICS, Role
from protocol.wire.codec import CHECKSUM, HEAD, MAGIC_BYTE, WIRE_OF_TYPE, decode
from protocol.wire.message import Message, Wire
from runtime.errors import RemoteError

MOST: Final = 60
STEP_NS: Final = 5_000_000


class MessageKind(NamedTuple):
    """A message type with its sender."""

    message: type[Message]
    sender: Role


PUBLISHED: Final = tuple(
    MessageKind(one, topic.publisher) for topic in TOPICS for one in topic.messages
)
REQUESTED: Final = tuple(
    MessageKind(one, Role.GROUND) for service in SERVICES for one in service.requests
)
KINDS: Final = (*PUBLISHED, *REQUESTED)
NUMBER_OF: Final = {kind.message: number for number, kind in reversed(list(enumerate(KINDS)))}


class TimedMessage(NamedTuple):
    """A message, its frame, and the time since the message before."""

    message: Message
    frame: bytes
    after_ns: int


def packed(*messages: Message, after: int = 10) -> bytes:
    """Return the bytes that `pieces` reads as these messages."""
    return b"".join(
        bytes((NUMBER_OF[type(one)], after)) + WIRE_OF_TYPE[type(one)].pack(one) for one in messages
    )


def pieces(data: bytes) -> Iterator[TimedMessage]:
    """Yield messages; each begins with a byte for its kind and one for the time since the last."""
    at = 0
    for sequence in range(MOST):
        if at + 2 > len(data):
            return
        kind, after = KINDS[data[at] % len(KINDS)], data[at + 1]
        wire = WIRE_OF_TYPE[kind.message]
        frame = frame_of(wire, data[at + 2 : at + 2 + wire.size], kind.sender, sequence)
        at += 2 + wire.size
        try:
            yield TimedMessage(decode(frame).message, frame, after * STEP_NS)
        except RemoteError:  # text that is not UTF-8
            continue


def frame_of(wire: Wire, payload: bytes, sender: Role, sequence: int) -> bytes:
    """Return the frame of a payload, with a valid checksum."""
    payload = payload.rstrip(b"\0") or b"\0"
    low, high = wire.number_low, wire.number_high
    body = HEAD(len(payload), 0, 0, sequence & 0xFF, 1, COMPONENT[sender], low, high) + payload
    return MAGIC_BYTE + body + CHECKSUM(mcrf4xx(body + wire.crc_extra))
