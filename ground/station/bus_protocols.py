"""Describe what a station needs of a bus: receiving to show a robot, publishing to command it."""

from collections.abc import Callable, Iterable
from typing import Any, Protocol, TypeVar, runtime_checkable

from ground.client.emergency_stop import MessagePublisher, ServiceCaller
from ground.client.presence import LivelinessToken
from ground.client.telemetry import MailboxSource
from protocol.bus.mailbox import Mailbox
from protocol.bus.network import Hub
from protocol.topics import Topic
from protocol.wire.message import Message

M = TypeVar("M", bound=Message)


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


@runtime_checkable
class LiveBus(ReadableBus, Protocol):
    """A live bus, with which an operator can command."""

    @property
    def zid(self) -> str:
        """Zenoh identity of the process."""
        ...

    @property
    def operator(self) -> str | None:
        """Identity of the operator, if any."""
        ...

    def publisher(self, topic: Topic[M], robot: str | None = None) -> MessagePublisher[M]:
        """Return a publisher for a topic."""
        ...

    def unsubscribe(self, mailbox: Mailbox[Any]) -> None:
        """End the subscription of a mailbox."""

    def announce(self, robot: str | None = None) -> None:
        """Publish a liveliness token of this process."""

    def watch(self, handler: Callable[[Any, bool], None]) -> None:
        """Call the handler for tokens that appear and disappear."""

    def hub(self) -> Hub:
        """Check the state of the hub; may block for a while."""
        ...

    def kept_out(self) -> str:
        """Return why the peer rejects this client, or an empty text."""
        ...
