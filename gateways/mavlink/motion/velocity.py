"""Speeds requested by a client, and the twist that produces them."""

from math import cos, pi, radians, remainder
from typing import Final, NamedTuple

from ground.client.operations.teleop import FASTEST_DEG_S, FASTEST_M_S, TTL_MS
from runtime.units import NS_PER_MS

SPEED: Final = "v_max_m_s"
"""The robot's parameter that limits the forward speed of goals, missions and MANUAL."""
TURN: Final = "yaw_max_rad_s"
"""The robot's parameter that limits its turns."""
REPEAT_NS: Final = 60 * NS_PER_MS
"""Interval of the speeds to the robot."""
LIFE_NS: Final = TTL_MS * NS_PER_MS
"""A speed is valid on the robot for this time; then it stops without a ramp. So the last one is
sent this long before a time-out, and the wheels stop at the time-out even if the gateway has
ended."""
TURN_GAIN_HZ: Final = 2.0
"""Turn rate per angle to the requested heading."""
FASTEST_RAD_S: Final = radians(FASTEST_DEG_S)
TURN_RAD_S: Final = 1.5
"""Fastest turn to a heading; the robot's own limit may be lower."""


class Velocity(NamedTuple):
    """A forward speed (negative: backwards), and a turn rate or a heading to turn to."""

    speed_m_s: float = 0.0
    yaw_rate_rad_s: float = 0.0
    heading_rad: float | None = None

    def twist(self, heading_rad: float | None) -> tuple[float, float]:
        """Return speed and turn rate for a robot with this heading; zero if it is unknown.

        A robot that turns to a heading drives only with the part of its speed in that direction.
        """
        speed_m_s, yaw_rate_rad_s = self.speed_m_s, self.yaw_rate_rad_s
        if self.heading_rad is not None:
            if heading_rad is None:
                return 0.0, 0.0
            error_rad = remainder(self.heading_rad - heading_rad, 2.0 * pi)
            yaw_rate_rad_s = within(TURN_GAIN_HZ * error_rad, TURN_RAD_S)
            speed_m_s *= max(0.0, cos(error_rad))
        return within(speed_m_s, FASTEST_M_S), within(yaw_rate_rad_s, FASTEST_RAD_S)


def within(value: float, limit: float) -> float:
    """Return the value, limited to the range -limit to limit."""
    return max(-limit, min(limit, value))
