"""Parameters that exist only so that ground stations accept the vehicle as an ArduPilot Rover.

QGroundControl's set-up pages and Mission Planner ask for them by name. They are read-only, describe
no part of the robot, and are not in `param list`. FRAME_CLASS is left out: with it, QGroundControl
shows a page about frames that do not apply to this robot.
"""

from collections.abc import Iterator
from typing import Final

from ground.client.parameter import Parameter

STICKS: Final = ("ROLL", "PITCH", "THROTTLE", "YAW")
AXES: Final = "XYZ"
COMPASSES: Final = ("", "2", "3")
GROUP: Final = "ArduPilot"
DOC: Final = "fixed: for ground stations that expect an ArduPilot Rover"
PWM: Final = (("MIN", 1000), ("MAX", 2000), ("TRIM", 1500))
"""The usual pulses in microseconds; with a MIN of 1100 a radio counts as not calibrated."""
CALIBRATED: Final = 0.001
"""An offset of an accelerometer in m/s^2; at 0 it counts as not calibrated."""


def compatibility_parameters() -> tuple[Parameter, ...]:
    """Return them in their order."""
    return tuple(
        Parameter(name=name, value=value, default=value, integer=isinstance(value, int), doc=DOC)
        for name, value in _values()
    )


def _values() -> Iterator[tuple[str, float]]:
    for channel, stick in enumerate(STICKS, start=1):
        yield f"RCMAP_{stick}", channel
    for channel in range(1, 1 + len(STICKS)):
        for limit, width_us in PWM:
            yield f"RC{channel}_{limit}", width_us
    for compass in COMPASSES:
        yield f"COMPASS_DEV_ID{compass}", 0
        yield f"COMPASS_USE{compass}", 0
        for axis in AXES:
            yield f"COMPASS_OFS{compass}_{axis}", 0.0
    for axis in AXES:
        yield f"INS_ACCOFFS_{axis}", CALIBRATED
    yield "BATT_CAPACITY", 0
    yield "BATT_MONITOR", 0
