"""Say which keys lead from a stop back to driving, with the keymap in force."""

from collections.abc import Callable
from typing import Final, NamedTuple

from ground.client.operations.lost_drive import LostDrive, LostMission
from protocol.wire.enums import Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason

FENCE_OFF: Final = ":fence off"


class Step(NamedTuple):
    """A key or command, what it does, and in long form where to."""

    key: str
    does: str
    where: str = ""

    @property
    def long(self) -> str:
        """The key with what it does."""
        return " ".join(filter(None, (self.key, self.does, self.where)))

    @property
    def short(self) -> str:
        """The key with what it does, in few words."""
        return f"{self.key} {self.does}"


def next_steps(
    status: NavigatorStatus, lost: LostDrive | None, key_of: Callable[[str], str]
) -> list[Step]:
    """Return the steps that lead from the present state to driving.

    `key_of` returns the key of an action by its id.
    """
    steps: list[Step] = []
    if status.vehicle == Vehicle.EMERGENCY_STOP:
        clear = key_of("clear-estop")
        steps.append(Step(clear if clear.startswith(":") else f"{clear} {clear}", "clear"))
    if status.vehicle_reason == Reason.FENCE_BREACHED:
        steps.append(Step(FENCE_OFF, "lift the fence"))
    if status.vehicle_reason == Reason.FENCE_UNCHECKED:
        steps.append(Step(key_of("place"), "set the place"))
    if status.vehicle != Vehicle.ACTIVE:
        steps.append(Step(key_of("arm"), "arm"))
    if lost is None:
        return [*steps, Step(key_of("goal"), "goal")]
    onto = "with" if isinstance(lost, LostMission) else "to"
    return [*steps, Step(key_of("resume"), "go on", f"{onto} {lost}")]


def forms(steps: list[Step], where: str) -> list[str]:
    """Return the steps in words, the longest form first; `where` names the screen that has them."""
    long = ", ".join(step.long for step in steps)
    short = ", ".join(step.short for step in steps)
    keys = [step.key for step in steps]
    if where:
        return [
            f"{where}, then {long}",
            f"{where}, then {short}",
            "  ".join((where.split()[0], *keys)),
        ]
    return [long, short, "  ".join(keys)]
