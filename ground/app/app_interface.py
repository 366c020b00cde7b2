"""Define what screens, keys and commands need of the app, so that none of them imports it."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Literal, Protocol, TypeVar

from ground.app.commands.command_sink import CommandSink
from ground.app.input.keymap import KeyBinding
from ground.app.panels.status import SessionInfo
from ground.app.stops.band import Band
from ground.station.station import Station

if TYPE_CHECKING:
    from textual.screen import ModalScreen

    from ground.app.playback.player import Player, RecordingReader
    from ground.app.screens.choice import Choice
    from ground.launch.launcher import Stack
    from ground.launch.recording_session import RecordingSession

Loudness = Literal["information", "warning", "error"]
"""How a message over the screen looks."""
T = TypeVar("T")


class AppInterface(Protocol):
    """The app as its screens see it; the replay and tests provide others."""

    @property
    def commands(self) -> CommandSink:
        """The runner of its commands."""

    @property
    def station(self) -> Station:
        """The station that is shown."""

    def keys_now(self) -> list[KeyBinding]:
        """Return the keys that are active now."""

    @property
    def session_info(self) -> SessionInfo:
        """The facts that the status line shows besides the robot's state."""

    @property
    def is_first_start(self) -> bool:
        """True while the hints for a new operator are shown."""

    @property
    def lesson(self) -> str:
        """The present step of the tutorial; empty without one."""

    @property
    def unread_warnings(self) -> int:
        """The number of warnings and errors since the log screen was last shown."""

    def stop_band(self, width: int, height: int) -> Band:
        """Return the band about robots that have stopped."""

    def key_shown(self, id: str) -> str:
        """Return the first key of an action as it is shown."""

    @property
    def ascii_only(self) -> bool:
        """True when the terminal's font has nothing but ASCII."""

    @property
    def stack(self) -> "Stack | None":
        """The processes that this app started, if any."""

    def run_in_background(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """Run a slow job in a thread; `done` gets the result, an error goes to the log."""

    def note(self, text: str) -> None:
        """Add a line to the log."""

    def choose(
        self, title: str, choices: "Sequence[str | Choice]", done: Callable[[str], None]
    ) -> None:
        """Let the operator choose one of a few."""


class AppControl(AppInterface, Protocol):
    """The app as its keys, commands and alerts see it: they change screens and show messages."""

    @property
    def player(self) -> "Player | None":
        """The player of the recording that is shown, if any."""

    @property
    def reader(self) -> "RecordingReader":
        """What reads a recording in the background."""

    @property
    def recording(self) -> "RecordingSession | None":
        """The recording of this session, if there is one."""

    @property
    def theme(self) -> str:
        """The name of the theme."""

    @property
    def size(self) -> tuple[int, int]:
        """The columns and rows of the terminal."""

    def choose_theme(self, name: str) -> None:
        """Show a theme, and remember it for the next start."""

    def open_replay(self, path: Path) -> None:
        """Read a recording in the background, and show it. Raise UserError if there is none."""

    def switch_mode(self, mode: str) -> object:
        """Show a screen by its name."""

    def push_screen(self, screen: "ModalScreen[None]") -> object:
        """Show a dialog above the screen."""

    def notify(
        self, message: str, *, severity: Loudness, timeout: float | None, markup: bool
    ) -> None:
        """Show a message over the screen for `timeout` seconds."""

    def clear_notifications(self) -> None:
        """Remove all messages over the screen."""

    def bell(self) -> None:
        """Ring the terminal's bell."""

    def notify_desktop(self, text: str) -> None:
        """Ask the terminal to show a notification on its desktop."""

    def copy_to_clipboard(self, text: str) -> None:
        """Copy a text to the clipboard."""

    def export_screenshot(self) -> str:
        """Return the screen as SVG."""

    def action_command_palette(self) -> None:
        """Open the command palette."""

    def suspend_to_shell(self) -> None:
        """Restore the terminal, and stop until the shell continues this program."""

    def exit(self, result: int) -> None:
        """End the app with this code."""
