"""What changed since it was last told: one line of text per change of vehicle, mode and goal."""

from typing import Final

from protocol.enums import GoalState, Mode, Severity, Vehicle
from protocol.messages import Statustext
from protocol.reasons import reason_text
from robot.core import reasons
from robot.core.machine import Machine

TEXT_BYTES: Final = 50

LOUD: Final = {Vehicle.FAILSAFE: Severity.CRITICAL, Vehicle.EMERGENCY_STOP: Severity.CRITICAL}
BAD: Final = {GoalState.STUCK: Severity.ERROR, GoalState.ABORTED: Severity.WARNING}
TOLD_GOALS: Final = frozenset(
    {GoalState.ACCEPTED, GoalState.REACHED, GoalState.STUCK, GoalState.ABORTED}
)


class News:
    """Compares the machine with what it was at the last call; it acts on nothing."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._vehicle = (machine.vehicle, machine.vehicle_reason)
        self._mode = machine.mode
        self._goal = (machine.serial, machine.goal_state, machine.goal_reason)
        self._text_id = 0

    def since_last_time(self) -> list[Statustext]:
        machine = self._machine
        texts: list[Statustext] = []
        goal = (machine.serial, machine.goal_state, machine.goal_reason)
        if goal != self._goal and machine.goal_state in TOLD_GOALS:
            state = GoalState(machine.goal_state)
            severity = BAD.get(state, Severity.INFO)
            texts += self.text(severity, line("goal", state.name, machine.goal_reason))
        vehicle = (machine.vehicle, machine.vehicle_reason)
        if vehicle != self._vehicle:
            name = Vehicle(machine.vehicle)
            severity = LOUD.get(name, Severity.INFO)
            texts += self.text(severity, line("vehicle", name.name, machine.vehicle_reason))
        if machine.mode != self._mode:
            texts += self.text(Severity.INFO, f"mode {Mode(machine.mode).name}")
        self._goal, self._vehicle, self._mode = goal, vehicle, machine.mode
        return texts

    def text(self, severity: int, words: str) -> list[Statustext]:
        """A text of any length in numbered pieces of 50 bytes, as MAVLink has it."""
        encoded = words.encode("ascii", "replace")
        pieces = [encoded[at : at + TEXT_BYTES] for at in range(0, len(encoded), TEXT_BYTES)]
        several = len(pieces) > 1
        if several:
            self._text_id = self._text_id % 65_535 + 1
        return [
            Statustext(
                severity=severity,
                text=piece.decode("ascii"),
                id=self._text_id if several else 0,
                chunk_seq=index,
            )
            for index, piece in enumerate(pieces)
        ]


def line(what: str, state: str, reason: int) -> str:
    return f"{what} {state}" if reason == reasons.OK else f"{what} {state}: {reason_text(reason)}"
