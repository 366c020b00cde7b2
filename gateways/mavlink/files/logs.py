"""The LOG protocol: lists the recordings and sends them, byte for byte (row 49 of the list)."""

from collections import deque
from dataclasses import dataclass, field
from typing import Final

from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.files.pacing import Pacing
from gateways.mavlink.files.recordings import ARMED, Recording, Recordings
from gateways.mavlink.files.sources import FileSource
from gateways.mavlink.traffic import Sender
from gateways.mavlink.vehicle import Vehicle

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
class Transfer:
    """One open log, and the requested ranges of it: the next offset and the end of each."""

    number: int
    source: FileSource
    ranges: deque[tuple[int, int]] = field(default_factory=deque)


@dataclass(slots=True)
class LogClient:
    """The requests of one client; its log numbers remain those of its last list."""

    logs: tuple[Recording, ...] = ()
    entries: deque[int] = field(default_factory=deque)
    transfer: Transfer | None = None


class LogProtocol:
    """Answers LOG_REQUEST_LIST, LOG_REQUEST_DATA, LOG_REQUEST_END and LOG_ERASE."""

    handles = (
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_LIST,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_DATA,
        mavlink.MAVLINK_MSG_ID_LOG_REQUEST_END,
        mavlink.MAVLINK_MSG_ID_LOG_ERASE,
    )

    def __init__(self, vehicle: Vehicle, recordings: Recordings, pacing: Pacing) -> None:
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

    def _opened(self, state: LogClient, number: int) -> Transfer | None:
        if not 1 <= number <= len(state.logs):
            return None
        try:
            return Transfer(number, FileSource(state.logs[number - 1].path))
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
