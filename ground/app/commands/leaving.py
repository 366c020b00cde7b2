"""Leave the app; while a robot drives, only at the second press."""

from typing import Final

from ground.app.commands.second_press import SecondPress
from ground.app.playback.app_interface import AppControl
from ground.client.telemetry import Age
from ground.station.station import Station
from ground.text.status_parts import GOAL_MODES
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus

WITHIN_S: Final = 5.0


class Leaving:
    """Performs the keys that leave the app or look as if they did."""

    def __init__(self, app: AppControl) -> None:
        self._app = app
        self._pressed = SecondPress(lambda: app.station.time_s, WITHIN_S)

    def quit(self) -> None:
        """Leave at once when all robots stand, else at the second press."""
        driving = robots_that_drive(self._app.station)
        if not driving or self._pressed.is_second():
            self._app.exit(0)
            return
        drive = "drives" if len(driving) == 1 else "drive"
        ends = "; that ends the simulation" if self._app.stack is not None else ""
        key = self._app.key_shown("quit")
        self._say(
            f"{' '.join(driving)} {drive}: {key} again within {WITHIN_S:g} s leaves{ends}",
        )

    def explain(self) -> None:
        """Say which key leaves."""
        self._say(f"{self._app.key_shown('quit')} quits")

    def _say(self, words: str) -> None:
        self._app.note(words)
        self._app.notify(words, severity="warning", timeout=WITHIN_S, markup=False)


def robots_that_drive(station: Station) -> list[str]:
    """Return the robots that drive to a goal or by hand; none in a recording."""
    if not station.live:
        return []
    return [
        entry.robot
        for entry in station.roster()
        if entry.status.age is not Age.GONE
        and isinstance(status := entry.status.message, NavigatorStatus)
        and drives(status)
    ]


def drives(status: NavigatorStatus) -> bool:
    """Return whether a robot is armed, and drives to a goal or by hand."""
    if status.vehicle != Vehicle.ACTIVE:
        return False
    under_way = GoalState.ACCEPTED <= status.goal <= GoalState.ALIGNING
    return status.mode == Mode.MANUAL or (status.mode in GOAL_MODES and under_way)
