"""Split received bytes into MAVLink frames. Only complete frames with the right checksum pass.

pymavlink's parser waits for as many bytes as a damaged length field demands, and drops them all if
the checksum is wrong. This parser continues with the byte after the wrong start, and limits its
work.
"""

from typing import Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from ground.gateway.dialect import mavlink
from runtime.units import NS_PER_MS

V1: Final = mavlink.PROTOCOL_MARKER_V1
V2: Final = mavlink.PROTOCOL_MARKER_V2
STARTS: Final = bytes((V1, V2))
HEADER_V1: Final = 6
HEADER_V2: Final = 10
CHECKSUM: Final = 2
SIGNED: Final = mavlink.MAVLINK_IFLAG_SIGNED
SIGNATURE: Final = 13
MAX_WAITING: Final = 16_384
"""Bytes of one client that wait to be processed; more are dropped."""
UNFINISHED_NS: Final = 500 * NS_PER_MS
"""If the rest of a frame does not arrive within this time, the frame is incomplete."""


class Frame(NamedTuple):
    """A complete frame with the right checksum."""

    data: bytes
    number: int
    sequence: int
    system: int
    component: int
    is_signed: bool

    @property
    def is_mavlink1(self) -> bool:
        """True for a frame of version 1, which cannot be signed."""
        return bool(self.data[0] == V1)


class Deframer:
    """The waiting bytes of one client; `malformed`, `unknown` and `dropped` count faults.

    `allowance` is the number of positions that may be examined before it is raised again.
    """

    def __init__(self) -> None:
        self.malformed = self.unknown = self.dropped = self.allowance = 0
        self._waiting = bytearray()
        self._unfinished_ns: int | None = None

    def feed(self, data: bytes) -> None:
        """Add received bytes; drop those for which there is no room."""
        room = MAX_WAITING - len(self._waiting)
        self.dropped += max(0, len(data) - room)
        self._waiting += data[:room]

    def take(self, now_ns: int) -> list[Frame]:
        """Return the next frames, as many as the allowance permits; the rest waits."""
        found: list[Frame] = []
        waiting, at = bytes(self._waiting), 0
        while self.allowance > 0:
            at = _next_start(waiting, at)
            size = _size(waiting, at)
            if size == 0 or at + size > len(waiting):
                if not self._is_overdue(at, len(waiting), now_ns):
                    break
                at = self._wrong(at)
                continue
            self._unfinished_ns = None
            self.allowance -= 1
            at = self._frame(waiting, at, size, found)
        del self._waiting[:at]
        return found

    def _is_overdue(self, at: int, end: int, now_ns: int) -> bool:
        """Return whether the rest of the frame at a position has not arrived in time."""
        if at == end:
            self._unfinished_ns = None
            return False
        if self._unfinished_ns is None:
            self._unfinished_ns = now_ns
        return now_ns - self._unfinished_ns >= UNFINISHED_NS

    def _frame(self, waiting: bytes, at: int, size: int, found: list[Frame]) -> int:
        """Add the frame at a position if it is valid; return the position to continue at."""
        frame = _parsed(waiting[at : at + size])
        known = mavlink.mavlink_map.get(frame.number)
        if known is None:
            end = at + size
            if end < len(waiting) and waiting[end] not in STARTS:
                return self._wrong(at)
            self.unknown += 1
            return end
        if not _is_intact(frame, known.crc_extra):
            return self._wrong(at)
        found.append(frame)
        return at + size

    def _wrong(self, at: int) -> int:
        self.malformed += 1
        return at + 1


def _next_start(data: bytes, at: int) -> int:
    """Return the position of the next byte that can start a frame, or the end."""
    places = (data.find(V1, at), data.find(V2, at))
    return min((place for place in places if place >= 0), default=len(data))


def _size(data: bytes, at: int) -> int:
    """Return the size of the frame at a position; 0 if its header is not complete."""
    if len(data) - at < 3:
        return 0
    if data[at] == V1:
        return HEADER_V1 + data[at + 1] + CHECKSUM
    signature = SIGNATURE if data[at + 2] & SIGNED else 0
    return HEADER_V2 + data[at + 1] + CHECKSUM + signature


def _parsed(data: bytes) -> Frame:
    if data[0] == V1:
        return Frame(data, data[5], data[2], data[3], data[4], is_signed=False)
    number = int.from_bytes(data[7:10], "little")
    return Frame(data, number, data[4], data[5], data[6], is_signed=bool(data[2] & SIGNED))


def _is_intact(frame: Frame, extra: int) -> bool:
    """Return whether the checksum is right, and no flag is set that changes the format."""
    data = frame.data
    if data[0] == V2 and data[2] & ~SIGNED:
        return False
    end = len(data) - CHECKSUM - (SIGNATURE if frame.is_signed else 0)
    crc = mcrf4xx(data[1:end] + bytes((extra,)))
    return crc == int.from_bytes(data[end : end + CHECKSUM], "little")
