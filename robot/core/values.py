"""Inputs and outputs of the core."""

from typing import Final, NamedTuple

SONARS = 8
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
After branch GIVE_UP or LOST the other fields are not used.
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
