"""Texts for an operator about changes of vehicle, mode, goal and mission."""

from typing import Final

from protocol.outcome import mission_state
from protocol.wire.enums import GoalState, MissionState, Mode, Severity, Vehicle
from protocol.wire.messages import Statustext
from protocol.wire.reasons import reason_text
from protocol.wire.statustext import pieces_of
from robot.core import reasons
from robot.core.modes import Machine
from robot.mission.mission import Mission

VEHICLE_SEVERITY: Final = {
    Vehicle.FAILSAFE: Severity.CRITICAL,
    Vehicle.EMERGENCY_STOP: Severity.CRITICAL,
}
GOAL_SEVERITY: Final = {GoalState.STUCK: Severity.ERROR, GoalState.ABORTED: Severity.WARNING}
REPORTED_GOALS: Final = frozenset(
    {GoalState.ACCEPTED, GoalState.REACHED, GoalState.STUCK, GoalState.ABORTED}
)


class ChangeLog:
    """Report what has changed in the machine and the mission since the last call."""

    def __init__(self, machine: Machine, mission: Mission) -> None:
        self._machine = machine
        self._mission = mission
        self._progress = (mission.number, mission.state, mission.current)
        self._vehicle = (machine.vehicle, machine.vehicle_reason)
        self._mode = machine.mode
        self._placed = machine.placed
        self._goal = (machine.serial, machine.goal_state, machine.goal_reason)
        self._text_id = 0

    def since_last_time(self) -> list[Statustext]:
        """Return a text for each change of goal, vehicle, mode and mission since the last call."""
        machine = self._machine
        texts: list[Statustext] = []
        goal = (machine.serial, machine.goal_state, machine.goal_reason)
        if goal != self._goal and machine.goal_state in REPORTED_GOALS:
            state = GoalState(machine.goal_state)
            severity = GOAL_SEVERITY.get(state, Severity.INFO)
            texts += self.text(severity, change_text("goal", state.name, machine.goal_reason))
        vehicle = (machine.vehicle, machine.vehicle_reason)
        if vehicle != self._vehicle:
            name = Vehicle(machine.vehicle)
            severity = VEHICLE_SEVERITY.get(name, Severity.INFO)
            texts += self.text(severity, change_text("vehicle", name.name, machine.vehicle_reason))
        if machine.mode != self._mode:
            texts += self.text(Severity.INFO, f"mode {Mode(machine.mode).name}")
        if self._placed and not machine.placed:
            words = f"PLACE UNKNOWN: {reason_text(reasons.PLACE_UNKNOWN)}"
            texts += self.text(Severity.ERROR, words)
        self._goal, self._vehicle, self._mode = goal, vehicle, machine.mode
        self._placed = machine.placed
        return texts + self._mission_texts()

    def _mission_texts(self) -> list[Statustext]:
        mission = self._mission
        progress = (mission.number, mission.state, mission.current)
        if progress == self._progress:
            return []
        self._progress = progress
        state = mission_state(mission.state, mission.reason)
        words = change_text("mission", state, mission.reason)
        if mission.items:
            words += f" (item {mission.current + 1} of {len(mission.items)})"
        failed = state == MissionState.FAILED.name
        return self.text(Severity.ERROR if failed else Severity.INFO, words)

    def text(self, severity: int, words: str) -> list[Statustext]:
        """Return the pieces of one text, at most 50 bytes each; no pieces for an empty text."""
        self._text_id = self._text_id % 65_535 + 1
        return pieces_of(words, self._text_id, severity) if words else []


def change_text(what: str, state: str, reason: int) -> str:
    """Return the text for a state, with the reason if there is one."""
    if reason == reasons.OK:
        return f"{what} {state}"
    gap = " " if reason == reasons.BY_EMERGENCY_STOP else ": "
    return f"{what} {state}{gap}{reason_text(reason)}"
