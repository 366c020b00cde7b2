"""Give the replay screen an app without commands to the robot."""

from collections.abc import Callable
from typing import Final

from ground.app.app_interface import AppControl
from ground.app.commands.command_sink import CommandSink
from ground.app.panels.status import SessionInfo
from ground.app.playback.player import Player
from ground.commands.command import OperatorCommand
from ground.console.app_commands import AppCommand, Undo
from ground.console.parser import read
from ground.map.scene import MapTarget
from ground.station.station import Station
from runtime.errors import UserError

REFUSED: Final = "this is a replay: press 1 to command the robot"


def is_allowed(command: OperatorCommand) -> bool:
    """Return whether it concerns only the screen, or only stops the robot."""
    is_local = isinstance(command, AppCommand) and not isinstance(command, Undo)
    return is_local or command.facts.only_stops


class ReadOnlyCommands:
    """Passes on commands that concern the screen or stop the robot, and refuses all others."""

    def __init__(self, commands: CommandSink, note: Callable[[str], None]) -> None:
        self._commands = commands
        self.assist, self.recall, self.search = commands.assist, commands.recall, commands.search
        self._note = note

    def run_line(self, line: str) -> None:
        """Run a line for the screen, or one that stops the robot; refuse all others."""
        try:
            may_run = not line or is_allowed(read(line))
        except UserError:
            may_run = True  # a wrong line only causes a message
        if may_run:
            self._commands.run_line(line)
        else:
            self._note(REFUSED)

    def perform(self, command: OperatorCommand, line: str = "") -> None:
        """Perform a command for the screen, or one that stops the robot; refuse all others."""
        if is_allowed(command):
            self._commands.perform(command, line)
        else:
            self._note(REFUSED)

    @property
    def last(self) -> str:
        """The last command as a line for a shell."""
        return self._commands.last

    def begin_world(self, *, keeps_draft: bool) -> None:
        """Refuse."""
        self._note(REFUSED)

    @property
    def draft_items(self) -> tuple[MapTarget, ...]:
        """The waypoints of the mission draft."""
        return self._commands.draft_items

    def begin_teleop(self) -> bool:
        """Refuse."""
        self._note(REFUSED)
        return False

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Do nothing."""

    def end_teleop(self) -> None:
        """Do nothing."""


class ReadOnlyApp:
    """The app's interface without robot commands; shows the app's station without a recording."""

    def __init__(self, app: AppControl) -> None:
        self._app = app
        self.commands = ReadOnlyCommands(app.commands, self.note)
        self.ascii_only, self.stack = app.ascii_only, app.stack
        self.is_first_start, self.lesson = False, ""
        self.keys_now, self.choose = app.keys_now, app.choose
        self.stop_band, self.key_shown = app.stop_band, app.key_shown
        self.run_in_background = app.run_in_background

    @property
    def player(self) -> Player | None:
        """The player, if a recording is open."""
        return self._app.player

    @property
    def station(self) -> Station:
        """The station of the recording, else that of the robot."""
        return self._app.station if self.player is None else self.player.station

    @property
    def session_info(self) -> SessionInfo:
        """The facts that the status line shows besides the robot's state."""
        return self._app.session_info if self.player is None else SessionInfo(kind="REPLAY")

    @property
    def unread_warnings(self) -> int:
        """The number of warnings and errors since the log screen was last shown."""
        return self._app.unread_warnings

    def note(self, text: str) -> None:
        """Add a line to the log."""
        self.station.note(text)
