"""The FTP server: read-only, for several clients and files at once (rows 20, 21, 23 and 50).

The names of its virtual tree are looked up in lists, so no path leads outside of it. `@PARAM` and
`@MAV_LOG` are names that ground stations use. QGroundControl lists only files that end in `.bin` or
`.ulg` as logs, so in `@MAV_LOG` the recordings have `.bin` behind their names.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import islice
from typing import Final, NamedTuple

from gateways.mavlink.ftp_messages import (
    FRAME_BYTES,
    HEADER,
    MAX_DATA,
    WRITING,
    Failure,
    FileRequest,
    Key,
    Opcode,
    checksum,
    request_in,
)
from gateways.mavlink.log_protocol import (
    ARMED,
    BytesSource,
    DataSource,
    FileSource,
    Recording,
    Recordings,
)
from gateways.mavlink.mav_service import MavService, Pacing, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.parameter_protocol import ParameterStore
from gateways.mavlink.parameter_table import (
    GENERAL_NAME,
    PARAMETERS_NAME,
    MavTable,
    Selection,
    packed,
    selection_in,
)
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

PARAMETERS_FOLDER, PACKED_NAME = "@PARAM", "param.pck"
LOGS_FOLDER, LOG_SUFFIX = "@MAV_LOG", ".bin"
RECORDINGS_FOLDER: Final = "recordings"
FOLDERS: Final = (LOGS_FOLDER, PARAMETERS_FOLDER, RECORDINGS_FOLDER)


class FileEntry(NamedTuple):
    """A line of a listing; `time_s` is since 1970, 0 if it is unknown."""

    name: str
    size: int = 0
    time_s: int = 0
    is_folder: bool = False

    def line(self, *, with_time: bool) -> bytes:
        """Return it as FTP lists it."""
        kind = "D" if self.is_folder else "F"
        parts = [kind + self.name]
        if with_time or not self.is_folder:
            parts.append(str(self.size))
        if with_time:
            parts.append(str(self.time_s))
        return "\t".join(parts).encode()


class VirtualTree:
    """The files of one vehicle."""

    def __init__(self, store: ParameterStore, recordings: Recordings) -> None:
        self._store = store
        self._recordings = recordings
        self._entries: dict[str, tuple[Sequence[Recording], list[FileEntry]]] = {}

    def entries(self, path: str, now_ns: int) -> Sequence[FileEntry] | None:
        """Return what a folder contains, None if there is no such folder."""
        match path.strip("/"):
            case "" | ".":
                return [*(FileEntry(name, is_folder=True) for name in FOLDERS), *self._metadata()]
            case "@PARAM":
                table = self._store.values
                size = 0 if table is None else len(packed(table, Selection()) or b"")
                return [FileEntry(PACKED_NAME, size)]
            case "@MAV_LOG":
                return self._logs(LOG_SUFFIX, now_ns)
            case "recordings":
                return self._logs("", now_ns)
        return None

    async def open(self, path: str, now_ns: int) -> DataSource | Failure:
        """Return a file, or the reason of a failure."""
        name, _, query = path.removeprefix("/").partition("?")
        folder, slash, file = name.partition("/")
        try:
            if name in (GENERAL_NAME, PARAMETERS_NAME):
                await self._store.known(now_ns)
                return self._described(name)
            if name == f"{PARAMETERS_FOLDER}/{PACKED_NAME}":
                return _packed(await self._store.latest(now_ns), selection_in(query))
        except RemoteError:
            return Failure.FAIL
        if slash and folder == RECORDINGS_FOLDER:
            return self._recording(file, now_ns)
        if slash and folder == LOGS_FOLDER and file.endswith(LOG_SUFFIX):
            return self._recording(file.removesuffix(LOG_SUFFIX), now_ns)
        return Failure.FILE_NOT_FOUND

    def _metadata(self) -> list[FileEntry]:
        found = self._store.metadata
        if found is None:
            return []
        sizes = {GENERAL_NAME: len(found.general), PARAMETERS_NAME: len(found.parameters)}
        return [FileEntry(name, size) for name, size in sizes.items()]

    def _logs(self, suffix: str, now_ns: int) -> list[FileEntry]:
        """Return the entries of all recordings, which are made once for each new list."""
        found = self._recordings.listed(now_ns)
        before, entries = self._entries.get(suffix, (None, []))
        if before is not found:
            entries = [FileEntry(one.name + suffix, one.size, one.began_s) for one in found]
            self._entries[suffix] = found, entries
        return entries

    def _described(self, name: str) -> DataSource | Failure:
        found = self._store.metadata
        if found is None:
            return Failure.FAIL
        return BytesSource(found.general if name == GENERAL_NAME else found.parameters)

    def _recording(self, name: str, now_ns: int) -> DataSource | Failure:
        found = self._recordings.find(name, now_ns)
        if found is None:
            return Failure.FILE_NOT_FOUND
        try:
            return FileSource(found.path)
        except OSError:
            return Failure.FAIL


def _packed(table: MavTable, selection: Selection | None) -> DataSource | Failure:
    data = None if selection is None else packed(table, selection)
    return Failure.FAIL if data is None else BytesSource(data)


MAX_OF_CLIENT: Final = 8
MAX_OPEN: Final = 64
IDLE_NS: Final = 3 * NS_PER_S
"""A session that is idle for this long may be closed to make room for another client."""
GONE_NS: Final = 20 * NS_PER_S
MAX_BURST: Final = 2000
"""Replies to one request; then the client must send a new request."""


@dataclass(slots=True)
class Burst:
    """A file that is being sent: the request, the next offset, and how much has been sent."""

    request: FileRequest
    offset: int
    block: int
    sent: int = 0


@dataclass(slots=True)
class FileSession:
    """An open file."""

    source: DataSource
    used_ns: int
    burst: Burst | None = field(default=None)


class Sessions:
    """The sessions of all clients, the least recently used first."""

    def __init__(self) -> None:
        self.open: dict[Key, FileSession] = {}

    def add(self, key: Key, source: DataSource, now_ns: int) -> bool:
        """Keep an open file; close another one if there are too many, False if none may be."""
        self.close(key)
        own = [other for other in self.open if other.client == key.client]
        if len(own) >= MAX_OF_CLIENT:
            self.close(own[0])
        elif len(self.open) >= MAX_OPEN:
            oldest = next(iter(self.open))
            if now_ns - self.open[oldest].used_ns < IDLE_NS:
                return False
            self.close(oldest)
        self.open[key] = FileSession(source, now_ns)
        return True

    def use(self, key: Key, now_ns: int) -> FileSession | None:
        """Return a session, and note its use."""
        found = self.open.pop(key, None)
        if found is not None:
            found.used_ns = now_ns
            self.open[key] = found
        return found

    def close(self, key: Key) -> None:
        """Close a session, if it is open."""
        found = self.open.pop(key, None)
        if found is not None:
            found.source.close()

    def close_program(self, key: Key) -> None:
        """Close all sessions of the program that a key names."""
        self._close_all([other for other in self.open if other[:3] == key[:3]])

    def close_client(self, client: int) -> None:
        """Close all sessions of a client that has disconnected."""
        self._close_all([key for key in self.open if key.client == client])

    def close_unused(self, now_ns: int) -> None:
        """Close sessions that have been idle for too long."""
        unused = [key for key, one in self.open.items() if now_ns - one.used_ns >= GONE_NS]
        self._close_all(unused)

    def _close_all(self, keys: list[Key]) -> None:
        for key in keys:
            self.close(key)


CHECKED_BYTES: Final = 1 << 19
"""Bytes of files whose checksum is computed in one round."""
MAX_CHECKS: Final = 16


@dataclass(slots=True)
class RunningChecksum:
    """A checksum that is being computed."""

    request: FileRequest
    source: DataSource
    offset: int = 0
    value: int = 0


class FileServer(MavService):
    """Answers FILE_TRANSFER_PROTOCOL."""

    handles = (mavlink.MAVLINK_MSG_ID_FILE_TRANSFER_PROTOCOL,)

    def __init__(self, vehicle: MavVehicle, tree: VirtualTree, pacing: Pacing) -> None:
        self._vehicle = vehicle
        self._tree = tree
        self._pacing = pacing
        self._sessions = Sessions()
        self._checks: dict[Key, RunningChecksum] = {}
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
        self._send(request.reply(Opcode.ACK, data, offset), request)

    def _fail(self, request: FileRequest, failure: Failure) -> None:
        self._send(request.failed(failure), request)

    def _send(self, reply: MavMessage, request: FileRequest) -> None:
        """Send a reply; clients know a copy by its sequence number."""
        self._vehicle.answer(reply, request.sender.client)

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
            self._vehicle.start(self._open_file(path, request))

    async def _open_file(self, path: str, first: FileRequest) -> None:
        """Answer the newest request for this file, unless the client has asked for another one."""
        found = await self._tree.open(path, self._now_ns)
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

    def _begin_check(self, request: FileRequest, found: DataSource) -> None:
        older = self._checks.pop(request.key, None)
        if older is not None:
            older.source.close()
        if len(self._checks) < MAX_CHECKS:
            self._checks[request.key] = RunningChecksum(request, found)
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
            if not self._pacing.take(client, length * self._vehicle.copies(client), self._now_ns):
                return
            data = self._bytes(session, burst.offset, burst.block)
            if not data:
                session.burst = None
                self._send(burst.request.failed(Failure.FAIL, burst.sent), burst.request)
                return
            is_last = burst.offset + len(data) >= size or burst.sent + 1 >= MAX_BURST
            reply = burst.request.reply(Opcode.ACK, data, burst.offset, burst.sent, last=is_last)
            self._send(reply, burst.request)
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

    def _read_from(self, source: DataSource, offset: int, count: int) -> bytes:
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
