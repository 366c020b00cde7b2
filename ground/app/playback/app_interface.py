"""What screens ask of the app around them, so that they can be shown by another one in tests."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, TypeVar

from ground.app.commands.command_sink import CommandSink
from ground.app.input.key_table import KeyBinding
from ground.app.panels.status import SessionInfo
from ground.station.station import Station

if TYPE_CHECKING:
    from ground.launch.launcher import Stack

T = TypeVar("T")


class AppInterface(CommandSink, Protocol):
    """The app, as its screens see it: it takes command lines, too."""

    @property
    def station(self) -> Station: ...
    def keys_now(self) -> list[KeyBinding]:
        """What keys do at this moment."""

    @property
    def session_info(self) -> SessionInfo: ...
    @property
    def ascii_only(self) -> bool: ...

    @property
    def stack(self) -> "Stack | None":
        """The processes that are ours, when they are."""

    def run_in_background(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """Do something slow in a thread; `done` gets the result, an error goes to the log."""

    def note(self, text: str) -> None:
        """A line in the log."""

    def choose(self, title: str, choices: list[str], done: Callable[[str], None]) -> None:
        """Let the operator pick one."""
