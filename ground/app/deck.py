"""What screens ask of the app around them, so that they can be shown by another one in tests."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol, TypeVar

from ground.app.faces.status import Setting
from ground.app.keys import Key
from ground.map import Target
from ground.station.station import Station

if TYPE_CHECKING:
    from ground.stack import Stack

T = TypeVar("T")


class Deck(Protocol):
    """The app, as its screens see it."""

    @property
    def station(self) -> Station: ...
    def keys_now(self) -> list[Key]:
        """What keys do at this moment."""

    @property
    def setting(self) -> Setting: ...
    @property
    def ascii_only(self) -> bool: ...

    @property
    def stack(self) -> "Stack | None":
        """The processes that are ours, when they are."""

    def aside(self, job: Callable[[], T], done: Callable[[T], None]) -> None:
        """Do something slow in a thread; `done` gets the result, an error goes to the log."""

    def give(self, line: str) -> None:
        """Do what a command line says; what comes of it is in the log."""

    @property
    def drafted(self) -> tuple[Target, ...]:
        """The waypoints of the mission that is being made."""

    def complete(self, text: str) -> list[str]: ...
    def recall(self, text: str, step: int) -> str:
        """An earlier command line (step -1) or a later one (1)."""

    def take_hand(self) -> bool:
        """Begin to drive by hand; False, with the reason in the log, when that may not be."""

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Drive like this for a moment."""

    def drop_hand(self) -> None:
        """Stand, and hold."""

    def say(self, text: str) -> None:
        """A line in the log."""

    def choose(self, title: str, choices: list[str], done: Callable[[str], None]) -> None:
        """Let the operator pick one."""
