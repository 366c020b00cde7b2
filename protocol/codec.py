"""One message, one MAVLink 2 frame: byte-identical with pymavlink, and strict about what comes in.

Whatever the bytes, `decode` raises nothing but RemoteError. Frames are whole: nothing is ever
searched for in a stream, and signed frames are refused (authentication belongs to the transport).
"""

from struct import Struct
from struct import error as StructError
from typing import Final

import msgspec
from fastcrc.crc16 import mcrf4xx

from protocol.errors import LocalError, RemoteError
from protocol.layout import LAYOUT
from protocol.message import Message, unfit
from protocol.messages import MESSAGES
from protocol.wire import wire_of

MAGIC: Final = 0xFD
HEADER: Final = Struct("<BBBBBBBHB")  # magic, size, flags, flags, sequence, system, component, id
HEADER_SIZE: Final = HEADER.size
CHECKSUM_SIZE: Final = 2
SMALLEST_FRAME: Final = HEADER_SIZE + 1 + CHECKSUM_SIZE
TYPE_OF_ID: Final = {LAYOUT[cls.__name__].number: cls for cls in MESSAGES}
UNPACKABLE: Final = (StructError, OverflowError, TypeError, ValueError, AttributeError)


class Frame(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """A decoded frame: the message and who sent it; `sequence` counts frames of one encoder."""

    message: Message
    system_id: int
    component_id: int
    sequence: int


class Encoder:
    """Frames of one sender on one key, with a sequence counter of their own."""

    def __init__(self, system_id: int, component_id: int) -> None:
        if not (0 <= system_id <= 255 and 0 <= component_id <= 255):
            raise LocalError(f"system {system_id}, component {component_id}: each must be 0 to 255")
        self._system_id = system_id
        self._component_id = component_id
        self._sequence = 0

    def encode(self, message: Message) -> bytes:
        """The next frame; LocalError names the field that does not fit."""
        wire = wire_of(type(message))
        try:
            payload = wire.pack(message)
        except UNPACKABLE as error:
            raise unfit(message) from error
        payload = payload.rstrip(b"\0") or b"\0"
        sequence, number = self._sequence, wire.number
        self._sequence = (sequence + 1) & 0xFF
        size, sender, component = len(payload), self._system_id, self._component_id
        body = HEADER.pack(
            MAGIC, size, 0, 0, sequence, sender, component, number & 0xFFFF, number >> 16
        )
        body += payload
        checksum = mcrf4xx(body[1:] + wire.crc_extra)
        return body + checksum.to_bytes(CHECKSUM_SIZE, "little")


def decode(frame: bytes) -> Frame:
    """The message in a frame; RemoteError says what is wrong with any other bytes."""
    if len(frame) < SMALLEST_FRAME:
        raise RemoteError(f"{len(frame)} bytes are too few for a frame")
    magic, size, flags, _, sequence, system_id, component_id, low, high = HEADER.unpack_from(frame)
    if magic != MAGIC:
        raise RemoteError(f"starts with 0x{magic:02x}, not with 0xfd of MAVLink 2")
    if size != len(frame) - HEADER_SIZE - CHECKSUM_SIZE:
        raise RemoteError(f"announces {size} bytes of payload in a frame of {len(frame)}")
    if flags:
        raise RemoteError(f"needs features that are not supported (flags 0x{flags:02x})")
    cls = TYPE_OF_ID.get(low | high << 16)
    if cls is None:
        raise RemoteError(f"message id {low | high << 16} is not in the dialect")
    message = _message(cls, frame)
    return Frame(message=message, system_id=system_id, component_id=component_id, sequence=sequence)


def _message(cls: type[Message], frame: bytes) -> Message:
    """Check the checksum, undo the truncation; bytes after the known payload are extensions."""
    wire = wire_of(cls)
    if mcrf4xx(frame[1:-2] + wire.crc_extra) != frame[-2] | frame[-1] << 8:
        raise RemoteError(f"checksum of {wire.name} does not match")
    payload = frame[HEADER_SIZE:-CHECKSUM_SIZE]
    try:
        return wire.unpack(payload.ljust(wire.size, b"\0")[: wire.size])
    except UnicodeDecodeError as error:
        raise RemoteError(f"a text of {wire.name} is not UTF-8") from error
