"""Perform commands that concern only the screen."""

from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ground.app.screens.help import show_help
from ground.console.app_commands import (
    AppCommand,
    CopyText,
    FindText,
    GoToScreen,
    KeyCommand,
    OpenReplay,
    RecordHere,
    SaveScreen,
    SelectRobot,
    SetTheme,
    ShowGhost,
    ShowHelp,
    SwitchLayers,
    SwitchMouse,
)
from ground.map.scene import LAYERS
from ground.recording.catalogue import recording_named
from ground.text.wording import THEMES
from protocol.topics import ODOMETRY
from runtime.errors import UserError
from runtime.files import replace_named

if TYPE_CHECKING:
    from ground.app.app import GroundApp
    from ground.app.screens.drive import DriveScreen

UNAVAILABLE: Final = "not available on this screen"
NO_MAP: Final = "this command needs the map: press 1 for the Drive screen"


class LocalCommands:
    """Performs commands of the command line for the screen."""

    def __init__(self, app: "GroundApp") -> None:
        self._app = app

    def do_command(self, command: AppCommand) -> str:
        """Perform a command and return its message.

        Raise UserError when it is not possible on this screen.
        """
        match command:
            case KeyCommand():
                self.do(command.key)
            case SetTheme():
                return self.theme(command.name)
            case ShowHelp():
                show_help(self._app, command.word, commands=True)
            case SaveScreen():
                return self.snap(command.file)
            case GoToScreen():
                self._app.switch_mode(command.name)
            case SwitchLayers():
                self.layers(command.names)
            case FindText():
                self.find(command.text)
            case SelectRobot():
                self._app.station.select(command.robot)
            case OpenReplay():
                self._app.open_replay(recording_named(command.file))
            case RecordHere():
                return self.record(begin=command.action == "start")
            case CopyText():
                return self.copy(command.what)
            case ShowGhost():
                self.ghost(command.navigator)
            case SwitchMouse():
                return self._app.use_mouse(is_used=command.action == "on")
            case _:
                raise UserError(UNAVAILABLE)
        return ""

    def theme(self, name: str | None) -> str:
        """Set the theme, or list the themes."""
        if name is None:
            return f"themes: {', '.join(THEMES)}; now {self._app.theme}"
        if name not in THEMES:
            raise UserError(f"no such theme: {name!r}; known: {', '.join(THEMES)}")
        self._app.choose_theme(name)
        return ""

    def copy(self, what: str) -> str:
        """Copy the pose as the words of `goto`, or do what the key does for a row or command."""
        if what == "row":
            self.do("copy")
            return ""
        text = self._app.commands.last if what == "last" else self.pose()
        if not text:
            raise UserError("nothing to copy yet")
        self._app.copy_to_clipboard(text)
        return f"copied: {text}"

    def pose(self) -> str:
        """Return the robot's pose as X Y DEG; UserError if it is not known now."""
        station = self._app.station
        pose = station.telemetry.live(ODOMETRY, station.now_ns)
        if pose is None:
            raise UserError("the pose of the robot is not known now")
        return f"{pose.x_m:z.3f} {pose.y_m:z.3f} {degrees(pose.heading_rad):z.1f}"

    def snap(self, path: Path | None) -> str:
        """Save the screen as an SVG file."""
        if path is None:
            self.do("shot")
            return ""
        replace_named(path, self._app.export_screenshot())
        return f"saved {path}"

    def layers(self, names: tuple[str, ...]) -> None:
        """Show or hide layers of the map, or let the operator choose them."""
        if not names:
            self.do("layers")
        for name in names:
            if name not in LAYERS:
                raise UserError(f"no such layer: {name!r}; known: {', '.join(LAYERS)}")
            self.map_screen().switch_layer(name)

    def record(self, *, begin: bool) -> str:
        """Start or end a recording."""
        recording = self._app.recording
        if recording is None:
            raise UserError("nothing to record: this app shows no robot")
        if begin:
            recording.begin()
            return "recording"
        return f"recorded: {recording.end()}"

    def ghost(self, navigator: str | None) -> None:
        """Simulate this navigator, or let the operator choose one."""
        if navigator is None:
            self.do("ghost")
        else:
            self.map_screen().start_ghost(navigator.lower())

    def find(self, words: str) -> None:
        """Show the log screen, then search it."""
        self._app.switch_mode("log")
        self._app.call_later(self.find_there, words)

    def find_there(self, words: str) -> None:
        """Find words on the log screen."""
        from ground.app.screens.log import LogScreen  # imported when it is first shown

        if isinstance(self._app.base_screen, LogScreen):
            self._app.base_screen.find(words)

    def do(self, id: str) -> None:
        """Run the action of a key, by id. Raise UserError when it is not possible here."""
        action = self._app.doable().get(id)
        if action is None:
            raise UserError(NO_MAP)
        action()

    def map_screen(self) -> "DriveScreen":
        """Return the screen that is shown, if it has a map. Raise UserError otherwise."""
        from ground.app.screens.drive import DriveScreen  # imported when it is first shown

        if not isinstance(self._app.base_screen, DriveScreen):
            raise UserError(NO_MAP)
        return self._app.base_screen
