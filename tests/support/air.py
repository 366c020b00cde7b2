"""Mailboxes that a test fills, where there would be a bus."""

from collections.abc import Callable
from typing import Any

from protocol.bus.mailbox import Mailbox, Sample
from protocol.topics import ENCODING, Topic
from protocol.wire.codec import Encoder
from protocol.wire.message import Message


class Air:
    """One mailbox for each topic."""

    def __init__(self) -> None:
        self.boxes: dict[str, Mailbox[Any]] = {}
        self._encoder = Encoder(1, 1)

    def mailbox(
        self,
        topic: Topic[Any],
        robot: str | None = None,
        notify: Callable[[int], None] | None = None,
        *,
        take: Callable[[str, bytes, int], None] | None = None,
    ) -> Mailbox[Any]:
        return self.boxes.setdefault(topic.path, Mailbox(topic, notify))

    def put(self, topic: Topic[Any], message: Message, at_ns: int) -> None:
        self.boxes[topic.path].store(Sample(ENCODING, self._encoder.encode(message)), at_ns)
