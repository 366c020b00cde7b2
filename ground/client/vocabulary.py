"""Names of sides and navigators, and remedies for refusals."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from protocol.wire.enums import Navigator
from protocol.wire.reasons import Reason

SIDES: Final = MappingProxyType({"left": 1, "right": -1})
NAVIGATORS: Final = MappingProxyType({name.name.lower(): name for name in Navigator})
NAVIGATOR_SUMMARIES: Final = MappingProxyType(
    {
        "bug": "the paper's Bug: follows the boundary of what is in its way",
        "vgm": "the paper's Virtual Goal Method: turns its goal away from the nearest echo",
        "bug1": "goes all the way round an obstacle, then leaves from the nearest point",
        "bug2": "follows the boundary back to the line from start to goal",
        "distbug": "follows the boundary until the free way leads nearer to the goal",
        "vgm_memory": "Virtual Goal Method with a memory of recent echoes (the default)",
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
USUAL_NAVIGATOR: Final = Navigator.VGM_MEMORY.name.lower()
"""The robot's default."""
HINTS: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.NOT_ARMED: "sidestep arm",
        Reason.EMERGENCY_STOPPED: "sidestep clear-estop",
        Reason.NO_OPERATOR: "keep `sidestep ground` running, or use --no-wait",
        Reason.NO_SENSES: "is the plant running? sidestep doctor",
        Reason.DRIVING: "sidestep abort",
        Reason.LEASE_HELD: "sidestep lease seize",
        Reason.OUTSIDE_FENCE: "sidestep fence show",
        Reason.FENCE_BREACHED: "sidestep fence off",
        Reason.NO_MISSION: "sidestep mission upload FILE",
    }
)
GOAL_HINT: Final = "`goto X Y` sets a goal"
