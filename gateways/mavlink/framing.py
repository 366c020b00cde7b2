"""Split received bytes into MAVLink frames. Only complete frames with the right checksum pass.

pymavlink's parser waits for as many bytes as a damaged length field demands, and drops them all if
the checksum is wrong. This parser continues with the byte after the wrong start, and limits its
work. A start whose header no frame can have is wrong at once; another one may be the beginning of a
frame whose rest is on its way. An emergency stop behind it never waits for that rest.
"""

import re
from struct import Struct
from typing import Final, NamedTuple

from fastcrc.crc16 import mcrf4xx

from gateways.mavlink.mavlink_dialect import mavlink
from protocol.wire.codec import CHECKSUM_SIZE, HEADER_SIZE, SIGNATURE_SIZE
from runtime.units import NS_PER_MS

V1: Final = mavlink.PROTOCOL_MARKER_V1
V2: Final = mavlink.PROTOCOL_MARKER_V2
STARTS: Final = bytes((V1, V2))
HEADER_V1: Final = 6
SIGNED: Final = mavlink.MAVLINK_IFLAG_SIGNED
MAX_WAITING: Final = 16_384
"""Bytes of one client that wait to be processed; more are dropped."""
UNFINISHED_NS: Final = 500 * NS_PER_MS
"""If the rest of a frame does not arrive within this time, the frame is incomplete."""
COMMANDS: Final = (mavlink.MAVLINK_MSG_ID_COMMAND_LONG, mavlink.MAVLINK_MSG_ID_COMMAND_INT)
COMMAND_START: Final = re.compile(
    rb"(?=\xfd.[\x00\x01]....[\x4b\x4c]\x00\x00|\xfe....[\x4b\x4c])", re.DOTALL
)
"""The header of a message that may be an emergency stop; it may overlap with another one."""
STOP_LAYOUT: Final = Struct("<f24xH")
"""Parameter 1 and the command; both messages have them at the same places."""


class MavFrame(NamedTuple):
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


def is_emergency_stop(frame: MavFrame) -> bool:
    """Return whether a frame is a DO_FLIGHTTERMINATION that stops the robot."""
    param1, command = _command(frame)
    return command == mavlink.MAV_CMD_DO_FLIGHTTERMINATION and param1 > 0.5


def may_release(frame: MavFrame) -> bool:
    """Return whether a frame may release an emergency stop, as a forced arming does, too."""
    param1, command = _command(frame)
    if command == mavlink.MAV_CMD_DO_FLIGHTTERMINATION:
        return not param1 > 0.5
    return command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM and param1 != 0.0


def _command(frame: MavFrame) -> tuple[float, int]:
    """Return parameter 1 and the number of a command; 0 for a frame that is none."""
    if frame.number not in COMMANDS:
        return 0.0, 0
    header = HEADER_V1 if frame.is_mavlink1 else HEADER_SIZE
    payload = frame.data[header : header + frame.data[1]].ljust(STOP_LAYOUT.size, b"\0")
    param1, command = STOP_LAYOUT.unpack_from(payload)
    return param1, command


def begins_with_frame(data: bytes) -> bool:
    """Return whether the first bytes are a complete frame with the right checksum."""
    size = _size(data, 0) if data[:1] and data[0] in STARTS else 0
    if not 0 < size <= len(data):
        return False
    frame = _parsed(data[:size])
    known = mavlink.mavlink_map.get(frame.number)
    return known is not None and _is_intact(frame, known.crc_extra)


class Deframer:
    """The waiting bytes of one client; `malformed`, `unknown` and `dropped` count faults.

    `allowance` is the number of positions that may be examined before it is raised again. With
    `begins` the first bytes have to be a frame: otherwise `is_foreign` becomes True, and nothing
    is taken any more.
    """

    def __init__(self, *, begins: bool = False) -> None:
        self.malformed = self.unknown = self.dropped = self.allowance = 0
        self.is_foreign = False
        self._begins = begins
        self._waiting = bytearray()
        self._unfinished_ns: int | None = None
        self._passed = 0
        """Bytes that no longer wait."""
        self._is_searched = False
        """Whether the waiting bytes have been searched for a stop behind an unfinished frame."""
        self._judged: set[int] = set()
        """The places there that were found to be no stop, in bytes since the beginning."""
        self._taken: set[int] = set()
        """The places of the stops that were found there."""

    def feed(self, data: bytes) -> None:
        """Add received bytes; drop those for which there is no room."""
        room = MAX_WAITING - len(self._waiting)
        self.dropped += max(0, len(data) - room)
        self._waiting += data[:room]
        self._is_searched = False

    def take(self, now_ns: int) -> list[MavFrame]:
        """Return the next frames, as many as the allowance permits; the rest waits."""
        found: list[MavFrame] = []
        if self.allowance <= 0:
            return found
        waiting, at = bytes(self._waiting), 0
        while self.allowance > 0 and not self.is_foreign:
            start = _next_start(waiting, at)
            if self._begins and start > at:
                self._wrong(at)
                break
            at = start
            size = _size(waiting, at)
            if size == 0 or at + size > len(waiting):
                if at < len(waiting) and not _is_possible(waiting, at):
                    self.allowance -= 1
                    at = self._wrong(at)
                    continue
                self._find_stops_behind(waiting, at, found)
                if not self._is_overdue(at, len(waiting), now_ns):
                    break
                at = self._wrong(at)
                continue
            self._unfinished_ns = None
            self.allowance -= 1
            at = self._frame(waiting, at, size, found)
        del self._waiting[:at]
        self._passed += at
        if at:
            self._judged = {place for place in self._judged if place >= self._passed}
            self._taken = {place for place in self._taken if place >= self._passed}
        return found

    def _find_stops_behind(self, waiting: bytes, at: int, found: list[MavFrame]) -> None:
        """Add the emergency stops behind an unfinished frame, each of them once.

        All bytes stay where they are: a frame that is carried by another one, as in a log that is
        uploaded, looks the same. It stops the robot without need, which is the lesser harm; the
        other messages there are still part of the outer frame.
        """
        if self._is_searched:
            return
        for start in COMMAND_START.finditer(waiting, at + 1):
            place, size = start.start(), _size(waiting, start.start())
            key = self._passed + place
            if key in self._judged or key in self._taken or place + size > len(waiting):
                continue
            if self.allowance <= 0:
                return
            self.allowance -= 1
            frame = _parsed(waiting[place : place + size])
            extra = mavlink.mavlink_map[frame.number].crc_extra
            if is_emergency_stop(frame) and _is_intact(frame, extra):
                self._taken.add(key)
                self._begins = False
                found.append(frame)
            else:
                self._judged.add(key)
        self._is_searched = True

    def _is_overdue(self, at: int, end: int, now_ns: int) -> bool:
        """Return whether the rest of the frame at a position has not arrived in time."""
        if at == end or self._begins:  # a first frame may be slow; false bytes are foreign at once
            self._unfinished_ns = None
            return False
        if self._unfinished_ns is None:
            self._unfinished_ns = now_ns
        return now_ns - self._unfinished_ns >= UNFINISHED_NS

    def _frame(self, waiting: bytes, at: int, size: int, found: list[MavFrame]) -> int:
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
        self._begins = False
        if not self._is_over(frame, self._passed + at):
            found.append(frame)
        return at + size

    def _is_over(self, frame: MavFrame, place: int) -> bool:
        """Return whether a frame was taken before, or would release a stop that was sent after it.

        It gets no answer then, and its client repeats it.
        """
        if not self._taken:
            return False
        return place in self._taken or (place < max(self._taken) and may_release(frame))

    def _wrong(self, at: int) -> int:
        self.malformed += 1
        self.is_foreign = self._begins
        return at + 1


def _next_start(data: bytes, at: int) -> int:
    """Return the position of the next byte that can start a frame, or the end."""
    if at < len(data) and data[at] in STARTS:
        return at
    places = (data.find(V1, at), data.find(V2, at))
    return min((place for place in places if place >= 0), default=len(data))


def _size(data: bytes, at: int) -> int:
    """Return the size of the frame at a position; 0 if its header is not complete."""
    if len(data) - at < 3:
        return 0
    if data[at] == V1:
        return HEADER_V1 + data[at + 1] + CHECKSUM_SIZE
    signature = SIGNATURE_SIZE if data[at + 2] & SIGNED else 0
    return HEADER_SIZE + data[at + 1] + CHECKSUM_SIZE + signature


def _is_possible(data: bytes, at: int) -> bool:
    """Return whether the header at a position, as far as it is there, can be that of a frame.

    Messages may be unknown here, and those of version 2 may have grown.
    """
    there = len(data) - at
    if data[at] == V2:
        return there < 3 or data[at + 2] & ~SIGNED == 0
    known = mavlink.mavlink_map.get(data[at + 5]) if there >= HEADER_V1 else None
    return known is None or data[at + 1] <= known.unpacker.size


def _parsed(data: bytes) -> MavFrame:
    if data[0] == V1:
        return MavFrame(data, data[5], data[2], data[3], data[4], is_signed=False)
    number = int.from_bytes(data[7:10], "little")
    return MavFrame(data, number, data[4], data[5], data[6], is_signed=bool(data[2] & SIGNED))


def _is_intact(frame: MavFrame, extra: int) -> bool:
    """Return whether the checksum is right, and no flag is set that changes the format."""
    data = frame.data
    if data[0] == V2 and data[2] & ~SIGNED:
        return False
    end = len(data) - CHECKSUM_SIZE - (SIGNATURE_SIZE if frame.is_signed else 0)
    crc = mcrf4xx(data[1:end] + bytes((extra,)))
    return crc == int.from_bytes(data[end : end + CHECKSUM_SIZE], "little")
