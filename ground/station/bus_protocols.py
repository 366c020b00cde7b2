"""Describe what a station needs of a bus to show a robot: a live one, or one that is played."""

from collections.abc import Iterable
from typing import Protocol

from ground.client.emergency_stop import ServiceCaller
from ground.client.presence import LivelinessToken
from ground.client.telemetry import MailboxSource


class Token(LivelinessToken, Protocol):
    """A liveliness token of a process, with the identity of that process."""

    @property
    def zid(self) -> str:
        """Zenoh identity of the process."""
        ...


class ReadableBus(ServiceCaller, MailboxSource, Protocol):
    """A bus that receives: a live one, or a recording that is played."""

    def present(self) -> Iterable[Token]:
        """Return the tokens of all present processes."""
        ...
