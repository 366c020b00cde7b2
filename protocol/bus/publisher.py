"""Publisher of one topic: one key, one sender, one sequence counter, and recent events kept.

Who subscribes late fetches the events that it missed. Publishers are Zenoh's advanced ones. Each
numbers its samples, and announces itself and the number of its newest one on
`KEY/@adv/pub/SESSION/NUMBER/_`, where it also answers with cached samples. Subscribers are our own:
Zenoh's advanced ones declare `KEY/@adv/**`. Whoever may declare that may declare every pattern
below it, and to match one with many `**` takes exponential time and memory.
"""

import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from threading import Lock, Timer
from typing import Any, Final, Generic, NamedTuple, TypeAlias, TypeVar

import zenoh
from zenoh import ext

from protocol.bus.callbacks import zenoh_callback
from protocol.bus.rights import kept_by
from protocol.bus.robot_clock import is_again, marked_again, time_bytes
from protocol.bus.session import Declared, LastingSession
from protocol.topics import ENCODING, Priority, Topic
from protocol.wire.codec import Encoder
from protocol.wire.message import Message
from runtime.errors import LocalError

Take: TypeAlias = Callable[[zenoh.Sample], None]
Source: TypeAlias = tuple[str, int]
"""A sender: its session id, and its number in that session."""

Got: TypeAlias = Callable[[list[zenoh.Sample]], None]
"""Receives what a sender has cached, once."""

BEAT_S: Final = 0.5
"""Period at which a sender publishes its sequence number; the last lost event before a pause is
detected after at most this time."""

LIVE: Final = zenoh.CongestionControl.DROP
FETCHED: Final = zenoh.CongestionControl.BLOCK
"""The congestion control of a sample distinguishes live from fetched ones on arrival. A reply has
that of its query. `congestion` decides how replies are really sent."""

FETCH_S: Final = 2.0
ASKING_S: Final = 30.0
"""Time for which a sender that does not answer is asked again, because its link may be broken."""

FETCHES: Final = 16
"""Fetches at the same time; limits the queries and the memory that a forger can cause."""

MAX_WAITING: Final = 1000
"""Samples of one sender that wait until its earlier ones are fetched; further ones are dropped."""

MAX_DIGITS: Final = 10
SOURCES: Final = 1000
"""Senders whose missed samples are fetched; those of further ones are delivered as they come."""


def caching_publisher(
    session: zenoh.Session, key: str, newest: int, **service: Any
) -> "ext.AdvancedPublisher":
    """Return a publisher that caches its `newest` samples for late joiners."""
    return ext.declare_advanced_publisher(
        session,
        key,
        congestion_control=LIVE,
        cache=ext.CacheConfig(newest),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=BEAT_S, sporadic_heartbeat=None),
        publisher_detection=True,
        **service,
    )


class PublishedEvent(NamedTuple):
    """An event as it was put, with its UTC time, which no other event of the bus has."""

    frame: bytes
    note: bytes | None
    stamp: Any

    def put_by(self, publisher: Any) -> None:
        """Put the event, once more perhaps."""
        publisher.put(self.frame, attachment=self.note, timestamp=self.stamp)

    def put_again_by(self, publisher: Any) -> None:
        """Put an event of an earlier session."""
        publisher.put(self.frame, attachment=marked_again(self.note), timestamp=self.stamp)


class CachingPublishers:
    """The publishers of one topic with a history, one after the other: that of each session.

    Events that were put while the link was broken are in the cache of a session, and are lost with
    it when a fresh one replaces it. So the fresh one begins with them: a receiver has them in order
    before the next ones, and those that it has received already it knows by their UTC times.
    """

    def __init__(self, key: str, newest: int, **service: Any) -> None:
        self.events: deque[PublishedEvent] = deque(maxlen=newest)
        self._key, self._service = key, service

    def declare(self, session: zenoh.Session) -> Any:
        """Return the publisher on a session, which is fresh if there are events already."""
        newest = self.events.maxlen or 0
        publisher = caching_publisher(session, self._key, newest, **self._service)
        for event in tuple(self.events):
            event.put_again_by(publisher)
        return publisher


class Subscriptions(NamedTuple):
    """The subscriptions to a key with a history."""

    samples: Any
    beats: Any
    senders: Any

    def undeclare(self) -> None:
        """End all of them."""
        for one in self:
            one.undeclare()


def fetching_subscriber(
    session: LastingSession, key: str, newest: int, take: Take
) -> Declared[Subscriptions]:
    """Return a subscriber that also fetches cached samples, each once, in the sender's order."""
    keys: dict[Source, str] = {}
    """The key of each sender: an operator serves its own key, not that of all operators."""

    def ask(source: Source, due: int, got: Got) -> None:
        fetch(session, keys.get(source, key), newest, source, due, got)

    late_join = LateJoin(ask, each_once(take, newest))

    def receive(sample: zenoh.Sample) -> None:
        source = source_of(sample)
        if source is not None and source not in keys and len(keys) < SOURCES:
            keys[source] = str(sample.key_expr)
        late_join.receive(sample)

    def found(sample: zenoh.Sample) -> None:
        place = str(sample.key_expr)
        source = source_in(place)
        if source is not None and sample.kind == zenoh.SampleKind.PUT:
            if source in keys or len(keys) < SOURCES:
                keys[source] = place.partition("/@adv/")[0]
            newest_bytes = sample.payload.to_bytes()[:4]
            late_join.announced(source, int.from_bytes(newest_bytes, "little"))

    def declare(one: zenoh.Session) -> Subscriptions:
        return Subscriptions(
            one.declare_subscriber(key, zenoh_callback(receive)),
            one.declare_subscriber(kept_by(key), zenoh_callback(found)),
            one.liveliness().declare_subscriber(kept_by(key), zenoh_callback(found), history=True),
        )

    return session.declare(declare)


def each_once(take: Take, newest: int) -> Take:
    """Return `take` for events, which may come again from the archive of a fresh session."""
    known: dict[str, None] = {}
    """The times of as many events as two sessions cache, the oldest first."""

    def take_new(sample: zenoh.Sample) -> None:
        stamp = str(sample.timestamp)
        if sample.timestamp is not None and stamp in known:
            return
        known[stamp] = None
        if len(known) > 2 * newest:
            del known[next(iter(known))]
        take(sample)

    return take_new


class ArrivedSamples:
    """What has arrived of one sender: `due` is the number of the next sample to deliver."""

    __slots__ = ("due", "fetching", "waiting")

    def __init__(self) -> None:
        self.due = 0
        self.fetching = False
        self.waiting: dict[int, zenoh.Sample] = {}


class LateJoin:
    """Deliver the samples of each sender from the first one on, each once and in order.

    `fetch` requests the samples of a sender from a number on. Later ones wait for the answer. What
    the sender no longer has, or does not answer for long, is left out.
    """

    def __init__(self, fetch: Callable[[Source, int, Got], None], take: Take) -> None:
        self._fetch, self._take = fetch, take
        self._lock = Lock()
        self._senders: dict[Source, ArrivedSamples] = {}
        self._fetches = 0

    def receive(self, sample: zenoh.Sample) -> None:
        """Take a live sample; those of a sender come one after the other."""
        source, number = source_of(sample), number_of(sample)
        with self._lock:
            sender = None if source is None else self._known(source)
            if source is None or sender is None:
                self._take(sample)
                return
            if number >= sender.due and len(sender.waiting) < MAX_WAITING:
                sender.waiting.setdefault(number, sample)
            self._deliver(sender)
            if not sender.waiting or sender.fetching:
                return
            if not self._may_fetch(sender):
                self._deliver(sender, gaps=True)
                return
        self._begin(source, sender)

    def announced(self, source: Source, newest: int) -> None:
        """Note that a sender has samples up to the number `newest`."""
        with self._lock:
            sender = self._known(source)
            if sender is None or sender.fetching or newest < sender.due:
                return
            if not self._may_fetch(sender):
                return  # it is announced again
        self._begin(source, sender)

    def _known(self, source: Source) -> ArrivedSamples | None:
        if source not in self._senders and len(self._senders) < SOURCES:
            self._senders[source] = ArrivedSamples()
        return self._senders.get(source)

    def _may_fetch(self, sender: ArrivedSamples) -> bool:
        if self._fetches >= FETCHES:
            return False
        self._fetches += 1
        sender.fetching = True
        return True

    def _begin(self, source: Source, sender: ArrivedSamples) -> None:
        """Fetch; without the lock, because a sender in this process answers at once."""
        self._fetch(source, sender.due, partial(self._complete, source, sender))

    def _complete(self, source: Source, sender: ArrivedSamples, got: list[zenoh.Sample]) -> None:
        """Deliver what was fetched, and what has arrived meanwhile."""
        with self._lock:
            new = {
                number_of(one): one
                for one in got
                if source_of(one) == source and number_of(one) >= sender.due
            }
            if new:
                sender.due = min(new)
                sender.waiting = new | sender.waiting
                self._deliver(sender)
            if not new or not sender.waiting:
                self._deliver(sender, gaps=True)
                sender.fetching = False
                self._fetches -= 1
                return
        self._begin(source, sender)  # a sample was lost while the others were fetched

    def _deliver(self, sender: ArrivedSamples, *, gaps: bool = False) -> None:
        """Deliver the waiting samples up to the first gap, or all."""
        while sender.waiting:
            number = min(sender.waiting) if gaps else sender.due
            sample = sender.waiting.pop(number, None)
            if sample is None:
                return
            sender.due = number + 1
            self._take(sample)


def fetch(
    session: LastingSession, key: str, newest: int, source: Source, due: int, got: Got
) -> None:
    """Query the samples that a sender has cached from the number `due` on.

    It has some, so an empty result is no answer: its link, or ours, has broken meanwhile.
    """
    zid, number = source
    samples: list[zenoh.Sample] = []
    until_s = time.monotonic() + ASKING_S

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None and len(samples) < newest:
            samples.append(reply.ok)

    def end() -> None:
        if samples or time.monotonic() >= until_s or session.now.is_closed():
            got(samples)
        else:
            again = Timer(BEAT_S, ask)
            again.daemon = True
            again.start()

    def ask() -> None:
        with suppress(zenoh.ZError):  # the session was closed, and `end` was called
            session.now.get(
                f"{key}/@adv/pub/{zid}/{number}/_?_sn={due}..;_max={newest}",
                zenoh_callback(take, end),
                timeout=FETCH_S,
                consolidation=zenoh.ConsolidationMode.NONE,
                accept_replies=zenoh.ReplyKeyExpr.ANY,
                congestion_control=FETCHED,
            )

    ask()


def source_in(key: str) -> Source | None:
    """Return the sender that announces itself on a key; None for any other key."""
    zid, number = key.split("/")[-3:-1]
    return (zid, int(number)) if number.isdecimal() and len(number) <= MAX_DIGITS else None


def source_of(sample: zenoh.Sample) -> Source | None:
    """Return the sender of a sample; None if its publisher does not cache."""
    info = sample.source_info
    return None if info is None else (str(info.source_id.zid), info.source_id.eid)


def number_of(sample: zenoh.Sample) -> int:
    """Return the sequence number of a sample at its sender, from 0."""
    info = sample.source_info
    return 0 if info is None else info.source_sn


def was_fetched(sample: zenoh.Sample) -> bool:
    """Return whether a sample comes from the cache of its sender, or of its earlier session."""
    if sample.congestion_control == FETCHED:
        return True
    return sample.attachment is not None and is_again(sample.attachment.to_bytes())


def published_ns(sample: zenoh.Sample, now_ns: int) -> int:
    """Return when a sample was published: now, or earlier if it was fetched.

    The age of a fetched sample is as accurate as the UTC clocks of both machines.
    """
    if not was_fetched(sample) or sample.timestamp is None:
        return now_ns
    age_ns = time.time_ns() - sample.timestamp.get_time_as_ntp64().as_nanos()
    return now_ns - max(0, age_ns)


M = TypeVar("M", bound=Message)

PRIORITIES: Final = {
    Priority.REAL_TIME: zenoh.Priority.REAL_TIME,
    Priority.DATA_HIGH: zenoh.Priority.DATA_HIGH,
    Priority.DATA: zenoh.Priority.DATA,
    Priority.DATA_LOW: zenoh.Priority.DATA_LOW,
}


class Matching:
    """Whether a publisher has a subscriber, as `status[0]`, which Zenoh keeps up to date.

    To ask it in every tick costs more than to put a sample: Zenoh locks its tables, and lets other
    threads have the interpreter.
    """

    def __init__(self, publisher: zenoh.Publisher) -> None:
        self.status = status = [False]

        def take(now: zenoh.MatchingStatus) -> None:
            status[0] = bool(now.matching)

        self._listener = publisher.declare_matching_listener(zenoh_callback(take))


class Publisher(Generic[M]):
    """Publish messages of one topic on its key.

    `time_ns` returns the robot's time, None while it is unknown: samples of an operator carry this
    sending time. Samples of a topic with a history also carry their UTC time.
    """

    def __init__(
        self,
        session: LastingSession,
        topic: Topic[M],
        key: str,
        encoder: Encoder,
        time_ns: Callable[[], int | None] | None = None,
    ) -> None:
        self.topic = topic
        self.key = key
        self._encoder = encoder
        self._time_ns = time_ns
        self._session = session
        # Express loses samples under load; BLOCK can block a loop for seconds. Neither is used.
        service: dict[str, Any] = {
            "encoding": ENCODING,
            "priority": PRIORITIES[topic.priority],
            "express": False,
            "reliability": zenoh.Reliability.RELIABLE,
        }
        plain = session.declare(
            lambda one: one.declare_publisher(key, congestion_control=LIVE, **service)
        )
        # An advanced publisher has no matching status.
        self._matching = session.declare(lambda _: Matching(plain.now))
        self._publisher: Declared[Any] = plain
        self._events: deque[PublishedEvent] | None = None
        if topic.history:
            caching = CachingPublishers(key, topic.history, **service)
            self._events = caching.events
            self._publisher = session.declare(caching.declare)

    def put(self, message: M) -> bytes:
        """Send a message and return its frame; LocalError if it fits neither topic nor wire."""
        frame = self.frame(message)
        self.put_frame(frame)
        return frame

    def frame(self, message: M) -> bytes:
        """Return the next frame of this key for `put_frame`; LocalError as for `put`."""
        if type(message) not in self.topic.messages:
            raise LocalError(f"{type(message).__name__} does not belong on {self.key}")
        return self._encoder.encode(message)

    def put_frame(self, frame: bytes) -> None:
        """Send a frame unchanged: prepared by `frame`, replayed, or malformed on purpose."""
        event = self._event(frame)
        while True:
            publisher = self._publisher.now
            try:
                if event is None:
                    publisher.put(frame)
                else:
                    event.put_by(publisher)
                if self._events is None:
                    return
            except zenoh.ZError:
                if publisher is self._publisher.now:
                    raise
            if publisher is self._publisher.now:
                return
            # A fresh session has replaced the one before, perhaps without this event.

    def _event(self, frame: bytes) -> PublishedEvent | None:
        """Return a frame with what is sent besides it; None for the plain frame of a stream."""
        if self._events is None and self._time_ns is None:
            return None
        stamp = None if self._events is None else self._session.now.new_timestamp()
        event = PublishedEvent(frame, self._sent(), stamp)
        if self._events is not None:
            self._events.append(event)
        return event

    def _sent(self) -> bytes | None:
        time_ns = None if self._time_ns is None else self._time_ns()
        return None if time_ns is None else time_bytes(time_ns)

    @property
    def ready(self) -> bool:
        """Return whether there is a subscriber and, for an operator, the robot's time is known."""
        return self.matched and (self._time_ns is None or self._time_ns() is not None)

    @property
    def matched(self) -> bool:
        """Return whether there is a subscriber.

        Samples put before are lost unless the topic has a history.
        """
        return self._matching.now.status[0]
