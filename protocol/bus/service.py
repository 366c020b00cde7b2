"""The answering side of a query: requests are decoded in one thread of their own and handed on.

Zenoh's receive thread only enqueues. What cannot be read is counted and denied with a reason.
"""

import logging
import re
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Final

import zenoh

from protocol.codec import LARGEST_FRAME, Encoder
from protocol.enums import AckResult
from protocol.errors import RemoteError
from protocol.mailbox import Sample, opened
from protocol.message import Message
from protocol.messages import CommandAck
from protocol.reasons import Reason
from protocol.topics import ENCODING, Service

JSON = "application/json"
LOG = logging.getLogger(__name__)
MOST_WAITING: Final = 1000
IDENTITY = re.compile(rb"[0-9a-f]{1,32}\Z")
"""Of a Zenoh session."""


class Asked:
    """A request: answer it once, from any thread, now or later.

    `operator` is who asks, as the bus knows it; empty for whoever is no operator.
    """

    def __init__(self, query: zenoh.Query, key: str, service: Service, encoder: Encoder) -> None:
        self.service = service
        self.key = key
        self.message: Message | None = None
        self.operator = ""
        self._query: zenoh.Query | None = query
        self._encoder = encoder
        self._lock = threading.Lock()

    def read(self) -> None:
        """Decode the request; RemoteError when it is not one this service takes."""
        query = self._query
        if query is None:
            return
        self.operator = sender_in(query.attachment)
        if self.service.requests:
            payload = b"" if query.payload is None else taken(query.payload)
            encoding = "" if query.encoding is None else str(query.encoding)
            self.message = opened(Sample(encoding, payload), self.service.requests)

    def reply(self, answer: Message | bytes) -> bool:
        """A message, or bytes of JSON; False when it was answered or dropped before."""
        query = self._taken()
        if query is None:
            return False
        raw = isinstance(answer, bytes)
        payload = answer if isinstance(answer, bytes) else self._encoder.encode(answer)
        with query:
            query.reply(self.key, payload, encoding=JSON if raw else ENCODING)
        return True

    def drop(self) -> None:
        """Leave it unanswered: the asker hears at once that nobody answers."""
        query: Any = self._taken()
        if query is not None:
            query.drop()

    @property
    def open(self) -> bool:
        return self._query is not None

    def _taken(self) -> zenoh.Query | None:
        with self._lock:
            query, self._query = self._query, None
            return query


Handler = Callable[[Asked], object]


def taken(payload: zenoh.ZBytes) -> bytes:
    """The bytes of a frame. What is longer than any is not copied: zeros stand for it."""
    return payload.to_bytes() if len(payload) <= LARGEST_FRAME else bytes(LARGEST_FRAME + 1)


def sender_in(attachment: zenoh.ZBytes | None) -> str:
    """Which operator an attachment names; empty when it names none, or is none of ours."""
    named = b"" if attachment is None else taken(attachment)
    return named.decode("ascii") if IDENTITY.match(named) else ""


class Desk:
    """Takes the requests of all services of one bus, in order."""

    def __init__(self) -> None:
        self.rejected: dict[str, int] = {}
        self.last_rejection = ""
        self._waiting: SimpleQueue[tuple[Asked, Handler] | None] = SimpleQueue()
        self._open: list[Asked] = []
        self._thread: threading.Thread | None = None

    def put(self, asked: Asked, handler: Handler) -> None:
        """Called from the bus: enqueues; what is too much is dropped, and its asker told so."""
        if self._waiting.qsize() < MOST_WAITING:
            self._waiting.put((asked, handler))
        else:
            self.rejected[asked.service.path] = self.rejected.get(asked.service.path, 0) + 1
            asked.drop()

    def start(self) -> None:
        if self._thread is None:
            self._thread = threading.Thread(target=self._run, name="services", daemon=True)
            self._thread.start()

    def close(self) -> None:
        """Stop taking requests and drop those still unanswered."""
        self._waiting.put(None)
        if self._thread is not None and self._thread is not threading.current_thread():
            self._thread.join(timeout=1.0)
        for asked in self._open:
            asked.drop()

    def _run(self) -> None:
        while (item := self._waiting.get()) is not None:
            asked, handler = item
            self._open = [other for other in self._open if other.open]
            self._open.append(asked)
            self._hand_on(asked, handler)

    def _hand_on(self, asked: Asked, handler: Handler) -> None:
        try:
            asked.read()
        except RemoteError as error:
            path = asked.service.path
            self.rejected[path] = self.rejected.get(path, 0) + 1
            self.last_rejection = str(error)
            asked.reply(refusal(Reason.MALFORMED))
            return
        try:
            handler(asked)
        except Exception:
            LOG.exception("the handler of %s failed", asked.key)
            asked.reply(refusal(Reason.NONE, result=AckResult.FAILED))


def refusal(reason: int, command: int = 0, result: AckResult = AckResult.DENIED) -> CommandAck:
    """COMMAND_ACK that says no, with the reason."""
    return CommandAck(command=command, result=result, result_param2=reason)
