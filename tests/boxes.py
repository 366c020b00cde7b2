"""A bus without a wire: mailboxes that hold what a test puts in, frames left out."""

from typing import Any

from protocol.bus import Bus
from protocol.mailbox import Mailbox
from protocol.topics import Topic


class Box(Mailbox[Any]):
    """Holds what the test puts in."""

    newest: tuple[Any, int] | None = None

    def latest(self) -> tuple[Any, int] | None:
        return self.newest


class Wireless(Bus):
    """One mailbox for each topic; nothing is opened."""

    def __init__(self) -> None:
        self.boxes: dict[str, Box] = {}

    def mailbox(self, topic: Topic[Any], *_: Any, **__: Any) -> Box:
        return self.boxes.setdefault(topic.path, Box(topic))
