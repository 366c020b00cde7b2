"""The app as the replay screen sees it: everything is as it was, and nothing can be commanded."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Final, TypeVar

from ground.app.input.key_table import KeyBinding
from ground.app.panels.status import SessionInfo
from ground.app.playback.player import Player
from ground.client.operations import Abort, Disarm, Hold, Operation, StopNow
from ground.client.results import Outcome
from ground.console import AppCommand
from ground.launch.launcher import Stack
from ground.map import Target
from ground.station import Station

if TYPE_CHECKING:
    from ground.app.app import GroundApp

T = TypeVar("T")
STOPS: Final = ("hold", "abort", "disarm", "estop", "stop")
REFUSED: Final = "this is a replay: the map of the robot itself is on 1"


class ReadOnlyApp:
    """Hands on what does not concern the robot; without a recording it shows the app's station."""

    def __init__(self, app: "GroundApp") -> None:
        self._app = app

    @property
    def player(self) -> Player | None:
        return self._app.player

    @property
    def station(self) -> Station:
        return self._app.station if self.player is None else self.player.station

    def keys_now(self) -> list[KeyBinding]:
        return self._app.keys_now()

    @property
    def session_info(self) -> SessionInfo:
        return self._app.session_info if self.player is None else SessionInfo(kind="REPLAY")

    @property
    def ascii_only(self) -> bool:
        return self._app.ascii_only

    @property
    def stack(self) -> Stack | None:
        return self._app.stack

    def run_in_background(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        self._app.run_in_background(job, done)

    def run_line(self, line: str) -> None:
        """Words of the app are done, and what stops the robot that is there; nothing else is."""
        if line and not (self._app.is_local(line) or line.split()[0] in STOPS):
            self.note(REFUSED)
            return
        self._app.run_line(line)

    def perform(self, command: Operation[Outcome] | AppCommand) -> None:
        """The same for what a key means."""
        if isinstance(command, AppCommand | Hold | Abort | Disarm | StopNow):
            self._app.perform(command)
        else:
            self.note(REFUSED)

    @property
    def last(self) -> str:
        return self._app.last

    def is_local(self, line: str) -> bool:
        return self._app.is_local(line)

    @property
    def draft_items(self) -> tuple[Target, ...]:
        return self._app.draft_items

    def complete(self, text: str) -> list[str]:
        return self._app.complete(text)

    def recall(self, text: str, step: int) -> str:
        return self._app.recall(text, step)

    def begin_teleop(self) -> bool:
        self.note(REFUSED)
        return False

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Nobody is there."""

    def end_teleop(self) -> None:
        """Nobody is there."""

    def note(self, text: str) -> None:
        self.station.note(text)

    def choose(self, title: str, choices: list[str], done: Callable[[str], None]) -> None:
        self._app.choose(title, choices, done)
