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
