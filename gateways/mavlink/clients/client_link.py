"""One peer of an endpoint: framing in both directions, and counters."""

from collections.abc import Callable
from typing import Any, Final

from gateways.mavlink.clients.framing import Deframer, Frame
from gateways.mavlink.dialect import MavMessage, mavlink
from gateways.mavlink.signing.guard import SigningGuard
from gateways.mavlink.signing.policy import Counters
from gateways.mavlink.traffic import COMPONENT

GONE_NS: Final = 10_000_000_000
MAVLINK_1_IDS: Final = 256
MAX_SOURCES: Final = 32
"""Senders behind one client whose sequences are followed."""
LATE: Final = 0xF0
"""A sequence number so far ahead is rather some behind: the frame was overtaken, or is a copy."""
LOSSY_SHARE: Final = 0.05
FADING: Final = 0.97
"""The weight that older frames lose with each new one; about the last 30 decide."""


class NoFile:
    """The output of a parser that never sends."""

    def write(self, data: bytes) -> None:
        """Ignore the bytes."""


class ClientLink:
    """Frames from and to one client.

    Each vehicle has its own sequence numbers, so they have no gaps. With `begins` what it sends has
    to begin with a frame.
    """

    def __init__(self, number: int, name: str, now_ns: int, *, begins: bool = False) -> None:
        self.number = number
        self.name = name
        self.heard_ns = now_ns
        self.received = self.sent = self.lost = 0
        self.is_mavlink1 = self.is_introduced = False
        self.signing = Counters()
        self._deframer = Deframer(begins=begins)
        self._ready: list[Frame] = []
        self._decoder = mavlink.MAVLink(NoFile())
        self._encoders: dict[int, Any] = {}
        self._sequences: dict[tuple[int, int], int] = {}
        self._recently_lost = self._recent = 0.0

    @property
    def is_lossy(self) -> bool:
        """Whether the line has lost a notable share of the newest frames from the client."""
        return self._recently_lost > LOSSY_SHARE * self._recent

    @property
    def malformed(self) -> int:
        """The number of byte sequences that were no frame, or a frame of an unknown message."""
        return self._deframer.malformed + self._deframer.unknown

    @property
    def is_foreign(self) -> bool:
        """Whether the first bytes were no frame: another program than a MAVLink client."""
        return self._deframer.is_foreign

    @property
    def dropped(self) -> int:
        """The number of received bytes that were dropped because the buffer was full."""
        return self._deframer.dropped

    def feed(self, data: bytes) -> None:
        """Add received bytes."""
        self._deframer.feed(data)

    def has_frame(self, now_ns: int, accepts: Callable[[Frame], bool] = lambda _: True) -> bool:
        """Return whether such a frame is among the received bytes; it stays for `frames`."""
        self._ready += self._deframer.take(now_ns)
        return any(accepts(frame) for frame in self._ready)

    def allow(self, frames: int) -> None:
        """Permit this many frames until the next call."""
        self._deframer.allowance = frames

    def frames(self, now_ns: int) -> list[Frame]:
        """Return the waiting frames, at most as many as permitted."""
        ready, self._ready = self._ready, []
        found = ready + self._deframer.take(now_ns)
        for frame in found:
            self._count(frame)
            self.heard_ns = now_ns
        return found

    def decode(self, frame: Frame) -> MavMessage | None:
        """Return the message in a frame; answer in its version, in version 2 to one that signs."""
        try:
            message = self._decoder.decode(bytearray(frame.data))
        except mavlink.MAVError:
            self._deframer.malformed += 1
            return None
        self.is_mavlink1 = frame.is_mavlink1 and not self.signing.signed
        return message

    def encode(self, system: int, message: MavMessage, guard: SigningGuard) -> bytes:
        """Return the next frame of a vehicle; empty if MAVLink 1 cannot carry the message."""
        if self.is_mavlink1 and message.get_msgId() >= MAVLINK_1_IDS:
            return b""
        encoder = self._encoders.get(system)
        if encoder is None:
            encoder = self._encoders[system] = mavlink.MAVLink(NoFile(), system, COMPONENT)
        guard.prepare(encoder)
        frame: bytes = message.pack(encoder, force_mavlink1=self.is_mavlink1)
        encoder.seq = (encoder.seq + 1) & 0xFF
        self.sent += 1
        return frame

    def _count(self, frame: Frame) -> None:
        self.received += 1
        source = (frame.system, frame.component)
        expected = self._sequences.get(source)
        if expected is None and len(self._sequences) >= MAX_SOURCES:
            return
        gap = 0 if expected is None else (frame.sequence - expected) & 0xFF
        if gap >= LATE:  # it was counted as lost
            gap = -1 if self.lost else 0
        else:
            self._sequences[source] = (frame.sequence + 1) & 0xFF
        self.lost += gap
        self._recently_lost = max(0.0, FADING * self._recently_lost + gap)
        self._recent = FADING * self._recent + 1 + gap
