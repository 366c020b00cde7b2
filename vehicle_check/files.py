"""A client of MAVLink FTP, as in MAVProxy and QGroundControl: bursts, then missing blocks."""

from struct import Struct
from typing import Final, NamedTuple

from runtime.units import NS_PER_S
from vehicle_check.dialect import mavlink
from vehicle_check.session import Client

TERMINATE: Final = 1
RESET: Final = 2
LIST: Final = 3
OPEN: Final = 4
READ: Final = 5
CRC32: Final = 14
BURST: Final = 15
ACK: Final = 128
NAK: Final = 129
END_OF_FILE: Final = 6
FILE_NOT_FOUND: Final = 10
HEADER: Final = Struct("<HBBBBBxI")
MAX_DATA: Final = 239
MAX_FILE: Final = 4_000_000
QUIET_S: Final = 0.3


class Reply(NamedTuple):
    """An answer of the server."""

    sequence: int
    session: int
    opcode: int
    size: int
    request: int
    is_last: bool
    offset: int
    data: bytes

    @property
    def is_ack(self) -> bool:
        """True unless the server refuses."""
        return self.opcode == ACK

    @property
    def error(self) -> int:
        """The code of a refusal."""
        return self.data[0] if self.opcode == NAK and self.data else 0


def reply_of(payload: list[int]) -> Reply:
    """Return the fields of a payload."""
    raw = bytes(payload)
    sequence, session, opcode, size, request, last, offset = HEADER.unpack_from(raw)
    data = raw[HEADER.size : HEADER.size + min(size, MAX_DATA)]
    return Reply(sequence, session, opcode, size, request, bool(last), offset, data)


class FileClient:
    """FTP of one ground station."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self._sequence = 0

    def request(
        self, opcode: int, data: bytes = b"", *, session: int = 0, offset: int = 0, size: int = 0
    ) -> Reply | None:
        """Send a request and return its answer; repeat it with the same number if frames drop."""
        self._sequence = (self._sequence + 1) & 0xFFFF
        expected = (self._sequence + 1) & 0xFFFF
        message = self._message(opcode, data, session, offset, size)
        within_s = 0.25 if self._client.station.is_lossy else 1.0

        def is_answer(one: object) -> bool:
            reply = reply_of(one.payload)  # type: ignore[attr-defined]
            return reply.sequence == expected and reply.request == opcode

        found = self._client.ask(message, "FILE_TRANSFER_PROTOCOL", is_answer, within_s)
        self._sequence = expected
        return None if found is None else reply_of(found.message.payload)

    def fetch(
        self, path: str, chunk: int = MAX_DATA, within_s: float = 5.0, at_most: int | None = None
    ) -> bytes | None:
        """Return a whole file or its start, None if it cannot be read in time."""
        end_ns = self._client.station.now_ns + round(within_s * NS_PER_S)
        opened = self.request(OPEN, path.encode())
        if opened is None or not opened.is_ack or len(opened.data) < 4:
            return None
        size = int.from_bytes(opened.data[:4], "little")
        if at_most is not None and size > at_most:
            found = self._filled(opened.session, {}, at_most, end_ns)
            self.request(TERMINATE, session=opened.session)
            return found
        if size > MAX_FILE:
            return None
        parts = self.burst(opened.session, size, chunk)
        found = self._filled(opened.session, parts, size, end_ns)
        self.request(TERMINATE, session=opened.session)
        return found

    def burst(self, session: int, size: int, chunk: int) -> dict[int, bytes]:
        """Request a burst from the start; return the blocks that arrive, by offset."""
        parts: dict[int, bytes] = {}
        self._sequence = (self._sequence + 1) & 0xFFFF
        since = self._client.mark()
        self._client.send(self._message(BURST, b"", session, 0, chunk))
        name = "FILE_TRANSFER_PROTOCOL"
        while sum(map(len, parts.values())) < size:
            if self._client.expect(name, QUIET_S, since=since) is None:
                break
            arrived, since = self._client.heard(name, since), self._client.mark()
            for one in arrived:
                reply = reply_of(one.message.payload)
                if reply.is_ack and reply.request == BURST and reply.data:
                    parts[reply.offset] = reply.data
        self._sequence = (self._sequence + 4096) & 0xFFFF
        return parts

    def _filled(
        self, session: int, parts: dict[int, bytes], size: int, end_ns: int
    ) -> bytes | None:
        found = bytearray()
        while len(found) < size:
            offset = len(found)
            part = parts.get(offset)
            if part is None:
                if self._client.station.now_ns > end_ns:
                    return None
                wanted = min(MAX_DATA, size - offset)
                reply = self.request(READ, session=session, offset=offset, size=wanted)
                if reply is None or not reply.is_ack or not reply.data:
                    return None
                part = reply.data
            found += part
        return bytes(found)

    def _message(self, opcode: int, data: bytes, session: int, offset: int, size: int) -> object:
        length = len(data) if data else size
        head = HEADER.pack(self._sequence, session, opcode, min(length, 255), 0, 0, offset)
        payload = list((head + data).ljust(251, b"\0"))
        station = self._client.station
        target = station.address
        return mavlink.MAVLink_file_transfer_protocol_message(0, *target, payload)
