"""Late-join support: publishers cache recent events; subscribers fetch those they missed.

Uses Zenoh's advanced publishers and subscribers, with the keys `KEY/@adv/...` beside each key. A
subscriber can distinguish fetched samples from live ones, and knows when they were published.
"""

import logging
import time
from collections.abc import Callable
from threading import Lock, Thread
from typing import Any, Final, TypeAlias

import zenoh
from zenoh import ext
from zenoh.handlers import Callback

LOG = logging.getLogger(__name__)
Take: TypeAlias = Callable[[zenoh.Sample], None]
Source: TypeAlias = tuple[str, int]
"""A sender: its session id, and its number in that session."""

BEAT_S: Final = 0.5
"""Period at which a sender publishes its sequence number; the last lost event before a pause is
detected after at most this time."""

LIVE: Final = zenoh.CongestionControl.DROP
FETCHED: Final = zenoh.CongestionControl.BLOCK
"""The congestion control of a sample distinguishes live from fetched ones on arrival. A reply has
that of its query, and advanced subscribers query with BLOCK. `congestion` decides how replies are
really sent."""

FETCH_S: Final = 2.0
FETCHES: Final = 16
"""Fetches at the same time; limits the threads that a forger of senders can cause."""
MAX_WAITING: Final = 1000
"""Samples of one sender that wait until its earlier ones are fetched; further ones are dropped."""

SOURCES: Final = 1000
"""Senders whose beginning is fetched; for further ones Zenoh alone fetches."""


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


def fetching_subscriber(session: zenoh.Session, key: str, newest: int, take: Take) -> Any:
    """Return a subscriber that also fetches cached samples, each once, in the sender's order."""
    late_join = LateJoin(lambda source: fetched(session, key, newest, source), take)
    return ext.declare_advanced_subscriber(
        session,
        key,
        Callback(late_join.receive, indirect=False),
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=newest),
        recovery=ext.RecoveryConfig(periodic_queries=None, heartbeat=True),
    )


class LateJoin:
    """Deliver the samples of each sender from the first one on.

    Zenoh 1.10 fetches twice from a sender that it detects. If the first live sample arrives between
    the two answers, Zenoh drops what it has fetched. If the first sample received from a sender is
    not its first one, delivery therefore waits until the earlier samples are fetched.
    """

    def __init__(self, fetch: Callable[[Source], list[zenoh.Sample]], take: Take) -> None:
        self._fetch, self._take = fetch, take
        self._lock = Lock()
        self._known: set[Source] = set()
        self._waiting: dict[Source, list[zenoh.Sample]] = {}

    def receive(self, sample: zenoh.Sample) -> None:
        """Take a sample from the bus; called for one sample after the other."""
        source = source_of(sample)
        with self._lock:
            if source in self._waiting:
                if len(self._waiting[source]) < MAX_WAITING:
                    self._waiting[source].append(sample)
            elif source is not None and self._lacks(source, sample):
                self._waiting[source] = [sample]
                Thread(target=self._complete, args=(source, number_of(sample)), daemon=True).start()
            else:
                self._take(sample)

    def _lacks(self, source: Source, sample: zenoh.Sample) -> bool:
        """Return whether this is the first sample of its sender, is live, and had predecessors."""
        if source in self._known or len(self._known) >= SOURCES:
            return False
        self._known.add(source)
        live = sample.congestion_control != FETCHED
        return live and number_of(sample) > 0 and len(self._waiting) < FETCHES

    def _complete(self, source: Source, first: int) -> None:
        """Fetch the earlier samples; deliver the waiting ones in any case."""
        before: list[zenoh.Sample] = []
        try:
            before = [sample for sample in self._fetch(source) if number_of(sample) < first]
        except Exception:
            LOG.exception("the cached samples of a sender could not be fetched")
        with self._lock:
            for sample in (*sorted(before, key=number_of), *self._waiting.pop(source)):
                self._take(sample)


def source_of(sample: zenoh.Sample) -> Source | None:
    """Return the sender of a sample; None if its publisher does not cache."""
    info = sample.source_info
    return None if info is None else (str(info.source_id.zid), info.source_id.eid)


def number_of(sample: zenoh.Sample) -> int:
    """Return the sequence number of a sample at its sender, from 0."""
    info = sample.source_info
    return 0 if info is None else info.source_sn


def fetched(session: zenoh.Session, key: str, newest: int, source: Source) -> list[zenoh.Sample]:
    """Return the samples that a sender has cached; nothing if it no longer answers."""
    zid, number = source
    try:
        replies = session.get(
            f"{key}/@adv/pub/{zid}/{number}/**?_max={newest}",
            timeout=FETCH_S,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
        )
        return [reply.ok for reply in replies if reply.ok is not None]
    except zenoh.ZError:  # the session was closed
        return []


def was_fetched(sample: zenoh.Sample) -> bool:
    """Return whether a sample comes from the cache of its sender."""
    return bool(sample.congestion_control == FETCHED)


def published_ns(sample: zenoh.Sample, now_ns: int) -> int:
    """Return when a sample was published: now, or earlier if it was fetched.

    The age of a fetched sample is as accurate as the UTC clocks of both machines.
    """
    if not was_fetched(sample) or sample.timestamp is None:
        return now_ns
    age_ns = time.time_ns() - sample.timestamp.get_time_as_ntp64().as_nanos()
    return now_ns - max(0, age_ns)
