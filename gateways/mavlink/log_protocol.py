"""The LOG protocol: lists the recordings and sends them, byte for byte (row 49 of the list).

The FTP server sends the same recordings.
"""

import os
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from gateways.mavlink.mav_service import MavService, Pacing, Sender
from gateways.mavlink.mav_vehicle import MavVehicle
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.recording.catalogue import began
from ground.recording.log_reader import NAMED
from runtime.units import NS_PER_S, UINT32


class DataSource(Protocol):
    """Data of a fixed size."""

    @property
    def size(self) -> int:
        """The size in bytes."""

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes; none beyond the end. OSError if it cannot be read."""

    def close(self) -> None:
        """Release it."""


class BytesSource:
    """Bytes in memory."""

    def __init__(self, data: bytes) -> None:
        self._data = data

    @property
    def size(self) -> int:
        """The size in bytes."""
        return len(self._data)

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes."""
        return self._data[offset : offset + count]

    def close(self) -> None:
        """Keep nothing open."""


class FileSource:
    """A file, without bytes that are appended later. OSError if it cannot be opened."""

    def __init__(self, path: Path) -> None:
        self._fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        self.size = min(os.fstat(self._fd).st_size, UINT32)

    def read(self, offset: int, count: int) -> bytes:
        """Return at most `count` bytes."""
        return os.pread(self._fd, max(0, min(count, self.size - offset)), offset)

    def close(self) -> None:
        """Close the file."""
        os.close(self._fd)


SUFFIX: Final = ".tlog"
MAX_LISTED: Final = 1000
"""The number of newest recordings that are listed; a log number has 16 bits."""
FRESH_NS: Final = NS_PER_S
ARMED: Final = "disarm before you download logs"
"""Why neither LOG nor FTP reads a recording of an armed robot: a slow disk would hold up commands
and the operator's heartbeat, which share a thread with it."""


class Recording(NamedTuple):
    """A file; `began_s` is when its run began, in seconds since 1970 in UTC."""

    path: Path
    began_s: int
    size: int

    @property
    def name(self) -> str:
        """The name of the file."""
        return self.path.name


class Recordings:
    """The `.tlog` files of a robot in a folder; without a folder there are none."""

    def __init__(
        self, folder: Path | None, robot: str, is_armed: Callable[[], bool] = lambda: False
    ) -> None:
        self._is_armed = is_armed
        self._folder = folder
        self._robot = robot
        self._found: tuple[Recording, ...] = ()
        self._looked_ns: int | None = None

    def listed(self, now_ns: int) -> tuple[Recording, ...]:
        """Return the recordings, the oldest first; the list is at most a second old.

        While the robot is armed, it is that of the last look at the disk.
        """
        is_old = self._looked_ns is None or now_ns - self._looked_ns >= FRESH_NS
        if is_old and not self._is_armed():
            self._looked_ns = now_ns
            self._found = self._look()
        return self._found

    def find(self, name: str, now_ns: int) -> Recording | None:
        """Return the recording with a name."""
        return next((one for one in self.listed(now_ns) if one.name == name), None)

    def _look(self) -> tuple[Recording, ...]:
        if self._folder is None:
            return ()
        try:
            paths = [path for path in self._folder.iterdir() if self._is_ours(path)]
            found = [Recording(path, int(began(path).timestamp()), _size(path)) for path in paths]
        except OSError:
            return ()
        return tuple(sorted(found, key=lambda one: (one.began_s, one.name))[-MAX_LISTED:])

    def _is_ours(self, path: Path) -> bool:
        named = NAMED.match(path.stem)
        is_robots = named is not None and named["robot"] == self._robot
        return is_robots and path.suffix == SUFFIX and path.is_file() and not path.is_symlink()


def _size(path: Path) -> int:
    return min(path.stat().st_size, UINT32)


BLOCK: Final = 90
DATA_BYTES: Final = 122
ENTRY_BYTES: Final = 39
MAX_RANGES: Final = 64
LAST_BLOCKS: Final = 3
"""On a lossy line the last block of a range is sent this often. MAVSDK asks for missing blocks at
once when it has that block, and every 0.5 s without it.
"""
KEPT: Final = "recordings are not erased from here; see sidestep rec"
NO_LOG: Final = "no log {number}; ask for the list again"


@dataclass(slots=True)
class LogTransfer:
    """One open log, and the requested ranges of it: the next offset and the end of each."""

    number: int
    source: FileSource
    ranges: deque[tuple[int, int]] = field(default_factory=deque)


@dataclass(slots=True)
class LogClient:
    """The requests of one client; its log numbers remain those of its last list."""

    logs: tuple[Recording, ...] = ()
    entries: deque[int] = field(default_factory=deque)
    transfer: LogTransfer | None = None


class LogProtocol(MavService):
    """Answers LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_REQUEST_END and LOG_ERASE."""

    handles = (
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
        mavlink.MAVLINK_MSG_ID_LOG_ERASE,
    )

    def __init__(self, vehicle: MavVehicle, recordings: Recordings, pacing: Pacing) -> None:
        self._vehicle = vehicle
        self._recordings = recordings
        self._pacing = pacing
        self._refusals = vehicle.refusals
        self._clients: dict[int, LogClient] = {}

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Start or end a list or a download."""
        number = message.get_msgId()
        if number == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END:
            self._stop(sender.client)
        elif number == mavlink.MAVLINK_MSG_ID_LOG_ERASE:
            self._refusals.say(KEPT, sender.client, now_ns)
        elif self._vehicle.is_armed:
            self._refusals.say(ARMED, sender.client, now_ns)
        elif number == mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST:
            self._list(message, sender.client, now_ns)
        else:
            self._begin(message, sender.client, now_ns)

    def due(self, now_ns: int) -> None:
        """Send as much as the line of each client allows.

        End all downloads when the robot is armed.
        """
        is_armed = self._vehicle.is_armed
        for client, state in self._clients.items():
            if is_armed and (state.transfer is not None or state.entries):
                self._refusals.say(ARMED, client, now_ns)
                self._stop(client)
            self._send_entries(client, state, now_ns)
            self._send_data(client, state, now_ns)

    def forget(self, client: int) -> None:
        """Close the log of a client that has disconnected."""
        self._stop(client)
        self._clients.pop(client, None)

    def _stop(self, client: int) -> None:
        state = self._clients.get(client)
        if state is not None:
            state.entries.clear()
            if state.transfer is not None:
                state.transfer.source.close()
                state.transfer = None

    def _state(self, client: int, now_ns: int) -> LogClient:
        found = self._clients.get(client)
        if found is None:
            found = self._clients[client] = LogClient(self._recordings.listed(now_ns))
        return found

    def _list(self, message: MavMessage, client: int, now_ns: int) -> None:
        state = self._state(client, now_ns)
        state.logs = self._recordings.listed(now_ns)
        first, last = max(1, message.start), min(len(state.logs), message.end)
        state.entries = deque(range(first, last + 1))
        if not state.logs:
            self._vehicle.outbox.send(mavlink.MAVLink_log_entry_message(0, 0, 0, 0, 0), client)

    def _begin(self, message: MavMessage, client: int, now_ns: int) -> None:
        """Add a range; a range of another log ends the download of the previous log."""
        state = self._state(client, now_ns)
        if state.transfer is None or state.transfer.number != message.id:
            self._stop(client)
            state.transfer = self._opened(state, message.id)
        if state.transfer is None:
            self._refusals.say(NO_LOG.format(number=message.id), client, now_ns)
        elif len(state.transfer.ranges) < MAX_RANGES:
            state.transfer.ranges.append((message.ofs, message.ofs + message.count))

    def _opened(self, state: LogClient, number: int) -> LogTransfer | None:
        if not 1 <= number <= len(state.logs):
            return None
        try:
            return LogTransfer(number, FileSource(state.logs[number - 1].path))
        except OSError:
            return None

    def _send_entries(self, client: int, state: LogClient, now_ns: int) -> None:
        while state.entries and self._pacing.take(client, ENTRY_BYTES, now_ns):
            number, count = state.entries.popleft(), len(state.logs)
            log = state.logs[number - 1]
            entry = mavlink.MAVLink_log_entry_message(number, count, count, log.began_s, log.size)
            self._vehicle.answer(entry, client)

    def _send_data(self, client: int, state: LogClient, now_ns: int) -> None:
        transfer = state.transfer
        while transfer is not None and transfer.ranges:
            if not self._pacing.take(client, DATA_BYTES, now_ns):
                return
            offset, end = transfer.ranges.popleft()
            try:
                data = transfer.source.read(offset, min(BLOCK, end - offset))
            except OSError:
                data = b""
            padded = list(data.ljust(BLOCK, b"\0"))
            block = mavlink.MAVLink_log_data_message(transfer.number, offset, len(data), padded)
            is_last = len(data) < BLOCK or offset + BLOCK >= end
            is_lossy = client in self._vehicle.lossy
            for _ in range(LAST_BLOCKS if is_last and is_lossy else 1):
                self._vehicle.outbox.send(block, client)
            # A log that ends with a whole block is followed by an empty one, which marks the end.
            if len(data) == BLOCK and offset + BLOCK < end:
                transfer.ranges.appendleft((offset + BLOCK, end))
