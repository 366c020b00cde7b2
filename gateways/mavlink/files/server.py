"""The FTP server: read-only, for several clients and files at once (rows 20, 21, 23 and 50)."""

from dataclasses import dataclass
from itertools import islice
from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.files.checksum import checksum
from gateways.mavlink.files.pacing import Pacing
from gateways.mavlink.files.recordings import ARMED
from gateways.mavlink.files.sessions import MAX_BURST, Burst, FileSession, Sessions
from gateways.mavlink.files.sources import FileSource, Source
from gateways.mavlink.files.tree import VirtualTree
from gateways.mavlink.files.wire import (
    FRAME_BYTES,
    HEADER,
    MAX_DATA,
    WRITING,
    Failure,
    FileRequest,
    Key,
    Opcode,
    request_in,
)
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle

CHECKED_BYTES: Final = 1 << 19
"""Bytes of files whose checksum is computed in one round."""
MAX_CHECKS: Final = 16


@dataclass(slots=True)
class Check:
    """A checksum that is being computed."""

    request: FileRequest
    source: Source
    offset: int = 0
    value: int = 0


class FileServer:
    """Answers FILE_TRANSFER_PROTOCOL."""

    handles = (mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,)

    def __init__(self, vehicle: Vehicle, tree: VirtualTree, pacing: Pacing) -> None:
        self._vehicle = vehicle
        self._outbox = vehicle.outbox
        self._tree = tree
        self._pacing = pacing
        self._sessions = Sessions()
        self._checks: dict[Key, Check] = {}
        self._opening: dict[Key, FileRequest] = {}
        self._now_ns = 0

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Execute a request."""
        self._now_ns = now_ns
        request = request_in(message, sender)
        if request.size > MAX_DATA:
            self._fail(request, Failure.INVALID_DATA_SIZE)
            return
        match request.opcode:
            case Opcode.ACK | Opcode.NAK:
                pass
            case Opcode.NONE:
                self._reply(request)
            case Opcode.TERMINATE:
                self._close(request)
            case Opcode.RESET:
                self._sessions.close_program(request.key)
                self._reply(request)
            case Opcode.LIST | Opcode.LIST_WITH_TIME:
                self._list(request)
            case Opcode.OPEN | Opcode.CHECKSUM:
                self._open(request)
            case Opcode.READ:
                self._read(request)
            case Opcode.BURST:
                self._begin_burst(request)
            case number:
                is_write = number in WRITING
                why = Failure.FILE_PROTECTED if is_write else Failure.UNKNOWN_COMMAND
                self._fail(request, why)

    def due(self, now_ns: int) -> None:
        """Continue bursts and checksums; close unused files."""
        self._now_ns = now_ns
        for session in list(self._sessions.open.values()):
            self._go_on(session)
        self._check()
        self._sessions.close_unused(now_ns)

    def forget(self, client: int) -> None:
        """Close the files of a client that has disconnected."""
        self._sessions.close_client(client)
        for key in [key for key in self._checks if key.client == client]:
            self._checks.pop(key).source.close()
        for key in [key for key in self._opening if key.client == client]:
            del self._opening[key]

    def _reply(self, request: FileRequest, data: bytes = b"", offset: int = 0) -> None:
        self._outbox.send(request.reply(Opcode.ACK, data, offset), request.sender.client)

    def _fail(self, request: FileRequest, failure: Failure) -> None:
        self._outbox.send(request.failed(failure), request.sender.client)

    def _close(self, request: FileRequest) -> None:
        """Close a session.

        A missing session is no error: the reply to an earlier request may have been lost.
        """
        self._sessions.close(request.key)
        self._reply(request)

    def _list(self, request: FileRequest) -> None:
        entries = self._tree.entries(request.path or "", self._now_ns)
        if entries is None:
            self._fail(request, Failure.FILE_NOT_FOUND)
            return
        data, with_time = b"", request.opcode == Opcode.LIST_WITH_TIME
        for entry in islice(entries, request.offset, None):
            line = entry.line(with_time=with_time) + b"\0"
            if len(data) + len(line) > MAX_DATA:
                break
            data += line
        if data:
            self._reply(request, data, request.offset)
        else:
            self._fail(request, Failure.END_OF_FILE)

    def _open(self, request: FileRequest) -> None:
        """Open a file for reading or for its checksum; a repeated request only waits."""
        path, key = request.path, request.key
        check, waiting = self._checks.get(key), self._opening.get(key)
        if path is None:
            self._fail(request, Failure.FILE_NOT_FOUND)
        elif check is not None and check.request.repeated_by(request):
            check.request = request
        elif waiting is not None and waiting.repeated_by(request):
            self._opening[key] = request
        else:
            self._opening[key] = request
            self._tree.open(path, lambda found: self._opened(request, found), self._now_ns)

    def _opened(self, first: FileRequest, found: Source | Failure) -> None:
        """Answer the newest request for this file, unless the client has asked for another one."""
        request = self._opening.get(first.key)
        if request is None or not first.repeated_by(request):
            if not isinstance(found, Failure):
                found.close()
            return
        del self._opening[first.key]
        if isinstance(found, FileSource) and self._vehicle.is_armed:
            found.close()
            self._vehicle.refusals.say(ARMED, request.sender.client, self._now_ns)
            found = Failure.FAIL
        if isinstance(found, Failure):
            self._fail(request, found)
        elif request.opcode == Opcode.CHECKSUM:
            self._begin_check(request, found)
        elif self._sessions.add(request.key, found, self._now_ns):
            self._reply(request, found.size.to_bytes(4, "little"))
        else:
            found.close()
            self._fail(request, Failure.NO_SESSIONS)

    def _begin_check(self, request: FileRequest, found: Source) -> None:
        older = self._checks.pop(request.key, None)
        if older is not None:
            older.source.close()
        if len(self._checks) < MAX_CHECKS:
            self._checks[request.key] = Check(request, found)
        else:
            found.close()
            self._fail(request, Failure.NO_SESSIONS)

    def _read(self, request: FileRequest) -> None:
        session = self._sessions.use(request.key, self._now_ns)
        if session is None:
            self._fail(request, Failure.INVALID_SESSION)
        elif not request.size:
            self._fail(request, Failure.INVALID_DATA_SIZE)
        else:
            data = self._bytes(session, request.offset, request.size)
            if data is None:
                self._fail(request, Failure.FAIL)
            elif not data:
                self._fail(request, Failure.END_OF_FILE)
            else:
                self._reply(request, data, request.offset)

    def _begin_burst(self, request: FileRequest) -> None:
        session = self._sessions.use(request.key, self._now_ns)
        if session is None:
            self._fail(request, Failure.INVALID_SESSION)
        elif request.offset >= session.source.size:
            session.burst = None
            self._fail(request, Failure.END_OF_FILE)
        else:
            session.burst = Burst(request, request.offset, request.size or MAX_DATA)
            self._go_on(session)

    def _go_on(self, session: FileSession) -> None:
        """Send as much of a burst as the client's line allows."""
        burst, size = session.burst, session.source.size
        while burst is not None:
            client = burst.request.sender.client
            length = FRAME_BYTES + HEADER.size + burst.block
            if not self._pacing.take(client, length, self._now_ns):
                return
            data = self._bytes(session, burst.offset, burst.block)
            if not data:
                session.burst = None
                self._outbox.send(burst.request.failed(Failure.FAIL, burst.sent), client)
                return
            is_last = burst.offset + len(data) >= size or burst.sent + 1 >= MAX_BURST
            reply = burst.request.reply(Opcode.ACK, data, burst.offset, burst.sent, last=is_last)
            self._outbox.send(reply, client)
            burst.offset += len(data)
            burst.sent += 1
            if is_last:
                session.burst = burst = None

    def _bytes(self, session: FileSession, offset: int, count: int) -> bytes | None:
        """Return bytes of an open file, None if it cannot be read."""
        try:
            return self._read_from(session.source, offset, count)
        except OSError:
            return None

    def _read_from(self, source: Source, offset: int, count: int) -> bytes:
        if isinstance(source, FileSource) and self._vehicle.is_armed:
            raise PermissionError(ARMED)
        return source.read(offset, count)

    def _check(self) -> None:
        """Continue the first checksum."""
        key, check = next(iter(self._checks.items()), (None, None))
        if key is None or check is None:
            return
        try:
            data = self._read_from(check.source, check.offset, CHECKED_BYTES)
        except OSError:
            data = b""
        check.value = checksum(data, check.value)
        check.offset += len(data)
        if data and check.offset < check.source.size:
            return
        del self._checks[key]
        check.source.close()
        if check.offset < check.source.size:
            self._fail(check.request, Failure.FAIL)
        else:
            self._reply(check.request, check.value.to_bytes(4, "little"))
