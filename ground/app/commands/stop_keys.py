"""Perform the keys of the emergency stop: the selected robot, all robots, and its release."""

from collections.abc import Callable, Mapping
from typing import Final

from ground.app.commands.second_press import SecondPress
from ground.app.panels.aged import live
from ground.app.playback.app_interface import AppInterface
from ground.app.stops.band import is_in_emergency_stop
from ground.client.operations import ClearEmergencyStop
from protocol.topics import STATUS

ALL_WITHIN_S: Final = 1.0
"""A second press within this time stops all robots."""
CLEAR_WITHIN_S: Final = 2.0


class StopKeys:
    """Performs the stop keys. Nothing here waits, and nothing rejects a stop."""

    def __init__(self, app: AppInterface) -> None:
        self._app = app

        def time_s() -> float:
            return app.station.time_s

        self._stopping = SecondPress(time_s, ALL_WITHIN_S)
        self._clearing = SecondPress(time_s, CLEAR_WITHIN_S)

    def actions(self) -> Mapping[str, Callable[[], object]]:
        """Return the actions by the id of their key."""
        return {
            **dict.fromkeys(("estop", "estop-here"), self.stop),
            "estop-all": self.stop_all,
            "clear-estop": self.clear,
        }

    def stop(self) -> None:
        """Stop the selected robot; at the second press within a second, all robots."""
        if self._stopping.is_second():
            self.stop_all()
        else:
            self._app.station.estop()

    def stop_all(self) -> None:
        """Stop all robots that are known."""
        self._app.station.estop_all()

    def clear(self) -> None:
        """Release the emergency stop of the selected robot at the second press.

        A robot whose state is not known may be in one.
        """
        station = self._app.station
        robot = station.robot
        if live(station.seen(STATUS)) is not None and not is_in_emergency_stop(station):
            self._app.note(f"{robot} is not in E-STOP: nothing to clear")
            return
        if self._clearing.is_second(robot):
            self._app.commands.perform(ClearEmergencyStop())
            return
        key = self._app.key_shown("clear-estop")
        self._app.note(f"press {key} again within {CLEAR_WITHIN_S:g} s to clear E-STOP of {robot}")
