"""Encode a message as a MAVLink 2 frame, byte-identical with pymavlink, and decode strictly.

Whatever the bytes, `decode` raises nothing but RemoteError. Each input is one whole frame: there is
no search in a stream. Signed frames are refused because the transport authenticates.
"""

from struct import Struct
from struct import error as struct_error
from typing import Final

import msgspec
from fastcrc.crc16 import mcrf4xx

from protocol.wire.message import Message, Wire, unfit, wire_of
from protocol.wire.messages import MESSAGES
from runtime.errors import LocalError, RemoteError

MAGIC: Final = 0xFD
MAGIC_BYTE: Final = bytes([MAGIC])
HEAD: Final = Struct("<BBBBBBHB").pack  # size, flags, flags, sequence, system, component, id
HEADER: Final = Struct("<BBBBBBBHB").unpack_from  # the same after the magic
CHECKSUM: Final = Struct("<H").pack
HEADER_SIZE: Final = 10
CHECKSUM_SIZE: Final = 2
SIGNATURE_SIZE: Final = 13
"""Behind a signed frame of another program; frames of the bus have none."""

OUTSIDE: Final = HEADER_SIZE + CHECKSUM_SIZE
SMALLEST_FRAME: Final = OUTSIDE + 1
LARGEST_FRAME: Final = OUTSIDE + 255
WIRE_OF_TYPE: Final[dict[type[Message], Wire]] = {cls: wire_of(cls) for cls in MESSAGES}
WIRE_OF_ID: Final[dict[int, Wire]] = {wire.number: wire for wire in WIRE_OF_TYPE.values()}
PACKING_ERRORS: Final = (struct_error, OverflowError, TypeError, ValueError, AttributeError)


class Frame(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """A decoded frame: message and sender; `sequence` counts the frames of one encoder."""

    message: Message
    system_id: int
    component_id: int
    sequence: int


class Encoder:
    """Encode the frames of one sender on one key, with their own sequence counter."""

    def __init__(self, system_id: int, component_id: int) -> None:
        if not (0 <= system_id <= 255 and 0 <= component_id <= 255):
            raise LocalError(f"system {system_id}, component {component_id}: each must be 0 to 255")
        self._system_id = system_id
        self._component_id = component_id
        self._sequence = 0

    def encode(self, message: Message) -> bytes:
        """Return the next frame; LocalError names a field that does not fit."""
        wire = WIRE_OF_TYPE[type(message)]
        try:
            payload = wire.pack(message).rstrip(b"\0") or b"\0"
        except PACKING_ERRORS as error:
            raise unfit(message) from error
        sequence = self._sequence
        self._sequence = (sequence + 1) & 0xFF
        system_id, component_id = self._system_id, self._component_id
        low, high = wire.number_low, wire.number_high
        body = HEAD(len(payload), 0, 0, sequence, system_id, component_id, low, high) + payload
        return MAGIC_BYTE + body + CHECKSUM(mcrf4xx(body + wire.crc_extra))


def is_frame(frame: bytes) -> bool:
    """Return whether bytes have the outer form of a frame; noise and truncated frames do not."""
    return len(frame) >= SMALLEST_FRAME and frame[0] == MAGIC and frame[1] == len(frame) - OUTSIDE


def decode(frame: bytes) -> Frame:
    """Return the message in a frame; raise RemoteError with the cause for any other bytes."""
    if len(frame) < SMALLEST_FRAME:
        raise RemoteError(f"frame of {len(frame)} bytes is too short")
    if len(frame) > LARGEST_FRAME:
        raise RemoteError(f"frame is longer than {LARGEST_FRAME} bytes")
    magic, size, flags, _, sequence, system_id, component_id, low, high = HEADER(frame)
    if magic != MAGIC:
        raise RemoteError(f"frame starts with 0x{magic:02x}, not with 0xfd of MAVLink 2")
    if size != len(frame) - HEADER_SIZE - CHECKSUM_SIZE:
        raise RemoteError(f"frame of {len(frame)} bytes announces {size} bytes of payload")
    if flags:
        raise RemoteError(f"frame needs unsupported features (flags 0x{flags:02x})")
    wire = WIRE_OF_ID.get(low | high << 16)
    if wire is None:
        raise RemoteError(f"message id {low | high << 16} is not in the dialect")
    if mcrf4xx(frame[1:-2] + wire.crc_extra) != frame[-2] | frame[-1] << 8:
        raise RemoteError(f"checksum of {wire.name} does not match")
    payload = frame[HEADER_SIZE:-CHECKSUM_SIZE]
    if size != wire.size:  # shorter: without trailing zeros; longer: with unknown extensions
        payload = payload.ljust(wire.size, b"\0")[: wire.size]
    try:
        message = wire.unpack(payload)
    except UnicodeDecodeError as error:
        raise RemoteError(f"a text of {wire.name} is not UTF-8") from error
    return Frame(message=message, system_id=system_id, component_id=component_id, sequence=sequence)
