"""Measure the progress to the goal: distance at its start, share driven, time left."""

from collections import deque
from math import isfinite
from typing import Final

from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from runtime.units import NS_PER_S

WINDOW_S: Final = 10.0
STEP_S: Final = 0.25
LEAST_S: Final = 2.0
"""The least duration from which a rate is computed."""
LEAST_M_S: Final = 0.01
KNOWN_S: Final = 2.0
"""A goal that is older when it is first seen has an unknown distance at its start."""
UNDER_WAY: Final = (GoalState.DRIVING, GoalState.AVOIDING)


class GoalProgress:
    """Follows the status of one robot; every new goal starts anew."""

    def __init__(self) -> None:
        self._goal_id = 0
        self._begun_m: float | None = None
        self._status: NavigatorStatus | None = None
        self._points: deque[tuple[float, float]] = deque(maxlen=round(WINDOW_S / STEP_S) + 1)

    def update(self, status: NavigatorStatus) -> None:
        """Add a status; times are of the robot's clock, in a simulation simulated time."""
        distance_m, time_s = status.goal_distance_m, status.time_ns / NS_PER_S
        if status.goal_id != self._goal_id:
            self._goal_id, self._begun_m = status.goal_id, None
            self._points.clear()
        restarted = bool(self._points) and time_s < self._points[-1][0]
        if restarted or not drives(status) or not isfinite(distance_m):
            self._points.clear()
        elif not self._points or time_s - self._points[-1][0] >= STEP_S:
            self._points.append((time_s, distance_m))
        is_new = status.time_ns - status.goal_started_ns <= KNOWN_S * NS_PER_S
        if self._begun_m is None and is_new and isfinite(distance_m) and distance_m > 0.0:
            self._begun_m = distance_m
        self._status = status

    @property
    def share(self) -> float | None:
        """Share of the distance that is done, 0 to 1; None if the start was not seen."""
        status = self._status
        if status is None or not status.goal_id:
            return None
        if status.goal == GoalState.REACHED:
            return 1.0
        if self._begun_m is None or not isfinite(status.goal_distance_m):
            return None
        return max(0.0, min(1.0, 1.0 - status.goal_distance_m / self._begun_m))

    @property
    def left_s(self) -> float | None:
        """Time to the goal in seconds of the robot's clock, at the rate of the last seconds.

        None if unknown or without rate.
        """
        if not self._points:
            return None
        (first_s, first_m), (last_s, last_m) = self._points[0], self._points[-1]
        if last_s - first_s < LEAST_S:
            return None
        rate_m_s = (first_m - last_m) / (last_s - first_s)
        return last_m / rate_m_s if rate_m_s >= LEAST_M_S else None


def drives(status: NavigatorStatus) -> bool:
    """Return whether the robot is on its way to a goal."""
    return (
        status.vehicle == Vehicle.ACTIVE
        and status.mode != Mode.HOLD
        and status.mode != Mode.MANUAL
        and status.goal in UNDER_WAY
    )
