"""A command that is one MAVLink command to the robot."""

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

from ground.client.link import Link
from ground.client.outcomes import Answer
from ground.client.session import Session, patience_ns
from ground.commands.command import TimedCommand
from protocol.wire.enums import Command
from protocol.wire.messages import CommandRequest


class Parts(NamedTuple):
    """A MAVLink command with the parameters that the robot reads."""

    command: Command
    param1: float = 0.0
    param2: float = 0.0
    param3: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlainCommand(TimedCommand):
    """One MAVLink command to the robot."""

    parts: ClassVar[Parts]

    def perform(self, session: Session) -> Answer:
        """Send the command and return the robot's answer."""
        patience = patience_ns(self.timeout_s)
        return session.with_holder(
            session.link.ask(self.request(session.link), patience_ns=patience)
        )

    def request(self, link: Link) -> CommandRequest:
        """Return the request, with an id of its own."""
        return link.command(*self.wire())

    def wire(self) -> Parts:
        """Return the command and its parameters."""
        return self.parts
