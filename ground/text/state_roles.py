"""Decide what a robot's status means for the display: the colour of its state, and its reason.

The side panel, the status line, the roster and the stop band all use these functions.
"""

from typing import Final

from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason

OK: Final = "ok"
CAUTION: Final = "caution"
DANGER: Final = "danger"
NEUTRAL: Final = "text"
FAILED_GOALS: Final = (GoalState.STUCK, GoalState.ABORTED, GoalState.REFUSED)
GOAL_MODES: Final = (Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL)
VEHICLE_ROLES: Final = {
    Vehicle.EMERGENCY_STOP: DANGER,
    Vehicle.FAILSAFE: CAUTION,
    Vehicle.ACTIVE: OK,
    Vehicle.STANDBY: NEUTRAL,
    Vehicle.BOOT: NEUTRAL,
}
STOPS: Final = frozenset(
    {
        Reason.BY_EMERGENCY_STOP,
        Reason.EMERGENCY_STOPPED,  # in recordings of version 0.1
        Reason.DISARMED,
        *(reason for reason in Reason if Reason.TICKS_LOST <= reason < Reason.BLOCKED),
    }
)
"""Reasons of a goal's end that were the vehicle's: the emergency stop, disarming, a failsafe."""


def vehicle_role(vehicle: int) -> str:
    """Return the role of the colour of a vehicle state; an unknown state is a danger."""
    return next((role for known, role in VEHICLE_ROLES.items() if known == vehicle), DANGER)


def driving(status: NavigatorStatus) -> bool:
    """Return whether a goal is being pursued."""
    return GoalState.ACCEPTED <= status.goal <= GoalState.ALIGNING


def state_role(status: NavigatorStatus) -> str:
    """Return the role of the colour of a robot's state.

    The goal counts only while the vehicle is armed and its mode drives to goals.
    """
    if status.vehicle != Vehicle.ACTIVE or status.mode not in GOAL_MODES:
        return vehicle_role(status.vehicle)
    if status.goal in FAILED_GOALS:
        return DANGER
    return CAUTION if status.goal == GoalState.AVOIDING else OK


def present_reason(status: NavigatorStatus) -> int:
    """Return the reason of the present state, or 0.

    The reason of an ended goal belongs to the past once the vehicle is armed again after the stop,
    or once the mode has changed.
    """
    if status.vehicle != Vehicle.ACTIVE or status.mode not in GOAL_MODES:
        return status.vehicle_reason
    return Reason.NONE if status.goal_reason in STOPS else status.goal_reason
