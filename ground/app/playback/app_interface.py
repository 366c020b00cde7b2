"""Define what screens need of the app, so that tests and the replay can provide another one."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Protocol, TypeVar

from ground.app.commands.command_sink import CommandSink
from ground.app.input.keymap import KeyBinding
from ground.app.panels.status import SessionInfo
from ground.app.stops.band import Band
from ground.station.station import Station

if TYPE_CHECKING:
    from ground.app.screens.choice import Choice
    from ground.launch.launcher import Stack

T = TypeVar("T")


class AppInterface(Protocol):
    """The app as its screens see it."""

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
