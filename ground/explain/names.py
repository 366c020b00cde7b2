"""Name the numbers of the dialect; an unknown one stays a number."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from protocol.wire.enums import Branch, GoalState, Mode, Navigator, Vehicle
from protocol.wire.reasons import Reason, reason_text

BRANCHES: Final[Mapping[int, str]] = MappingProxyType(
    {
        Branch.NONE: "idle",
        Branch.TO_GOAL: "goes for the goal",
        Branch.PASS_LEFT: "passes on the left",
        Branch.PASS_RIGHT: "passes on the right",
        Branch.ALIGN: "turns to the final heading",
        Branch.GIVE_UP: "gives up",
        Branch.LOST: "is lost",
    }
)
VEHICLES: Final[Mapping[int, str]] = MappingProxyType(
    {
        Vehicle.BOOT: "it is still starting",
        Vehicle.STANDBY: "it is not armed",
        Vehicle.FAILSAFE: "failsafe",
        Vehicle.EMERGENCY_STOP: "emergency stop",
    }
)
ENDS: Final[Mapping[int, str]] = MappingProxyType(
    {
        GoalState.NONE: "it has no goal",
        GoalState.REACHED: "the goal is reached",
        GoalState.STUCK: "it gave the goal up",
        GoalState.ABORTED: "the goal was dropped",
        GoalState.REFUSED: "the goal was refused",
    }
)
ZONES: Final[Mapping[int, str]] = MappingProxyType({Navigator.VGM: "d_obs", Navigator.BUG: "d_th"})
"""Name of the avoidance zone of each navigator that has one."""


def branch_words(number: int) -> str:
    """Name a branch."""
    return BRANCHES.get(number, f"branch {number}")


def navigator_words(number: int) -> str:
    """Name a navigator."""
    return word(Navigator, number, "navigator").lower()


def mode_words(number: int) -> str:
    """Name a mode."""
    return word(Mode, number, "mode")


def vehicle_words(number: int) -> str:
    """Name a vehicle state."""
    return word(Vehicle, number, "vehicle")


def goal_words(number: int) -> str:
    """Name a goal state."""
    return word(GoalState, number, "goal")


def word(kind: type[Navigator | Mode | Vehicle | GoalState], number: int, what: str) -> str:
    """Return the name of a number, or the number itself."""
    try:
        return kind(number).name
    except ValueError:
        return f"{what} {number}"


def because(what: str, reason: int) -> str:
    """Append a reason other than NONE."""
    return what if reason == Reason.NONE else f"{what}: {reason_text(reason)}"
