"""Names of sides, modes and navigators, and remedies for refusals."""

import re
from collections.abc import Mapping
from math import isfinite, nan
from types import MappingProxyType
from typing import Final, NamedTuple

from protocol.wire.enums import Navigator
from protocol.wire.reasons import Reason
from runtime.errors import UserError, decimal_point

NOISES: Final = ("none", "default", "lossy", "harsh")
SIDES: Final = MappingProxyType({"left": 1, "right": -1})
NAVIGATORS: Final = MappingProxyType({name.name.lower(): name for name in Navigator})
"""Those that a robot may have: also `own`, that of the user's file with which it was started."""
NAVIGATOR_SUMMARIES: Final = MappingProxyType(
    {
        "bug": "the paper's Bug: follows the boundary of obstacles",
        "vgm": "the paper's Virtual Goal Method: turns its goal away",
        "bug1": "goes all the way round, then leaves at the nearest point",
        "bug2": "follows the boundary back to the line to the goal",
        "distbug": "follows the boundary until the way leads nearer",
        "vgm_memory": "vgm with a memory of recent echoes (the default)",
        "own": "yours, if the robot was started with `--navigator FILE`",
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
HINTS: Final[Mapping[int, str]] = MappingProxyType(
    {
        Reason.NOT_ARMED: "sidestep arm",
        Reason.EMERGENCY_STOPPED: "sidestep clear-estop",
        Reason.NEWER_STOP: "sidestep clear-estop",
        Reason.NO_OPERATOR: (
            "`sidestep teleop` and `sidestep goto` send it while they drive; `sidestep mode auto`"
            " needs none"
        ),
        Reason.NO_SENSES: "is the plant running? sidestep doctor",
        Reason.DRIVING: "sidestep abort",
        Reason.LEASE_HELD: "sidestep lease seize",
        Reason.OUTSIDE_FENCE: "sidestep fence show",
        Reason.FENCE_BREACHED: "sidestep fence off",
        Reason.FENCE_UNCHECKED: "sidestep pose set X Y DEG",
        Reason.NO_MISSION: "sidestep mission upload FILE",
        Reason.PLACE_UNKNOWN: (
            "`sidestep pose set X Y DEG`, or in a simulation `sidestep pose truth`"
        ),
        Reason.PARAMETERS_DAMAGED: (
            "see `sidestep param list`, then `sidestep param set` one of the safety group"
        ),
    }
)
GOAL_HINT: Final = "`sidestep goto X Y` sets a goal"


class Remedies(NamedTuple):
    """What to do about a refusal or a silence, in the words of those who read it.

    `refusals` by reason; `robot` names one that is there, `keys` the certificates, `run` one of
    several runs, `parameters` lists the parameters, `drive` drives by hand. `options` are those
    that name the robot and its bus, as they were typed.
    """

    refusals: Mapping[int, str]
    robot: str
    keys: str
    run: str
    parameters: str
    drive: str
    options: str = ""

    def addressed(self, words: str) -> str:
        """Return words whose `sidestep` commands have the options that name the robot."""
        return COMMAND.sub(lambda found: f"{found[0]}{self.options}", words)

    def by_hand(self) -> "Remedies":
        """Return the remedies for a drive by hand, which no other mode replaces."""
        return self._replace(refusals={**self.refusals, Reason.NO_OPERATOR: self.drive})


COMMAND: Final = re.compile("sidestep [a-z-]+(?: (?:[a-z-]+|[A-Z]+))*")


SHELL: Final = Remedies(
    refusals=MappingProxyType(
        {**HINTS, Reason.LEASE_HELD: "--seize takes it over, as does sidestep lease seize"}
    ),
    robot="name one that is there, as in --id {0}",
    keys="use --config DIR/ground.toml",
    run="choose one with --run NAME or --connect ENDPOINT, as in: --run {0}",
    parameters="sidestep param list",
    drive="`sidestep teleop` drives by hand, and sends it",
)
PYTHON: Final = Remedies(
    refusals=MappingProxyType(
        {
            Reason.NOT_ARMED: "await robot.arm()",
            Reason.EMERGENCY_STOPPED: "await robot.clear_emergency_stop()",
            Reason.NEWER_STOP: "await robot.clear_emergency_stop()",
            Reason.NO_OPERATOR: "the event loop sends the heartbeat: do not block it",
            Reason.NO_SENSES: "is the plant running? `sidestep doctor` in a terminal tells",
            Reason.NO_GOAL: "await robot.goto(x_m, y_m) sets a goal",
            Reason.DRIVING: "await robot.abort()",
            Reason.LEASE_HELD: "await robot.lease.seize()",
            Reason.OUTSIDE_FENCE: "await robot.fence.get()",
            Reason.FENCE_BREACHED: "await robot.fence.clear()",
            Reason.FENCE_UNCHECKED: "await robot.set_pose(x_m, y_m, heading_deg)",
            Reason.NO_MISSION: "await robot.mission.upload(mission)",
            Reason.PLACE_UNKNOWN: (
                "await robot.set_pose(x_m, y_m, heading_deg), or in a simulation"
                " await robot.set_true_pose()"
            ),
            Reason.PARAMETERS_DAMAGED: (
                "await robot.parameters.list(), then await robot.parameters.set(name, value)"
                " for one of the safety group"
            ),
        }
    ),
    robot="name one that is there, as in sidestep.connect(robot={0!r})",
    keys='use sidestep.connect(config="DIR/ground.toml")',
    run="choose one with sidestep.connect({1!r})",
    parameters="await robot.parameters.list()",
    drive="await robot.drive(speed_m_s, turn_deg_s) drives by hand, and sends it",
)


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
    point = decimal_point(words)
    fix = f", written as {point}" if point else ""
    raise UserError(f"{parameter} = {words!r}: must be a finite number{choices}{fix}")
