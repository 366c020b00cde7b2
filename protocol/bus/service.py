"""Server side of the services: one thread decodes requests, another sends the replies.

Zenoh's receive thread only enqueues, and no caller of `reply` waits for a slow client. A malformed
request is counted and denied with a reason.
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
"""Replies in the queue. Further ones are dropped; the client then times out."""


class ServiceRequest:
    """A request, to be answered once, from any thread, at any time; answering never blocks.

    `operator` is the requesting operator from the key; empty if the key names none. `good_until_ns`
    is the request's deadline on the clock of this process's bus; None if it has none.
    """

    def __init__(
        self,
        query: zenoh.Query,
        key: str,
        service: Service,
        encoder: Encoder,
        send: "Callable[[Reply], None]",
    ) -> None:
        requested_key = str(query.key_expr)
        self.service = service
        self.operator = operator_in(requested_key.removeprefix(f"{key}/"))
        self.key = requested_key if self.operator else key
        self.message: Message | None = None
        self.good_until_ns: int | None = None
        self._query: zenoh.Query | None = query
        self._encoder = encoder
        self._send = send
        self._lock = threading.Lock()

    @property
    def payload(self) -> bytes:
        """The bytes of the request; empty if it has none or is already answered."""
        query = self._query
        return b"" if query is None or query.payload is None else payload_bytes(query.payload)

    def read(self) -> None:
        """Decode the request; raise RemoteError unless the service accepts it."""
        query = self._query
        if query is None:
            return
        self.good_until_ns = attached_time(query.attachment)
        if self.service.requests:
            encoding = "" if query.encoding is None else str(query.encoding)
            self.message = opened(Sample(encoding, self.payload), self.service.requests)

    def reply(self, answer: Message | bytes) -> bool:
        """Answer with a message or bytes of JSON; return False if already answered or dropped."""
        query = self._taken()
        if query is None:
            return False
        self._send(Reply(query, self.key, answer, self._encoder))
        return True

    def drop(self) -> None:
        """Leave the request unanswered: its client gets an empty result at once."""
        query: Any = self._taken()
        if query is not None:
            query.drop()

    @property
    def open(self) -> bool:
        """Return whether the request is still unanswered."""
        return self._query is not None

    def _taken(self) -> zenoh.Query | None:
        with self._lock:
            query, self._query = self._query, None
            return query


class Reply(NamedTuple):
    """An answer to be sent: a message, or the bytes of a JSON text."""

    query: zenoh.Query
    key: str
    answer: Message | bytes
    encoder: Encoder


Handler = Callable[[ServiceRequest], object]


def payload_bytes(payload: zenoh.ZBytes) -> bytes:
    """Return the bytes of a frame; a longer payload is not copied but replaced by zeros."""
    return payload.to_bytes() if len(payload) <= LARGEST_FRAME else bytes(LARGEST_FRAME + 1)


def attached_time(attachment: zenoh.ZBytes | None) -> int | None:
    """Return the time in an attachment, in ns; None if it contains none."""
    return None if attachment is None else time_in(payload_bytes(attachment))


class ServiceQueue:
    """Queue of the requests of all services of one bus."""

    def __init__(self) -> None:
        self.rejected: dict[str, int] = {}
        self.last_rejection = ""

        self._waiting: SimpleQueue[tuple[ServiceRequest, Handler] | None] = SimpleQueue()
        self._replies: SimpleQueue[Reply | None] = SimpleQueue()
        self._open: list[ServiceRequest] = []
        self._threads: dict[str, threading.Thread] = {}
        self._closed = False

    def put(self, request: ServiceRequest, handler: Handler) -> None:
        """Enqueue a request, or drop it if the queue is full; called by the bus."""
        if self._waiting.qsize() < MAX_WAITING:
            self._waiting.put((request, handler))
        else:
            self._count(request.service)
            request.drop()

    def send(self, reply: Reply) -> None:
        """Enqueue a reply and return at once; drop it if the queue is full."""
        if self._replies.qsize() < MAX_REPLIES:
            self._replies.put(reply)

    def start(self) -> None:
        """Start the threads, and restart those that have ended; may be called at any time."""
        for name, work in (("requests", self._take_requests), ("replies", self._send_replies)):
            thread = self._threads.get(name)
            if not self._closed and (thread is None or not thread.is_alive()):
                thread = threading.Thread(target=work, name=name, daemon=True)
                self._threads[name] = thread
                thread.start()

    def close(self) -> None:
        """Stop taking requests and drop the unanswered ones."""
        self._closed = True
        self._waiting.put(None)
        self._replies.put(None)
        for thread in self._threads.values():
            if thread is not threading.current_thread():
                thread.join(timeout=1.0)
        for request in self._open:
            request.drop()

    def _take_requests(self) -> None:
        while (item := self._waiting.get()) is not None:
            request, handler = item
            self._open = [other for other in self._open if other.open]
            self._open.append(request)
            self._handle(request, handler)

    def _send_replies(self) -> None:
        while (reply := self._replies.get()) is not None:
            try:
                send_now(reply)
            except zenoh.ZError:
                continue  # the client has gone, or it used a key that is not served
            except Exception:  # a defect of one service must not end the others
                LOG.exception("a reply on %s could not be sent", reply.key)

    def _handle(self, request: ServiceRequest, handler: Handler) -> None:
        try:
            request.read()
        except RemoteError as error:
            self._count(request.service)
            self.last_rejection = str(error)
            request.reply(refusal(Reason.MALFORMED))
            return
        try:
            handler(request)
        except Exception:
            LOG.exception("the handler of %s failed", request.key)
            request.reply(refusal(Reason.NONE, result=AckResult.FAILED))

    def _count(self, service: Service) -> None:
        self.rejected[service.path] = self.rejected.get(service.path, 0) + 1


def send_now(reply: Reply) -> None:
    """Encode and send a reply. May block while its client is slow."""
    raw = isinstance(reply.answer, bytes)
    payload = (
        reply.answer if isinstance(reply.answer, bytes) else reply.encoder.encode(reply.answer)
    )
    with reply.query:
        reply.query.reply(reply.key, payload, encoding=JSON if raw else ENCODING)


def refusal(reason: int, command: int = 0, result: AckResult = AckResult.DENIED) -> CommandAck:
    """Return a COMMAND_ACK that denies a request with a reason."""
    return CommandAck(command=command, result=result, result_param2=reason)
