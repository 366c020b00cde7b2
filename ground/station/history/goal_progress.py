"""Measure the progress to the goal: distance at its start, share driven, time left, and outcome."""

from collections import deque
from math import hypot, isfinite
from typing import Final

from ground.client.goal import Destination
from ground.client.status_line import PLACE_UNKNOWN, knows_place
from ground.client.vocabulary import NAVIGATORS
from protocol.outcome import ENDS, reason_words
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus, PlanarOdometry
from protocol.wire.reasons import reason_text
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
        self._goal: tuple[float, ...] = ()
        self._begun_m: float | None = None
        self._status: NavigatorStatus | None = None
        self._points: deque[tuple[float, float]] = deque(maxlen=round(WINDOW_S / STEP_S) + 1)

    def update(self, status: NavigatorStatus) -> None:
        """Add a status; times are of the robot's clock, in a simulation simulated time."""
        distance_m, time_s = status.goal_distance_m, status.time_ns / NS_PER_S
        if goal_of(status) != self._goal:
            self._goal, self._begun_m = goal_of(status), None
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


def goal_of(status: NavigatorStatus) -> tuple[float, ...]:
    """Return what tells a goal from another one; those of a mission share their id."""
    place = (status.goal_x_m, status.goal_y_m)
    return (status.goal_id, *(place if has_goal(status) else ()))


def drives(status: NavigatorStatus) -> bool:
    """Return whether the robot is on its way to a goal."""
    return (
        status.vehicle == Vehicle.ACTIVE
        and status.mode != Mode.HOLD
        and status.mode != Mode.MANUAL
        and status.goal in UNDER_WAY
    )


STEP_M: Final = 0.01
"""Shorter moves are noise of the estimate."""
BEGIN_NS: Final = NS_PER_S
"""A goal first seen later than this after it was set was driven to before, unseen."""


class LastDrive:
    """Measures the distance since the last goal was set.

    A restarted robot has no goal; the drive before the restart is still the last one.
    """

    def __init__(self) -> None:
        self._status: NavigatorStatus | None = None
        self._before = ""
        self._placed = True
        self._set: tuple[float, ...] = ()
        self._whole = True
        self._driven_m = 0.0
        self._place: tuple[float, float] | None = None

    def moved(self, odometry: PlanarOdometry) -> None:
        """Add a position."""
        x_m, y_m = odometry.x_m, odometry.y_m
        self._placed = knows_place(odometry)
        if not (isfinite(x_m) and isfinite(y_m)):
            return
        if self._place is None:
            self._place = (x_m, y_m)
            return
        step_m = hypot(x_m - self._place[0], y_m - self._place[1])
        if step_m >= STEP_M:
            self._place = (x_m, y_m)
            self._driven_m += step_m

    def lose_place(self) -> None:
        """Ignore the distance to the next position, because the robot estimates it anew."""
        self._place = None

    def update(self, status: NavigatorStatus) -> None:
        """Add a status; a new goal begins a new distance."""
        if self._status is not None and has_goal(self._status) and not has_goal(status):
            self._before = self._drive(self._status)
        if goal_of(status) != self._set:
            self._set, self._driven_m = goal_of(status), 0.0
            self._whole = status.time_ns - status.goal_started_ns <= BEGIN_NS
        self._status = status

    def text(self) -> str:
        """Return outcome, time and distance of the last goal."""
        status = self._status
        if status is None:
            return "no status was received"
        if has_goal(status):
            return self._drive(status)
        if self._before:
            place = "" if self._placed else f", {PLACE_UNKNOWN}"
            return f"{self._before}; then the robot restarted{place}"
        if status.goal == GoalState.NONE:
            return "no goal was set"
        return f"refused the goal: {reason_text(status.goal_reason)}"

    def _drive(self, status: NavigatorStatus) -> str:
        """Return outcome, time and distance of the goal of this status."""
        goal = self._goal(status)
        words, until_ns = f"was driving to {goal}", status.time_ns
        if status.goal in ENDS:
            until_ns = status.goal_ended_ns
            words = f"{ENDS[GoalState(status.goal)]}: goal {goal}"
            if status.goal == GoalState.REACHED:
                words = f"reached the goal {goal}"
        if (name := navigator_of(status)) is not None:
            words += f" with {name}"
        words += f" in {max(0, until_ns - status.goal_started_ns) / NS_PER_S:.1f} s"
        if self._whole:
            words += f", {self._driven_m:.2f} m driven"
        if status.goal not in (GoalState.REACHED, GoalState.REFUSED):
            words += self._rest(status)
        if status.goal in ENDS and status.goal != GoalState.REACHED and status.goal_reason:
            words += f"; {reason_words(status.goal_reason, status.ended_by)}"
        return words

    def _rest(self, status: NavigatorStatus) -> str:
        """Return the distance that is left."""
        left_m = status.goal_distance_m
        return f", {left_m:.2f} m to go" if isfinite(left_m) else ""

    def _goal(self, status: NavigatorStatus) -> str:
        heading_rad = status.goal_heading_rad
        heading = heading_rad if isfinite(heading_rad) else None
        return str(Destination(x_m=status.goal_x_m, y_m=status.goal_y_m, heading_rad=heading))


def has_goal(status: NavigatorStatus) -> bool:
    """Return whether the robot has accepted a goal since its start."""
    return status.goal != GoalState.NONE and isfinite(status.goal_x_m)


def navigator_of(status: NavigatorStatus) -> str | None:
    """Return the name of the navigator, if it is known."""
    names = {int(number): name for name, number in NAVIGATORS.items()}
    return names.get(status.navigator)
