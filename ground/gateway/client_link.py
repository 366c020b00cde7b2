"""One peer of an endpoint: framing in both directions, and what is counted about it."""

from typing import Any, Final

from ground.gateway.dialect import MavMessage, mavlink
from ground.gateway.traffic import COMPONENT

GONE_NS: Final = 10_000_000_000
MAVLINK_1_IDS: Final = 256


class NoFile:
    """The output of a parser that never sends."""

    def write(self, data: bytes) -> None:
        """Ignore the bytes."""


class ClientLink:
    """Frames from and to one client. A sequence of its own for each vehicle, so without gaps."""

    def __init__(self, number: int, name: str, now_ns: int, *, is_loopback: bool) -> None:
        self.number = number
        self.name = name
        self.is_loopback = is_loopback
        self.heard_ns = now_ns
        self.received = self.sent = self.lost = self.malformed = 0
        self.is_mavlink1 = False
        self._parser = mavlink.MAVLink(NoFile())
        self._parser.robust_parsing = True
        self._encoders: dict[int, Any] = {}
        self._sequences: dict[tuple[int, int], int] = {}

    def decode(self, data: bytes, now_ns: int) -> list[MavMessage]:
        """Return the messages in received bytes; count what is malformed or unknown."""
        self.heard_ns = now_ns
        found = []
        for message in self._parser.parse_buffer(data) or ():
            if message.get_msgId() < 0 or message.get_type().startswith("UNKNOWN_"):
                self.malformed += 1
                continue
            self._count(message)
            found.append(message)
        return found

    def encode(self, system: int, message: MavMessage) -> bytes:
        """Return the next frame of a vehicle; empty if MAVLink 1 cannot carry the message."""
        if self.is_mavlink1 and message.get_msgId() >= MAVLINK_1_IDS:
            return b""
        encoder = self._encoders.get(system)
        if encoder is None:
            encoder = self._encoders[system] = mavlink.MAVLink(NoFile(), system, COMPONENT)
        frame: bytes = message.pack(encoder, force_mavlink1=self.is_mavlink1)
        encoder.seq = (encoder.seq + 1) & 0xFF
        self.sent += 1
        return frame

    def _count(self, message: MavMessage) -> None:
        self.received += 1
        self.is_mavlink1 = message.get_msgbuf()[0] == mavlink.PROTOCOL_MARKER_V1
        source = (message.get_srcSystem(), message.get_srcComponent())
        expected = self._sequences.get(source)
        sequence = message.get_seq()
        if expected is not None:
            self.lost += (sequence - expected) & 0xFF
        self._sequences[source] = (sequence + 1) & 0xFF
