"""What a robot's calibration has found for each level of noise: read here, by all who start robots.

The files are as `sidestep calibrate --output` writes them; the command is in each. A world that
changes single values of its noise has the calibration of the level that it starts from.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Final

from runtime import config
from runtime.robot_settings import parameters_of

FOLDER: Final = Path(__file__).parent / "calibrations"


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration:
    """Robot parameters that differ from the robot's defaults."""

    parameters: dict[str, float] = field(default_factory=dict)


@cache
def calibration_of(level: str) -> Mapping[str, float]:
    """Parameters by name for a noise level; ConfigError when nobody has calibrated for it."""
    found = config.load(FOLDER / f"{level}.toml", Calibration)
    return MappingProxyType(found.parameters)


def settings_of(
    robot: Mapping[str, bool | int | float | str], level: str, *, calibrated: bool
) -> dict[str, float]:
    """Parameters of a robot in a world: its calibration, and over it the world's own `[robot]`."""
    found = calibration_of(level) if calibrated else {}
    return {**found, **parameters_of(robot)}
