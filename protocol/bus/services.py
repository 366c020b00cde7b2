"""Both sides of the services: a request with a deadline on the robot's clock, and its answer.

On the server's side one thread decodes requests and another sends the replies. Zenoh's receive
thread only enqueues, and no caller of `reply` waits for a slow client. A malformed request is
counted and denied with a reason.
"""

import logging
import threading
from collections.abc import Callable, Generator
from itertools import count
from queue import SimpleQueue
from typing import Any, Final, NamedTuple, TypeVar

import zenoh

from protocol.bus.callbacks import zenoh_callback
from protocol.bus.mailbox import Sample, foreign, opened
from protocol.bus.network import Network
from protocol.bus.publisher import PRIORITIES
from protocol.bus.rights import denial, unanswered
from protocol.bus.robot_clock import RobotClocks, time_bytes, time_in
from protocol.bus.session import LastingSession
from protocol.topics import (
    CLOCK_SERVICE,
    ENCODING,
    ENCODING_FAMILY,
    Role,
    Service,
    operator_in,
    sender_of,
)
from protocol.wire.codec import LARGEST_FRAME, Encoder, decode
from protocol.wire.enums import AckResult
from protocol.wire.message import Message
from protocol.wire.messages import CommandAck, MissionVerdict, Timesync
from protocol.wire.reasons import Reason
from runtime.errors import NoAnswerError, RemoteError
from runtime.units import NS_PER_S

T = TypeVar("T")
CLOCK_S: Final = 0.5
SHORTEST_S: Final = 0.01


class ServiceQuery(NamedTuple):
    """A query of a robot's service. `timeout_s` is the time for its answer.

    `deadline` is the robot's time until which the robot may act on it, as bytes; None if it does
    not expire. `patience_s` is the timeout of the whole request.
    """

    service: Service
    robot: str
    frame: bytes | None
    deadline: bytes | None
    timeout_s: float
    patience_s: float


Steps = Generator[ServiceQuery, Message | bytes, T]
"""Queries, one after the other: it gets the answer to each, or the error, and returns a result."""


class Requester:
    """Query services for one process; `operator` is the end of the keys of an operator's requests.

    `holder` is the common name of this process's certificate, None on an open bus.
    """

    def __init__(
        self,
        session: LastingSession,
        network: Network,
        role: Role | None,
        operator: str | None,
        holder: str | None,
        now_ns: Callable[[], int],
    ) -> None:
        self.clocks = RobotClocks(now_ns, lambda robot: self.run(self._measuring(robot)))
        self._session = session
        self._network = network
        self._role = role
        self._operator = operator
        self._holder = holder
        self._now_ns = now_ns

    def steps(
        self, service: Service, message: Message | None, timeout_s: float, robot: str
    ) -> Steps[Message | bytes]:
        """Yield the queries of a request, each to be sent at once, and return its answer.

        An operator's request expires after `timeout_s`. The robot's clock is queried first if it is
        unknown, and again if the robot refuses the request as too late.
        """
        deadline_ns = self._now_ns() + round(timeout_s * NS_PER_S)
        if not (self._operator and service.of_operators and service.requests and service.expires):
            return (yield self._query(service, message, timeout_s, robot))
        if self.clocks.time_ns(robot) is None:
            yield from self._measuring(robot, timeout_s)
        answer = yield self._query(service, message, self._left_s(deadline_ns), robot, timeout_s)
        if refused_as_late(answer) and self._now_ns() < deadline_ns:
            self.clocks.of(robot).forget()
            yield from self._measuring(robot, self._left_s(deadline_ns))
            left_s = self._left_s(deadline_ns)
            answer = yield self._query(service, message, left_s, robot, timeout_s)
        return answer

    def run(self, steps: Steps[T]) -> T:
        """Send each query and wait for its answer; return the result, or raise the error."""
        try:
            query = next(steps)
            while True:
                try:
                    answer = self._put(query)
                except (RemoteError, zenoh.ZError) as error:
                    query = steps.throw(error)
                else:
                    query = steps.send(answer)
        except StopIteration as end:
            result: T = end.value
            return result

    def send(
        self, query: ServiceQuery, done: Callable[[Message | bytes | Exception], object]
    ) -> None:
        """Send a query, and call `done` once, with its answer or with the error.

        Does not wait for a slow link: a query that it does not accept is dropped, and times out.
        The call comes from a thread of Zenoh, or before this returns.
        """
        outcomes = count()

        def settle(outcome: Message | bytes | Exception) -> None:
            if next(outcomes) == 0:
                done(outcome)

        def take(reply: zenoh.Reply) -> None:
            try:
                answer = self._answer(query, reply)
            except RemoteError as error:
                settle(error)
            else:
                settle(answer)

        callback = zenoh_callback(take, lambda: settle(self._unserved(query)))
        try:
            self._get(query, callback, congestion_control=zenoh.CongestionControl.DROP)
        except (RemoteError, zenoh.ZError) as error:
            settle(error)

    def _put(self, query: ServiceQuery) -> Message | bytes:
        """Send a query and return its answer."""
        for reply in self._get(query):
            return self._answer(query, reply)
        raise self._unserved(query)

    def _left_s(self, deadline_ns: int) -> float:
        return max(SHORTEST_S, (deadline_ns - self._now_ns()) / NS_PER_S)

    def _query(
        self,
        service: Service,
        message: Message | None,
        timeout_s: float,
        robot: str,
        patience_s: float | None = None,
    ) -> ServiceQuery:
        """Return a query, with a deadline if the robot's clock is known."""
        frame = deadline = None
        if message is not None:
            frame = Encoder(*sender_of(self._role, robot)).encode(message)
        if service.of_operators and self._operator:
            time_ns = self.clocks.time_ns(robot)
            if time_ns is not None:
                deadline = time_bytes(time_ns + round(timeout_s * NS_PER_S))
        return ServiceQuery(service, robot, frame, deadline, timeout_s, patience_s or timeout_s)

    def _get(self, query: ServiceQuery, *handler: Any, **options: Any) -> Any:
        """Send a query on the present session."""
        session: Any = self._session.now
        key = self._key(query)
        is_operators = query.service.of_operators and self._operator
        try:
            return session.get(
                f"{key}/{self._operator}" if is_operators else key,
                *handler,
                payload=query.frame,
                encoding=None if query.frame is None else ENCODING,
                timeout=query.timeout_s,
                attachment=query.deadline,
                priority=PRIORITIES[query.service.priority],
                **options,
            )
        except zenoh.ZError as error:
            if session is self._session.now:
                raise
            raise NoAnswerError(f"{key}: a fresh session has replaced the one before") from error

    def _key(self, query: ServiceQuery) -> str:
        return f"{self._network.prefix}/{query.robot}/{query.service.path}"

    def _answer(self, query: ServiceQuery, reply: zenoh.Reply) -> Message | bytes:
        """Return the answer in a reply; NoAnswerError for none in time, or another version."""
        if reply.ok is not None:
            return answer_in(reply.ok)
        late = f"no answer within {query.patience_s:.2g} s"
        why = denial(self._holder, query.robot, query.service) or late
        raise NoAnswerError(f"{self._key(query)}: {why}")

    def _unserved(self, query: ServiceQuery) -> NoAnswerError:
        """Return the error for a query without a reply."""
        why = unanswered(self._holder, query.robot, query.service)
        return NoAnswerError(f"{self._key(query)}: {why}")

    def _measuring(self, robot: str, timeout_s: float = CLOCK_S) -> Steps[bool]:
        """Query a robot's time; return False if it does not answer."""
        asked_ns = self._now_ns()
        question = Timesync(tc1=0, ts1=asked_ns)
        try:
            answer = yield self._query(CLOCK_SERVICE, question, timeout_s, robot)
        except (RemoteError, zenoh.ZError):
            return False
        if isinstance(answer, Timesync) and answer.ts1 == asked_ns:
            self.clocks.of(robot).observe(asked_ns, answer.tc1, self._now_ns())
            return True
        return False


def refused_as_late(answer: Message | bytes) -> bool:
    """Return whether a robot refused a request because it arrived too late."""
    if isinstance(answer, CommandAck):
        return answer.result_param2 == Reason.TOO_LATE
    return isinstance(answer, MissionVerdict) and answer.reason == Reason.TOO_LATE


def answer_in(sample: zenoh.Sample) -> Message | bytes:
    """Return a message or the bytes of a JSON text; NoAnswerError for another version."""
    encoding = str(sample.encoding)
    if not encoding.startswith(ENCODING_FAMILY):
        return sample.payload.to_bytes()
    if encoding != ENCODING:
        raise NoAnswerError(f"{sample.key_expr}: {foreign(encoding)}")
    return decode(sample.payload.to_bytes()).message


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
