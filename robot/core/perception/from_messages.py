"""Convert messages to inputs of the core.

Host and trial both use these functions, so that the core gets the same inputs. A message is any
object with the fields of the dialect: the core does not depend on the wire format.
"""

from typing import Protocol

from robot.core.values import Goal, Scan, Twist, Wheels

NS_PER_MS = 1_000_000


class WheelMessage(Protocol):
    """Fields of a message with wheel data."""

    @property
    def time_ns(self) -> int:
        """Stamp in nanoseconds."""

    @property
    def left(self) -> int:
        """Counter of the left encoder."""

    @property
    def right(self) -> int:
        """Counter of the right encoder."""

    @property
    def bumper(self) -> int:
        """Bit mask of pressed bumper sectors."""


class ScanMessage(Protocol):
    """Fields of a message with a sonar scan."""

    @property
    def range_mm(self) -> "tuple[int, ...]":
        """Ranges from the robot's rim."""

    @property
    def ping_age_us(self) -> "tuple[int, ...]":
        """Age of each ping when the scan was sent."""

    @property
    def valid(self) -> int:
        """Bit mask of sonars that measured."""

    @property
    def echo(self) -> int:
        """Bit mask of sonars with an echo."""


def now_ms_of(time_ns: int) -> int:
    """Convert nanoseconds to whole milliseconds, truncated."""
    return time_ns // NS_PER_MS


def wheels_of(message: WheelMessage) -> Wheels:
    """Return the core's input from wheel data."""
    return Wheels(message.left, message.right, message.bumper, now_ms_of(message.time_ns))


def scan_of(message: ScanMessage, since_ms: int) -> Scan:
    """Return the core's input from a scan; each ping is `since_ms` older now."""
    age_ms = tuple([since_ms + age_us // 1000 for age_us in message.ping_age_us])
    return Scan(message.range_mm, age_ms, message.valid, message.echo)


def twist_of(speed_mm_s: int, yaw_rate_mrad_s: int) -> Twist:
    """Return the twist that an operator commands."""
    return Twist(speed_mm_s / 1000.0, yaw_rate_mrad_s / 1000.0)


def goal_of(
    x_mm: int,
    y_mm: int,
    heading_urad: int,
    heading_free: int,
    position_tolerance_mm: int,
    heading_tolerance_urad: int,
) -> Goal:
    """Return the goal in a request."""
    return Goal(
        x_mm / 1000.0,
        y_mm / 1000.0,
        None if heading_free else heading_urad / 1e6,
        position_tolerance_mm / 1000.0,
        heading_tolerance_urad / 1e6,
    )
