"""Common types of the protocols: the sender of a message, and the outbox for answers."""

from collections.abc import Collection
from typing import Final, NamedTuple, Protocol

from gateways.mavlink.dialect import MavMessage, mavlink
from protocol.wire.enums import Severity
from protocol.wire.statustext import pieces_of

COMPONENT: Final = mavlink.MAV_COMP_ID_AUTOPILOT1
EVERYONE: Final = None
WATCHER: Final = "signing: this endpoint takes commands only from clients that sign"
NEWCOMER: Final = "by TCP a client has to send a HEARTBEAT before its first command"


class Sender(NamedTuple):
    """The origin of a message.

    `client` numbers the peers of all endpoints, and is never reused. `barred` is the reason why
    this message may command nothing, such as `WATCHER` or `NEWCOMER`; empty if it may. `doubt` is
    what is wrong with the time stamp of its signature: then it is an emergency stop.
    """

    client: int
    system: int
    component: int
    barred: str = ""
    is_signed: bool = False
    is_loopback: bool = True
    doubt: str = ""

    @property
    def may_command(self) -> bool:
        """Whether what it asks for is done."""
        return not self.barred


class Send(NamedTuple):
    """A message to send to one client, or to all of them if `client` is None."""

    message: MavMessage
    client: int | None


class Outbox:
    """The messages of one vehicle that have not been sent."""

    def __init__(self) -> None:
        self._sends: list[Send] = []
        self._texts = 0

    def send(self, message: MavMessage, client: int | None = EVERYONE) -> None:
        """Add a message."""
        self._sends.append(Send(message, client))

    def text(self, severity: Severity, words: str, client: int | None = EVERYONE) -> None:
        """Add a STATUSTEXT, in several pieces if it is longer than 50 bytes."""
        self._texts = self._texts % 0xFFFF + 1
        for piece in pieces_of(words, self._texts, severity):
            self.send(
                mavlink.MAVLink_statustext_message(
                    severity, piece.text.encode(), piece.id, piece.chunk_seq
                ),
                client,
            )

    def take(self) -> list[Send]:
        """Return all messages in their order, and remove them."""
        taken, self._sends = self._sends, []
        return taken


class MavService(Protocol):
    """One MAVLink protocol of one vehicle, without I/O. Answers go into the vehicle's outbox."""

    @property
    def handles(self) -> Collection[int]:
        """The ids of the messages that `receive` takes."""

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Process a message for this vehicle."""

    def due(self, now_ns: int) -> None:
        """Process streams, retries and time-outs. Called about every 20 ms."""

    def forget(self, client: int) -> None:
        """Drop the state of a client that has disconnected."""
