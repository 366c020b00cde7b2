"""Whether the client in control is still there: any frame of it tells, and PING asks for one.

QGroundControl and MAVSDK answer PING. MAVProxy and most scripts answer nothing, and send one
HEARTBEAT a second.
"""

from typing import Final

from gateways.mavlink.traffic import Sender
from protocol.wire.limits import OPERATOR_LOST_MS
from runtime.units import NS_PER_MS, NS_PER_S

SILENCE_NS: Final = 3_500 * NS_PER_MS
"""Without a frame of the client for so long, the robot gets no heartbeat of its operator any more.
It misses it 1.5 s later, so that both together are the 5 s of ArduPilot's FS_GCS_TIMEOUT."""
PATIENCE_NS: Final = 7_000 * NS_PER_MS
"""The same on a line that loses frames, for a client that answers no PING. If a fifth of its
heartbeats is lost, four in a row are lost five times in an hour, and eight once in a week."""
LOST_NS: Final = OPERATOR_LOST_MS * NS_PER_MS
"""A client that is heard again within this time stays in control: the robot has not missed it."""
QUIET_NS: Final = 1_200 * NS_PER_MS
"""After this silence, longer than the time between two heartbeats, the client is asked by PING."""
ASK_NS: Final = 200 * NS_PER_MS
MAX_QUESTIONS: Final = 5
"""So often a new client in control is asked once a second, to learn whether it answers."""


class Presence:
    """What was heard of a client, `station`, since it took control."""

    def __init__(self, station: Sender, now_ns: int) -> None:
        self.station = station
        self.heard_ns = now_ns
        self._answers = False
        self._asked_ns = now_ns - NS_PER_S
        self.questions = 0

    def heard(self, now_ns: int) -> None:
        """Note a frame."""
        self.heard_ns = now_ns

    def answered(self) -> None:
        """Note an answer to PING."""
        self._answers = True

    def silent_ns(self, now_ns: int) -> int:
        """Return the time since the last frame."""
        return now_ns - self.heard_ns

    def limit_ns(self, *, is_lossy: bool) -> int:
        """Return the silence after which the client counts as gone, by the state of its line."""
        return PATIENCE_NS if is_lossy and not self._answers else SILENCE_NS

    def must_ask(self, now_ns: int, *, is_doubted: bool) -> bool:
        """Return whether to send a PING now; `is_doubted`: another one claims to be this client."""
        is_quiet = is_doubted or self.silent_ns(now_ns) >= QUIET_NS
        is_new = not self._answers and self.questions < MAX_QUESTIONS
        every_ns = ASK_NS if is_quiet else NS_PER_S
        if not (is_quiet or is_new) or now_ns - self._asked_ns < every_ns:
            return False
        self._asked_ns = now_ns
        self.questions += 1
        return True
