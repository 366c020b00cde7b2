"""Names of sides and navigators, and remedies for refusals."""

from collections.abc import Mapping
from math import isfinite, nan
from types import MappingProxyType
from typing import Final

from protocol.wire.enums import Navigator
from protocol.wire.reasons import Reason
from runtime.errors import UserError

SIDES: Final = MappingProxyType({"left": 1, "right": -1})
NAVIGATORS: Final = MappingProxyType({name.name.lower(): name for name in Navigator})
NAVIGATOR_SUMMARIES: Final = MappingProxyType(
    {
        "bug": "the paper's Bug: follows the boundary of obstacles",
        "vgm": "the paper's Virtual Goal Method: turns its goal away",
        "bug1": "goes all the way round, then leaves at the nearest point",
        "bug2": "follows the boundary back to the line to the goal",
        "distbug": "follows the boundary until the way leads nearer",
        "vgm_memory": "vgm with a memory of recent echoes (the default)",
    }
)
MODE_SUMMARIES: Final = MappingProxyType(
    {
        "manual": "you drive",
        "hold": "stopped; keeps its goal",
        "auto": "drives to its goal, with or without an operator",
        "smart_rtl": "drives back along its own trail",
        "guided": "drives to its goal while an operator is connected",
    }
)
NAMED_VALUES: Final[Mapping[str, Mapping[str, float]]] = MappingProxyType(
    {"navigator": MappingProxyType({**NAVIGATORS}), "side": SIDES}
)
"""The names of values, by the name of their parameter."""
USUAL_NAVIGATOR: Final = Navigator.VGM_MEMORY.name.lower()
"""The robot's default."""
HINTS: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.NOT_ARMED: "sidestep arm",
        Reason.EMERGENCY_STOPPED: "sidestep clear-estop",
        Reason.NEWER_STOP: "sidestep clear-estop",
        Reason.NO_OPERATOR: "keep `sidestep ground` running, or use --no-wait",
        Reason.NO_SENSES: "is the plant running? sidestep doctor",
        Reason.DRIVING: "sidestep abort",
        Reason.LEASE_HELD: "sidestep lease seize",
        Reason.OUTSIDE_FENCE: "sidestep fence show",
        Reason.FENCE_BREACHED: "sidestep fence off",
        Reason.FENCE_UNCHECKED: "sidestep pose set X Y DEG",
        Reason.NO_MISSION: "sidestep mission upload FILE",
    }
)
GOAL_HINT: Final = "`goto X Y` sets a goal"


def value_words(parameter: str, value: float) -> str:
    """Return the name of a parameter's value, or the number with seven digits."""
    names = NAMED_VALUES.get(parameter, {})
    return next((name for name, number in names.items() if number == value), f"{value:z.7g}")


def value_in_words(parameter: str, words: str) -> float:
    """Return the value that is typed as a number or by its name; UserError for neither."""
    names = NAMED_VALUES.get(parameter, {})
    try:
        value = names[words.lower()] if words.lower() in names else float(words)
    except ValueError:
        value = nan
    if isfinite(value):
        return float(value)
    choices = f" or one of {', '.join(names)}" if names else ""
    raise UserError(f"{parameter} = {words!r}: must be a finite number{choices}")
