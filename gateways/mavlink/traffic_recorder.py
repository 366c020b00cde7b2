"""Record the messages that the endpoints send and receive as a `.tlog` for every MAVLink tool.

Each message is recorded once, also if several clients receive it. The recording has its own
sequence numbers. A key is never recorded.
"""

from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from threading import Event, Thread
from typing import Any, Final

from gateways.mavlink.mav_service import COMPONENT
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from ground.recording.log_writer import FLUSH_NS, SYNC_EVERY, LogFile, LogWriter, new_log
from runtime.errors import UserError
from runtime.units import NS_PER_S

SECRET: Final = mavlink.MAVLINK_MSG_ID_SETUP_SIGNING
SUFFIX: Final = ".tlog"
NAME: Final = "mavlink"
"""Stands in the name of the file where recordings of a robot have its name."""


def new_file(path: Path) -> LogFile:
    """Create a file with this name, or in a folder one named after the time."""
    try:
        is_file = path.suffix == SUFFIX
        return LogFile(path) if is_file else new_log(path, NAME, datetime.now(UTC))
    except OSError as error:
        raise UserError(f"cannot record to {path}: {error.strerror or error}") from error


class TrafficRecorder:
    """Collects messages in the gateway's thread, and writes them in another thread."""

    def __init__(
        self, file: LogFile, utc_offset_ns: int, note: Callable[[str], None] = lambda _: None
    ) -> None:
        self.path = file.path
        self._note = note
        self._is_noted = False
        self._writer = LogWriter(file, utc_offset_ns)
        self._encoders: dict[int, Any] = {}
        self._ending = Event()
        self._thread = Thread(target=self._write, name="record traffic", daemon=True)
        self._thread.start()

    def sent(self, system: int, message: MavMessage, now_ns: int) -> None:
        """Record a message of a vehicle."""
        encoder = self._encoders.get(system)
        if encoder is None:
            encoder = self._encoders[system] = mavlink.MAVLink(None, system, COMPONENT)
        if message.get_msgId() != SECRET:
            self._take(message.pack(encoder), now_ns)
            encoder.seq = (encoder.seq + 1) & 0xFF

    def received(self, message: MavMessage, now_ns: int) -> None:
        """Record a message of a client; a frame of MAVLink 1 in the form of MAVLink 2."""
        if message.get_msgId() == SECRET:
            return
        frame = bytes(message.get_msgbuf())
        if frame[0] == mavlink.PROTOCOL_MARKER_V1:
            source = message.get_srcSystem(), message.get_srcComponent()
            encoder = mavlink.MAVLink(None, *source)
            encoder.seq = message.get_seq()
            frame = message.pack(encoder)
        self._take(frame, now_ns)

    def close(self) -> str:
        """Write the rest.

        Return a description of the lost messages, empty if the recording is complete.
        """
        self._ending.set()
        self._thread.join()
        if self._writer.close():
            return ""
        return f"{self.path}: {self._writer.dropped} messages lost: {self._writer.drop_reason}"

    def _take(self, frame: bytes, now_ns: int) -> None:
        self._writer.take(NAME, frame, now_ns)
        if not self._is_noted and (self._writer.error or self._writer.dropped):
            self._is_noted = True
            why = self._writer.error or self._writer.drop_reason
            self._note(f"{self.path}: messages wait or are lost ({why}); the gateway continues")

    def _write(self) -> None:
        rounds = 0
        while not self._ending.wait(FLUSH_NS / NS_PER_S):
            rounds += 1
            self._writer.flush()
            if rounds % SYNC_EVERY == 0:
                self._writer.sync()
