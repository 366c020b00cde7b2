"""What all protocols share: their interface, the sender of a message, and the outbox for answers.

Parameter lists, files and logs share one budget of bytes for each client.
"""

from collections.abc import Callable, Collection, Mapping
from typing import Final, NamedTuple

from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from protocol.wire.enums import Severity
from protocol.wire.statustext import pieces_of
from runtime.units import NS_PER_S

COMPONENT: Final = mavlink.MAV_COMP_ID_AUTOPILOT1
MAVLINK_1_LAST: Final = 255
"""The last id of a message that MAVLink 1 can carry."""
EVERYONE: Final = None
WATCHER: Final = "signing: this endpoint takes commands only from clients that sign"
NEWCOMER: Final = "by TCP a client has to send a HEARTBEAT before its first command"


class Sender(NamedTuple):
    """The origin of a message.

    `client` numbers the peers of all endpoints, and is never reused. `barred` is the reason why
    this message may command nothing, such as `WATCHER` or `NEWCOMER`; empty if it may. `doubt` is
    what is wrong with the time stamp of its signature: then it is an emergency stop. `is_mavlink1`:
    it gets no messages with an id above MAVLINK_1_LAST.
    """

    client: int
    system: int
    component: int
    barred: str = ""
    is_signed: bool = False
    is_loopback: bool = True
    doubt: str = ""
    is_mavlink1: bool = False

    @property
    def may_command(self) -> bool:
        """Whether what it asks for is done."""
        return not self.barred


class Send(NamedTuple):
    """A message to send to one client, or to all of them if `client` is None.

    `is_stream`: the next one follows by itself, so this one may be dropped.
    """

    message: MavMessage
    client: int | None
    is_stream: bool = False


class Outbox:
    """The messages of one vehicle that have not been sent; `filled` is called at the first one."""

    def __init__(self) -> None:
        self.filled: Callable[[], object] = lambda: None
        self._sends: list[Send] = []
        self._texts = 0

    def send(
        self, message: MavMessage, client: int | None = EVERYONE, *, is_stream: bool = False
    ) -> None:
        """Add a message."""
        if not self._sends:
            self.filled()
        self._sends.append(Send(message, client, is_stream))

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


class MavService:
    """One MAVLink protocol of one vehicle, without I/O. Answers go into the vehicle's outbox.

    `handles` are the ids of the messages that `receive` takes.
    """

    handles: Collection[int] = ()

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Process a message for this vehicle."""

    def due(self, now_ns: int) -> None:
        """Process streams, retries and time-outs. Called about every 20 ms."""

    def forget(self, client: int) -> None:
        """Drop the state of a client that has disconnected."""


FAST_BYTES_S: Final = 250_000
"""Limit for a line without its own; a client in Python reads more than twice as fast."""
LINE_SHARE: Final = 0.3
"""The part of a slow line that transfers may use; at 57,600 baud the streams take half of it."""
FULL_NS: Final = 60_000_000
"""Unused budget is kept for this time."""


class Pacing:
    """Budgets in bytes.

    `lines` holds the capacity of each client's line, None if it has no limit.
    """

    def __init__(self, lines: Mapping[int, int | None]) -> None:
        self._lines = lines
        self._budgets: dict[int, tuple[float, int]] = {}

    def take(self, client: int, size: int, now_ns: int) -> bool:
        """Return whether bytes may be sent now, and subtract them from the budget."""
        line_bytes_s = self._lines.get(client)
        rate = FAST_BYTES_S if line_bytes_s is None else line_bytes_s * LINE_SHARE
        full = rate * FULL_NS / NS_PER_S
        left, since_ns = self._budgets.get(client, (full, now_ns))
        left = min(full, left + rate * (now_ns - since_ns) / NS_PER_S)
        # The budget may become negative, so that slow lines also carry long messages.
        may = left > 0
        self._budgets[client] = (left - size if may else left, now_ns)
        return may

    def forget(self, client: int) -> None:
        """Drop the budget of a client that has disconnected."""
        self._budgets.pop(client, None)
