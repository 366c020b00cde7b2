"""The answering side of a query: one thread decodes requests, another one sends the replies.

Zenoh's receive thread only enqueues, and no caller of `reply` waits for a reader that is slow.
A request that cannot be read is counted and denied with a reason.
"""

import logging
import threading
from collections.abc import Callable
from queue import SimpleQueue
from typing import Any, Final, NamedTuple

import zenoh

from protocol.bus.mailbox import Sample, opened
from protocol.bus.robot_clock import time_in
from protocol.topics import ENCODING, Service, operator_in
from protocol.wire.codec import LARGEST_FRAME, Encoder
from protocol.wire.enums import AckResult
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck
from protocol.wire.reasons import Reason
from runtime.errors import RemoteError

JSON = "application/json"
LOG = logging.getLogger(__name__)
MAX_WAITING: Final = 1000
MAX_REPLIES: Final = 256
"""Replies that wait to be sent. Further ones are dropped, as after a lost answer."""


class ServiceRequest:
    """A request: answer it once, from any thread, now or later; answering never blocks.

    `operator` is who asks, taken from the key; empty when the key names no operator.
    `good_until_ns` is when the request ceases to count, on the clock of this process's bus; None
    when it does not say. `arrived_ns` is when the request arrived, on the same clock.
    """

    def __init__(
        self,
        query: zenoh.Query,
        key: str,
        service: Service,
        encoder: Encoder,
        send: "Callable[[Reply], None]",
        arrived_ns: int,
    ) -> None:
        asked = str(query.key_expr)
        self.arrived_ns = arrived_ns
        self.service = service
        self.operator = operator_in(asked.removeprefix(f"{key}/")) if asked != key else ""
        self.key = asked if self.operator else key
        self.message: Message | None = None
        self.good_until_ns: int | None = None
        self._query: zenoh.Query | None = query
        self._encoder = encoder
        self._send = send
        self._lock = threading.Lock()

    @property
    def payload(self) -> bytes:
        """The bytes of the request; none when it carries none, or was answered before."""
        query = self._query
        return b"" if query is None or query.payload is None else taken(query.payload)

    def read(self) -> None:
        """Decode the request; RemoteError when it is not one this service takes."""
        query = self._query
        if query is None:
            return
        self.good_until_ns = attached_time(query.attachment)
        if self.service.requests:
            encoding = "" if query.encoding is None else str(query.encoding)
            self.message = opened(Sample(encoding, self.payload), self.service.requests)

    def reply(self, answer: Message | bytes) -> bool:
        """A message, or bytes of JSON; False when it was answered or dropped before."""
        query = self._taken()
        if query is None:
            return False
        self._send(Reply(query, self.key, answer, self._encoder))
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


class Reply(NamedTuple):
    """An answer on its way out: a message, or the bytes of a JSON text."""

    query: zenoh.Query
    key: str
    answer: Message | bytes
    encoder: Encoder


Handler = Callable[[ServiceRequest], object]


def taken(payload: zenoh.ZBytes) -> bytes:
    """The bytes of a frame. What is longer than any is not copied: zeros stand for it."""
    return payload.to_bytes() if len(payload) <= LARGEST_FRAME else bytes(LARGEST_FRAME + 1)


def attached_time(attachment: zenoh.ZBytes | None) -> int | None:
    """Return the time that an attachment carries, in ns; None when it carries none."""
    return None if attachment is None else time_in(taken(attachment))


class ServiceQueue:
    """Takes the requests of all services of one bus, in order."""

    def __init__(self) -> None:
        self.rejected: dict[str, int] = {}
        self.last_rejection = ""
        self.unsent = 0
        """Replies that their askers did not wait for, or asked for on a key that is not served."""

        self._waiting: SimpleQueue[tuple[ServiceRequest, Handler] | None] = SimpleQueue()
        self._replies: SimpleQueue[Reply | None] = SimpleQueue()
        self._open: list[ServiceRequest] = []
        self._threads: dict[str, threading.Thread] = {}
        self._closed = False

    def put(self, asked: ServiceRequest, handler: Handler) -> None:
        """Enqueue a request; called from the bus. What is too much is dropped unanswered."""
        if self._waiting.qsize() < MAX_WAITING:
            self._waiting.put((asked, handler))
        else:
            self._count(asked.service)
            asked.drop()

    def send(self, reply: Reply) -> None:
        """Enqueue a reply and return at once; what is too much is dropped."""
        if self._replies.qsize() < MAX_REPLIES:
            self._replies.put(reply)

    def start(self) -> None:
        """Start the threads, or those again that have ended; may be called at any time."""
        for name, work in (("requests", self._take_requests), ("replies", self._send_replies)):
            thread = self._threads.get(name)
            if not self._closed and (thread is None or not thread.is_alive()):
                thread = threading.Thread(target=work, name=name, daemon=True)
                self._threads[name] = thread
                thread.start()

    def close(self) -> None:
        """Stop taking requests and drop those still unanswered."""
        self._closed = True
        self._waiting.put(None)
        self._replies.put(None)
        for thread in self._threads.values():
            if thread is not threading.current_thread():
                thread.join(timeout=1.0)
        for asked in self._open:
            asked.drop()

    def _take_requests(self) -> None:
        while (item := self._waiting.get()) is not None:
            asked, handler = item
            self._open = [other for other in self._open if other.open]
            self._open.append(asked)
            self._hand_on(asked, handler)

    def _send_replies(self) -> None:
        while (reply := self._replies.get()) is not None:
            try:
                send_now(reply)
            except zenoh.ZError:
                self.unsent += 1
            except Exception:  # a defect of one service must not end the others
                LOG.exception("a reply on %s could not be sent", reply.key)

    def _hand_on(self, asked: ServiceRequest, handler: Handler) -> None:
        try:
            asked.read()
        except RemoteError as error:
            self._count(asked.service)
            self.last_rejection = str(error)
            asked.reply(refusal(Reason.MALFORMED))
            return
        try:
            handler(asked)
        except Exception:
            LOG.exception("the handler of %s failed", asked.key)
            asked.reply(refusal(Reason.NONE, result=AckResult.FAILED))

    def _count(self, service: Service) -> None:
        self.rejected[service.path] = self.rejected.get(service.path, 0) + 1


def send_now(reply: Reply) -> None:
    """Encode and send a reply. May block while its reader is slow."""
    raw = isinstance(reply.answer, bytes)
    payload = (
        reply.answer if isinstance(reply.answer, bytes) else reply.encoder.encode(reply.answer)
    )
    with reply.query:
        reply.query.reply(reply.key, payload, encoding=JSON if raw else ENCODING)


def refusal(reason: int, command: int = 0, result: AckResult = AckResult.DENIED) -> CommandAck:
    """COMMAND_ACK that says no, with the reason."""
    return CommandAck(command=command, result=result, result_param2=reason)
