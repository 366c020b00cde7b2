"""The payload of FILE_TRANSFER_PROTOCOL: requests in, replies out; and its CRC32."""

from enum import IntEnum
from struct import Struct
from typing import Final, NamedTuple
from zlib import crc32

from gateways.mavlink.mav_service import Sender
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink

ALL_ONES: Final = 0xFFFF_FFFF


def checksum(data: bytes, before: int = 0) -> int:
    """Return the checksum of data, continued from the checksum `before` of the data before it."""
    return crc32(data, before ^ ALL_ONES) ^ ALL_ONES


HEADER: Final = Struct("<HBBBBBxI")
MAX_DATA: Final = 239
PAYLOAD_BYTES: Final = HEADER.size + MAX_DATA
FRAME_BYTES: Final = 28
"""Bytes of a frame without header and data, with the signature."""


class Opcode(IntEnum):
    """The operations that are carried out."""

    NONE = 0
    TERMINATE = 1
    RESET = 2
    LIST = 3
    OPEN = 4
    READ = 5
    CHECKSUM = 14
    BURST = 15
    LIST_WITH_TIME = 16
    ACK = 128
    NAK = 129


WRITING: Final = frozenset(range(6, 14))
"""The operations that would change files."""


class Failure(IntEnum):
    """Reasons in a NAK."""

    FAIL = 1
    INVALID_DATA_SIZE = 3
    INVALID_SESSION = 4
    NO_SESSIONS = 5
    END_OF_FILE = 6
    UNKNOWN_COMMAND = 7
    FILE_PROTECTED = 9
    FILE_NOT_FOUND = 10


class Key(NamedTuple):
    """A session: the program that opened it, and the number chosen by that program."""

    client: int
    system: int
    component: int
    session: int


class FileRequest(NamedTuple):
    """A request; `size` is as it was sent, `data` has at most 239 bytes."""

    sender: Sender
    sequence: int
    session: int
    opcode: int
    size: int
    offset: int
    data: bytes

    @property
    def key(self) -> Key:
        """The session that the request is for."""
        sender = self.sender
        return Key(sender.client, sender.system, sender.component, self.session)

    @property
    def path(self) -> str | None:
        """The path in the data; None if it is no plain text."""
        text = self.data.split(b"\0")[0]
        plain = text.isascii() and text.decode("ascii").isprintable()
        return text.decode("ascii") if text and plain else None

    def repeated_by(self, other: "FileRequest") -> bool:
        """Return whether another request of the same session has the same content."""
        return (self.opcode, self.data) == (other.opcode, other.data)

    def reply(
        self,
        opcode: Opcode,
        data: bytes = b"",
        offset: int = 0,
        sent: int = 0,
        *,
        last: bool = False,
    ) -> MavMessage:
        """Return a reply with the request's session; `sent` replies were sent before it."""
        head = HEADER.pack(
            (self.sequence + 1 + sent) & 0xFFFF,
            self.session,
            opcode,
            len(data),
            self.opcode,
            last,
            offset,
        )
        payload = (head + data).ljust(PAYLOAD_BYTES, b"\0")
        sender = self.sender
        return mavlink.MAVLink_file_transfer_protocol_message(
            0, sender.system, sender.component, list(payload)
        )

    def failed(self, failure: Failure, sent: int = 0) -> MavMessage:
        """Return a NAK."""
        return self.reply(Opcode.NAK, bytes([failure]), self.offset, sent, last=True)


def request_in(message: MavMessage, sender: Sender) -> FileRequest:
    """Parse a message."""
    payload = bytes(message.payload)
    sequence, session, opcode, size, _, _, offset = HEADER.unpack_from(payload)
    data = payload[HEADER.size : HEADER.size + min(size, MAX_DATA)]
    return FileRequest(sender, sequence, session, opcode, size, offset, data)
