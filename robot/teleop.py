"""The dead man's handle: an operator steers for as long as frames keep coming, and no longer."""

from protocol.wire.limits import MAX_TELEOP_TTL_MS
from protocol.wire.messages import Teleop
from robot.core.perception.from_messages import twist_of
from robot.core.values import Twist
from runtime.units import NS_PER_MS


class TeleopInput:
    """The newest frame and until when it counts. A frame that would count too long is ignored."""

    def __init__(self) -> None:
        self._newest: Teleop | None = None
        self._until_ns = 0
        self._refused_ms = 0

    def receive(self, teleop: Teleop, sent_ns: int) -> str:
        """Take a frame that was sent then; return why it is ignored, once for each new cause."""
        ttl_ms = teleop.ttl_ms
        if ttl_ms > MAX_TELEOP_TTL_MS:
            again, self._refused_ms = ttl_ms == self._refused_ms, ttl_ms
            words = (
                f"teleop ignored: valid for {ttl_ms} ms, at most {MAX_TELEOP_TTL_MS} are allowed"
            )
            return "" if again else words
        self._newest = teleop
        self._until_ns = sent_ns + ttl_ms * NS_PER_MS
        self._refused_ms = 0
        return ""

    def clear(self) -> None:
        """Forget the frame: another operator takes over."""
        self._newest = None

    def newest(self, now_ns: int) -> Teleop | None:
        """Return the frame in force; None when its time is over."""
        return self._newest if now_ns < self._until_ns else None


def operator_twist(teleop: Teleop | None) -> Twist | None:
    """Return how the operator steers; None when there is no frame in force."""
    return None if teleop is None else twist_of(teleop.speed_mm_s, teleop.yaw_rate_mrad_s)
