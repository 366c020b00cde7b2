"""The robot's fastest speeds, by which shares of them are converted."""

from collections.abc import Mapping
from typing import Final

from ground.client.operations import ParameterTable, ShowParameters
from ground.gateway.port import Answered
from ground.gateway.vehicle import Vehicle
from runtime.units import NS_PER_S

SPEED: Final = "v_max_m_s"
"""The parameter that limits the forward speed of goals, missions and MANUAL."""
TURN: Final = "yaw_max_rad_s"
AGAIN_NS: Final = 2 * NS_PER_S


class SpeedLimits:
    """Reads the limits from the vehicle's parameters, and asks the robot while they are unknown."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._asked_ns: int | None = None

    def fastest_m_s(self, now_ns: int) -> float | None:
        """Return the fastest forward speed; None while it is unknown."""
        return self._known(now_ns).get(SPEED)

    def fastest_rad_s(self, now_ns: int) -> float | None:
        """Return the fastest turn; None while it is unknown."""
        return self._known(now_ns).get(TURN)

    def _known(self, now_ns: int) -> Mapping[str, float]:
        known = self._vehicle.parameters
        is_due = self._asked_ns is None or now_ns - self._asked_ns >= AGAIN_NS
        if is_due and not (SPEED in known and TURN in known):
            self._asked_ns = now_ns
            self._vehicle.port.perform(ShowParameters(pattern="*_max_*"), self._answered)
        return known

    def _answered(self, answered: Answered) -> None:
        if isinstance(answered.outcome, ParameterTable):
            for one in answered.outcome.parameters:
                self._vehicle.parameters.setdefault(one.name, one.value)
