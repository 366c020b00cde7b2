"""A bus without a wire: mailboxes that hold what a test puts in, frames left out."""

from typing import Any

from protocol.bus.bus import Bus
from protocol.bus.mailbox import Mailbox, Origin
from protocol.topics import Topic


class Box(Mailbox[Any]):
    """Holds what the test puts in."""

    newest: tuple[Any, int] | None = None
    sender = "open/0a"
    delay_ns = 0
    """How long before its arrival a frame of an operator was sent."""

    def latest(self) -> tuple[Any, int] | None:
        return self.newest

    def received(self) -> list[tuple[Any, Origin]]:
        if self.newest is None:
            return []
        message, arrived_ns = self.newest
        return [(message, Origin(self.sender, arrived_ns - self.delay_ns, arrived_ns))]


class Wireless(Bus):
    """One mailbox for each topic; nothing is opened."""

    def __init__(self) -> None:
        self.boxes: dict[str, Box] = {}

    def mailbox(self, topic: Topic[Any], *_: Any, **__: Any) -> Box:
        return self.boxes.setdefault(topic.path, Box(topic))
