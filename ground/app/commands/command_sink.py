"""Define what the app needs of the object that runs its commands."""

from typing import Protocol

from ground.commands.command import OperatorCommand
from ground.console.completion import Assistance
from ground.map.scene import MapTarget


class CommandSink(Protocol):
    """Runs commands and command lines, and remembers them."""

    @property
    def last(self) -> str:
        """The last command as a line for a shell; empty when there was none."""

    def begin_world(self, *, keeps_draft: bool) -> None:
        """Remove the changes of robots that have ended; also the draft, unless it is kept."""

    @property
    def draft_items(self) -> tuple[MapTarget, ...]:
        """The waypoints of the mission draft."""

    def run_line(self, line: str) -> None:
        """Run a line; refusals and outcomes go to the log."""

    def perform(self, command: OperatorCommand, line: str = "") -> None:
        """Perform a command in the same way; `line` is what the operator has typed, if any."""

    def assist(self, text: str) -> Assistance:
        """Return the completions of a line, and a hint on its arguments."""

    def search(self, words: str) -> Assistance:
        """Return the earlier lines that contain these words, the newest first."""

    def recall(self, text: str, step: int) -> str:
        """Return an earlier (step -1) or later (1) command line."""

    def begin_teleop(self) -> bool:
        """Start teleop. Return False, with the reason in the log, when it is refused."""

    def steer(self, speed_m_s: float, yaw_rate_rad_s: float) -> None:
        """Send a teleop command."""

    def end_teleop(self) -> None:
        """Stop the robot and switch to HOLD."""
