"""A world file's `[robot]` table, said in the robot's own parameters: both must be one robot."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

SAME: Final = ("radius_m", "track_m", "wheel_radius_m", "sonar_max_m")

RENAMED: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "max_speed_m_s": ("wheel_max_m_s", "v_max_m_s"),
        "max_acceleration_m_s2": ("accel_m_s2",),
    }
)


def parameters_of(robot: Mapping[str, bool | int | float | str]) -> dict[str, float]:
    """Parameters of the robot that differ from its defaults because the world's robot does.

    What the robot cannot know of itself (motor lag, brake, where its counters start) is left out.
    """
    values: dict[str, float] = {}
    for key, setting in robot.items():
        if key in SAME:
            values[key] = float(setting)
        elif key in RENAMED:
            values.update(dict.fromkeys(RENAMED[key], float(setting)))
        elif key == "ticks_per_m":
            values["m_per_tick"] = 1.0 / float(setting)
    return values
