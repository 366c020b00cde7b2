"""From what a message carries to what the core is given, and nothing in between.

Host and trial both come through here, so neither can read a sense in its own way. A message is
anything with the fields of the dialect: the core knows no wire.
"""

from robot.core.typing_shim import Protocol
from robot.core.values import Goal, Scan, Twist, Wheels

NS_PER_MS = 1_000_000


class WheelMessage(Protocol):
    @property
    def time_ns(self) -> int: ...
    @property
    def left(self) -> int: ...
    @property
    def right(self) -> int: ...
    @property
    def bumper(self) -> int: ...


class ScanMessage(Protocol):
    @property
    def range_mm(self) -> "tuple[int, ...]": ...
    @property
    def ping_age_us(self) -> "tuple[int, ...]": ...
    @property
    def valid(self) -> int: ...
    @property
    def echo(self) -> int: ...


def now_ms_of(time_ns: int) -> int:
    """Milliseconds of a stamp in nanoseconds, cut, not rounded."""
    return time_ns // NS_PER_MS


def wheels_of(message: WheelMessage) -> Wheels:
    return Wheels(message.left, message.right, message.bumper, now_ms_of(message.time_ns))


def scan_of(message: ScanMessage, since_ms: int) -> Scan:
    """The scan as it is `since_ms` after it was taken: each ping is older by that."""
    age_ms = tuple([since_ms + age_us // 1000 for age_us in message.ping_age_us])
    return Scan(message.range_mm, age_ms, message.valid, message.echo)


def twist_of(speed_mm_s: int, yaw_rate_mrad_s: int) -> Twist:
    """How an operator steers, from the integers of the wire."""
    return Twist(speed_mm_s / 1000.0, yaw_rate_mrad_s / 1000.0)


def goal_of(
    x_mm: int,
    y_mm: int,
    heading_urad: int,
    heading_free: int,
    position_tolerance_mm: int,
    heading_tolerance_urad: int,
) -> Goal:
    return Goal(
        x_mm / 1000.0,
        y_mm / 1000.0,
        None if heading_free else heading_urad / 1e6,
        position_tolerance_mm / 1000.0,
        heading_tolerance_urad / 1e6,
    )
