"""The values that cross the border of the core: what it is given each tick and what it answers."""

from robot.core.typing_shim import Final, NamedTuple

SONARS = 8
EVERY: Final = tuple(range(SONARS))
"""The numbers of all sonars: to go through these costs less than `range` does, here and there."""

Pose = NamedTuple("Pose", [("x_m", float), ("y_m", float), ("heading_rad", float)])

Wheels = NamedTuple("Wheels", [("left", int), ("right", int), ("bumper", int), ("at_ms", int)])
"""Encoder counters (32 bits, they wrap), pressed bumper sectors (1 left, 2 right, 4 rear), and when
that was by the clock of whoever counted."""

Scan = NamedTuple(
    "Scan",
    [("range_mm", "tuple[int, ...]"), ("age_ms", "tuple[int, ...]"), ("valid", int), ("echo", int)],
)
"""One ring: ranges from the rim, the age of each ping, bit masks «measured» and «echo came»."""

Inputs = NamedTuple(
    "Inputs",
    [
        ("now_ms", int),
        ("wheels", "Wheels | None"),
        ("scan", "Scan | None"),
        ("operator_age_ms", "int | None"),
    ],
)
"""None is missing or stale, decided before the core sees it; operator_age_ms None: never heard."""

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
"""Where to go; heading_rad None: any final heading will do."""

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
"""What a navigator saw and chose; without an echo the range is inf and the bearing None.

`speed_limit_m_s` is inf where the navigator sets none. After branch GIVE_UP the rest is not read.
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
"""Wheel speeds as integers, so that the wire changes nothing; guard: why speed was taken away."""
