"""Manual driving with a dead-man switch: steering lasts only while frames arrive."""

from protocol.wire.limits import MAX_TELEOP_TTL_MS
from protocol.wire.messages import Teleop
from robot.core.values import Twist, twist_of
from runtime.units import NS_PER_MS


class TeleopInput:
    """The newest teleop frame and its expiry; a frame with too long a validity is ignored."""

    def __init__(self) -> None:
        self._newest: Teleop | None = None
        self._until_ns = 0
        self._refused_ms = 0

    def receive(self, teleop: Teleop, sent_ns: int) -> str:
        """Take a frame sent at `sent_ns`; return why it is ignored, once for each new cause."""
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
        """Drop the frame, because another operator takes over."""
        self._newest = None

    def newest(self, now_ns: int) -> Teleop | None:
        """Return the frame in force, or None after its expiry."""
        return self._newest if now_ns < self._until_ns else None


def operator_twist(teleop: Teleop | None) -> Twist | None:
    """Return the twist the operator commands, or None without a frame in force."""
    return None if teleop is None else twist_of(teleop.speed_mm_s, teleop.yaw_rate_mrad_s)
