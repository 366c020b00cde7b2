"""What the app needs of the object that does its commands."""

from typing import Protocol

from ground.client.operations import Operation
from ground.client.results import Outcome
from ground.console import AppCommand
from ground.map import Target


class CommandSink(Protocol):
    """Does typed operations and typed lines, and remembers them."""

    @property
    def last(self) -> str:
        """The last line as a command for a shell; empty when there was none."""

    @property
    def draft_items(self) -> tuple[Target, ...]:
        """The waypoints of the mission that is being made."""

    def run_line(self, line: str) -> None:
        """Do it off this thread; refusals and outcomes are lines in the log."""

    def perform(self, command: Operation[Outcome] | AppCommand) -> None:
        """Do what a key or a choice means, in the same way."""

    def is_local(self, line: str) -> bool:
        """Whether it concerns the screen, and no robot."""

    def complete(self, text: str) -> list[str]:
        """How the line could go on."""

    def recall(self, text: str, step: int) -> str:
        """An earlier command line (step -1) or a later one (1)."""

    def begin_teleop(self) -> bool:
        """Begin to drive by hand; False, with the reason in the log, when that may not be."""

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Drive like this for a moment."""

    def end_teleop(self) -> None:
        """Stand, and hold."""
