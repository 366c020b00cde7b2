"""Load the calibration of a robot for a noise level; shared by all launchers of robots.

`sidestep calibrate --output` writes the files; each contains its command. A world that changes
single noise values uses the calibration of the noise level that it is based on.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

from runtime import config

FOLDER: Final = Path(__file__).parent / "calibrations"
SAME: Final = ("radius_m", "track_m", "wheel_radius_m", "sonar_max_m")
RENAMED: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "max_speed_m_s": ("wheel_max_m_s", "v_max_m_s"),
        "max_acceleration_m_s2": ("accel_m_s2",),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Robot parameters that differ from the robot's defaults."""

    parameters: dict[str, float] = field(default_factory=dict)


@cache
def calibration_of(level: str) -> Mapping[str, float]:
    """Return the parameters for a noise level; raise ConfigError if there is no calibration."""
    found = config.load(FOLDER / f"{level}.toml", Calibration)
    return MappingProxyType(found.parameters)


def settings_of(
    robot: Mapping[str, bool | int | float | str], level: str, *, calibrated: bool
) -> dict[str, float]:
    """Return a robot's parameters in a world: calibration, then the world's own `[robot]`."""
    found = calibration_of(level) if calibrated else {}
    return {**found, **parameters_of(robot)}


def parameters_of(robot: Mapping[str, bool | int | float | str]) -> dict[str, float]:
    """Return the parameters that a world's `[robot]` changes.

    Properties that the robot cannot know, such as motor lag and brake, are left out.
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


def start_totals(robot: Mapping[str, bool | int | float | str]) -> tuple[int, int]:
    """Return the left and right encoder totals at the start pose, from a world's `[robot]`."""
    return int(robot.get("left_start_ticks", 0)), int(robot.get("right_start_ticks", 0))


def totals_arguments(robot: Mapping[str, bool | int | float | str]) -> tuple[str, ...]:
    """Return the arguments of `sidestep run robot` for these totals; none if they are zero."""
    totals = start_totals(robot)
    return ("--encoders", *map(str, totals)) if any(totals) else ()
