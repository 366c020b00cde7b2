"""Inputs and outputs of the core, their angles, and how messages become inputs.

Host and trial both use these functions, so that the core gets the same inputs. A message is any
object with the fields of the dialect: the core does not depend on the wire format.
"""

from math import pi
from typing import Final, NamedTuple, Protocol

from robot.core.ring import BEARINGS, SONARS
from runtime.elementary import cos, cos_sin, sin

EVERY: Final = tuple(range(SONARS))
"""Indices of all sonars; iterating over this tuple is cheaper than over a `range`."""

Pose = NamedTuple("Pose", [("x_m", float), ("y_m", float), ("heading_rad", float)])

Wheels = NamedTuple("Wheels", [("left", int), ("right", int), ("bumper", int), ("at_ms", int)])
"""Encoder counters and bumpers.

Counters have 32 bits and wrap. `bumper` has a bit for each pressed sector: 1 left, 2 right, 4 rear.
`at_ms` is the time of the sample on the sender's clock.
"""

Scan = NamedTuple(
    "Scan",
    [("range_mm", "tuple[int, ...]"), ("age_ms", "tuple[int, ...]"), ("valid", int), ("echo", int)],
)
"""One scan: ranges from the robot's rim, age of each ping, bit masks of measured and of echo."""

Inputs = NamedTuple(
    "Inputs",
    [
        ("now_ms", int),
        ("wheels", "Wheels | None"),
        ("scan", "Scan | None"),
        ("operator_age_ms", "int | None"),
    ],
)
"""None means missing or stale, as the host decides; operator_age_ms None means no heartbeat yet."""

Goal = NamedTuple(
    "Goal",
    [
        ("x_m", float),
        ("y_m", float),
        ("heading_rad", "float | None"),
        ("position_tolerance_m", float),
        ("heading_tolerance_rad", float),
    ],
)
"""A goal pose; heading_rad None accepts any final heading."""

Decision = NamedTuple(
    "Decision",
    [
        ("branch", int),
        ("nearest_bearing_rad", "float | None"),
        ("nearest_range_m", float),
        ("goal_bearing_rad", float),
        ("rotation_rad", float),
        ("virtual_x_m", float),
        ("virtual_y_m", float),
        ("speed_limit_m_s", float),
    ],
)
"""The measurement and the choice of a navigator.

Without an echo the range is inf and the bearing None. `speed_limit_m_s` is inf without a limit.
After branch GIVE_UP, LOST or FAILED the other fields are not used.
"""

Twist = NamedTuple("Twist", [("speed_m_s", float), ("yaw_rate_rad_s", float)])

Outputs = NamedTuple(
    "Outputs",
    [
        ("left_mrad_s", int),
        ("right_mrad_s", int),
        ("guard", int),
        ("twist", "Twist"),
        ("decision", "Decision | None"),
    ],
)
"""Wheel speeds are integers, which the wire does not change; guard: the reason for a reduction."""


TWO_PI: Final = 2.0 * pi

COSINES: Final = tuple([cos(b) for b in BEARINGS])
SINES: Final = tuple([sin(b) for b in BEARINGS])


def wrap(angle_rad: float) -> float:
    """Return the same direction in (-pi, pi]; NaN and infinity become NaN."""
    if -pi < angle_rad <= pi:
        return angle_rad
    if angle_rad - angle_rad != 0.0:
        return angle_rad - angle_rad
    wrapped_rad = angle_rad % TWO_PI
    return wrapped_rad - TWO_PI if wrapped_rad > pi else wrapped_rad


def whole_cos_sin(angle_rad: float) -> tuple[int, int]:
    """Return cosine and sine in 1024ths."""
    cosine, sine = cos_sin(angle_rad)
    return int(1024.0 * cosine), int(1024.0 * sine)


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


AGES: "Final[list[tuple[tuple[int, ...], int, tuple[int, ...]]]]" = [((), 0, ())]
"""The last ages of pings that were converted, by how much older they had become, and the result.

Nearly every scan has those of the last one.
"""


def scan_of(message: ScanMessage, since_ms: int) -> Scan:
    """Return the core's input from a scan; each ping is `since_ms` older now."""
    ages_us, older_ms, age_ms = AGES[0]
    ping_age_us = message.ping_age_us
    if ping_age_us != ages_us or since_ms != older_ms:
        age_ms = tuple([since_ms + age_us // 1000 for age_us in ping_age_us])
        AGES[0] = ping_age_us, since_ms, age_ms
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
